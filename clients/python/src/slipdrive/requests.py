"""Requests, as dictionaries."""

# Written by make_types.py: do not edit.

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypedDict

import numpy as np
import numpy.typing as npt

from . import answers

Numbers = Sequence[float] | npt.NDArray[np.floating[Any]]

# What may differ from what a plan was made for.
# - `friction`: Friction coefficients of wheels and front support.
# - `mass`: Mass and yaw inertia of the chassis, without a payload.
# - `center_of_mass_right`: Centre of mass of the chassis, to the right; a payload stays where it is.
# - `center_of_mass_forward`: Centre of mass of the chassis, forward; a payload stays where it is.
# - `torque`: Torques of both wheels.
# - `torque_left`: Torques of the left wheel.
# - `start_heading`: Heading of the start, which turns the start velocity of the axle midpoint too.
# - `torque_right`: Torques of the right wheel.
# - `payload_mass`: Mass of the payload, kg more than it has; its own yaw inertia stays.
# - `payload_right`: Place of the payload, to the right.
# - `payload_forward`: Place of the payload, forward.
# - `start_x`: World x of the start.
# - `start_y`: World y of the start.
# - `delay_left`: How long the left wheel holds zero torque before its schedule begins, s.
# - `delay_right`: How long the right wheel holds zero torque before its schedule begins, s.
ChangedParameter = Literal["friction", "mass", "center_of_mass_right", "center_of_mass_forward", "torque", "torque_left", "start_heading", "torque_right", "payload_mass", "payload_right", "payload_forward", "start_x", "start_y", "delay_left", "delay_right"]

# Which of the local optima is the answer.
# - `fastest`: The fastest.
# - `steadiest`: Of those within `choose_within` of the fastest the one whose end shifts least with 10 % less friction,
# in units of the replay tolerances (the larger of position and heading); one that makes a contact lift comes last. A
# search that was stopped has the fastest.
Choice = Literal["fastest", "steadiest"]

# The solver of the one-step friction problem.
# - `exact`: Contact patterns solved exactly.
# - `fixed_point`: The paper's prox fixed point.
ContactSolver = Literal["exact", "fixed_point"]

# What files an export has.
# - `csv`: Rows of numbers: trajectory.csv.
# - `ros2_json`: The messages of ros2_mcap as JSON, null for numbers that are absent: trajectory.json and
# joint_trajectory.json.
# - `ros2_mcap`: A bag of ROS 2, to be written into one folder: plan.mcap and metadata.yaml. It has
# nav_msgs/msg/Trajectory and trajectory_msgs/msg/JointTrajectory.
ExportFormat = Literal["csv", "ros2_json", "ros2_mcap"]

# The optimiser.
# - `sequential_linear`: Trust-region sequential linear programming on an exact penalty.
# - `nelder_mead`: The paper's Nelder-Mead on the paper's penalty.
Method = Literal["sequential_linear", "nelder_mead"]

# The point of the chassis whose position and velocity start, goal and trajectory speak of.
# - `chassis_center_of_mass`: Centre of mass of the chassis, as in the paper; a payload does not move it.
# - `axle_midpoint`: Midpoint of the axle, what planners call base_link.
ReferencePoint = Literal["chassis_center_of_mass", "axle_midpoint"]

# Whether the wheels may slip.
# - `allowed`: Wherever it is faster; contradicts limits.grip_utilization.
# - `forbidden`: Never: both wheels stick at every step.
SlipPolicy = Literal["allowed", "forbidden"]

# How much of the answer is sent.
# - `full`: Everything.
# - `plan`: Without trajectory and contacts.
View = Literal["full", "plan"]


class _AssessRequestRequired(TypedDict):
    tolerances: Tolerances
    """When a sample is a success; required, with one tolerance at least."""
    uncertain: Sequence[Uncertainty]
    """What is not known, each parameter once; required. All of them are independent of each other."""


class AssessRequest(_AssessRequestRequired, total=False):
    """A plan to sample: exactly one of `solve` and `simulate`. Each sample is one rollout of its torques, by
    Coulomb's law, under changes of its own. Starts and ends are those of the axle midpoint, which keeps its place
    where the centre of mass moves.
    """

    payload: Payload
    """What it carries then; absent: what the plan was made for."""
    robot: Robot
    """The robot that drives the plan; absent: the one that it was made for. Without a footprint it has that one's."""
    samples: int
    """How many samples; default 1000. [>= 1, <= 10000]"""
    seed: int
    """Seed of all random numbers. Those of a parameter follow from seed, sample and parameter alone. [>= 0, <=
    1.84467e+19]
    """
    simulate: SimulatedPlan
    """An integrated torque schedule: its ends are compared with its own end."""
    solve: SolvedPlan
    """A solved maneuver: its ends are compared with the goal, and where that is free with the end of the plan."""


