"""Answers; nan stands for numbers of arrays that are not finite, None for other ones."""

# Written by make_types.py: do not edit.

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

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

# Whether a contact slips.
# - `stick`: No slip.
# - `slip`: Slip; also a contact without friction or without normal force.
ContactMode = Literal["stick", "slip"]

# A contact of the robot with the ground.
# - `left`: The left wheel.
# - `right`: The right wheel.
# - `front`: The front support.
ContactName = Literal["left", "right", "front"]

# The solver of the one-step friction problem.
# - `exact`: Contact patterns solved exactly.
# - `fixed_point`: The paper's prox fixed point.
ContactSolver = Literal["exact", "fixed_point"]

# What the lower bound on the final time rests on.
# - `friction`: Friction bounds the acceleration of the whole robot's centre of mass.
# - `yaw_friction`: Friction bounds the yaw acceleration.
# - `drive_torque`: Torque builds up the motion that carries the robot; friction brakes it.
# - `wheel_drive`: Torque and friction bound the acceleration of each wheel.
# - `limits`: Limits of the maneuver bound speeds, accelerations or slip, beside friction and torque.
LowerBoundAssumption = Literal["friction", "yaw_friction", "drive_torque", "wheel_drive", "limits"]

# The optimiser.
# - `sequential_linear`: Trust-region sequential linear programming on an exact penalty.
# - `nelder_mead`: The paper's Nelder-Mead on the paper's penalty.
Method = Literal["sequential_linear", "nelder_mead"]

# The point of the chassis whose position and velocity start, goal and trajectory speak of.
# - `chassis_center_of_mass`: Centre of mass of the chassis, as in the paper; a payload does not move it.
# - `axle_midpoint`: Midpoint of the axle, what planners call base_link.
ReferencePoint = Literal["chassis_center_of_mass", "axle_midpoint"]

# How the steps of the plan's grid came about.
# - `fixed`: The caller chose them.
# - `within_tolerance`: Automatic: the replay is within tolerance.
# - `step_limit`: Automatic: the replay is above tolerance on the finest allowed grid.
# - `goal_lost`: Automatic: the goal was lost on finer grids.
# - `interrupted`: Automatic: a limit of time or rollouts ended the refinement.
# - `no_plan`: Automatic: no plan met the goal, so there was nothing to refine.
Refinement = Literal["fixed", "within_tolerance", "step_limit", "goal_lost", "interrupted", "no_plan"]

# A part of a search that takes time of its own.
# - `start`: Plans are sought from each start.
# - `polish`: The best of them are worked on.
# - `refinement`: The plan is carried to a finer grid.
# - `certificate`: Why to trust the plan is found out.
SearchPhase = Literal["start", "polish", "refinement", "certificate"]

# How good a plan is.
# - `converged`: Goal met within the limits, `normal_load_share` kept, first-order measure small, no separation, contact
# law kept.
# - `feasible`: Goal met within the limits, but not shown to be a local optimum (it is none, or the certificate was cut
# off by the time limit or the deadline), or a contact carries less than `normal_load_share`, separates, or breaks the
# contact law.
# - `not_converged`: Best iterate; the goal is missed, or a limit on the way exceeded.
# - `infeasible`: Shown to be impossible.
Status = Literal["converged", "feasible", "not_converged", "infeasible"]

# Why a solve ended.
# - `finished`: The whole search asked for was done, and its plan certified.
# - `time_limit`: The time limit passed.
# - `deadline`: The deadline of the call came near.
# - `rollout_limit`: The rollout limit was used up.
StopReason = Literal["finished", "time_limit", "deadline", "rollout_limit"]


