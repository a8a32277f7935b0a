"""Cases of the benchmark suite (`benches/maneuvers`) as bodies of solve requests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

SUITE = Path(__file__).resolve().parents[1] / "maneuvers"
# The paper's grid, on which the suite's best-known plans were found.
GRID = {"steps": 200, "control_intervals": 40}


def request_of_case(name: str) -> dict[str, Any]:
    """The body of a case by its name, such as `reference/forward-5m`; raises KeyError for an unknown one."""
    robot = read_suite("robots.json")[name.split("/")[0]]
    maneuvers = {case["name"]: case["maneuver"] for case in read_suite("cases.json")}
    maneuver = robot.get("maneuver", {}) | maneuvers[name]
    return {"robot": robot["robot"], "maneuver": maneuver, "grid": GRID}


def request_of(source: str) -> dict[str, Any]:
    """The body in a file, or of a case of the suite."""
    path = Path(source)
    return json.loads(path.read_text()) if path.suffix == ".json" else request_of_case(source)


def read_suite(file: str) -> Any:
    """A file of the suite."""
    return json.loads((SUITE / file).read_text())
