"""The nonlinear program of a maneuver: direct simultaneous transcription with one of three friction laws.

Unknowns are the states at every step, the contact forces of every step, the torques of every control interval and the
final time, each scaled to about 1. A wheel with normal force N carries the friction mu N n; with slip gamma at the end
of the step the laws are

    smooth, slip scale eps:   n sqrt(gamma.gamma + eps^2) + gamma = 0
    exact Coulomb, lifted:    gamma + s n = 0,  w = 1 - n.n,  0 <= s, w,  s w <= tau
    sticking to eta:          gamma = 0,  n.n <= eta^2

The wheels share one lateral slip, so sticking leaves the split of their lateral force open: the program may choose it.
Limits of the request are bounds of the unknowns where they bound one, else rows of every step.
"""

from __future__ import annotations

from enum import Enum

import casadi as ca
import numpy as np

from maneuver import Maneuver
from mechanics import HEADING, RIM_LEFT, STATE_LEN, YAW_RATE, Mechanics, body_velocity, control_interval

# Shortest final time, s, as in slipdrive.
SHORTEST_FINAL_TIME = 0.02


class Law(Enum):
    """How friction is written."""

    SMOOTH = "smooth"
    COULOMB = "coulomb"
    STICKING = "sticking"


# Friction rows of a step that are at most zero; all others are zero.
FRICTION_INEQUALITIES = {Law.SMOOTH: 0, Law.COULOMB: 2, Law.STICKING: 2}

Values = dict[str, np.ndarray]
"""Unknowns by name: `state` (8 x steps + 1), `direction` (4 x steps), `load` (3 x steps, over the weight), `effort`
(2 x intervals, torque over limit), `final_time` (1 x 1, s); with exact friction also `sliding` (2 x steps, the s of the
law, m/s) and `margin` (2 x steps, w)."""


