//! The answer of a solve: a plan, its status and its report.

use nalgebra::SVector;

use super::settings::Method;
use crate::motion::{EndShift, LimitUse, Sensitivity};
use crate::robot::State;
use crate::simulation::{TorqueSchedule, Trajectory};

/// How good the plan is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// Goal met within the limits, criticality measure small, contact law and least normal forces kept.
    Converged,
    /// Goal met within the limits, but not shown to be a local optimum that keeps its contacts: it is none, a contact carries less than
    /// it should or breaks its law, or the certificate was cut off.
    Feasible,
    /// Best iterate; the goal is missed, or a limit exceeded.
    NotConverged,
    /// Shown to be impossible.
    Infeasible,
}

impl Status {
    /// The name in the public contract.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Feasible => "feasible",
            Self::NotConverged => "not_converged",
            Self::Infeasible => "infeasible",
        }
    }
}

/// Why the search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StopReason {
    /// The whole search asked for was done.
    #[default]
    Finished,
    /// The stop flag was set from outside.
    Stopped,
    /// The rollout limit was used up.
    RolloutLimit,
}

/// The first requirement that a plan does not meet.
#[derive(Debug, Clone, PartialEq)]
pub struct Reason {
    /// Stable `snake_case` code.
    pub code: &'static str,
    /// The field of the input that could not be met, such as `maneuver.goal.y_m`.
    pub field: String,
    /// When it fails, s; none where nobody knows, at a goal without a plan to it.
    pub time: Option<f64>,
    /// What was reached, or the least or most that can be; of a goal the magnitude of the miss.
    pub value: f64,
    /// What was required; of a goal the tolerance.
    pub limit: f64,
    /// One sentence for people.
    pub message: String,
}

impl Reason {
    /// The code of a plan that meets its goal and exceeds a limit.
    pub const LIMIT_EXCEEDED: &'static str = "limit_exceeded";

    /// A number as messages tell it: with four digits, or all of them where four do not tell it from the limit.
    pub(super) fn told(value: f64, limit: f64) -> f64 {
        let short: f64 = format!("{value:.3e}").parse().unwrap_or(value);
        let exceeds = |value: f64| value.abs() > limit;
        if exceeds(short) == exceeds(value) { short } else { value }
    }
}

/// A local optimum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistinctOptimum {
    /// Its final time, s.
    pub final_time: f64,
    /// How many starts, and spins of the best plan, led to it; those that were given up on the way do not count.
    pub count: usize,
    /// Shift of the end of the fastest of them under a tenth less friction; none without motion, or where the search was
    /// stopped.
    pub friction_shift: Option<EndShift>,
}

/// What a lower bound on the final time rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LowerBoundAssumption {
    /// Friction bounds the acceleration of the whole robot's centre of mass.
    Friction,
    /// Friction bounds the yaw acceleration.
    YawFriction,
    /// Torque builds up the motion that carries the robot; friction brakes it.
    DriveTorque,
    /// Torque and friction bound the acceleration of each wheel.
    WheelDrive,
    /// Limits of the maneuver bound speeds, accelerations or slip, beside friction and torque.
    Limits,
}

impl LowerBoundAssumption {
    /// The name in the public contract.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Friction => "friction",
            Self::YawFriction => "yaw_friction",
            Self::DriveTorque => "drive_torque",
            Self::WheelDrive => "wheel_drive",
            Self::Limits => "limits",
        }
    }
}

/// How the number of steps of the plan's grid was determined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RefinementOutcome {
    /// The caller chose them.
    #[default]
    Fixed,
    /// Automatic: the replay is within tolerance.
    WithinTolerance,
    /// Automatic: the replay is above tolerance on the finest allowed grid.
    StepLimit,
    /// Automatic: the goal was lost on finer grids.
    GoalLost,
    /// Automatic: a limit of time or rollouts ended the refinement.
    Interrupted,
    /// Automatic: no plan met the goal, so there was nothing to refine.
    NoPlan,
}

/// The plan's torques on a finer grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Replay {
    /// Number of steps of the fine grid.
    pub step_count: usize,
    /// The larger of the distance of its end from the goal position and of what a wheel's rim misses where the goal fixes wheel
    /// angles, m.
    pub miss_position: f64,
    /// Difference of its heading, rad.
    pub miss_heading: f64,
    /// Difference of its velocity, m/s.
    pub miss_speed: f64,
    /// Difference of its yaw rate, rad/s.
    pub miss_yaw_rate: f64,
    /// Largest difference of a wheel's rim speed, m/s.
    pub miss_wheel_speed: f64,
    /// How often a contact separates.
    pub separations: usize,
    /// Largest excess over a limit as a share of it; at most 0 where all are kept.
    pub limit_excess: f64,
    /// Whether all misses are within the asked tolerances and no contact separates.
    pub within_tolerance: bool,
}

/// The report on a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// The optimiser used.
    pub method: Method,
    /// Steps of the plan's grid.
    pub step_count: usize,
    /// How the grid was chosen.
    pub refinement: RefinementOutcome,
    /// Iterations of the optimiser, over all starts.
    pub iterations: u64,
    /// Rollouts spent.
    pub rollouts: u64,
    /// Starts tried.
    pub starts_tried: usize,
    /// Local optima seen, fastest first.
    pub distinct_optima: Vec<DistinctOptimum>,
    /// Criticality measure: decrease of the final time that the linear model still predicts, s, at most that time; where the goal is
    /// missed, coming nearer to it counts as a decrease too.
    pub predicted_decrease: f64,
    /// Rigorous lower bound on the final time, s; none where the certificate was cut off.
    pub lower_bound: Option<f64>,
    /// What the bound rests on.
    pub lower_bound_assumption: Option<LowerBoundAssumption>,
    /// Steps for whose friction problem a second solution was found; all where the certificate was cut off.
    pub indeterminate_steps: usize,
    /// Torques that contradict the sign of the switching function: off the limit at which they would gain.
    pub switching_sign_violations: usize,
    /// The plan on a finer grid; none where the certificate was cut off.
    pub replay: Option<Replay>,
    /// How far the plan uses each limit that was given.
    pub limits: Vec<LimitUse>,
    /// How far small changes shift the end; nothing where nothing moves, or the certificate was cut off.
    pub sensitivity: Vec<Sensitivity>,
}

/// A plan with its status and report.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// How good the plan is.
    pub status: Status,
    /// Why the search ended.
    pub stop_reason: StopReason,
    /// Goal met, no separation, replay within tolerance.
    pub replay_confirmed: bool,
    /// The first requirement that fails, where the goal is missed or impossible, or a limit exceeded.
    pub reason: Option<Reason>,
    /// The torques.
    pub schedule: TorqueSchedule,
    /// End state minus goal at the reference point, 0 where free, in the order of [`State::to_vector`].
    pub goal_error: SVector<f64, { State::LEN }>,
    /// The motion; its states are those of the reference point.
    pub trajectory: Trajectory,
    /// The report on the plan.
    pub report: Report,
}
