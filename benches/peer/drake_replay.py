#!/usr/bin/env python3
"""Replays plans that keep off their grip in Drake, on a floor with a little less friction: the wheels should not slip.

The torques of a plan are applied open loop to the robot of `drake_robot.py`. By hand only: `pip install drake==1.51.1`.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drake_robot import Discretisation, DrakeRobot
from maneuver import robot_from_wire
from program import ask
from suite import read_suite

# Grip that the plans may use, and the share of the friction coefficient that Drake's floor has.
GRIP_UTILIZATION = 0.9
FRICTION_SHARE = 0.95
# Largest slip of a wheel that passes, m/s.
SLIP_TOLERANCE = 1e-3
TIME_STEP = 1e-4
# The robot comes to rest on its contacts before the torques begin, s.
SETTLING_TIME = 0.3

# Robot of the suite, goal, and limits beside the grip.
PLANS: tuple[tuple[str, dict[str, Any], dict[str, float]], ...] = (
    ("reference", {"x_m": 0.0, "y_m": 5.0}, {}),
    ("reference", {"x_m": 1.0, "y_m": 2.0}, {}),
    ("reference", {"heading_rad": math.pi / 2.0}, {}),
    ("reference", {"x_m": 0.0, "y_m": -2.0}, {}),
    ("warehouse", {"x_m": 0.0, "y_m": 5.0}, {"speed_m_s": 1.5}),
    ("warehouse", {"x_m": -1.0, "y_m": 2.0}, {}),
    ("slippery", {"x_m": 0.0, "y_m": 3.0}, {}),
    ("grippy", {"x_m": 1.0, "y_m": 1.0, "heading_rad": -math.pi / 2.0}, {}),
    ("offset", {"x_m": 0.0, "y_m": 3.0}, {}),
    ("tall", {"x_m": 0.0, "y_m": 3.0}, {"speed_m_s": 1.5}),
)


@dataclass(frozen=True)
class Replay:
    """What Drake says of a plan.

    `slip_m_s`: largest speed of a wheel's contact point, left and right, and `slip_time_s` when. `miss_m`, `miss_rad`:
    where the replay ends against the goal, open loop on a floor that is not the plan's.
    """

    slip_m_s: float
    slip_time_s: float
    miss_m: float
    miss_rad: float


def drive(drake: DrakeRobot, schedule: dict[str, Any]) -> tuple[float, float]:
    """Settles and drives; the largest slip (m/s) and when (s)."""
    drake.simulator.Initialize()
    drake.simulator.AdvanceTo(SETTLING_TIME)
    interval, left, right = schedule["interval_s"], schedule["left_n_m"], schedule["right_n_m"]
    largest, when, applied = 0.0, 0.0, -1
    for step in range(round(interval * len(left) / TIME_STEP)):
        current = min(int((step + 0.5) * TIME_STEP / interval), len(left) - 1)
        if current != applied:
            drake.apply(left[current], right[current])
            applied = current
        time = (step + 1) * TIME_STEP
        drake.simulator.AdvanceTo(SETTLING_TIME + time)
        slip = drake.slip()
        if slip > largest:
            largest, when = slip, time
    return largest, when


COLUMNS = (
    f"{'robot':10} {'goal':40}{'t_f s':>8}{'status':>11}{'steps':>7}{'grip':>8}"
    f"{'slip m/s':>10}{'at s':>7}{'miss m':>9}{'miss rad':>10}"
)
LEGEND = (
    "grip: largest share that the plan uses on its replay, which is finer.\n"
    f"slip: largest of a wheel's contact point in Drake, passes up to {SLIP_TOLERANCE:g} m/s.\n"
    "miss: end of Drake's motion against the plan's, open loop."
)


def request_of_plan(name: str, goal: dict[str, Any], limits: dict[str, float]) -> dict[str, Any]:
    """The body of a solve request: slipdrive chooses the grid."""
    of_robot = read_suite("robots.json")[name]
    limits = limits | {"grip_utilization": GRIP_UTILIZATION}
    maneuver = of_robot.get("maneuver", {}) | {"goal": goal, "limits": limits}
    return {"robot": of_robot["robot"], "maneuver": maneuver, "solver": {"starts": 1, "time_limit_s": 60.0}}


def replay(request: dict[str, Any], answer: dict[str, Any], approximation: str) -> Replay:
    """Drives a plan in Drake."""
    robot = robot_from_wire(request["robot"])
    robot = replace(robot, wheel_friction_coefficient=FRICTION_SHARE * robot.wheel_friction_coefficient)
    drake = DrakeRobot(robot, Discretisation(TIME_STEP, approximation=approximation))
    begin, begin_heading = drake.pose()
    slip, when = drive(drake, answer["torque_schedule"])
    end, end_heading = drake.pose()
    moved, planned = end - begin, answer["end_state"]
    return Replay(
        slip,
        when,
        math.hypot(moved[0] - planned["x_m"], moved[1] - planned["y_m"]),
        abs(math.remainder(end_heading - begin_heading - planned["heading_rad"], math.tau)),
    )


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slipdrive", type=Path, required=True, help="the binary")
    parser.add_argument("plans", nargs="*", type=int, help="which of the plans, from 0; default: all")
    parser.add_argument("--approximation", choices=("lagged", "tamsi"), default="lagged", help="of Drake's contacts")
    return parser.parse_args()


def main() -> int:
    """Exit code 0, or 1 if some plan slips."""
    asked = arguments()
    print(COLUMNS, flush=True)
    passed = True
    for name, goal, limits in [PLANS[index] for index in asked.plans] or PLANS:
        request = request_of_plan(name, goal, limits)
        answer = ask(asked.slipdrive, "solve", request)
        driven = replay(request, answer, asked.approximation)
        passed = passed and driven.slip_m_s <= SLIP_TOLERANCE
        used = {limit["limit"]: limit for limit in answer["report"]["limits"]}["maneuver.limits.grip_utilization"]
        replayed = used["value"] * (1.0 + used["replay_excess"]) if used["replay_excess"] is not None else math.nan
        where = ", ".join(f"{field} {value:.3g}" for field, value in goal.items())
        print(
            f"{name:10} {where:40}{answer['final_time_s']:8.4f}{answer['status']:>11}{answer['report']['steps']:7}"
            f"{replayed:8.4f}{driven.slip_m_s:10.1e}{driven.slip_time_s:7.3f}{driven.miss_m:9.1e}{driven.miss_rad:10.1e}",
            flush=True,
        )
    print(LEGEND)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