class BodyPoint(TypedDict, total=False):
    """A point of the robot, from the axle midpoint; absent is 0."""

    forward_m: float
    """Forward, m. [>= -100, <= 100]"""
    right_m: float
    """To the right, m. [>= -100, <= 100]"""


class _ExportRequestRequired(TypedDict):
    format: ExportFormat
    """What files are wanted; required."""
    rate_hz: float
    """Points per second, Hz; required. The last point is at the final time, whatever the rate. [>= 1, <= 10000]"""


class ExportRequest(_ExportRequestRequired, total=False):
    """A plan to hand over to a controller: exactly one of `solve` and `simulate`. Frames are those of REP-103 and
    REP-105: the pose is that of base_link, the axle midpoint, in the world of the maneuver, yaw = heading + pi/2;
    the twist is along the axes of base_link.
    """

    frame_id: str
    """The frame of the poses, the world of the maneuver; default odom."""
    joint_names: Sequence[str]
    """Names of the joints of the left and of the right wheel; an absent or empty list is left_wheel_joint,
    right_wheel_joint.
    """
    simulate: SimulatedPlan
    """An integrated torque schedule."""
    solve: SolvedPlan
    """A solved maneuver."""
    start_time: StartTime
    """When the plan begins; default 0."""


class Goal(TypedDict, total=False):
    """The goal at the reference point. Absent: position and heading are the start's, velocities and wheel rates are
    0, wheel angles are free. A goal at speed needs wheel rates that fit, or free ones: those of 0 ask for locked
    wheels that slide.
    """

    free: Sequence[str]
    """Names of further fields of the goal that are free; none of them may be given too."""
    heading_rad: float
    """Heading, rad, met modulo 2 pi: the fastest winding wins. [>= -10000, <= 10000]"""
    velocity_x_m_s: float
    """World x velocity, m/s. [>= -100, <= 100]"""
    velocity_y_m_s: float
    """World y velocity, m/s. [>= -100, <= 100]"""
    wheel_angle_left_rad: float
    """Left wheel angle, rad. [>= -1e+06, <= 1e+06]"""
    wheel_angle_right_rad: float
    """Right wheel angle, rad. [>= -1e+06, <= 1e+06]"""
    wheel_rate_left_rad_s: float
    """Left wheel rate, rad/s. [>= -100000, <= 100000]"""
    wheel_rate_right_rad_s: float
    """Right wheel rate, rad/s. [>= -100000, <= 100000]"""
    x_m: float
    """World x, m. [>= -10000, <= 10000]"""
    y_m: float
    """World y, m. [>= -10000, <= 10000]"""
    yaw_rate_rad_s: float
    """Yaw rate, rad/s. [>= -1000, <= 1000]"""


class InitialGuess(TypedDict):
    """A start of the search, tried first. All fields are required."""

    final_time_s: float
    """Final time, s, at least 1e-12. [>= 1e-12]"""
    torque_left_n_m: Numbers
    """Torques of the left wheel in equal intervals, N m."""
    torque_right_n_m: Numbers
    """Torques of the right wheel, as many, N m."""


class Maneuver(TypedDict, total=False):
    """Start, goal, and what the plan must keep."""

    goal: Goal
    """Absent: as if it were empty."""
    keep_in: Sequence[WorldPoint]
    """Corners of a convex aisle in the world, in either order: the footprint, which it needs, stays inside. An empty
    list is an absent one.
    """
    limits: ManeuverLimits
    """What the plan must keep on the way."""
    reference_point: ReferencePoint
    """The point that start and goal speak of."""
    slip: SlipPolicy
    """Whether the wheels may slip."""
    start: State | answers.EndState
    """Absent: at rest at the origin."""
    torque_limit_left_n_m: float
    """Largest torque magnitude of the left wheel, N m, 0 for a wheel without drive; default: the stall torque of the
    motor, 1 without one. [>= 0, <= 1e+06]
    """
    torque_limit_right_n_m: float
    """Largest torque magnitude of the right wheel, N m, 0 for a wheel without drive; default: the stall torque of
    the motor, 1 without one. [>= 0, <= 1e+06]
    """


