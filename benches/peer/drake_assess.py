#!/usr/bin/env python3
"""Rolls the samples of an assessment out in Drake: do both agree on which samples succeed, and on where they end?

    pip install drake==1.51.1 -r benches/peer/requirements.txt
    python benches/peer/drake_assess.py --slipdrive target/release/slipdrive

`slipdrive assess` draws 300 robots, torques and starts for a plan, and the tolerance is the median of their distances
from the goal. The same numbers are drawn here again (`samples.py`), checked against the sample that the answer states.
Each sample is assessed by itself for its end, and driven in Drake (`drake_robot.py`), with two lengths of step. By hand
only: a plan takes about ten minutes of two cores.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import Any

from drake_robot import Discretisation, DrakeRobot
from maneuver import robot_from_wire
from mechanics import Robot
from program import ask
from samples import Changes, check_drawn, drawn

SAMPLES = 300
SEED = 17
# What is not known: a weighed robot on a floor that was measured once.
UNCERTAIN: tuple[dict[str, Any], ...] = (
    {"parameter": "friction", "low": -0.1, "high": 0.1},
    {"parameter": "mass", "low": -0.05, "high": 0.05},
    {"parameter": "center_of_mass_right", "mean": 0.0, "standard_deviation": 0.001},
    {"parameter": "center_of_mass_forward", "mean": 0.0, "standard_deviation": 0.005},
    {"parameter": "torque_left", "mean": 0.0, "standard_deviation": 0.003},
    {"parameter": "torque_right", "mean": 0.0, "standard_deviation": 0.003},
    {"parameter": "start_heading", "mean": 0.0, "standard_deviation": 0.005},
)
FORWARD = {"y_m": 5.0}
# From rest at the origin straight ahead: the end of the axle midpoint is then compared with this way from its start.
PLANS: dict[str, dict[str, Any]] = {
    "grip 0.9": {"maneuver": {"goal": FORWARD, "limits": {"grip_utilization": 0.9}}, "solver": {"starts": 1}},
    "drifting": {"maneuver": {"goal": FORWARD}},
    "drifting, 200 steps": {"maneuver": {"goal": FORWARD}, "grid": {"steps": 200}},
}
# The other one is to show what a coarse grid of slipdrive costs.
PLANS_ASKED = ("grip 0.9", "drifting")
# Longest step in Drake, s; half of it is the judge.
TIME_STEP = 8e-4
# Of Drake's friction, m/s: ten times as much makes ends depend on the step by some millimetres.
STICTION_TOLERANCE = 1e-5
# The robot comes to rest on its contacts before the torques begin, s.
SETTLING_TIME = 0.3
# Ends nearer to each other than this are the same, m.
NEAR = 0.01
# Most steps of a rollout.
STEP_LIMIT = 10_000
# Drake agrees with at least these shares of verdicts and of ends, %.
LEAST_SAME = 90.0
LEAST_NEAR = 95.0
# The tolerance with which the median of the distances is found, m, and its place among the quantiles.
FIRST_TOLERANCE = 0.1
MEDIAN = 2


@dataclass(frozen=True)
class End:
    """Where the axle midpoint ends: from the goal ahead and to the left (m), and the error of the heading (rad)."""

    along: float
    left: float
    heading: float

    @property
    def distance(self) -> float:
        """From the goal, m."""
        return math.hypot(self.along, self.left)

    def apart(self, other: End) -> float:
        """From another end, m."""
        return math.hypot(self.along - other.along, self.left - other.left)


# --- The samples of slipdrive ---------------------------------------------------------------------------------------


def assess(
    slipdrive: Path, plan: dict[str, Any], tolerance: float, uncertain: Any = UNCERTAIN, samples: int = SAMPLES
) -> dict[str, Any]:
    """The assessment of a plan with a tolerance of the distance (m)."""
    asked = {"uncertain": uncertain, "tolerances": {"distance_m": tolerance}, "samples": samples, "seed": SEED}
    return ask(slipdrive, "assess", {"solve": plan} | asked)


def end_of_sample(slipdrive: Path, plan: dict[str, Any], tolerance: float, changes: Changes) -> dict[str, Any]:
    """A sample: the only one, and so the worst, of an assessment in which nothing but its changes is possible."""
    exactly = [{"parameter": name, "low": change, "high": change} for name, change in changes.items()]
    answer = assess(slipdrive, plan, tolerance, exactly, 1)
    if answer["refused"] + answer["separations"] > 0:
        raise RuntimeError(f"outside the model under {changes}: take narrower bands")
    return answer["worst"]


def end_of(sample: dict[str, Any]) -> End:
    """The end of a sample by its errors."""
    errors = sample["errors"]
    return End(errors["along_m"], errors["across_m"], errors["heading_rad"])


def end_on_finer_grid(slipdrive: Path, factor: int, sample: dict[str, Any]) -> End:
    """The end of the same motion in more steps."""
    motion = sample["simulate"]
    grid = motion["grid"] | {"steps": factor * motion["grid"]["steps"]}
    begin, end = motion["start"], ask(slipdrive, "simulate", motion | {"grid": grid})["end_state"]
    return End(end["y_m"] - begin["y_m"] - FORWARD["y_m"], begin["x_m"] - end["x_m"], end["heading_rad"])


# --- The same in Drake ----------------------------------------------------------------------------------------------


def changed_robot(robot: Robot, changes: Changes) -> Robot:
    """The robot of a sample."""
    return replace(
        robot,
        wheel_friction_coefficient=robot.wheel_friction_coefficient * (1.0 + changes["friction"]),
        chassis_mass_kg=robot.chassis_mass_kg * (1.0 + changes["mass"]),
        chassis_yaw_inertia_kg_m2=robot.chassis_yaw_inertia_kg_m2 * (1.0 + changes["mass"]),
        center_of_mass_right_m=robot.center_of_mass_right_m + changes["center_of_mass_right"],
        center_of_mass_forward_m=robot.center_of_mass_forward_m + changes["center_of_mass_forward"],
    )


def drive(schedule: dict[str, Any], longest_step: float, changes: Changes) -> End:
    """The end of a sample in Drake, in equal steps of which each interval of the schedule has a whole number."""
    interval = schedule["interval_s"]
    steps = math.ceil(interval / longest_step)
    step = interval / steps
    drake = DrakeRobot(changed_robot(robot_from_wire({}), changes), Discretisation(step, STICTION_TOLERANCE))
    drake.place(changes["start_heading"])
    drake.simulator.Initialize()
    # Half a step early: the state is already that of the node, and no rounding shifts when a torque changes.
    settling = step * (math.ceil(SETTLING_TIME / step) - 0.5)
    drake.simulator.AdvanceTo(settling)
    # It settles unevenly and rolls a little.
    drake.hold()
    begin, _ = drake.axle_pose()
    for index, (left, right) in enumerate(zip(schedule["left_n_m"], schedule["right_n_m"], strict=True)):
        drake.apply(left * (1.0 + changes["torque_left"]), right * (1.0 + changes["torque_right"]))
        drake.simulator.AdvanceTo(settling + (index + 1) * steps * step)
    end, heading = drake.axle_pose()
    right, ahead = end - begin
    return End(ahead - FORWARD["y_m"], -right, heading)


# --- The comparison -------------------------------------------------------------------------------------------------

COLUMNS = (
    f"{'compared':46}{'succeed, %':>16}{'same verdict, %':>17}{f'ends within {1e3 * NEAR:g} mm, %':>22}"
    f"{'apart, mm: median, 95 %, worst':>32}{'mrad: median, worst':>21}"
)


def compare(names: tuple[str, str], ends: tuple[list[End], list[End]], tolerance: float) -> tuple[float, float]:
    """Prints a line and gives the shares (%) of the samples with the same verdict, and of those with near ends."""
    pairs = list(zip(*ends, strict=True))
    apart = sorted(1e3 * one.apart(other) for one, other in pairs)
    turned = sorted(1e3 * abs(math.remainder(one.heading - other.heading, math.tau)) for one, other in pairs)
    succeed = [percentage(end.distance <= tolerance for end in side) for side in ends]
    same = percentage((one.distance <= tolerance) == (other.distance <= tolerance) for one, other in pairs)
    near = percentage(gap <= 1e3 * NEAR for gap in apart)
    late = apart[math.ceil(0.95 * len(apart)) - 1]
    print(
        f"{f'{names[0]}; {names[1]}':46}{succeed[0]:9.1f}{succeed[1]:7.1f}{same:17.1f}{near:22.1f}"
        f"{statistics.median(apart):16.1f}{late:8.1f}{apart[-1]:8.1f}"
        f"{statistics.median(turned):13.2f}{turned[-1]:8.2f}",
        flush=True,
    )
    return same, near


def percentage(passed: Iterable[bool]) -> float:
    """The share that passed, %."""
    return 100.0 * statistics.fmean(passed)


def compare_plan(name: str, slipdrive: Path, pool: Any) -> bool:
    """Prints the comparisons of a plan; whether Drake agrees as far as is asked."""
    request = PLANS[name] | {"view": "plan"}
    plan = {"request": request, "answer": ask(slipdrive, "solve", request)}
    tolerance = assess(slipdrive, plan, FIRST_TOLERANCE)["quantiles"][MEDIAN]["errors"]["distance_m"]
    answer = assess(slipdrive, plan, tolerance)
    samples = drawn(SEED, SAMPLES, UNCERTAIN)
    check_drawn(samples, answer)
    ours = pool.map(partial(end_of_sample, slipdrive, plan, tolerance), samples)
    ends = [end_of(sample) for sample in ours]
    check_successes(answer, ends, tolerance)
    steps, factor = answer["steps"], answer["grid_factor"]
    print(f"{name}: {plan['answer']['final_time_s']:.4f} s, tolerance {1e3 * tolerance:.1f} mm, grid factor {factor}")
    schedule = plan["answer"]["torque_schedule"]
    coarse, fine = (pool.map(partial(drive, schedule, step), samples, 4) for step in (TIME_STEP, 0.5 * TIME_STEP))
    names = f"Drake, {1e3 * TIME_STEP:g} ms", f"Drake, {5e2 * TIME_STEP:g} ms"
    same, near = compare((f"slipdrive, {steps} steps", names[1]), (ends, fine), tolerance)
    compare(names, (coarse, fine), tolerance)
    finer = 2 ** int(math.log2(STEP_LIMIT / steps))
    if finer > 1:
        refined = pool.map(partial(end_on_finer_grid, slipdrive, finer), ours)
        compare((f"slipdrive, {finer * steps} steps", names[1]), (refined, fine), tolerance)
    return same >= LEAST_SAME and near >= LEAST_NEAR


def check_successes(answer: dict[str, Any], ends: list[End], tolerance: float) -> None:
    """Raises where the samples by themselves are not those of the assessment of all."""
    successes = sum(end.distance <= tolerance for end in ends)
    largest = max(end.distance for end in ends)
    known = answer["quantiles"][-1]["errors"]["distance_m"]
    if successes != answer["successes"] or not math.isclose(largest, known, rel_tol=1e-9):
        said = f"{answer['successes']}, {known} m"
        raise RuntimeError(f"{successes} succeed, the farthest is at {largest} m; the assessment says {said}")


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slipdrive", type=Path, required=True, help="the binary")
    parser.add_argument("--processes", type=int, default=2, help="how many samples are driven at once")
    parser.add_argument("plans", nargs="*", help=f"some of: {'; '.join(PLANS)}; default: {'; '.join(PLANS_ASKED)}")
    return parser.parse_args()


def main() -> int:
    """Exit code 0, or 1 where Drake disagrees by more than is allowed."""
    asked = arguments()
    print(COLUMNS, flush=True)
    with Pool(asked.processes) as pool:
        agree = [compare_plan(name, asked.slipdrive, pool) for name in asked.plans or PLANS_ASKED]
    return 0 if all(agree) else 1


if __name__ == "__main__":
    sys.exit(main())