@dataclass(frozen=True, kw_only=True, eq=False)
class AppliedChange:
    """A change of one sample."""

    change: float
    """By how much."""
    parameter: ChangedParameter
    """The parameter."""
    unit: str
    """The unit of the change: share, m, rad, kg or s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AppliedLimits:
    """The limits that applied to a solve."""

    time_limit_s: float
    """How long it was allowed to run, s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AssessResponse:
    """How often a plan succeeds. The same request has the same answer, whatever the number of workers."""

    grid_factor: int
    """How many times finer than the plan's that grid is."""
    limits: list[LimitExcess]
    """How many samples exceed each limit that the plan was given, in the order of its report."""
    mean: EndErrors
    """Mean errors, with their signs; null (in protobuf not a number) without motions."""
    nominal: EndErrors
    """The errors of the motion without changes there."""
    nominal_success: bool
    """Whether the motion without changes is a success there."""
    quantiles: list[ErrorQuantile]
    """Magnitudes that a share of the samples do not exceed: 0.05, 0.25, 0.5, 0.75, 0.95 and 1. Null (in protobuf
    infinite or not a number) where motions diverge, and without motions.
    """
    refused: int
    """Samples whose changes break the rules of the robot or are impossible; they have no motion, and fail."""
    samples: int
    """How many samples."""
    separations: int
    """Samples in which a contact lifts, which no longer is the model's motion; they fail."""
    shares: list[VarianceShares]
    """What each parameter alone adds to the variance of each error, in the order of the request."""
    steps: int
    """Steps of a sample without delay: on the first grid of 1, 2, 4, 8 and 16 times the plan's on which the motion
    without changes is a success. Where there is none, and where finer ones would take more than 10,000 steps a
    sample or 20,000,000 in all: the finest. A delay adds steps as long; where they would be more than 20,000 they
    are longer.
    """
    success_rate: float
    """Their share."""
    success_rate_high: float
    """Its upper end."""
    success_rate_low: float
    """Wilson's interval of 95 % for that share: its lower end."""
    successes: int
    """Those within all tolerances in which no contact lifts."""
    worst: WorstSample | None
    """The sample with the largest error for its tolerance, one in which a contact lifts before all others; null (in
    protobuf absent) where all are refused.
    """


