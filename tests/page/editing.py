"""Checks of what is typed into the form, and of start and goal on the floor."""

from playwright.sync_api import Browser, expect
from service import Service
from visit import Visit, accessible, fragment_of


def faulty_text_stays(browser: Browser, service: Service) -> None:
    """What cannot be read is neither replaced nor left out of what is solved, until the value comes from elsewhere."""
    visit = Visit(browser, service, fragment_of({"maneuver": {"goal": {"y_m": 5}}}))
    page = visit.page
    goal, fault = page.locator("#maneuver-goal-y_m"), page.locator("#maneuver-goal-y_m-error")
    goal.press("Control+a")
    page.keyboard.type("2,5")
    page.fill("#maneuver-goal-heading_rad", "0")
    asked = len(visit.requests)
    page.click("#solve")
    expect(goal).to_have_value("2,5")
    expect(fault).to_contain_text("must be a number with a decimal point")
    expect(goal).to_be_focused()
    assert len(visit.requests) == asked, "another maneuver is solved"
    page.press("#handle-goal", "ArrowRight")
    expect(goal).to_have_value("2.1")
    expect(fault).to_be_hidden()
    # Where the value stays, the box that frees it takes it back too, and so does another preset.
    page.click("summary:text-is('Velocities and wheel angles')")
    speed, fault = page.locator("#maneuver-goal-velocity_x_m_s"), page.locator("#maneuver-goal-velocity_x_m_s-error")
    speed.fill("fast")
    page.check("#free-velocity_x_m_s")
    expect(speed).to_have_value("")
    expect(fault).to_be_hidden()
    page.uncheck("#free-velocity_x_m_s")
    speed.fill("fast")
    page.select_option("#preset", "half-turn")
    expect(speed).to_have_value("0")
    expect(fault).to_be_hidden()
    visit.close()


def wheel_angle_is_typed_again(browser: Browser, service: Service) -> None:
    """It is free where it is empty, and the field keeps the keyboard."""
    visit = Visit(browser, service)
    page = visit.page
    page.click("summary:text-is('Velocities and wheel angles')")
    page.uncheck("#free-wheel_angle_left_rad")
    page.press("#maneuver-goal-wheel_angle_left_rad", "Control+a")
    page.keyboard.press("Delete")
    expect(page.locator("#free-wheel_angle_left_rad")).to_be_checked()
    page.keyboard.type("1.5")
    expect(page.locator("#maneuver-goal-wheel_angle_left_rad")).to_have_value("1.5")
    expect(page.locator("#free-wheel_angle_left_rad")).not_to_be_checked()
    visit.close()


def what_is_typed_outlives_the_api(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service)
    page = visit.page
    page.fill("#maneuver-goal-y_m", "3")
    with visit.context.expect_page():
        page.click("a:text-is('API')")
    expect(page.locator("#maneuver-goal-y_m")).to_have_value("3")
    visit.close()


def what_is_typed_outlives_a_reload(browser: Browser, service: Service) -> None:
    """A link that is opened anew still fills the form."""
    visit = Visit(browser, service, fragment_of({"maneuver": {"goal": {"y_m": 7}}}))
    page = visit.page
    goal = page.locator("#maneuver-goal-y_m")
    expect(goal).to_have_value("7")
    goal.fill("3")
    page.reload()
    expect(goal).to_have_value("3")
    page.goto("about:blank")
    page.go_back()
    expect(goal).to_have_value("3")
    page.goto("about:blank")
    page.goto(f"{service.url}/{fragment_of({'maneuver': {'goal': {'y_m': 7}}})}")
    expect(goal).to_have_value("7")
    visit.close()


def a_preset_leaves_a_way_back(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service)
    page = visit.page
    expect(page.locator("#preset")).to_have_value("forward-drive")
    expect(page.locator("#preset option:not([hidden])")).to_have_count(3)
    page.fill("#maneuver-goal-y_m", "3.21")
    expect(page.locator("#preset")).to_have_value("As typed")
    page.select_option("#preset", "half-turn")
    expect(page.locator("#maneuver-goal-y_m")).not_to_have_value("3.21")
    page.select_option("#preset", "As typed")
    expect(page.locator("#maneuver-goal-y_m")).to_have_value("3.21")
    visit.close()