class ManeuverLimits(TypedDict, total=False):
    """What a plan must keep at every step of its grid. An absent limit bounds nothing, apart from the first. Speed
    and accelerations are those of the reference point, or of the centre of the payload where there is one.
    """

    acceleration_m_s2: float
    """Largest acceleration while the speed grows, m/s2. [>= 0.0001, <= 10000]"""
    deceleration_m_s2: float
    """Largest acceleration while the speed falls, m/s2. [>= 0.0001, <= 10000]"""
    grip_utilization: float
    """Largest share of the grip of each wheel that its friction force may use, below 1; forbids slip. [>= 0.001, <
    1]
    """
    normal_load_share: float
    """Least normal force of each contact as a share of the robot's weight, at most half of the contact's share at
    rest; 0 for no more than no separation; default 0.01. Kept on the plan's grid; its replay asks only that no
    contact lifts off. [>= 0, <= 0.5]
    """
    speed_m_s: float
    """Largest speed, m/s. [>= 0.0001, <= 100]"""
    torque_rate_n_m_s: float
    """Largest magnitude of the change of the torque of each wheel per time, N m/s. [>= 1e-06, <= 1e+09]"""
    wheel_rate_rad_s: float
    """Largest magnitude of the rate of each wheel, rad/s. [>= 0.001, <= 100000]"""
    yaw_acceleration_rad_s2: float
    """Largest magnitude of the yaw acceleration, rad/s2. [>= 0.0001, <= 1e+06]"""
    yaw_rate_rad_s: float
    """Largest magnitude of the yaw rate, rad/s. [>= 0.0001, <= 1000]"""


class _PayloadRequired(TypedDict):
    height_m: float
    """Height of its centre of mass above the ground, m; required. [>= 0, <= 100]"""
    mass_kg: float
    """Mass, kg; required, 0 is no load, whose other fields have no effect. [>= 0, <= 50000]"""


class Payload(_PayloadRequired, total=False):
    """A load that is fixed to the chassis. Joined to it by the parallel-axis theorem, it is a heavier chassis with
    another centre of mass; a reference point `chassis_center_of_mass` stays that of the chassis alone.
    """

    forward_m: float
    """Its centre of mass ahead of the axle, m; default 0. [>= -100, <= 100]"""
    right_m: float
    """Its centre of mass to the right of the axle midpoint, m; default 0. [>= -100, <= 100]"""
    yaw_inertia_kg_m2: float
    """Yaw inertia about its own centre of mass, kg m2; default 0, a point. [>= 0, <= 500000]"""


class PresentRequest(TypedDict, total=False):
    """Plans to show together."""

    plans: Sequence[PresentedPlan]
    """1 to 4 plans, overlaid in every figure."""
    report: bool
    """Whether a report is written too."""


class PresentedPlan(TypedDict, total=False):
    """A request with its answer: exactly one of the two."""

    simulate: SimulatedPlan
    """An integrated torque schedule."""
    solve: SolvedPlan
    """A solved maneuver."""


