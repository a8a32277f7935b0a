"""The page at `/` in a browser: check.py PROGRAM AXE, where PROGRAM is the built slipdrive and AXE is axe.min.js.

Needs PyPI's playwright and Debian's chromium (another one by CHROMIUM). Prints a line per check and the figures that it
measures; ends at the first check that fails, with a picture of the page in `page.png` of the folder for temporary files.
"""

import json
import os
import statistics
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import editing
import plans
from playwright.sync_api import Browser, Page, expect, sync_playwright
from service import Service
from visit import LONG, PROGRAM, Visit, accessible, fragment_of, says_what_was_answered, shown

# What the page may load before anything is clicked; the types and examples of the API are in it.
MOST_BYTES, MOST_REQUESTS = 300_000, 32
FIRST_PICTURE_S = 3.0
SCRUB_TARGET_MS = 16
HOSTILE = "<img src=x onerror=alert(1)> ' \" $(touch /tmp/hostile) `id` \\"


def forward_drive_by_clicks(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service)
    loaded = [each for each in visit.requests if each.startswith("GET")]
    size = sum(bytes_of(service, each.split(" ")[1]) for each in loaded)
    assert size <= MOST_BYTES and len(loaded) <= MOST_REQUESTS, (size, len(loaded))
    begin = time.monotonic()
    answer = visit.solve()
    picture = time.monotonic() - begin - answer["report"]["solve_time_s"]
    assert picture <= FIRST_PICTURE_S, picture
    assert answer["status"] == "converged" and abs(answer["final_time_s"] - 2.930) < 5e-4
    says_what_was_answered(visit, answer)
    assert sum("/present" in each for each in visit.requests) == 1
    print(f"        {size} bytes in {len(loaded)} requests; first picture {picture:.2f} s after the answer")
    visit.close()


def bytes_of(service: Service, url: str) -> int:
    with urllib.request.urlopen(url) as answer:
        return len(answer.read())


def goal_is_dragged(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service)
    page = visit.page
    before = float(page.input_value("#maneuver-goal-y_m"))
    box = page.locator("#handle-goal .touch").bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 120, y + 30, steps=4)
    page.mouse.up()
    after = float(page.input_value("#maneuver-goal-y_m"))
    assert after < before - 0.2 and float(page.input_value("#maneuver-goal-x_m")) > 0.05, after
    knob = page.locator("#handle-goal .knob").bounding_box()
    assert knob
    page.mouse.move(knob["x"] + 12, knob["y"] + 12)
    page.mouse.down()
    page.mouse.move(knob["x"] + 12, knob["y"] - 60, steps=4)
    page.mouse.up()
    assert float(page.input_value("#maneuver-goal-heading_rad")) > 0.2
    answer = visit.solve()
    assert abs(answer["end_state"]["y_m"] - after) < 1e-3
    says_what_was_answered(visit, answer)
    visit.close()


def keyboard_alone(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service)
    page = visit.page

    def reach(selector: str, key: str = "Tab") -> None:
        for _ in range(120):
            page.keyboard.press(key)
            if page.evaluate("selector => document.activeElement.matches(selector)", selector):
                return
        raise AssertionError(f"{key} never comes to {selector}")

    reach("#solve")
    reach("#handle-goal")
    for key in ("ArrowLeft", "ArrowLeft", "Shift+ArrowDown", "["):
        page.keyboard.press(key)
    assert abs(float(page.input_value("#maneuver-goal-y_m")) - 4.8) < 1e-9
    assert abs(float(page.input_value("#maneuver-goal-x_m")) - 0.01) < 1e-9
    assert float(page.input_value("#maneuver-goal-heading_rad")) > 0.2
    page.keyboard.press("]")
    reach("#solve", "Shift+Tab")
    page.keyboard.press("Enter")
    answer = visit.answered()
    expect(page.locator("#figures figure").first).to_be_visible(timeout=20_000)
    says_what_was_answered(visit, answer)
    reach("#play")
    page.keyboard.press("Enter")
    expect(page.locator("#play")).to_have_text("Pause")
    page.keyboard.press("Enter")
    reach("#scrub")
    page.keyboard.press("End")
    assert shown(visit, "time").startswith(f"{answer['final_time_s']:.3f} s")
    visit.close()


