"""Slipdrive's request as a maneuver of the peer, and the guess that its homotopy starts from."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mechanics import HEADING, STATE_LEN, VELOCITY_X, X, Y, Mechanics, Robot

# Fields of start and goal in the order of the state.
STATE_FIELDS = (
    "x_m",
    "y_m",
    "heading_rad",
    "velocity_x_m_s",
    "velocity_y_m_s",
    "yaw_rate_rad_s",
    "wheel_rate_left_rad_s",
    "wheel_rate_right_rad_s",
)

# Share of what torque limit and friction allow: off its limits, everything can move both ways.
GUESS_AMPLITUDE = 0.8
# Shorter legs (m, rad) are left out of the guess.
SHORTEST_LEG = 1e-3
# A guess takes at least this long, s.
SHORTEST_GUESS = 0.1


class Refusal(Exception):
    """A request that the peer does not cover."""


@dataclass(frozen=True)
class Maneuver:
    """Start, goal and torque limits of one maneuver at the chassis centre of mass, and the grid.

    `start` and `goal` are states (8), the goal NaN where it is free; `torque_limit` is left, right (N m).
    """

    robot: Robot
    start: np.ndarray
    goal: np.ndarray
    torque_limit: np.ndarray
    step_count: int
    control_count: int


def maneuver_from_request(request: dict[str, Any]) -> Maneuver:
    """Reads the body of a solve request; raises Refusal for what the peer does not cover."""
    robot = robot_from_wire(request.get("robot", {}))
    asked = request["maneuver"]
    if asked.get("reference_point", "chassis_center_of_mass") != "chassis_center_of_mass":
        raise Refusal("`maneuver.reference_point` must be chassis_center_of_mass")
    grid = request.get("grid", {})
    if "steps" not in grid:
        raise Refusal("`grid.steps` is missing: both solvers must use the same grid")
    start = start_from_wire(asked.get("start", {}), robot)
    goal = goal_from_wire(asked["goal"], start, robot)
    limits = [asked.get(f"torque_limit_{side}_n_m", 1.0) for side in ("left", "right")]
    return Maneuver(robot, start, goal, np.array(limits), grid["steps"], grid.get("control_intervals", 40))


def robot_from_wire(wire: dict[str, float]) -> Robot:
    """The robot of a request; raises Refusal for front friction, restitution and unknown fields."""
    unknown = set(wire) - {field.name for field in fields(Robot)}
    if unknown:
        raise Refusal(f"unknown fields in `robot`: {', '.join(sorted(unknown))}")
    robot = Robot(**wire)
    for name in ("front_friction_coefficient", "tangential_restitution"):
        if getattr(robot, name) != 0.0:
            raise Refusal(f"`robot.{name}` is {getattr(robot, name)}, must be 0")
    return robot


def state_scale(robot: Robot) -> np.ndarray:
    """From the request's units to those of a state, 8: wheel rates become rim speeds."""
    return np.array([1.0] * 6 + [robot.wheel_radius_m] * 2)


def start_from_wire(wire: dict[str, float], robot: Robot) -> np.ndarray:
    """The start state, 8."""
    return state_scale(robot) * np.array([wire.get(field, 0.0) for field in STATE_FIELDS])


def goal_from_wire(wire: dict[str, Any], start: np.ndarray, robot: Robot) -> np.ndarray:
    """The goal state, 8, NaN where it is free; the heading in the winding nearest to the start's."""
    free = set(wire.get("free", []))
    unknown = (set(wire) | free) - {"free", *STATE_FIELDS}
    if unknown:
        raise Refusal(f"fields of `maneuver.goal` that are not covered: {', '.join(sorted(unknown))}")
    default = np.where(np.arange(STATE_LEN) < VELOCITY_X, start, 0.0)
    scale = state_scale(robot)
    goal = np.array([wire[field] * scale[i] if field in wire else default[i] for i, field in enumerate(STATE_FIELDS)])
    goal[HEADING] = start[HEADING] + math.remainder(goal[HEADING] - start[HEADING], math.tau)
    goal[[STATE_FIELDS.index(field) for field in free]] = math.nan
    return goal


