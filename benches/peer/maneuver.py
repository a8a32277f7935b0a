"""Slipdrive's request as a maneuver of the peer, and the guess that its homotopy starts from."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from limits import Limits, Motor
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

# What the chassis carries, in the middle of the axle unless given.
PAYLOAD = {"mass_kg": 0.0, "right_m": 0.0, "forward_m": 0.0, "height_m": 0.0, "yaw_inertia_kg_m2": 0.0}
MOTOR_FIELDS = ("motor_stall_torque_n_m", "motor_free_speed_rad_s")
REFERENCE_POINTS = ("chassis_center_of_mass", "axle_midpoint")
# Torque limit where neither it nor a motor is given, N m.
DEFAULT_TORQUE_LIMIT = 1.0

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

    `robot` carries its payload. `start` and `goal` are states (8), the goal NaN where it is free; `goal_asked` is that
    of the request at its own reference point. `torque_limit` is left, right (N m).
    """

    robot: Robot
    start: np.ndarray
    goal: np.ndarray
    goal_asked: np.ndarray
    torque_limit: np.ndarray
    motor: Motor | None
    limits: Limits
    step_count: int
    control_count: int


def maneuver_from_request(request: dict[str, Any]) -> Maneuver:
    """Reads the body of a solve request; raises Refusal for what the peer does not cover."""
    asked, grid = request["maneuver"], request.get("grid", {})
    torque_limits = ("torque_limit_left_n_m", "torque_limit_right_n_m")
    refuse_unknown("`maneuver`", asked, {"reference_point", "start", "goal", "slip", "limits", *torque_limits})
    if "steps" not in grid:
        raise Refusal("`grid.steps` is missing: both solvers must use the same grid")
    wire = dict(request.get("robot", {}))
    motor = motor_from_wire({name: wire.pop(name) for name in MOTOR_FIELDS if name in wire})
    bare = robot_from_wire(wire)
    payload = request.get("payload", {})
    robot = with_payload(bare, payload)
    start = start_from_wire(asked.get("start", {}), robot)
    goal = goal_from_wire(asked["goal"], start, robot)
    reference = reference_offset(asked.get("reference_point", REFERENCE_POINTS[0]), bare, robot)
    point = robot.axle_midpoint + payload_position(payload) if payload else reference
    largest = motor.stall_torque if motor else DEFAULT_TORQUE_LIMIT
    return Maneuver(
        robot,
        at_center_of_mass("start", start, reference),
        at_center_of_mass("goal", goal, reference),
        goal,
        np.array([asked.get(name, largest) for name in torque_limits]),
        motor,
        limits_from_wire(asked, (float(point[0]), float(point[1]))),
        grid["steps"],
        grid.get("control_intervals", 40),
    )


def refuse_unknown(where: str, wire: dict[str, Any], known: set[str]) -> None:
    """Raises Refusal for fields that are not covered."""
    unknown = set(wire) - known
    if unknown:
        raise Refusal(f"fields of {where} that are not covered: {', '.join(sorted(unknown))}")


def robot_from_wire(wire: dict[str, float]) -> Robot:
    """The robot of a request; raises Refusal for front friction, restitution and unknown fields."""
    refuse_unknown("`robot`", wire, {field.name for field in fields(Robot)})
    robot = Robot(**wire)
    for name in ("front_friction_coefficient", "tangential_restitution"):
        if getattr(robot, name) != 0.0:
            raise Refusal(f"`robot.{name}` is {getattr(robot, name)}, must be 0")
    return robot


def motor_from_wire(wire: dict[str, float]) -> Motor | None:
    """The motor of both wheels, if one is given; raises Refusal for half of one."""
    if not wire:
        return None
    if len(wire) < len(MOTOR_FIELDS):
        raise Refusal(f"`robot` needs both or none of {', '.join(MOTOR_FIELDS)}")
    return Motor(*(wire[name] for name in MOTOR_FIELDS))


def limits_from_wire(asked: dict[str, Any], point: tuple[float, float]) -> Limits:
    """The limits of a maneuver; raises Refusal for unknown ones and for unequal ones of acceleration and braking."""
    wire = dict(asked.get("limits", {}))
    braking = wire.pop("deceleration_m_s2", None)
    if braking != wire.get("acceleration_m_s2"):
        raise Refusal("`limits.deceleration_m_s2` must be `limits.acceleration_m_s2`: one row serves both")
    refuse_unknown("`maneuver.limits`", wire, {field.name for field in fields(Limits)} - {"point"})
    if asked.get("slip", "allowed") == "forbidden":
        wire.setdefault("grip_utilization", 1.0)
    return Limits(point=point, **wire)


def with_payload(bare: Robot, wire: dict[str, float]) -> Robot:
    """The robot with its payload joined to the chassis by the parallel-axis theorem."""
    refuse_unknown("`payload`", wire, set(PAYLOAD))
    if not wire:
        return bare
    load = PAYLOAD | wire
    mass = bare.chassis_mass_kg + load["mass_kg"]
    share = load["mass_kg"] / mass
    way = payload_position(wire) + bare.axle_midpoint
    right, forward = share * way - bare.axle_midpoint
    height = bare.center_of_mass_height_m
    return replace(
        bare,
        chassis_mass_kg=mass,
        chassis_yaw_inertia_kg_m2=bare.chassis_yaw_inertia_kg_m2
        + load["yaw_inertia_kg_m2"]
        + share * bare.chassis_mass_kg * float(way @ way),
        center_of_mass_right_m=float(right),
        center_of_mass_forward_m=float(forward),
        center_of_mass_height_m=height + share * (load["height_m"] - height),
    )