def scrubbing(browser: Browser, service: Service) -> None:
    request = {"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 2000}, "solver": {"starts": 1}}
    visit = Visit(browser, service, fragment_of(request))
    answer = visit.solve()
    times = visit.page.evaluate("""async () => {
      const scrub = document.querySelector("#scrub");
      const times = [];
      for (let index = 0; index <= 200; index += 1) {
        scrub.value = String((Number(scrub.max) * index) / 200);
        const begin = performance.now();
        scrub.dispatchEvent(new Event("input"));
        times.push(performance.now() - begin);
        await new Promise(requestAnimationFrame);
      }
      return times;
    }""")
    slow = statistics.quantiles(times, n=20)[-1]
    print(f"        scrub handler at 2,000 steps: p95 {slow:.1f} ms (target {SCRUB_TARGET_MS} ms)")
    assert slow < 20 * SCRUB_TARGET_MS
    # All cursors are at the end now.
    ends = visit.page.evaluate("[...document.querySelectorAll('#figures .cursor')].map(line => line.getAttribute('x1'))")
    assert len(ends) > 20 and len(set(ends)) <= 6, ends
    assert shown(visit, "time").startswith(f"{answer['final_time_s']:.3f} s of")
    visit.page.locator("#figures figure svg").nth(2).click(position={"x": 200, "y": 130})
    assert not shown(visit, "time").startswith(f"{answer['final_time_s']:.3f} s of")
    assert sum("/present" in each for each in visit.requests) == 1
    visit.close()


def cancelling(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service, fragment_of(LONG))
    visit.page.click("#solve")
    expect(visit.page.locator("#status")).to_contain_text("start", timeout=30_000)
    assert service.busy() >= 1
    visit.page.click("#cancel")
    expect(visit.page.locator("#status")).to_have_text("Cancelled.")
    service.wait_until(lambda: service.busy() == 0, "the worker is free")
    visit.page.select_option("#preset", "forward-drive")
    visit.solve()
    visit.close()


def another_search_takes_over(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service, fragment_of(LONG))
    visit.page.click("#solve")
    expect(visit.page.locator("#status")).to_contain_text("start", timeout=30_000)
    visit.page.select_option("#preset", "forward-drive")
    visit.solve()
    expect(visit.page.locator("#status")).to_have_text("Answered: converged, 2.930 s.")
    expect(visit.page.locator("#cancel")).to_be_hidden()
    service.wait_until(lambda: service.busy() == 0, "the worker is free")
    visit.close()


def faults_of_fields(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service)
    page = visit.page
    page.click("summary:text-is('Robot')")
    page.fill("#robot-chassis_mass_kg", "-3")
    page.fill("#robot-wheel_radius_m", "9e9")
    page.click("#solve")
    expect(page.locator("#robot-chassis_mass_kg-error")).to_contain_text("-3, must be between")
    expect(page.locator("#robot-wheel_radius_m-error")).to_contain_text("must be between")
    expect(page.locator("#problem")).to_contain_text("break their rules")
    accessible(visit, "faults")
    page.click("#problem li >> nth=0 >> button")
    assert page.evaluate("document.activeElement.id") in ("robot-chassis_mass_kg", "robot-wheel_radius_m")
    page.fill("#robot-wheel_radius_m", "six")
    asked = len(visit.requests)
    page.click("#solve")
    expect(page.locator("#robot-wheel_radius_m-error")).to_contain_text("must be a number")
    assert len(visit.requests) == asked, "what cannot be read is not sent"
    page.fill("#robot-wheel_radius_m", "0.06")
    expect(page.locator("#problem")).to_contain_text("-3, must be between")
    page.fill("#robot-chassis_mass_kg", "3")
    expect(page.locator("#problem")).to_be_hidden()
    visit.close()


def sheet(page: Page, button: str, title: str) -> str:
    """What a button shows to take away; closes an earlier one."""
    if page.locator("#sheet").is_visible():
        page.click("#sheet-close")
    page.click(f"#{button}")
    expect(page.locator("#sheet-title")).to_contain_text(title)
    return page.input_value("#sheet-text")


def links_and_snippets(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service, fragment_of({"maneuver": {"goal": {"x_m": 1.5, "y_m": 2}}, "solver": {"starts": 1}}))
    page = visit.page
    assert (page.input_value("#maneuver-goal-x_m"), page.input_value("#solver-starts")) == ("1.5", "1")
    assert not any("/solve" in each for each in visit.requests), "a link solves nothing by itself"
    link = sheet(page, "link", "A link")
    accessible(visit, "sheet")
    curl, python = sheet(page, "curl", "The same in a shell"), sheet(page, "python", "The same in Python")
    assert curl.startswith("curl -s 'http://127.0.0.1:") and '"Authorization: Bearer $SLIPDRIVE_API_KEY"' in curl
    compile(python, "snippet.py", "exec")
    answer = json.loads(os.popen(curl).read())
    assert answer["status"] == "converged"
    visit.close()
    again = Visit(browser, service, "#" + link.partition("#")[2])
    assert again.page.input_value("#maneuver-goal-x_m") == "1.5"
    again.close()


def hostile_strings(browser: Browser, service: Service) -> None:
    hostile = {"maneuver": {"slip": HOSTILE, "goal": {"x_m": HOSTILE, "free": [HOSTILE]}, HOSTILE: 1}, "robot": {"chassis_mass_kg": HOSTILE}}
    visit = Visit(browser, service, fragment_of(hostile))
    page = visit.page
    page.click("#solve")
    expect(page.locator("#problem")).to_be_visible()
    page.click("#curl")
    expect(page.locator("#problem")).to_be_visible()
    for fragment in ("#request=%7B", "#request=5", "#request=%ZZ", "#request=" + urllib.request.quote(json.dumps([HOSTILE]))):
        page.evaluate("fragment => { location.hash = fragment; }", fragment)
        expect(page.locator("#problem")).to_contain_text("The link cannot be opened")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"{HOSTILE.replace('/', '')}.json"[:80])
        answer = {"status": HOSTILE, "final_time_s": 1, "reason": {"message": HOSTILE}, "report": {}, "torque_schedule": {}}
        for content in ("no JSON", "[]", json.dumps({"solve": {"request": hostile, "answer": answer}}), json.dumps(hostile)):
            file.write_text(content)
            page.set_input_files("#open", file)
            page.wait_for_timeout(200)
    assert page.locator("img").count() == 0 and not Path("/tmp/hostile").exists()
    visit.close()