# --- The guess ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Leg:
    """A turn on the spot or a straight drive of the axle midpoint from rest to rest: full effort, then full braking.

    `turn` (rad) or `drive` (m) is its signed length, the other one is zero.
    """

    turn: float
    drive: float
    duration: float

    def progress(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Share of the leg done (0 to 1) and its rate (1/s) at times since its begin."""
        share = np.clip(time / self.duration, 0.0, 1.0)
        done = np.where(share < 0.5, 2.0 * share**2, 1.0 - 2.0 * (1.0 - share) ** 2)
        rate = 4.0 * np.minimum(share, 1.0 - share) / self.duration
        return done, rate


@dataclass(frozen=True)
class Guess:
    """Where the homotopy starts: states (8 x steps + 1), efforts (2 x intervals, -1 to 1), final time (s)."""

    state: np.ndarray
    effort: np.ndarray
    final_time: float


def turn_drive_turn(maneuver: Maneuver) -> Guess:
    """The fastest-looking turn, drive, turn without slip, forwards or backwards; goals straight ahead need no turn."""
    legs = shortest_legs(maneuver)
    final_time = max(sum(leg.duration for leg in legs), SHORTEST_GUESS)
    times = np.linspace(0.0, final_time, maneuver.step_count + 1)
    return Guess(states_along(maneuver, legs, times), efforts_along(maneuver, legs, final_time), final_time)


def shortest_legs(maneuver: Maneuver) -> list[Leg]:
    """The legs from start to goal that take the least time."""
    start = maneuver.start
    goal = np.where(np.isnan(maneuver.goal), start, maneuver.goal)
    way = axle_position(maneuver.robot, goal) - axle_position(maneuver.robot, start)
    distance, turn = float(np.hypot(*way)), goal[HEADING] - start[HEADING]
    if distance < SHORTEST_LEG:
        return legs_of(maneuver, turn, 0.0, 0.0)
    ahead = math.remainder(math.atan2(-way[0], way[1]) - start[HEADING], math.tau)
    behind = math.remainder(ahead + math.pi, math.tau)
    candidates = [
        legs_of(maneuver, first, drive, turn - first)
        for heading, drive in ((ahead, distance), (behind, -distance))
        for first in (heading, heading - math.copysign(math.tau, heading))
    ]
    return min(candidates, key=lambda legs: sum(leg.duration for leg in legs))


def legs_of(maneuver: Maneuver, first: float, drive: float, last: float) -> list[Leg]:
    """The legs turn, drive, turn (rad, m, rad) without those that are too short to matter."""
    robot = maneuver.robot
    force = GUESS_AMPLITUDE * float(np.sum(rim_force_limit(maneuver)))
    rolling_mass = robot.mass + 2.0 * robot.rim_mass
    arm = 0.5 * robot.track_width_m
    offset = float(robot.axle_midpoint @ robot.axle_midpoint)
    yaw_inertia = robot.chassis_yaw_inertia_kg_m2 + robot.chassis_mass_kg * offset
    rolling_inertia = yaw_inertia + 2.0 * (robot.wheel_mass_kg + robot.rim_mass) * arm**2
    yaw_acceleration, acceleration = force * arm / rolling_inertia, force / rolling_mass
    legs = [
        Leg(first, 0.0, 2.0 * math.sqrt(abs(first) / yaw_acceleration)),
        Leg(0.0, drive, 2.0 * math.sqrt(abs(drive) / acceleration)),
        Leg(last, 0.0, 2.0 * math.sqrt(abs(last) / yaw_acceleration)),
    ]
    return [leg for leg in legs if abs(leg.turn) + abs(leg.drive) >= SHORTEST_LEG]


def rim_force_limit(maneuver: Maneuver) -> np.ndarray:
    """Largest longitudinal force of each wheel at rest by torque and friction, 2, N."""
    robot = maneuver.robot
    by_torque = maneuver.torque_limit / robot.wheel_radius_m
    by_friction = robot.wheel_friction_coefficient * Mechanics(robot).static_load[:2]
    return np.minimum(by_torque, by_friction)


def axle_position(robot: Robot, state: np.ndarray) -> np.ndarray:
    """World position of the axle midpoint, 2, m."""
    return state[[X, Y]] + to_world(state[HEADING], *robot.axle_midpoint)


def to_world(heading: np.ndarray | float, right: np.ndarray | float, forward: np.ndarray | float) -> np.ndarray:
    """World components (x, y) of body components."""
    sin, cos = np.sin(heading), np.cos(heading)
    return np.array([cos * right - sin * forward, sin * right + cos * forward])


def states_along(maneuver: Maneuver, legs: list[Leg], times: np.ndarray) -> np.ndarray:
    """States at `times` (s) on the legs, 8 x len(times); the wheels roll without slip."""
    robot, start = maneuver.robot, maneuver.start
    heading = np.full_like(times, start[HEADING])
    yaw_rate, speed = np.zeros_like(times), np.zeros_like(times)
    axle = np.tile(axle_position(robot, start)[:, None], (1, len(times)))
    leg_heading, begin = start[HEADING], 0.0
    for leg in legs:
        done, rate = leg.progress(times - begin)
        heading += leg.turn * done
        yaw_rate += leg.turn * rate
        speed += leg.drive * rate
        leg_heading += leg.turn
        axle += to_world(leg_heading, 0.0, leg.drive)[:, None] * done
        begin += leg.duration
    right, forward = -robot.axle_midpoint
    position = axle + to_world(heading, right, forward)
    velocity = to_world(heading, -forward * yaw_rate, speed + right * yaw_rate)
    swing = 0.5 * robot.track_width_m * yaw_rate
    return np.vstack([position, heading, velocity, yaw_rate, speed - swing, speed + swing])


def efforts_along(maneuver: Maneuver, legs: list[Leg], final_time: float) -> np.ndarray:
    """Torques of the legs over their limits at the middle of each control interval, 2 x intervals."""
    middles = (np.arange(maneuver.control_count) + 0.5) * final_time / maneuver.control_count
    sides = np.zeros((2, maneuver.control_count))
    begin = 0.0
    for leg in legs:
        share = (middles - begin) / leg.duration
        push = np.where((share >= 0.0) & (share < 0.5), 1.0, 0.0) - np.where((share >= 0.5) & (share < 1.0), 1.0, 0.0)
        sides += np.outer([math.copysign(1.0, leg.drive - leg.turn), math.copysign(1.0, leg.drive + leg.turn)], push)
        begin += leg.duration
    by_limit = rim_force_limit(maneuver) * maneuver.robot.wheel_radius_m / maneuver.torque_limit
    return GUESS_AMPLITUDE * by_limit[:, None] * sides
