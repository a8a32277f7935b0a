"""Holds the peer's discretised equations to rollouts of an independent implementation (`tests/data/rollouts`).

Each rollout is taken one step at a time: a projection loop finds the friction forces of the step, then the rows of the
nonlinear program are evaluated there and the states compared with the reference.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from maneuver import Refusal, robot_from_wire, state_scale
from mechanics import STATE_LEN, Mechanics, Robot, control_interval
from transcription import Law, friction_rows

ROLLOUTS = Path(__file__).resolve().parents[2] / "tests" / "data" / "rollouts"
# For m, rad, m/s and rad/s: the references hold 12 digits of values up to 100.
STATE_TOLERANCE = 1e-8
# Friction rows (m/s) of the program: what the projection loop leaves.
ROW_TOLERANCE = 1e-8
# The loop ends when no force changes by more than this share of the weight.
FORCE_TOLERANCE = 1e-14
SWEEP_LIMIT = 100_000


def self_check() -> bool:
    """Prints one line per rollout; whether all that are covered agree."""
    agree = True
    for path in sorted(ROLLOUTS.glob("*.json")):
        reference = json.loads(path.read_text())
        try:
            robot = robot_from_wire(reference["robot"])
        except Refusal as refusal:
            print(f"{path.stem:24} not covered: {refusal}")
            continue
        state_error, row_error = Rollout(robot, reference).compare()
        passed = state_error <= STATE_TOLERANCE and row_error <= ROW_TOLERANCE
        agree = agree and passed
        verdict = "agrees" if passed else "DIFFERS"
        print(f"{path.stem:24} {verdict}: states to {state_error:.1e}, friction rows to {row_error:.1e} m/s")
    return agree


class Rollout:
    """One reference rollout through the peer's equations."""

    def __init__(self, robot: Robot, reference: dict[str, Any]) -> None:
        self._robot, self._reference = robot, reference
        self._dt = reference["final_time_s"] / reference["steps"]
        self._step = affine_step(robot)
        self._rows = coulomb_rows()

    def compare(self) -> tuple[float, float]:
        """Largest difference of the sampled states (m, rad, m/s, rad/s), largest violation of a friction row (m/s)."""
        reference, scale = self._reference, state_scale(self._robot)
        samples = reference["samples"]
        states = map(without_wheel_angles, samples["configuration"], samples["velocity"])
        expected = dict(zip(samples["step"], states, strict=True))
        state = scale * without_wheel_angles(reference["start"]["configuration"], reference["start"]["velocity"])
        force = np.zeros(4)
        state_error = row_error = 0.0
        for index in range(reference["steps"]):
            state, force, violation = self._advance(index, state, force)
            row_error = max(row_error, violation)
            if index + 1 in expected:
                state_error = max(state_error, float(np.max(np.abs(state / scale - expected[index + 1]))))
        return state_error, row_error

    def _advance(self, index: int, state: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """The next state (8), the step's forces (4, N), and the violation of the program's friction rows (m/s)."""
        left, right = self._reference["torque_left_n_m"], self._reference["torque_right_n_m"]
        interval = control_interval(index, self._reference["steps"], len(left))
        torque = [left[interval], right[interval]]
        after, after_by_force, slip, slip_by_force, load, load_by_force = (
            value.full() for value in self._step(state, torque, self._dt)
        )
        friction = self._robot.wheel_friction_coefficient
        force = coulomb_forces(
            force, slip.ravel(), slip_by_force, friction * load.ravel(), friction * load_by_force, self._robot.weight
        )
        violation = self._violation(slip.ravel() + slip_by_force @ force, force, load.ravel() + load_by_force @ force)
        return after.ravel() + after_by_force @ force, force, violation

    def _violation(self, slip: np.ndarray, force: np.ndarray, load: np.ndarray) -> float:
        """The program's friction rows at slip (4), forces (4) and loads (3)."""
        radius = self._robot.wheel_friction_coefficient * np.repeat(load[:2], 2)
        direction = force / radius
        sliding = np.hypot(slip[::2], slip[1::2])
        margin = 1.0 - direction[::2] ** 2 - direction[1::2] ** 2
        rows = self._rows(slip, direction, sliding, margin, 0.0).full().ravel()
        return float(max(np.max(np.abs(rows)), -np.min(margin)))


def without_wheel_angles(configuration: list[float], velocity: list[float]) -> np.ndarray:
    """A reference's state (x, y, heading, velocity, yaw rate, wheel rates), 8, in its units."""
    return np.array(configuration[:3] + velocity)


def affine_step(robot: Robot) -> ca.Function:
    """The step solved for its end: `(state, torque, dt)` to next state, slip and load, each with its force derivative.

    All three are affine in the forces; the values are those without friction.
    """
    state, after = ca.SX.sym("state", STATE_LEN), ca.SX.sym("next", STATE_LEN)
    force, torque, dt = ca.SX.sym("force", 4), ca.SX.sym("torque", 2), ca.SX.sym("dt")
    defect, slip, load = Mechanics(robot).step()(state, after, force, torque, dt)
    at_zero = ca.substitute(defect, after, 0)
    end = -ca.solve(ca.jacobian(defect, after), at_zero)
    results = []
    for value in (end, ca.substitute(slip, after, end), ca.substitute(load, after, end)):
        results += [ca.substitute(value, force, 0), ca.substitute(ca.jacobian(value, force), force, 0)]
    return ca.Function("affine_step", [state, torque, dt], results)


def coulomb_rows() -> ca.Function:
    """The friction rows of the program at `(slip, direction, sliding, margin, tau)`."""
    slip, direction = ca.SX.sym("slip", 4), ca.SX.sym("direction", 4)
    sliding, margin, relaxation = ca.SX.sym("sliding", 2), ca.SX.sym("margin", 2), ca.SX.sym("relaxation")
    contact = {"direction": direction, "sliding": sliding, "margin": margin}
    rows = friction_rows(Law.COULOMB, slip, contact, relaxation)
    return ca.Function("rows", [slip, direction, sliding, margin, relaxation], [ca.vertcat(*rows)])


def coulomb_forces(
    force: np.ndarray,
    slip: np.ndarray,
    slip_by_force: np.ndarray,
    radius: np.ndarray,
    radius_by_force: np.ndarray,
    weight: float,
) -> np.ndarray:
    """Friction forces (4, N) by Gauss-Seidel projection: slip = `slip` + `slip_by_force` force, radii alike.

    Plain floats: arrays this small would spend the time on their own bookkeeping.
    """
    current = force.tolist()
    rows, free = slip_by_force.tolist(), slip.tolist()
    radius_rows, free_radius = radius_by_force.tolist(), radius.tolist()
    steps = [1.0 / float(np.linalg.norm(slip_by_force[2 * i : 2 * i + 2, 2 * i : 2 * i + 2], 2)) for i in (0, 1)]
    for _ in range(SWEEP_LIMIT):
        change = 0.0
        for wheel in (0, 1):
            first = 2 * wheel
            limit = max(affine(free_radius[wheel], radius_rows[wheel], current), 0.0)
            a = current[first] - steps[wheel] * affine(free[first], rows[first], current)
            b = current[first + 1] - steps[wheel] * affine(free[first + 1], rows[first + 1], current)
            length = math.hypot(a, b)
            shrink = limit / length if length > limit else 1.0
            change = max(change, abs(shrink * a - current[first]), abs(shrink * b - current[first + 1]))
            current[first], current[first + 1] = shrink * a, shrink * b
        if change <= FORCE_TOLERANCE * weight:
            break
    return np.array(current)


def affine(constant: float, row: list[float], values: list[float]) -> float:
    """The sum of `constant` and row.values, 4 entries each."""
    return constant + row[0] * values[0] + row[1] * values[1] + row[2] * values[2] + row[3] * values[3]