def documents(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service)
    page = visit.page
    answer = visit.solve()
    with tempfile.TemporaryDirectory() as folder:
        for button, name in (("save", "plan.json"), ("csv", "plan.csv"), ("report", "report.html")):
            with page.expect_download() as download:
                page.click(f"#{button}")
            download.value.save_as(Path(folder, name))
        saved = json.loads(Path(folder, "plan.json").read_text())
        assert saved["solve"]["answer"] == answer
        rows = Path(folder, "plan.csv").read_text().splitlines()
        assert len(rows) == answer["report"]["steps"] + 2 and rows[0].startswith("time_s,x_m")
        report_is_whole(browser, Path(folder, "report.html"), answer)
        page.select_option("#preset", "half-turn")
        page.set_input_files("#open", Path(folder, "plan.json"))
        expect(page.locator("#final-time")).to_have_text(f"{answer['final_time_s']:.4f} s")
        assert page.input_value("#maneuver-goal-y_m") == "5"
        page.fill("#maneuver-goal-y_m", "4")
        expect(page.locator("#stale")).to_be_visible()
        visit.solve()
        page.set_input_files("#compare", Path(folder, "plan.json"))
        expect(page.locator("#words")).to_contain_text("B. The robot reaches its goal in 2.930 s, which no replay in finer steps confirms.")
        accessible(visit, "two plans")
        page.click("#alone")
        expect(page.locator("#words")).not_to_contain_text("B. ")
    visit.close()


def report_is_whole(browser: Browser, report: Path, answer: dict) -> None:
    context = browser.new_context(offline=True)
    page = context.new_page()
    faults: list[str] = []
    page.on("console", lambda said: faults.append(said.text))
    page.on("request", lambda request: None if request.url.startswith("file:") else faults.append(request.url))
    page.goto(report.as_uri())
    assert f"in {answer['final_time_s']:.3f} s" in page.inner_text("h2 >> nth=0")
    assert f"{1000 * answer['report']['replay']['miss_m']:.3g} mm" in page.inner_text("main")
    assert page.locator("figure svg").count() == 7
    quoted = json.loads(page.locator("details pre").nth(1).text_content() or "")
    assert quoted["final_time_s"] == answer["final_time_s"] and quoted["torque_schedule"] == answer["torque_schedule"]
    assert not faults, faults
    context.close()


def infeasible_in_words(browser: Browser, service: Service) -> None:
    visit = Visit(browser, service, fragment_of({"maneuver": {"goal": {"y_m": 5}, "torque_limit_left_n_m": 0, "torque_limit_right_n_m": 0}}))
    answer = visit.solve()
    assert answer["status"] == "infeasible"
    assert answer["reason"]["message"].replace("`", "").rstrip(".") in shown(visit, "words")
    expect(visit.page.locator("#play")).to_be_disabled()
    visit.close()