def enter_solves(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service)
    with visit.page.expect_response("**/solve"):
        visit.page.press("#maneuver-goal-y_m", "Enter")
    expect(visit.page.locator("#figures figure").first).to_be_visible(timeout=20_000)
    visit.close()


def only_what_moves_changes(browser: Browser, service: Service) -> None:
    """A key rounds no coordinate beside the one that it moves, and a press that moves nothing changes nothing."""
    visit = Visit(browser, service, fragment_of({"maneuver": {"goal": {"y_m": 2.3456, "heading_rad": 0.12345}}, "solver": {"starts": 1}}))
    page = visit.page

    def value(name: str) -> str:
        return page.input_value(f"#maneuver-goal-{name}")

    visit.solve()
    page.click("#handle-goal .touch", force=True)
    expect(page.locator("#stale")).to_be_hidden()
    page.press("#handle-goal", "[")
    assert (value("x_m"), value("y_m"), value("heading_rad")) == ("", "2.3456", "0.3852")
    page.press("#handle-goal", "ArrowUp")
    assert (value("x_m"), value("y_m")) == ("-0.1", "2.3456")
    page.press("#handle-goal", "ArrowRight")
    assert (value("x_m"), value("y_m")) == ("-0.1", "2.45")
    visit.close()


def narrow_search_is_widened(browser: Browser, service: Service) -> None:
    """What the preset of the paper's case brings, another goal need not keep."""
    narrow = {"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 200}, "solver": {"starts": 1, "time_limit_s": 2}}
    visit = Visit(browser, service, fragment_of(narrow))
    page = visit.page
    answer = visit.solve()
    assert not answer["replay_confirmed"]
    expect(page.locator("#narrow")).to_contain_text("One start was asked for")
    expect(page.locator("#narrow")).to_contain_text("200 steps were asked for")
    accessible(visit, "a narrow search")
    page.click("#widen")
    wider = visit.answered()
    assert wider["final_time_s"] < answer["final_time_s"] and wider["report"]["starts_tried"] > 1, wider["report"]
    expect(page.locator("#narrow")).to_be_hidden()
    assert (page.input_value("#solver-starts"), page.input_value("#solver-time_limit_s")) == ("", "2")
    expect(page.locator("#stale")).to_be_hidden()
    visit.close()


def handle_that_is_held_stays(browser: Browser, service: Service) -> None:
    """Also while the robot is followed, which moves the view."""
    visit = Visit(browser, service, fragment_of({"maneuver": {"goal": {"y_m": 1}}, "solver": {"starts": 1}}))
    page = visit.page
    visit.solve()
    page.check("#follow")
    box = page.locator("#handle-start .touch").bounding_box()
    assert box
    page.mouse.move(box["x"] + 14, box["y"] + 14)
    page.mouse.down()
    to_the_middle = "scrub => { scrub.value = scrub.max / 2; scrub.dispatchEvent(new Event('input')); }"
    page.eval_on_selector("#scrub", to_the_middle)
    assert page.locator("#handle-start .touch").bounding_box() == box
    page.mouse.move(box["x"] + 15, box["y"] + 14)
    page.mouse.up()
    start = float(page.input_value("#maneuver-start-y_m") or 0)
    assert abs(start) < 0.05, f"the start follows the robot to {start} m"
    assert page.locator("#handle-start .touch").bounding_box() != box, "the view follows again"
    visit.close()


def solve_is_at_hand(browser: Browser, service: Service) -> None:
    """On a phone, with the longest form, and what is refused comes before the eyes."""
    visit = Visit(browser, service, viewport={"width": 360, "height": 740})
    page = visit.page
    page.evaluate("document.querySelectorAll('#fields details').forEach(each => { each.open = true; })")
    for field in ("#maneuver-goal-y_m", "#robot-track_width_m"):
        page.focus(field)
        expect(page.locator("#solve")).to_be_in_viewport(ratio=1)
    page.fill("#robot-track_width_m", "-1")
    page.keyboard.press("Enter")
    expect(page.locator("#problem")).to_be_in_viewport(ratio=1)
    visit.close()


CHECKS = [
    faulty_text_stays, wheel_angle_is_typed_again, what_is_typed_outlives_the_api,
    what_is_typed_outlives_a_reload, a_preset_leaves_a_way_back, enter_solves, only_what_moves_changes, narrow_search_is_widened,
    handle_that_is_held_stays, solve_is_at_hand,
]  # fmt: skip
