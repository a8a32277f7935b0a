"""Checks of plans on the page: their numbers, side by side, and from files."""

import csv
import tempfile
from pathlib import Path

from playwright.sync_api import Browser
from service import Service
from visit import Visit, fragment_of


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