def with_a_key(browser: Browser) -> None:
    with Service(PROGRAM, keys="secret") as service:
        visit = Visit(browser, service)
        visit.page.click("#solve")
        expect(visit.page.locator("#problem")).to_contain_text("asks for an API key")
        visit.page.fill("#key", "secret")
        says_what_was_answered(visit, visit.solve())
        stored = visit.page.evaluate("() => localStorage.length + sessionStorage.length + document.cookie.length")
        assert stored == 0 and "secret" not in visit.page.url
        visit.close()


def full_and_gone(browser: Browser) -> None:
    with Service(PROGRAM, "--workers", "1", "--queue-length", "1") as service:
        blockers = [threading.Thread(target=service.try_to_solve, args=(LONG,), daemon=True) for _ in range(2)]
        for blocker in blockers:
            blocker.start()
        service.wait_until(lambda: service.metric("slipdrive_queue_depth") >= 1, "the queue is full")
        visit = Visit(browser, service)
        visit.page.click("#solve")
        expect(visit.page.locator("#problem")).to_contain_text("The service is busy")
        expect(visit.page.locator("#problem")).to_contain_text("Try again in")
        visit.close()
    with Service(PROGRAM) as service:
        visit = Visit(browser, service, fragment_of(LONG))
        visit.page.click("#solve")
        expect(visit.page.locator("#status")).to_contain_text("start", timeout=30_000)
        service.kill()
        expect(visit.page.locator("#problem")).to_contain_text("connection to the service was lost")
        expect(visit.page.locator("#solve")).to_be_visible()
        visit.close()


def everyone(browser: Browser, service: Service) -> None:
    looks = [{"color_scheme": "light"}, {"color_scheme": "dark"}, {"viewport": {"width": 320, "height": 700}}]
    for look in looks:
        visit = Visit(browser, service, **look)
        accessible(visit, f"{look} at first")
        visit.solve()
        visit.page.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
        accessible(visit, f"{look} with an answer")
        across = visit.page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert across <= 0, f"{look}: the page is {across} px wider than the window"
        visit.close()


def still_or_moving(browser: Browser, service: Service) -> None:
    for setting, word in (("reduce", "Play"), ("no-preference", "Pause")):
        visit = Visit(browser, service, reduced_motion=setting)
        visit.solve()
        expect(visit.page.locator("#play")).to_have_text(word)
        visit.close()


def pictures_beside_solves() -> None:
    """Figures of 2,000 steps while all workers solve."""
    with Service(PROGRAM, "--workers", "2") as service:
        request = {"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 2000}, "solver": {"starts": 1}, "view": "plan"}
        body = {"plans": [{"solve": {"request": request, "answer": service.post("/solve", request)}}]}
        for _ in range(2):
            threading.Thread(target=service.try_to_solve, args=(LONG,), daemon=True).start()
        service.wait_until(lambda: service.busy() >= 2, "all workers solve")
        times = []
        for _ in range(40):
            begin = time.monotonic()
            service.post("/present", body)
            times.append(1000 * (time.monotonic() - begin))
        print(f"        present at 2,000 steps, all workers solving: p95 {statistics.quantiles(times, n=20)[-1]:.0f} ms (target 150 ms)")


@contextmanager
def reporting(name: str, browser: Browser) -> Iterator[None]:
    begin = time.monotonic()
    try:
        yield
    except BaseException:
        pages = [page for context in browser.contexts for page in context.pages]
        if pages:
            pages[-1].screenshot(path=Path(tempfile.gettempdir(), "page.png"), full_page=True)
        print(f"FAILED  {name}", flush=True)
        raise
    print(f"ok      {name} ({time.monotonic() - begin:.0f} s)", flush=True)


def main() -> None:
    of_service: list[Callable[[Browser, Service], None]] = [
        forward_drive_by_clicks, goal_is_dragged, keyboard_alone, scrubbing, cancelling, another_search_takes_over,
        faults_of_fields, links_and_snippets, hostile_strings, documents, infeasible_in_words, everyone, still_or_moving,
        *plans.CHECKS, *editing.CHECKS,
    ]  # fmt: skip
    wanted = sys.argv[3:]
    with sync_playwright() as playwright:
        chromium = os.environ.get("CHROMIUM", "/usr/bin/chromium")
        # Containers have no user namespaces for its sandbox.
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        with Service(PROGRAM) as service:
            for check in of_service:
                if not wanted or check.__name__ in wanted:
                    with reporting(check.__name__, browser):
                        check(browser, service)
        for check in (with_a_key, full_and_gone):
            if not wanted or check.__name__ in wanted:
                with reporting(check.__name__, browser):
                    check(browser)
        if not wanted or "pictures_beside_solves" in wanted:
            with reporting("pictures_beside_solves", browser):
                pictures_beside_solves()
        browser.close()


main()
