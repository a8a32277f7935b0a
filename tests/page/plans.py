"""Checks of plans on the page: their numbers, side by side, and from files."""

import csv
import json
import math
import re
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, Download, expect
from service import Service
from visit import LONG, Visit, fragment_of, says_what_was_answered, shown


def torques_are_those_of_steps(browser: Browser, service: Service) -> None:
    """Of 100 steps over 40 intervals every fifth has its middle on a boundary, and belongs to the later interval."""
    request = {"maneuver": {"goal": {"y_m": 1.37}}, "grid": {"steps": 100, "control_intervals": 40}, "solver": {"starts": 1}}
    visit = Visit(browser, service, fragment_of(request))
    page = visit.page
    schedule = visit.solve()["torque_schedule"]
    with tempfile.TemporaryDirectory() as folder:
        with page.expect_download() as download:
            page.click("#csv")
        download.value.save_as(Path(folder, "plan.csv"))
        rows = list(csv.DictReader(Path(folder, "plan.csv").read_text().splitlines()))
    for side in ("left", "right"):
        torques = [schedule[f"{side}_n_m"][(2 * step + 1) * 40 // 200] for step in range(100)]
        assert [float(row[f"torque_{side}_n_m"]) for row in rows[:-1]] == torques, side
    visit.close()


def aisle_is_left_by_a_distance(browser: Browser, service: Service) -> None:
    """The plan that the finer grid takes out of the aisle says how far, in metres and not as a share of the robot."""
    aisle = [{"x_m": x, "y_m": y} for x, y in ((-0.3, -0.5), (0.9, -0.5), (0.9, 3.4), (-0.3, 3.4))]
    footprint = [{"right_m": x, "forward_m": y} for x, y in ((-0.2, -0.1), (0.2, -0.1), (0.2, 0.35), (-0.2, 0.35))]
    request = {
        "maneuver": {"goal": {"x_m": 0.6, "y_m": 3}, "keep_in": aisle},
        "robot": {"footprint": footprint},
        "grid": {"steps": 100},
        "solver": {"starts": 1},
    }
    visit = Visit(browser, service, fragment_of(request))
    answer = visit.solve()
    simulation = {"robot": request["robot"], "torque_schedule": answer["torque_schedule"], "keep_in": aisle, "grid": {"steps": 1600}}
    outside_m = service.post("/simulate", simulation)["limits"][0]["largest"]
    assert outside_m > 0.1
    assert f"outside the aisle by {1000 * outside_m:.3g} mm" in shown(visit, "replay-miss")
    visit.close()


def shorter_plan_ends(browser: Browser, service: Service) -> None:
    """Beside a longer one: where it is over, no numbers, forces and slip of its last step go on."""
    visit = Visit(browser, service, fragment_of({"maneuver": {"goal": {"y_m": 1}}, "solver": {"starts": 1}}))
    page = visit.page
    end_s = visit.solve()["final_time_s"]
    longer = {"maneuver": {"goal": {"y_m": 5}}, "solver": {"starts": 1}}
    open_file(visit, "compare", {"solve": {"request": longer, "answer": service.post("/solve", longer)}})
    expect(page.locator("#words")).to_contain_text("B. ")
    page.press("#scrub", "End")
    assert shown(visit, "moment").split("\n") == ["This plan", f"ended at {end_s:.3f} s"]
    forces = [page.get_attribute(".robot.plan-a .force >> nth=0", "d"), page.get_attribute(".robot.plan-b .force >> nth=0", "d")]
    assert forces[0] == "" and forces[1], forces
    assert page.locator(".robot.plan-a .slips").count() == 0
    page.press("#scrub", "Home")
    assert "Speed" in shown(visit, "moment") and page.get_attribute(".robot.plan-a .force >> nth=0", "d")
    visit.close()


def opened_plan_stays(browser: Browser, service: Service) -> None:
    """A search that runs meanwhile ends without an answer."""
    request = {"maneuver": {"goal": {"y_m": 1}}, "solver": {"starts": 1}}
    answer = service.post("/solve", request)
    visit = Visit(browser, service, fragment_of(LONG))
    visit.page.click("#solve")
    expect(visit.page.locator("#status")).to_contain_text("start", timeout=30_000)
    open_file(visit, "open", {"solve": {"request": request, "answer": answer}})
    expect(visit.page.locator("#final-time")).to_have_text(f"{answer['final_time_s']:.4f} s")
    expect(visit.page.locator("#status")).to_have_text("Cancelled.")
    service.wait_until(lambda: service.busy() == 0, "the worker is free")
    visit.close()


def damaged_plans(browser: Browser, service: Service) -> None:
    """Contact modes without a contact are made again, and of an answer to another request no number is shown."""
    request = {"maneuver": {"goal": {"y_m": 1}}, "solver": {"starts": 1}}
    answer = service.post("/solve", request)
    visit = Visit(browser, service)
    page = visit.page
    spans = [{"start_s": 0, "end_s": answer["final_time_s"], "left": "slip"}]
    open_file(visit, "open", {"solve": {"request": request, "answer": {**answer, "contact_modes": spans}}})
    expect(page.locator("#final-time")).to_have_text(f"{answer['final_time_s']:.4f} s")
    expect(page.locator("#figures figure").first).to_be_visible()
    says_what_was_answered(visit, answer)
    open_file(visit, "open", {"solve": {"request": {"maneuver": {"goal": {"y_m": 2}}}, "answer": answer}})
    expect(page.locator("#headline")).to_have_text("The answer does not belong to its request.")
    expect(page.locator("#facts")).to_be_empty()
    visit.close()


def files_for_a_controller(browser: Browser, service: Service) -> None:
    """As `export` makes them, and what the twist alone would miss."""
    visit = Visit(browser, service, fragment_of({"maneuver": {"goal": {"y_m": 2}}, "solver": {"starts": 1}}))
    page = visit.page
    end_s = visit.solve()["final_time_s"]
    page.fill("#rate", "20")
    with page.expect_download() as download:
        page.click("text=Export")
    rows = list(csv.DictReader(Path(download.value.path()).read_text().splitlines()))
    assert download.value.suggested_filename == "trajectory.csv"
    assert (len(rows), float(rows[-1]["time_s"])) == (math.floor(20 * end_s) + 2, end_s), rows[-1]
    expect(page.locator("#handed-over")).to_have_text(re.compile(r"^trajectory\.csv: .* ends [\d.]+ mm and [\de.-]+ rad off\.$"))
    page.select_option("#format", "ros2_mcap")
    downloads: list[Download] = []
    page.on("download", lambda download: downloads.append(download))
    page.click("text=Export")
    service.wait_until(lambda: page.evaluate("true") and len(downloads) == 2, "both files of a bag come")
    bag = {each.suggested_filename: Path(each.path()).read_bytes() for each in downloads}
    assert bag["plan.mcap"].startswith(b"\x89MCAP0\r\n") and b"rosbag2" in bag["metadata.yaml"], bag.keys()
    page.fill("#rate", "10000")
    page.click("text=Export")
    expect(page.locator("#problem")).to_contain_text("rate_hz")
    visit.close()


def open_file(visit: Visit, button: str, content: object) -> None:
    visit.page.set_input_files(f"#{button}", {"name": "plan.json", "mimeType": "application/json", "buffer": json.dumps(content).encode()})


CHECKS = [torques_are_those_of_steps, aisle_is_left_by_a_distance, shorter_plan_ends, opened_plan_stays, damaged_plans,
          files_for_a_controller]  # fmt: skip