def payload_position(wire: dict[str, float]) -> np.ndarray:
    """The payload's centre of mass from the axle midpoint (right, forward), m."""
    load = PAYLOAD | wire
    return np.array([load["right_m"], load["forward_m"]])


def reference_offset(name: str, bare: Robot, robot: Robot) -> np.ndarray:
    """The reference point from the chassis centre of mass with its load (right, forward), m."""
    if name not in REFERENCE_POINTS:
        raise Refusal(f"`maneuver.reference_point` must be one of {', '.join(REFERENCE_POINTS)}")
    return robot.axle_midpoint - (bare.axle_midpoint if name == REFERENCE_POINTS[0] else 0.0)


def at_center_of_mass(name: str, state: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """A state (8) given at the reference point; raises Refusal where the points differ and it is not at rest."""
    if not np.any(reference):
        return state
    if np.any(state[VELOCITY_X:] != 0.0) or np.any(np.isnan(state)):
        raise Refusal(f"`maneuver.{name}` must be at rest, all of it given, where its point is not the centre of mass")
    moved = state.copy()
    moved[[X, Y]] -= to_world(state[HEADING], *reference)
    return moved


def state_scale(robot: Robot) -> np.ndarray:
    """From the request's units to those of a state, 8: wheel rates become rim speeds."""
    return np.array([1.0] * 6 + [robot.wheel_radius_m] * 2)


def start_from_wire(wire: dict[str, float], robot: Robot) -> np.ndarray:
    """The start state, 8."""
    return state_scale(robot) * np.array([wire.get(field, 0.0) for field in STATE_FIELDS])


def goal_from_wire(wire: dict[str, Any], start: np.ndarray, robot: Robot) -> np.ndarray:
    """The goal state, 8, NaN where it is free; the heading in the winding nearest to the start's."""
    free = set(wire.get("free", []))
    refuse_unknown("`maneuver.goal`", dict.fromkeys([*wire, *free]), {"free", *STATE_FIELDS})
    default = np.where(np.arange(STATE_LEN) < VELOCITY_X, start, 0.0)
    scale = state_scale(robot)
    goal = np.array([wire[field] * scale[i] if field in wire else default[i] for i, field in enumerate(STATE_FIELDS)])
    goal[HEADING] = start[HEADING] + math.remainder(goal[HEADING] - start[HEADING], math.tau)
    goal[[STATE_FIELDS.index(field) for field in free]] = math.nan
    return goal


# --- The guess ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Leg:
    """A turn on the spot or a straight drive of the axle midpoint from rest to rest: pushing, then braking as long.

    `turn` (rad) or `drive` (m) is its signed length, the other one is zero; `effort` is the share of what the guess may
    push, below 1 where a rate is limited.
    """

    turn: float
    drive: float
    duration: float
    effort: float

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
    top_yaw_rate, top_speed = top_rates(maneuver)
    legs = [
        Leg(first, 0.0, *pace(abs(first), yaw_acceleration, top_yaw_rate)),
        Leg(0.0, drive, *pace(abs(drive), acceleration, top_speed)),
        Leg(last, 0.0, *pace(abs(last), yaw_acceleration, top_yaw_rate)),
    ]
    return [leg for leg in legs if abs(leg.turn) + abs(leg.drive) >= SHORTEST_LEG]


def pace(length: float, acceleration: float, top: float) -> tuple[float, float]:
    """Duration (s) of a leg whose rate stays below `top`, and the share of `acceleration` that it takes."""
    fastest, slowest = 2.0 * math.sqrt(length / acceleration), 2.0 * length / top
    return (fastest, 1.0) if fastest >= slowest else (slowest, (fastest / slowest) ** 2)


def top_rates(maneuver: Maneuver) -> tuple[float, float]:
    """Yaw rate (rad/s) and speed (m/s) that the guess keeps."""
    limits, radius = maneuver.limits, maneuver.robot.wheel_radius_m
    free_speed = maneuver.motor.free_speed if maneuver.motor else None
    rim_speed = radius * least(limits.wheel_rate_rad_s, free_speed)
    yaw_rate = least(limits.yaw_rate_rad_s, rim_speed / (0.5 * maneuver.robot.track_width_m))
    return GUESS_AMPLITUDE * yaw_rate, GUESS_AMPLITUDE * least(limits.speed_m_s, rim_speed)


def least(*values: float | None) -> float:
    """The least of the values that are given; infinity if none is."""
    return min((value for value in values if value is not None), default=math.inf)


def rim_force_limit(maneuver: Maneuver) -> np.ndarray:
    """Largest longitudinal force of each wheel at rest by torque and friction, 2, N."""
    robot = maneuver.robot
    by_torque = maneuver.torque_limit / robot.wheel_radius_m
    by_friction = robot.wheel_friction_coefficient * Mechanics(robot).static_load[:2]
    if maneuver.limits.grip_utilization is not None:
        by_friction = maneuver.limits.grip_utilization * by_friction
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
        signs = [math.copysign(leg.effort, leg.drive - leg.turn), math.copysign(leg.effort, leg.drive + leg.turn)]
        sides += np.outer(signs, push)
        begin += leg.duration
    by_limit = rim_force_limit(maneuver) * maneuver.robot.wheel_radius_m / maneuver.torque_limit
    return GUESS_AMPLITUDE * by_limit[:, None] * sides