class Program:
    """The nonlinear program of one maneuver with one friction law; its parameter is eps, tau or eta."""

    def __init__(self, maneuver: Maneuver, law: Law) -> None:
        self.maneuver, self.law = maneuver, law
        steps, controls = maneuver.step_count, maneuver.control_count
        self.shapes = {"state": (STATE_LEN, steps + 1), "direction": (4, steps), "load": (3, steps)}
        if law is Law.COULOMB:
            self.shapes |= {"sliding": (2, steps), "margin": (2, steps)}
        self.shapes |= {"effort": (2, controls), "final_time": (1, 1)}
        self._formulate()
        self.lower, self.upper = self._bounds()

    def _formulate(self) -> None:
        """Sets the symbolic program and the bounds of its rows."""
        unknown = {name: ca.MX.sym(name, *shape) for name, shape in self.shapes.items()}
        parameter = ca.MX.sym("parameter")
        rows = self._step_rows().map(self.maneuver.step_count)(*self._step_arguments(unknown, parameter))
        self.problem = {
            "x": ca.vertcat(*map(ca.vec, unknown.values())),
            "p": parameter,
            "f": unknown["final_time"],
            "g": ca.vec(rows),
        }
        lower = np.zeros(rows.shape)
        lower[self._equality_count :] = -np.inf
        self.row_lower = lower.ravel(order="F")

    def _step_arguments(self, unknown: dict[str, ca.MX], parameter: ca.MX) -> list[ca.MX]:
        """The arguments of the step rows, one column per step."""
        steps, controls = self.maneuver.step_count, self.maneuver.control_count
        intervals = [control_interval(step, steps, controls) for step in range(steps)]
        state, effort = unknown["state"], unknown["effort"]
        contact = [unknown[name] for name in self._contact_names()]
        shared = [ca.repmat(scalar, 1, steps) for scalar in (unknown["final_time"], parameter)]
        return [state[:, :-1], state[:, 1:], effort[:, intervals], *contact, *shared]

    def _contact_names(self) -> list[str]:
        """The unknowns of every step's contacts."""
        return [name for name in self.shapes if name not in ("state", "effort", "final_time")]

    def _step_rows(self) -> ca.Function:
        """The rows of a step: motion 8, normal forces 3, friction, limits; from `_equality_count` on at most zero."""
        maneuver = self.maneuver
        robot = maneuver.robot
        state, after, effort = ca.SX.sym("state", STATE_LEN), ca.SX.sym("next", STATE_LEN), ca.SX.sym("effort", 2)
        contact = {name: ca.SX.sym(name, self.shapes[name][0]) for name in self._contact_names()}
        final_time, parameter = ca.SX.sym("final_time"), ca.SX.sym("parameter")
        direction, load = contact["direction"], contact["load"]
        grip = robot.wheel_friction_coefficient * robot.weight * load
        force = ca.vertcat(grip[0] * direction[:2], grip[1] * direction[2:])
        dt = final_time / maneuver.step_count
        step = Mechanics(robot).step()
        torque = effort * maneuver.torque_limit
        defect, slip, normal_force = step(state, after, force, torque, dt)
        friction = friction_rows(self.law, slip, contact, parameter)
        limits = self._limit_rows(state, after, torque, dt)
        rows = ca.vertcat(defect, normal_force / robot.weight - load, *friction)
        self._equality_count = rows.numel() - FRICTION_INEQUALITIES[self.law]
        arguments = [state, after, effort, *contact.values(), final_time, parameter]
        return ca.Function("rows", arguments, [ca.vertcat(rows, *limits)])

    def _limit_rows(self, state: ca.SX, after: ca.SX, torque: ca.SX, dt: ca.SX) -> list[ca.SX]:
        """The limits of one step that are no bounds of unknowns, each at most zero."""
        heading = state[HEADING] + 0.5 * dt * state[YAW_RATE]
        rows = self.maneuver.limits.rows(body_velocity(state, heading), body_velocity(after, heading), dt)
        if self.maneuver.motor is not None:
            rates = [node[RIM_LEFT:] / self.maneuver.robot.wheel_radius_m for node in (state, after)]
            rows += self.maneuver.motor.rows(torque, rates)
        return rows

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the unknowns: start, goal, torque limits, rates, least loads."""
        lower = {name: np.full(shape, -np.inf) for name, shape in self.shapes.items()}
        upper = {name: np.full(shape, np.inf) for name, shape in self.shapes.items()}
        robot, limits = self.maneuver.robot, self.maneuver.limits
        for component, largest, unit in (
            (slice(YAW_RATE, RIM_LEFT), limits.yaw_rate_rad_s, 1.0),
            (slice(RIM_LEFT, STATE_LEN), limits.wheel_rate_rad_s, robot.wheel_radius_m),
        ):
            if largest is not None:
                lower["state"][component], upper["state"][component] = -unit * largest, unit * largest
        start, goal = self.maneuver.start, self.maneuver.goal
        fixed = ~np.isnan(goal)
        for bound in (lower, upper):
            bound["state"][:, 0] = start
            bound["state"][fixed, -1] = goal[fixed]
        lower["effort"][:], upper["effort"][:] = -1.0, 1.0
        lower["final_time"][:] = SHORTEST_FINAL_TIME
        lower["load"].T[:] = limits.least_load(Mechanics(robot).static_load) / robot.weight
        for name in {"sliding", "margin"} & set(self.shapes):
            lower[name][:] = 0.0
        return self.pack(lower), self.pack(upper)

    def pack(self, values: Values) -> np.ndarray:
        """The vector of the unknowns, column by column."""
        return np.concatenate([values[name].ravel(order="F") for name in self.shapes])

    def unpack(self, vector: np.ndarray) -> Values:
        """The inverse of `pack`."""
        ends = np.cumsum([rows * columns for rows, columns in self.shapes.values()])
        parts = np.split(vector, ends[:-1])
        return {
            name: part.reshape(shape, order="F") for (name, shape), part in zip(self.shapes.items(), parts, strict=True)
        }


def friction_rows(law: Law, slip: ca.SX, contact: dict[str, ca.SX], parameter: ca.SX) -> list[ca.SX]:
    """The friction law of both wheels: rows that are zero, then those of `FRICTION_INEQUALITIES`."""
    gammas, units = (slip[:2], slip[2:]), (contact["direction"][:2], contact["direction"][2:])
    if law is Law.SMOOTH:
        pairs = zip(gammas, units, strict=True)
        return [unit * ca.sqrt(ca.dot(gamma, gamma) + parameter**2) + gamma for gamma, unit in pairs]
    if law is Law.STICKING:
        # The lateral slip of the right wheel is that of the left one.
        return [slip[:3], *(ca.dot(unit, unit) - parameter**2 for unit in units)]
    sliding, margin = contact["sliding"], contact["margin"]
    opposed = [gammas[wheel] + sliding[wheel] * unit for wheel, unit in enumerate(units)]
    margins = [margin[wheel] - 1.0 + ca.dot(unit, unit) for wheel, unit in enumerate(units)]
    return [*opposed, *margins, sliding * margin - parameter]