class Robot(TypedDict, total=False):
    """The robot; the defaults are the reference robot. Lateral is positive to the right, longitudinal forward."""

    axle_to_front_support_m: float
    """Distance of the front support ahead of the axle, m; default 0.28. [>= 0.01, <= 100]"""
    center_of_mass_forward_m: float
    """Centre of mass of the chassis ahead of the axle, m; default 0.07. [>= -100, <= 100]"""
    center_of_mass_height_m: float
    """Height of the centre of mass above the ground, m; default 0.10. [>= 0, <= 100]"""
    center_of_mass_right_m: float
    """Centre of mass of the chassis to the right of the middle, m; default -0.02. [>= -100, <= 100]"""
    chassis_mass_kg: float
    """Mass of the chassis without wheels, kg; default 10.33. [>= 0.001, <= 100000]"""
    chassis_yaw_inertia_kg_m2: float
    """Yaw inertia of the chassis about its centre of mass, kg m2; default 0.20. [>= 1e-07, <= 1e+06]"""
    footprint: Sequence[BodyPoint]
    """Corners of the robot's convex outline, in either order; what `keep_in` keeps inside. Alone it has no effect,
    an empty list is an absent one.
    """
    front_friction_coefficient: float
    """Friction coefficient of the front support; default 0. [>= 0, <= 10]"""
    front_support_right_m: float
    """The front support to the right of the middle, m; default 0. [>= -100, <= 100]"""
    gravity_m_s2: float
    """Gravity, m/s2; default 9.81. [>= 0.01, <= 1000]"""
    motor_free_speed_rad_s: float
    """Speed of the motor of each wheel without load, rad/s at the wheel; given together with the stall torque. [>=
    0.001, <= 100000]
    """
    motor_stall_torque_n_m: float
    """Torque of the motor of each wheel at standstill, N m at the wheel, gears included; absent: no motor curve.
    Between there and the free speed the torque falls linearly. [>= 1e-06, <= 1e+06]
    """
    tangential_restitution: float
    """Tangential restitution of impacts, 0 to 1; default 0. [>= 0, <= 1]"""
    track_width_m: float
    """Distance of the wheels' contact points, m; default 0.30. [>= 0.01, <= 100]"""
    wheel_diametral_inertia_kg_m2: float
    """Inertia of one wheel about a diameter, kg m2; default 5.5e-4. [>= 1e-09, <= 10000]"""
    wheel_friction_coefficient: float
    """Friction coefficient of the wheels; default 0.45. [>= 0, <= 10]"""
    wheel_mass_kg: float
    """Mass of one wheel, kg; default 0.6. [>= 0.0001, <= 10000]"""
    wheel_radius_m: float
    """Radius of the wheels, m; default 0.06. [>= 0.001, <= 10]"""
    wheel_spin_inertia_kg_m2: float
    """Inertia of one wheel about its axle, kg m2; default 3.0e-3. [>= 1e-09, <= 10000]"""
    wheel_viscous_friction_n_m_s: float
    """Viscous friction between chassis and each wheel, N m s/rad; default 0. [>= 0, <= 10000]"""


class SimulateGrid(TypedDict, total=False):
    """The time grid of a simulation."""

    steps: int
    """Number of time steps; default 200, or the next multiple of the number of intervals. Each step has the torques
    at its midpoint: on other numbers some intervals last a step longer than others. [>= 1, <= 10000]
    """


class _SimulateRequestRequired(TypedDict):
    torque_schedule: TorqueSchedule | answers.TorqueSchedule
    """The torques; required."""


class SimulateRequest(_SimulateRequestRequired, total=False):
    """A torque schedule to integrate."""

    contact_solver: ContactSolver
    """The solver of the one-step friction problem."""
    grid: SimulateGrid
    """The time grid."""
    keep_in: Sequence[WorldPoint]
    """Corners of a convex aisle in the world, in either order, which the footprint is compared with. An empty list
    is an absent one.
    """
    limits: ManeuverLimits
    """What the motion is compared with: the answer says how far it uses each limit that is given, and never changes
    by it. They are always compared with the motion of the exact contact solver. `normal_load_share` has no effect
    here.
    """
    payload: Payload
    """What the robot carries; absent: nothing."""
    reference_point: ReferencePoint
    """The point that the start and the answer speak of."""
    robot: Robot
    """The robot; absent: the reference robot."""
    start: State | answers.EndState
    """Absent: at rest at the origin."""


class SimulatedPlan(TypedDict):
    """An integrated torque schedule. The motion is rolled out again from the request."""

    answer: answers.SimulateResponse
    """What was answered; required. Null is absent, and what is not known is ignored."""
    request: SimulateRequest
    """What was asked; required."""


class SolveGrid(TypedDict, total=False):
    """The time grid of a solve."""

    control_intervals: int
    """Torques per wheel; default 40. [>= 1, <= 1000]"""
    steps: int
    """Number of time steps. Absent: automatic, refined until the plan's replay is within tolerance. [>= 1, <= 10000]"""


class SolveRequest(TypedDict, total=False):
    """A maneuver to solve."""

    grid: SolveGrid
    """The time grid."""
    initial_guess: InitialGuess
    """A start of the search, tried first."""
    maneuver: Maneuver
    """Start, goal, and what the plan must keep."""
    payload: Payload
    """What the robot carries; absent: nothing."""
    robot: Robot
    """The robot; absent: the reference robot."""
    solver: Solver
    """Search effort and tolerances."""
    view: View
    """How much of the answer is sent."""


class SolvedPlan(TypedDict):
    """A solved maneuver. The motion is rolled out again from the request and the torques of the answer, so the view
    plan is enough: `trajectory` and `contacts` are not read.
    """

    answer: answers.Solution
    """What was answered; required. Null is absent, and what is not known is ignored."""
    request: SolveRequest
    """What was asked; required."""


