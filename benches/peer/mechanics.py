"""The robot as the peer sees it: parameters, constant matrices and one midpoint step as a CasADi function.

Derived in `docs/model.md`, written apart from the Rust source. A state has 8 entries: x, y (m), heading (rad),
velocity x, y (m/s), yaw rate (rad/s), rim speeds left, right (m/s; wheel radius times wheel rate, so that all speeds
have one scale). Wheel angles drive nothing and are left out. A body velocity has 5: right, forward (m/s), yaw rate
(rad/s), rim speeds left, right (m/s). Wheel forces and slips have 4: left longitudinal, left lateral, right
longitudinal, right lateral (N, m/s).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

STATE_LEN = 8
X, Y, HEADING, VELOCITY_X, VELOCITY_Y, YAW_RATE, RIM_LEFT, RIM_RIGHT = range(STATE_LEN)


@dataclass(frozen=True)
class Robot:
    """Parameters by their names in the request, SI units; the defaults are the reference robot."""

    chassis_mass_kg: float = 10.33
    wheel_mass_kg: float = 0.6
    chassis_yaw_inertia_kg_m2: float = 0.20
    wheel_diametral_inertia_kg_m2: float = 5.5e-4
    wheel_spin_inertia_kg_m2: float = 3.0e-3
    wheel_radius_m: float = 0.06
    track_width_m: float = 0.30
    axle_to_front_support_m: float = 0.28
    front_support_right_m: float = 0.0
    center_of_mass_right_m: float = -0.02
    center_of_mass_forward_m: float = 0.07
    center_of_mass_height_m: float = 0.10
    wheel_friction_coefficient: float = 0.45
    front_friction_coefficient: float = 0.0
    tangential_restitution: float = 0.0
    gravity_m_s2: float = 9.81

    @property
    def mass(self) -> float:
        """Mass of the whole robot, kg."""
        return self.chassis_mass_kg + 2.0 * self.wheel_mass_kg

    @property
    def weight(self) -> float:
        """Weight of the whole robot, N."""
        return self.mass * self.gravity_m_s2

    @property
    def rim_mass(self) -> float:
        """Spin inertia of one wheel as a mass at its rim, kg."""
        return self.wheel_spin_inertia_kg_m2 / self.wheel_radius_m**2

    @property
    def axle_midpoint(self) -> np.ndarray:
        """Axle midpoint from the chassis centre of mass, body frame (right, forward), m."""
        return -np.array([self.center_of_mass_right_m, self.center_of_mass_forward_m])

    def contact_points(self) -> np.ndarray:
        """Left wheel, right wheel and front support from the chassis centre of mass, 3x2 (right, forward), m."""
        half_track = np.array([self.track_width_m / 2.0, 0.0])
        front = np.array([self.front_support_right_m, self.axle_to_front_support_m])
        return self.axle_midpoint + np.array([-half_track, half_track, front])


class Mechanics:
    """Constant matrices of one robot in the body frame, and its step."""

    def __init__(self, robot: Robot) -> None:
        points = robot.contact_points()
        self.robot = robot
        self.slip_map = slip_map(points)
        self.inverse_mass = np.linalg.inv(mass_matrix(robot, points))
        self.static_moment = robot.wheel_mass_kg * (points[0] + points[1])
        self._set_normal_load(points)

    def _set_normal_load(self, points: np.ndarray) -> None:
        """Normal forces (left, right, front) from lift, pitch and roll, (12) and (22) of the paper."""
        robot = self.robot
        lever = robot.wheel_mass_kg * robot.wheel_radius_m
        tilt = robot.chassis_mass_kg * robot.center_of_mass_height_m + 2.0 * lever
        rim = robot.wheel_spin_inertia_kg_m2 / robot.wheel_radius_m
        wheel_forward, wheels_right = points[0, 1], points[0, 0] + points[1, 0]
        weights = [robot.mass, 2.0 * robot.wheel_mass_kg * wheel_forward, robot.wheel_mass_kg * wheels_right]
        pitch = [0.0, -tilt, -lever * wheels_right, -rim, -rim]
        roll = [-tilt, 0.0, 2.0 * lever * wheel_forward, 0.0, 0.0]
        loads = np.linalg.inv(np.array([np.ones(3), points[:, 1], points[:, 0]]))
        self.static_load = robot.gravity_m_s2 * loads @ np.array(weights)
        self.load_by_yaw_rate_squared = loads @ np.array([0.0, 2.0 * lever * wheel_forward, lever * wheels_right])
        self.load_by_yaw_rate_rim_speed = loads @ np.array([0.0, 0.0, rim])
        self.load_by_acceleration = loads @ np.array([np.zeros(5), pitch, roll])

    def step(self) -> ca.Function:
        """One midpoint step: `(state, next, force, torque, dt) -> (defect, slip, load)`.

        `force` (4, N) and `torque` (2, N m) are means over the step of length `dt` (s). `defect` (8; m, rad, m/s,
        rad/s) is zero where `next` follows from `state`; `slip` (4, m/s) is that of `next`; `load` (3, N) holds the
        normal forces of left wheel, right wheel and front support.
        """
        state, after = ca.SX.sym("state", STATE_LEN), ca.SX.sym("next", STATE_LEN)
        force, torque, dt = ca.SX.sym("force", 4), ca.SX.sym("torque", 2), ca.SX.sym("dt")
        heading = state[HEADING] + 0.5 * dt * state[YAW_RATE]
        before, end = body_velocity(state, heading), body_velocity(after, heading)
        acceleration = self._acceleration(before, force, torque)
        mean_rate = 0.5 * (state[VELOCITY_X:RIM_LEFT] + after[VELOCITY_X:RIM_LEFT])
        moved = after[:VELOCITY_X] - state[:VELOCITY_X] - dt * mean_rate
        defect = ca.vertcat(moved, end - before - dt * acceleration)
        slip = ca.DM(self.slip_map) @ end
        names = ["state", "next", "force", "torque", "dt"], ["defect", "slip", "load"]
        results = [defect, slip, self._load(before, acceleration)]
        return ca.Function("step", [state, after, force, torque, dt], results, *names)

    def _acceleration(self, velocity: ca.SX, force: ca.SX, torque: ca.SX) -> ca.SX:
        """M^-1 (h + W_T force): change of body velocity per second, 5."""
        centrifugal = velocity[2] ** 2 * ca.DM(self.static_moment)
        smooth = ca.vertcat(centrifugal, 0.0, torque / self.robot.wheel_radius_m)
        return ca.DM(self.inverse_mass) @ (smooth + ca.DM(self.slip_map.T) @ force)

    def _load(self, velocity: ca.SX, acceleration: ca.SX) -> ca.SX:
        """Normal forces, 3, N, of a step that starts at `velocity`."""
        yaw_rate, rim_speeds = velocity[2], velocity[3] + velocity[4]
        at_speed = yaw_rate**2 * ca.DM(self.load_by_yaw_rate_squared)
        gyroscopic = yaw_rate * rim_speeds * ca.DM(self.load_by_yaw_rate_rim_speed)
        return ca.DM(self.static_load) + at_speed + gyroscopic + ca.DM(self.load_by_acceleration) @ acceleration


def mass_matrix(robot: Robot, points: np.ndarray) -> np.ndarray:
    """M, 5x5, kg, kg m and kg m2; the wheels' rows are masses, since their coordinates are rim speeds."""
    right, forward = robot.wheel_mass_kg * (points[0] + points[1])
    wheels = 2.0 * robot.wheel_diametral_inertia_kg_m2 + robot.wheel_mass_kg * float(np.sum(points[:2] ** 2))
    yaw_inertia = robot.chassis_yaw_inertia_kg_m2 + wheels
    matrix = np.diag([robot.mass, robot.mass, yaw_inertia, robot.rim_mass, robot.rim_mass])
    matrix[0, 2] = matrix[2, 0] = -forward
    matrix[1, 2] = matrix[2, 1] = right
    return matrix


def slip_map(points: np.ndarray) -> np.ndarray:
    """W_T' of both wheels, 4x5, (4) of the paper."""
    (left, forward), (right, _) = points[:2]
    lateral = [1.0, 0.0, -forward, 0.0, 0.0]
    return np.array([[0.0, 1.0, left, -1.0, 0.0], lateral, [0.0, 1.0, right, 0.0, -1.0], lateral])


def body_velocity(state: ca.SX, heading: ca.SX) -> ca.SX:
    """Velocity of a state in the body frame at `heading`, 5."""
    sin, cos = ca.sin(heading), ca.cos(heading)
    right = cos * state[VELOCITY_X] + sin * state[VELOCITY_Y]
    forward = cos * state[VELOCITY_Y] - sin * state[VELOCITY_X]
    return ca.vertcat(right, forward, state[YAW_RATE:])


def control_interval(step: int, step_count: int, control_count: int) -> int:
    """The control interval that holds the midpoint of a step; one on a boundary belongs to the later interval."""
    return (2 * step + 1) * control_count // (2 * step_count)