@dataclass(frozen=True, kw_only=True, eq=False)
class AxesMap:
    """Where the data of one pair of axes lie in the viewBox of its figure."""

    axes: str
    """Name of the axes, unique in the figure, such as left_longitudinal_force."""
    x: AxisMap
    """Across."""
    y: AxisMap
    """Up."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisMap:
    """One axis: linear from the first to the second pair of numbers."""

    data: Array
    """The values at its two ends."""
    px: Array
    """Where the two ends are, px of the viewBox."""
    quantity: str
    """What it measures, with its unit, such as time_s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyPoint:
    """A point of the robot, from the axle midpoint; absent is 0."""

    forward_m: float | None = None
    """Forward, m."""
    right_m: float | None = None
    """To the right, m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """One contact; one entry per step. Forces are the step's means."""

    lateral_force_n: Array
    """Friction force to the right, N."""
    lateral_slip_m_s: Array
    """Slip to the right, m/s."""
    longitudinal_force_n: Array
    """Friction force forward, N."""
    longitudinal_slip_m_s: Array
    """Slip forward, m/s."""
    normal_force_n: Array
    """Normal force, N."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactModeSpan:
    """A span of time with constant contact modes."""

    degrees_of_freedom: int
    """5 minus the rank of the sticking directions."""
    end_s: float
    """Its end, s."""
    front: ContactMode
    """The front support."""
    left: ContactMode
    """The left wheel."""
    right: ContactMode
    """The right wheel."""
    start_s: float
    """Its start, s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Contacts:
    """Forces and slips of all contacts."""

    front: Contact
    """The front support."""
    left: Contact
    """The left wheel."""
    right: Contact
    """The right wheel."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossFieldRule:
    """A rule that several fields must keep together."""

    fields: list[str]
    """Dotted paths of the fields."""
    job: str
    """The kind of job whose requests have the fields."""
    rule: str
    """What must hold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DistinctOptimum:
    """A local optimum."""

    count: int
    """How many starts, and spins of the best plan, led to it; those that were given up on the way do not count."""
    final_time_s: float
    """Its final time, s."""
    friction_shift_m: float | None = None
    """How far its end shifts with 10 % less friction, m, as in `sensitivity`, on the grid of the search; left out
    where nothing moves, and where the search was stopped.
    """
    friction_shift_rad: float | None = None
    """The same of its heading, rad."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EndErrors:
    """How far an end is from where it should be."""

    across_m: float | None
    """Across it, m; positive to the left."""
    along_m: float | None
    """Along the heading of the goal, m; positive ahead of it."""
    distance_m: float | None
    """In any direction, m; not negative."""
    heading_rad: float | None
    """Of the heading, modulo 2 pi, rad; positive to the left."""
    speed_m_s: float | None
    """Magnitude of the difference of the velocities, m/s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EndState:
    """The state of the reference point at the end, as a goal judges it. A step keeps the friction law at the heading
    of its midpoint, so the velocity of the chassis centre of mass is first turned by half the angle of the last
    step, then moved to the reference point; with restitution e it is the mean of the velocities turned so forwards
    and, counting e times, backwards.
    """

    heading_rad: float | None
    """Heading, rad, not wrapped."""
    velocity_x_m_s: float | None
    """World x velocity, m/s."""
    velocity_y_m_s: float | None
    """World y velocity, m/s."""
    wheel_angle_left_rad: float | None
    """Left wheel angle, rad."""
    wheel_angle_right_rad: float | None
    """Right wheel angle, rad."""
    wheel_rate_left_rad_s: float | None
    """Left wheel rate, rad/s."""
    wheel_rate_right_rad_s: float | None
    """Right wheel rate, rad/s."""
    x_m: float | None
    """World x, m."""
    y_m: float | None
    """World y, m."""
    yaw_rate_rad_s: float | None
    """Yaw rate, rad/s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorQuantile:
    """What a share of the samples do not exceed."""

    errors: EndErrors
    """The magnitudes, each for itself."""
    share: float
    """The share."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportResponse:
    """A plan as files, and what a controller that follows its twist alone would miss."""

    files: list[ExportedFile]
    """The files, with names that depend on the format alone."""
    miss_m: float | None
    """Distance between the last pose and where the twist leads, linear between the points and integrated from the
    first pose, m.
    """
    miss_rad: float | None
    """The same of the yaw, rad."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportedFile:
    """A file."""

    base64: str
    """Its content in base64."""
    media_type: str
    """Its media type."""
    name: str
    """Its name, such as trajectory.csv."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldError:
    """One fault of one field."""

    code: str
    """The code of the broken rule."""
    limit: float | None
    """The bound that was passed, where the rule is a bound."""
    message: str
    """Field, value and rule."""
    pointer: str
    """JSON pointer as a URI fragment, such as `#/robot/wheel_radius_m`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldRule:
    """The bounds of a number, or of the length of an array."""

    exclusive_maximum: float | None = None
    """All accepted values are less than this."""
    exclusive_minimum: float | None = None
    """All accepted values are greater than this."""
    field: str
    """Dotted path, such as robot.wheel_radius_m; \\[\\] stands for each item of an array."""
    job: str
    """The kind of job whose requests have the field, such as solve."""
    maximum: float | None = None
    """The largest accepted value on this server, unless exclusive_maximum is there; absent both: there is none."""
    minimum: float | None = None
    """The smallest accepted value, unless exclusive_minimum is there."""
    rule: str
    """The bounds in words, such as "between 0.001 and 10 m"."""
    unit: str
    """The unit; "items" for the length of an array, empty for pure numbers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Figure:
    """A figure, complete by itself."""

    caption: str
    """What it shows, in a sentence or two."""
    height_px: float
    """Height of its viewBox, px."""
    maps: list[AxesMap]
    """Where the data lie, one entry per axes."""
    name: str
    """Its name, stable: path, contact, motion, torques, normal_forces, wheel_rates, friction."""
    svg: str
    """An SVG document without style and script. Its colours are presentation attributes, and what has one has a
    class that starts with `sd-`, by which a page may give it another.
    """
    title: str
    """Its title."""
    width_px: float
    """Width of its viewBox, px."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GetLimitsResponse:
    """What this server accepts at most."""

    batch_window: int
    """Items of a batch that may be unanswered at once."""
    cross_field_rules: list[CrossFieldRule]
    """What several fields must keep together, by kind of job."""
    default_time_limit_s: float
    """Time limit of a solve that names none, s."""
    jobs: list[JobLimits]
    """What each kind of job takes."""
    light_queue_length: int
    """Light jobs that may wait for the one thread that runs them beside the workers."""
    max_body_bytes: int
    """Largest request, bytes, of the kinds of jobs that have no other."""
    max_control_intervals: int
    """Most control intervals per wheel."""
    max_rollout_limit: int
    """Most rollouts of one search."""
    max_starts: int
    """Most starts of one search."""
    max_steps: int
    """Most time steps of a grid."""
    max_time_limit_s: float
    """Longest time limit of a solve, and that of each simulation, s."""
    queue_length: int
    """Jobs that may wait for a worker."""
    queue_work_s: float
    """Expected work per worker that may be in flight before more is refused, s."""
    rules: list[FieldRule]
    """The bounds of single fields, by kind of job."""
    workers: int
    """Jobs that run at once, light ones apart."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalError:
    """`end_state` minus goal; wheel angles appear only where the goal constrains them."""

    heading_rad: float | None
    """Heading modulo 2 pi, rad."""
    velocity_x_m_s: float | None
    """World x velocity, m/s."""
    velocity_y_m_s: float | None
    """World y velocity, m/s."""
    wheel_angle_left_rad: float | None = None
    """Left wheel angle, rad."""
    wheel_angle_right_rad: float | None = None
    """Right wheel angle, rad."""
    wheel_rate_left_rad_s: float | None
    """Left wheel rate, rad/s."""
    wheel_rate_right_rad_s: float | None
    """Right wheel rate, rad/s."""
    x_m: float | None
    """World x, m."""
    y_m: float | None
    """World y, m."""
    yaw_rate_rad_s: float | None
    """Yaw rate, rad/s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JobLimits:
    """What a kind of job takes."""

    job: str
    """The kind of job, such as solve."""
    light: bool
    """Whether it runs beside the workers, so that it never waits behind a solve."""
    max_body_bytes: int
    """Its largest request, bytes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LimitExcess:
    """How often a limit is exceeded."""

    limit: str
    """The field of the request that has the limit, such as maneuver.limits.speed_m_s."""
    samples: int
    """Samples that exceed it by more than 0.5 %."""
    value: float
    """What is allowed, in the unit of the field."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LimitUse:
    """How far a motion uses one of the limits that were given."""

    excess: float | None
    """The largest use above the limit as a share of the limit, on the grid of the motion; at most 0 where it is
    kept.
    """
    largest: float | None
    """The largest use, in the unit of the field."""
    limit: str
    """The field of the request that has the limit, such as maneuver.limits.speed_m_s."""
    replay_excess: float | None
    """The same on the finer grid of the replay; null (in protobuf absent) where nothing was replayed."""
    time_s: float
    """When, s."""
    value: float
    """What is allowed, in the unit of the field."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ManeuverLimits:
    """What a plan must keep at every step of its grid. An absent limit bounds nothing, apart from the first. Speed
    and accelerations are those of the reference point, or of the centre of the payload where there is one.
    """

    acceleration_m_s2: float | None = None
    """Largest acceleration while the speed grows, m/s2."""
    deceleration_m_s2: float | None = None
    """Largest acceleration while the speed falls, m/s2."""
    grip_utilization: float | None = None
    """Largest share of the grip of each wheel that its friction force may use, below 1; forbids slip."""
    normal_load_share: float | None = None
    """Least normal force of each contact as a share of the robot's weight, at most half of the contact's share at
    rest; 0 for no more than no separation; default 0.01. Kept on the plan's grid; its replay asks only that no
    contact lifts off.
    """
    speed_m_s: float | None = None
    """Largest speed, m/s."""
    torque_rate_n_m_s: float | None = None
    """Largest magnitude of the change of the torque of each wheel per time, N m/s."""
    wheel_rate_rad_s: float | None = None
    """Largest magnitude of the rate of each wheel, rad/s."""
    yaw_acceleration_rad_s2: float | None = None
    """Largest magnitude of the yaw acceleration, rad/s2."""
    yaw_rate_rad_s: float | None = None
    """Largest magnitude of the yaw rate, rad/s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NormalLoad:
    """A normal force as a share of the robot's weight."""

    contact: ContactName
    """Which contact."""
    share: float | None
    """The share; negative where the contact would have had to pull."""
    time_s: float
    """When, s: the start of its step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Payload:
    """A load that is fixed to the chassis. Joined to it by the parallel-axis theorem, it is a heavier chassis with
    another centre of mass; a reference point `chassis_center_of_mass` stays that of the chassis alone.
    """

    forward_m: float | None = None
    """Its centre of mass ahead of the axle, m; default 0."""
    height_m: float
    """Height of its centre of mass above the ground, m; required."""
    mass_kg: float
    """Mass, kg; required, 0 is no load, whose other fields have no effect."""
    right_m: float | None = None
    """Its centre of mass to the right of the axle midpoint, m; default 0."""
    yaw_inertia_kg_m2: float | None = None
    """Yaw inertia about its own centre of mass, kg m2; default 0, a point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanInWords:
    """What is said of a plan."""

    certificate: list[str]
    """Why to trust the plan, in sentences; empty where its motion does not end where the answer says."""
    details: list[str]
    """The answer in further sentences."""
    end_difference: float | None
    """Largest difference between the end of the motion and `end_state`, in any of its fields; null (in protobuf not
    a number) where the answer has no end.
    """
    headline: str
    """The answer in one sentence."""
    label: str
    """Its name in the figures: A, B, C or D."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PresentResponse:
    """Figures of plans, and the plans in words."""

    figures: list[Figure]
    """Figures in the order in which they are read. Those that need a motion are left out where no plan moves."""
    plans: list[PlanInWords]
    """What is said of each plan, in the order of the request."""
    report_html: str
    """All of it as one page that needs nothing beside it, with what was asked and answered and how to repeat it, in
    HTML; empty where no report was asked for.
    """


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """An error as RFC 9457 says, with the code, the faults of single fields, and when to come back."""

    code: str
    """What kind of problem it is, for programs."""
    detail: str
    """What happened this time, for people."""
    errors: list[FieldError]
    """The faults of single fields."""
    instance: str
    """The path that was asked."""
    request_id: str
    """The id of the request, which the log of the server has too."""
    retry_after_ms: int | None
    """When it is worth trying again, where that is known, ms."""
    retryable: bool
    """Whether the same request may succeed later."""
    status: int
    """The status of HTTP."""
    title: str
    """What kind of problem it is, for people."""
    type: str
    """Names the kind of problem, as a URI."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Progress:
    """The best iterate of a running solve."""

    best_final_time_s: float | None
    """Its final time, s."""
    best_goal_error: float | None
    """Largest magnitude of its goal errors (m, rad, m/s, rad/s)."""
    phase: SearchPhase
    """What the search does; starts and polishes overlap: the later of them."""
    start: int
    """The running start, from 1."""
    start_count: int
    """Number of starts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Queued:
    """A solve was queued."""

    position: int
    """Position in the queue: 0 when a worker was idle, 1 when it is the next to start."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reason:
    """A requirement that is not met. Of an infeasible maneuver, found without search, the answer shows the start:
    one node, an empty schedule, its goal error.
    """

    code: str
    """Stable code in snake_case. Infeasible: no_torque, no_friction, final_time_too_long, start_separates,
    goal_separates, start_below_load_share, goal_below_load_share, start_outside, goal_outside, start_exceeds_limit,
    goal_exceeds_limit, start_slips, goal_slips. Not converged: goal_missed, limit_exceeded, motion_diverges.
    """
    field: str
    """The field of the request that cannot be met."""
    limit: float
    """What was required. goal_missed, motion_diverges, no_torque, no_friction: `solver.goal_tolerance`.
    final_time_too_long: the longest final time that is searched, s. start_separates, goal_separates: 0 N.
    start_below_load_share, goal_below_load_share: the least normal force that the contact must have, N.
    start_outside, goal_outside: 0 m. start_slips, goal_slips: what the goal tolerance leaves, m/s.
    start_exceeds_limit, goal_exceeds_limit, limit_exceeded: the limit.
    """
    message: str
    """One sentence for people, with what would help."""
    time_s: float | None = None
    """When it fails, s: 0 at the start, the least final time, the end of the best plan, or when it uses most of the
    limit. Absent where nobody knows: goal_separates, goal_below_load_share, goal_outside, goal_exceeds_limit,
    goal_slips, motion_diverges.
    """
    value: float | None
    """What was reached, or the most or least that can be: above `limit`, or below it if it is a normal force.
    goal_missed, motion_diverges, no_torque, no_friction: the magnitude of the goal error of `field`, of the best
    plan or of the start, in its unit; within `limit` where the start meets the field but cannot keep it.
    final_time_too_long: the least final time, s. start_separates, goal_separates, start_below_load_share,
    goal_below_load_share: the largest normal force that the contact can have, N. start_outside, goal_outside: how
    far the worst corner of the footprint is outside, m. start_slips, goal_slips: the slip speed of a wheel, m/s.
    start_exceeds_limit, goal_exceeds_limit, limit_exceeded: the largest use of the limit, in the unit of `field`.
    Null (in protobuf not finite) where the motion diverges.
    """