class Solver(TypedDict, total=False):
    """Search effort and tolerances."""

    choose: Choice
    """Which of the local optima is the answer."""
    choose_within: float
    """How much slower than the fastest local optimum the answer may be, as a share of its final time; without effect
    on the fastest; default 0.01. [>= 0, <= 1]
    """
    goal_tolerance: float
    """Largest accepted magnitude of each goal error (m, rad, m/s, rad/s); default 1e-6. [>= 1e-09, <= 1]"""
    method: Method
    """The optimiser."""
    replay_tolerance_m: float
    """Largest accepted replay miss of the position, and of a wheel's rim where the goal fixes wheel angles, m;
    default 0.001. [>= 1e-09, <= 100]
    """
    replay_tolerance_rad: float
    """Largest accepted replay miss of the heading, rad; default 0.001. [>= 1e-09, <= 100]"""
    rollout_limit: int
    """Most rollouts that the search may spend; default 2,000,000. [>= 1, <= 1e+08]"""
    seed: int
    """Seed of all randomness; default 0. [>= 0, <= 1.84467e+19]"""
    starts: int
    """How many starts the search tries, and as many more where none leads to a plan; automatic steps then begin
    again on a finer grid. Default 36. [>= 1, <= 64]
    """
    time_limit_s: float
    """How long the solve may run, s, counted from its start; default 10. [> 0, <= 60]"""


class StartTime(TypedDict, total=False):
    """An instant as ROS has it; absent is 0."""

    nanosec: int
    """Nanoseconds beside them. [>= 0, <= 1e+09]"""
    sec: int
    """Whole seconds. [>= 0, <= 2.147e+09]"""


class State(TypedDict, total=False):
    """A state at the reference point; absent is 0."""

    heading_rad: float
    """Heading, rad. [>= -10000, <= 10000]"""
    velocity_x_m_s: float
    """World x velocity, m/s. [>= -100, <= 100]"""
    velocity_y_m_s: float
    """World y velocity, m/s. [>= -100, <= 100]"""
    wheel_angle_left_rad: float
    """Left wheel angle, rad. [>= -1e+06, <= 1e+06]"""
    wheel_angle_right_rad: float
    """Right wheel angle, rad. [>= -1e+06, <= 1e+06]"""
    wheel_rate_left_rad_s: float
    """Left wheel rate, rad/s. [>= -100000, <= 100000]"""
    wheel_rate_right_rad_s: float
    """Right wheel rate, rad/s. [>= -100000, <= 100000]"""
    x_m: float
    """World x, m. [>= -10000, <= 10000]"""
    y_m: float
    """World y, m. [>= -10000, <= 10000]"""
    yaw_rate_rad_s: float
    """Yaw rate, rad/s. [>= -1000, <= 1000]"""


class Tolerances(TypedDict, total=False):
    """The largest magnitude of each error of the end; absent: any."""

    across_m: float
    """Across it, m. [>= 1e-09, <= 10000]"""
    along_m: float
    """Along the heading of the goal, m. [>= 1e-09, <= 10000]"""
    distance_m: float
    """In any direction, m. [>= 1e-09, <= 10000]"""
    heading_rad: float
    """Of the heading, modulo 2 pi, rad. [>= 1e-09, <= 4]"""
    speed_m_s: float
    """Of the velocity, m/s. [>= 1e-09, <= 10000]"""


class TorqueSchedule(TypedDict):
    """Piecewise constant torques."""

    interval_s: float
    """Length of one interval, s, at least 1e-12; required in requests."""
    left_n_m: Numbers
    """Torques of the left wheel, N m."""
    right_n_m: Numbers
    """Torques of the right wheel, as many, N m."""


class _UncertaintyRequired(TypedDict):
    parameter: ChangedParameter
    """The parameter; required."""


class Uncertainty(_UncertaintyRequired, total=False):
    """What is known of a parameter: a band, each value of which is as likely as any other, or a normal distribution.
    The numbers are changes: a share multiplies by 1 + change, anything else is added.
    """

    high: float
    """The largest change."""
    low: float
    """The least change; with `high`."""
    mean: float
    """The mean of the changes; with `standard_deviation`."""
    standard_deviation: float
    """Their standard deviation."""


class WorldPoint(TypedDict, total=False):
    """A point of the world; absent is 0."""

    x_m: float
    """World x, m. [>= -10000, <= 10000]"""
    y_m: float
    """World y, m. [>= -10000, <= 10000]"""