@dataclass(frozen=True, kw_only=True, eq=False)
class Replay:
    """The same torques on a 16x finer grid."""

    miss_heading_rad: float | None
    """Difference of its heading, rad."""
    miss_m: float | None
    """The larger of the distance of its end from the goal position and of what a wheel's rim misses where the goal
    fixes wheel angles, m.
    """
    miss_speed_m_s: float | None
    """Difference of its velocity, m/s."""
    miss_wheel_speed_m_s: float | None
    """Largest difference of a wheel's rim speed, m/s."""
    miss_yaw_rate_rad_s: float | None
    """Difference of its yaw rate, rad/s."""
    separations: int
    """Steps in which a contact would have had to pull."""
    steps: int
    """Steps of the fine grid."""
    within_tolerance: bool
    """Whether all misses are within the asked tolerances, those of speeds by what they move in a second, no contact
    separates, and no limit is exceeded there by more than half a percent of it.
    """


@dataclass(frozen=True, kw_only=True, eq=False)
class Report:
    """What a plan states about itself."""

    control_intervals: int
    """Torques per wheel."""
    distinct_optima: list[DistinctOptimum]
    """Local optima seen, fastest first."""
    indeterminate_steps: int
    """Steps for whose friction problem a second solution was found; all where the certificate was cut off."""
    iterations: int
    """Iterations over all starts."""
    least_normal_load: NormalLoad | None
    """The smallest normal force on the way; null without motion."""
    limits: list[LimitUse] | None = None
    """How far the plan uses each limit that was given; left out where none was."""
    lower_bound_assumption: LowerBoundAssumption | None
    """What the bound rests on; null (in protobuf unspecified) where there is none."""
    lower_bound_s: float | None
    """No plan on this grid within the limits is faster, s; null (in protobuf not a number) where the certificate was
    cut off.
    """
    method: Method
    """The optimiser used."""
    predicted_decrease_s: float | None
    """Decrease of the final time that the linear model still predicts, s, at most that time; where the goal is
    missed, coming nearer to it counts as a decrease too. The final time where the certificate was cut off.
    """
    refinement: Refinement
    """How the steps were chosen, and why no finer ones."""
    replay: Replay | None
    """The plan on a finer grid; null where the certificate was cut off."""
    rollouts: int
    """Rollouts spent."""
    sensitivity: list[Sensitivity] | None = None
    """How far small changes shift the end under the same torques; left out where nothing moves, and where the
    certificate was cut off.
    """
    separations: list[Separation]
    """Steps in which a contact would have had to pull."""
    slip_reversals: int
    """Slip reversals, where derivatives mislead."""
    solve_time_s: float
    """How long the solve ran on its worker, s."""
    starts_tried: int
    """Starts tried."""
    steps: int
    """Steps of the plan's grid."""
    switching_sign_violations: int
    """Torques that contradict the sign of the switching function; all where the certificate was cut off."""
    worst_contact_residual: float | None
    """Largest residual of the contact law, relative to m g dt."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """The robot; the defaults are the reference robot. Lateral is positive to the right, longitudinal forward."""

    axle_to_front_support_m: float | None = None
    """Distance of the front support ahead of the axle, m; default 0.28."""
    center_of_mass_forward_m: float | None = None
    """Centre of mass of the chassis ahead of the axle, m; default 0.07."""
    center_of_mass_height_m: float | None = None
    """Height of the centre of mass above the ground, m; default 0.10."""
    center_of_mass_right_m: float | None = None
    """Centre of mass of the chassis to the right of the middle, m; default -0.02."""
    chassis_mass_kg: float | None = None
    """Mass of the chassis without wheels, kg; default 10.33."""
    chassis_yaw_inertia_kg_m2: float | None = None
    """Yaw inertia of the chassis about its centre of mass, kg m2; default 0.20."""
    footprint: list[BodyPoint] | None = None
    """Corners of the robot's convex outline, in either order; what `keep_in` keeps inside. Alone it has no effect,
    an empty list is an absent one.
    """
    front_friction_coefficient: float | None = None
    """Friction coefficient of the front support; default 0."""
    front_support_right_m: float | None = None
    """The front support to the right of the middle, m; default 0."""
    gravity_m_s2: float | None = None
    """Gravity, m/s2; default 9.81."""
    motor_free_speed_rad_s: float | None = None
    """Speed of the motor of each wheel without load, rad/s at the wheel; given together with the stall torque."""
    motor_stall_torque_n_m: float | None = None
    """Torque of the motor of each wheel at standstill, N m at the wheel, gears included; absent: no motor curve.
    Between there and the free speed the torque falls linearly.
    """
    tangential_restitution: float | None = None
    """Tangential restitution of impacts, 0 to 1; default 0."""
    track_width_m: float | None = None
    """Distance of the wheels' contact points, m; default 0.30."""
    wheel_diametral_inertia_kg_m2: float | None = None
    """Inertia of one wheel about a diameter, kg m2; default 5.5e-4."""
    wheel_friction_coefficient: float | None = None
    """Friction coefficient of the wheels; default 0.45."""
    wheel_mass_kg: float | None = None
    """Mass of one wheel, kg; default 0.6."""
    wheel_radius_m: float | None = None
    """Radius of the wheels, m; default 0.06."""
    wheel_spin_inertia_kg_m2: float | None = None
    """Inertia of one wheel about its axle, kg m2; default 3.0e-3."""
    wheel_viscous_friction_n_m_s: float | None = None
    """Viscous friction between chassis and each wheel, N m s/rad; default 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity:
    """How far one change shifts the end, on the plan's grid and by Coulomb's law: also a plan whose wheels may not
    slip slips where the floor is worse. Start and end are those of the axle midpoint.
    """

    change: float
    """By how much: a share multiplies by 1 + change, anything else is added."""
    end_shift_m: float | None
    """Distance of the end from the end of the plan, m; null (in protobuf absent) where the change is refused."""
    end_shift_rad: float | None
    """Difference of the headings there, not wrapped, rad, at least 0; null (in protobuf absent) where the change is
    refused.
    """
    parameter: ChangedParameter
    """What is changed."""
    refused: str | None
    """The field whose rule refuses the change; null (in protobuf absent) where none does."""
    separates: bool
    """Whether a contact lifts on the way, which no longer is the model's motion."""
    unit: str
    """The unit of the change: share, m or rad."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Separation:
    """A step in which a contact would have had to pull."""

    contact: ContactName
    """Which contact."""
    normal_force_n: float | None
    """The normal force that it would have needed, N."""
    time_s: float
    """When, s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulateGrid:
    """The time grid of a simulation."""

    steps: int | None = None
    """Number of time steps; default 200, or the next multiple of the number of intervals. Each step has the torques
    at its midpoint: on other numbers some intervals last a step longer than others.
    """


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulateRequest:
    """A torque schedule to integrate."""

    contact_solver: ContactSolver | None = None
    """The solver of the one-step friction problem."""
    grid: SimulateGrid | None = None
    """The time grid."""
    keep_in: list[WorldPoint] | None = None
    """Corners of a convex aisle in the world, in either order, which the footprint is compared with. An empty list
    is an absent one.
    """
    limits: ManeuverLimits | None = None
    """What the motion is compared with: the answer says how far it uses each limit that is given, and never changes
    by it. They are always compared with the motion of the exact contact solver. `normal_load_share` has no effect
    here.
    """
    payload: Payload | None = None
    """What the robot carries; absent: nothing."""
    reference_point: ReferencePoint | None = None
    """The point that the start and the answer speak of."""
    robot: Robot | None = None
    """The robot; absent: the reference robot."""
    start: State | None = None
    """Absent: at rest at the origin."""
    torque_schedule: TorqueSchedule
    """The torques; required."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulateResponse:
    """The motion under a torque schedule."""

    contact_modes: list[ContactModeSpan]
    """Contact modes over time."""
    contacts: Contacts
    """Forces and slips."""
    end_state: EndState
    """The end state as a goal judges it."""
    indeterminate_steps: int
    """Steps for whose friction problem a second solution was found."""
    limits: list[LimitUse] | None = None
    """How far the motion uses each limit that was given; left out where none was."""
    separations: list[Separation]
    """Steps in which a contact would have had to pull."""
    slip_reversals: int
    """Slip reversals."""
    trajectory: Trajectory
    """The motion of the reference point."""
    worst_contact_residual: float | None
    """Largest residual of the contact law, relative to m g dt; null (in protobuf not a number) where the motion
    diverges.
    """


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """A plan with its status and report."""

    applied_limits: AppliedLimits
    """The limits that applied."""
    contact_modes: list[ContactModeSpan]
    """Contact modes over time."""
    contacts: Contacts | None = None
    """Forces and slips; left out of the view plan."""
    end_state: EndState
    """The end state as the goal judges it."""
    final_time_s: float
    """Final time of the plan, s."""
    goal_error: GoalError
    """`end_state` minus goal, 0 where the goal is free."""
    input_hash: str
    """SHA-256 of the completed request, in hexadecimal."""
    reason: Reason | None
    """The first requirement that cannot be met, where the goal is missed or impossible, or a limit exceeded."""
    replay_confirmed: bool
    """Goal errors within tolerance, no separation on either grid, replay within tolerance and within half a percent
    of all `limits`; false where the certificate was cut off. Least normal loads are kept on the plan's grid alone.
    """
    report: Report
    """What the plan states about itself."""
    robot: Robot | None = None
    """The robot with its payload, as one robot; left out where it carries nothing. Its centre of mass is that of
    chassis and payload.
    """
    solver_version: str
    """Version of the solver."""
    status: Status
    """How good the plan is."""
    stop_reason: StopReason
    """Why the solve ended."""
    torque_schedule: TorqueSchedule
    """The torques."""
    trajectory: Trajectory | None = None
    """The motion; left out of the view plan."""


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """A state at the reference point; absent is 0."""

    heading_rad: float | None = None
    """Heading, rad."""
    velocity_x_m_s: float | None = None
    """World x velocity, m/s."""
    velocity_y_m_s: float | None = None
    """World y velocity, m/s."""
    wheel_angle_left_rad: float | None = None
    """Left wheel angle, rad."""
    wheel_angle_right_rad: float | None = None
    """Right wheel angle, rad."""
    wheel_rate_left_rad_s: float | None = None
    """Left wheel rate, rad/s."""
    wheel_rate_right_rad_s: float | None = None
    """Right wheel rate, rad/s."""
    x_m: float | None = None
    """World x, m."""
    y_m: float | None = None
    """World y, m."""
    yaw_rate_rad_s: float | None = None
    """Yaw rate, rad/s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueSchedule:
    """Piecewise constant torques."""

    interval_s: float
    """Length of one interval, s, at least 1e-12; required in requests."""
    left_n_m: Array
    """Torques of the left wheel, N m."""
    right_n_m: Array
    """Torques of the right wheel, as many, N m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """States of the reference point; one entry per node, that is steps + 1."""

    heading_rad: Array
    """Heading, rad, not wrapped."""
    time_s: Array
    """Time, s."""
    velocity_x_m_s: Array
    """World x velocity, m/s."""
    velocity_y_m_s: Array
    """World y velocity, m/s."""
    wheel_angle_left_rad: Array
    """Left wheel angle, rad."""
    wheel_angle_right_rad: Array
    """Right wheel angle, rad."""
    wheel_rate_left_rad_s: Array
    """Left wheel rate, rad/s."""
    wheel_rate_right_rad_s: Array
    """Right wheel rate, rad/s."""
    x_m: Array
    """World x, m."""
    y_m: Array
    """World y, m."""
    yaw_rate_rad_s: Array
    """Yaw rate, rad/s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VarianceShares:
    """First-order Sobol shares of one parameter, estimated from the means of bins of the same samples: 0 where an
    error does not depend on the parameter, 1 where it depends on nothing else. What several parameters do together
    is in none of them. Null (in protobuf not a number) of fewer than 64 motions, and of errors that do not vary.
    """

    across: float | None
    """Of the signed error across it."""
    along: float | None
    """Of the signed error along the heading."""
    distance: float | None
    """Of the distance."""
    heading: float | None
    """Of the signed error of the heading."""
    parameter: ChangedParameter
    """The parameter."""
    speed: float | None
    """Of the speed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WorldPoint:
    """A point of the world; absent is 0."""

    x_m: float | None = None
    """World x, m."""
    y_m: float | None = None
    """World y, m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WorstSample:
    """A sample."""

    changes: list[AppliedChange]
    """Its changes, in the order of the request."""
    errors: EndErrors
    """Its errors."""
    relative_error: float | None
    """Its largest error as a multiple of the tolerance; null (in protobuf infinite) where the motion diverges."""
    sample: int
    """Its number, from 0."""
    separates: bool
    """Whether a contact lifts."""
    simulate: SimulateRequest
    """Its motion as a request, with the footprint where there is one, so that limits of the plan may be added. After
    a delay, where it would have more than 1,000 intervals, steps share mean torques, and its end is a little another
    one.
    """
