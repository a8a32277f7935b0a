//! Answers as they are written in JSON. Field names carry their SI units.
//!
//! JSON has no infinities: a number that is not finite, as in the trajectory of a diverged iterate, is written as `null`.

use serde::Serialize;
use utoipa::ToSchema;

use super::request::{SolveRequest, TorqueScheduleWire};
use super::strict::{Named, write_name};
use crate::service::StopReason;
use crate::service::domain::{
    ContactMode, ContactName, LowerBoundAssumption, Method, RefinementOutcome, SolveProgress, Status,
};

/// Answer of `POST /solve`.
#[derive(Debug, Serialize, ToSchema)]
pub(in crate::api) struct SolveAnswer<'a> {
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) status: Status,
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) stop_reason: StopReason,
    pub(in crate::api) executable: bool,
    pub(in crate::api) reason: Option<ReasonWire>,
    pub(in crate::api) final_time_s: f64,
    pub(in crate::api) torque_schedule: TorqueScheduleWire,
    pub(in crate::api) contact_modes: Vec<ContactModeWire>,
    pub(in crate::api) goal_error: GoalErrorWire,
    /// Left out of the view `plan`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::api) trajectory: Option<TrajectoryWire>,
    /// Left out of the view `plan`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::api) contacts: Option<ContactsWire>,
    pub(in crate::api) report: ReportWire,
    pub(in crate::api) applied_limits: AppliedLimitsWire,
    pub(in crate::api) solver_version: &'static str,
    pub(in crate::api) input_hash: &'a str,
}

/// Why there is no plan that meets the goal; null for plans that do.
///
/// Codes of `infeasible`, found without search: `no_torque`, `no_friction`, `final_time_too_long`, `start_separates`,
/// `goal_separates`. The answer then shows the start: one node, an empty schedule, its goal error. Codes of `not_converged`:
/// `goal_missed`, `motion_diverges`.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Reason)]
pub(in crate::api) struct ReasonWire {
    pub(in crate::api) code: &'static str,
    /// The field of the request that cannot be met.
    pub(in crate::api) field: String,
    /// When it fails, s.
    pub(in crate::api) time_s: f64,
    /// What was reached, or the least that it would take.
    pub(in crate::api) value: f64,
    /// What was required.
    pub(in crate::api) limit: f64,
    /// One sentence for people, with what would help.
    pub(in crate::api) message: String,
}

#[derive(Debug, Serialize, ToSchema)]
#[schema(as = ContactMode)]
pub(in crate::api) struct ContactModeWire {
    pub(in crate::api) start_s: f64,
    pub(in crate::api) end_s: f64,
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) left: ContactMode,
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) right: ContactMode,
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) front: ContactMode,
    pub(in crate::api) degrees_of_freedom: u8,
}

/// Wheel angles appear only where the goal constrains them.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = GoalError)]
pub(in crate::api) struct GoalErrorWire {
    pub(in crate::api) x_m: f64,
    pub(in crate::api) y_m: f64,
    pub(in crate::api) heading_rad: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::api) wheel_angle_left_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::api) wheel_angle_right_rad: Option<f64>,
    pub(in crate::api) velocity_x_m_s: f64,
    pub(in crate::api) velocity_y_m_s: f64,
    pub(in crate::api) yaw_rate_rad_s: f64,
    pub(in crate::api) wheel_rate_left_rad_s: f64,
    pub(in crate::api) wheel_rate_right_rad_s: f64,
}

/// One array per component, one entry per node.
#[derive(Debug, Default, Serialize, ToSchema)]
#[schema(as = Trajectory)]
pub(in crate::api) struct TrajectoryWire {
    pub(in crate::api) time_s: Vec<f64>,
    pub(in crate::api) x_m: Vec<f64>,
    pub(in crate::api) y_m: Vec<f64>,
    pub(in crate::api) heading_rad: Vec<f64>,
    pub(in crate::api) wheel_angle_left_rad: Vec<f64>,
    pub(in crate::api) wheel_angle_right_rad: Vec<f64>,
    pub(in crate::api) velocity_x_m_s: Vec<f64>,
    pub(in crate::api) velocity_y_m_s: Vec<f64>,
    pub(in crate::api) yaw_rate_rad_s: Vec<f64>,
    pub(in crate::api) wheel_rate_left_rad_s: Vec<f64>,
    pub(in crate::api) wheel_rate_right_rad_s: Vec<f64>,
}

#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Contacts)]
pub(in crate::api) struct ContactsWire {
    pub(in crate::api) left: ContactWire,
    pub(in crate::api) right: ContactWire,
    pub(in crate::api) front: ContactWire,
}

/// One array per component, one entry per step.
#[derive(Debug, Default, Serialize, ToSchema)]
#[schema(as = Contact)]
pub(in crate::api) struct ContactWire {
    pub(in crate::api) normal_force_n: Vec<f64>,
    pub(in crate::api) lateral_force_n: Vec<f64>,
    pub(in crate::api) longitudinal_force_n: Vec<f64>,
    pub(in crate::api) lateral_slip_m_s: Vec<f64>,
    pub(in crate::api) longitudinal_slip_m_s: Vec<f64>,
}

#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Report)]
pub(in crate::api) struct ReportWire {
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) method: Method,
    pub(in crate::api) steps: usize,
    pub(in crate::api) control_intervals: usize,
    pub(in crate::api) iterations: u64,
    pub(in crate::api) rollouts: u64,
    pub(in crate::api) solve_time_s: f64,
    pub(in crate::api) starts_tried: usize,
    pub(in crate::api) distinct_optima: Vec<DistinctOptimumWire>,
    pub(in crate::api) worst_contact_residual: f64,
    pub(in crate::api) predicted_decrease_s: f64,
    /// No plan on this grid without separation is faster.
    pub(in crate::api) lower_bound_s: f64,
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) lower_bound_assumption: LowerBoundAssumption,
    pub(in crate::api) separations: Vec<SeparationWire>,
    pub(in crate::api) indeterminate_steps: usize,
    pub(in crate::api) slip_reversals: usize,
    /// Torques that contradict the sign of the switching function.
    pub(in crate::api) switching_sign_violations: usize,
    pub(in crate::api) replay: ReplayWire,
    /// How the steps were chosen, and why no finer ones.
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) refinement: RefinementOutcome,
}

#[derive(Debug, Serialize, ToSchema)]
#[schema(as = DistinctOptimum)]
pub(in crate::api) struct DistinctOptimumWire {
    pub(in crate::api) final_time_s: f64,
    pub(in crate::api) count: usize,
}

#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Separation)]
pub(in crate::api) struct SeparationWire {
    pub(in crate::api) time_s: f64,
    #[serde(serialize_with = "write_name")]
    pub(in crate::api) contact: ContactName,
    pub(in crate::api) normal_force_n: f64,
}

#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Replay)]
pub(in crate::api) struct ReplayWire {
    pub(in crate::api) steps: usize,
    pub(in crate::api) miss_m: f64,
    pub(in crate::api) miss_heading_rad: f64,
    pub(in crate::api) miss_speed_m_s: f64,
    pub(in crate::api) within_tolerance: bool,
}

#[derive(Debug, Serialize, ToSchema)]
#[schema(as = AppliedLimits)]
pub(in crate::api) struct AppliedLimitsWire {
    pub(in crate::api) time_limit_s: f64,
}

/// Answer of `POST /simulate`.
#[derive(Debug, Serialize, ToSchema)]
pub(in crate::api) struct SimulateAnswer {
    pub(in crate::api) trajectory: TrajectoryWire,
    pub(in crate::api) contacts: ContactsWire,
    pub(in crate::api) contact_modes: Vec<ContactModeWire>,
    pub(in crate::api) separations: Vec<SeparationWire>,
    pub(in crate::api) worst_contact_residual: f64,
    pub(in crate::api) indeterminate_steps: usize,
    pub(in crate::api) slip_reversals: usize,
}

/// Answer of `POST /validate`: the completed body and its hash.
#[derive(Debug, Serialize, ToSchema)]
pub(in crate::api) struct ValidateAnswer<'a> {
    #[serde(flatten)]
    pub(in crate::api) completed: &'a SolveRequest,
    pub(in crate::api) input_hash: &'a str,
}

/// Event of a solve: it was queued.
#[derive(Debug, Serialize, ToSchema)]
pub(in crate::api) struct QueuedEvent {
    /// Place in the line: 0 when a worker was idle, 1 when it is the next to start.
    pub(in crate::api) position: usize,
}

/// Event of a solve: the best iterate so far.
#[derive(Debug, Serialize, ToSchema)]
pub(in crate::api) struct ProgressEvent {
    /// Its final time, s.
    pub(in crate::api) best_final_time_s: f64,
    /// Largest magnitude of its goal errors (m, rad, m/s, rad/s).
    pub(in crate::api) best_goal_error: f64,
    /// The running start, from 1.
    pub(in crate::api) start: usize,
    /// Number of starts.
    pub(in crate::api) start_count: usize,
}

impl From<SolveProgress> for ProgressEvent {
    fn from(progress: SolveProgress) -> Self {
        let SolveProgress { best_final_time, best_goal_error, start, start_count } = progress;
        Self { best_final_time_s: best_final_time, best_goal_error, start, start_count }
    }
}

impl Named for Status {
    const ALL: &'static [Self] = &[Self::Converged, Self::Feasible, Self::NotConverged, Self::Infeasible];

    fn name(self) -> &'static str {
        self.as_str()
    }
}

impl Named for StopReason {
    const ALL: &'static [Self] = &[Self::Finished, Self::TimeLimit, Self::Deadline, Self::RolloutLimit];

    fn name(self) -> &'static str {
        self.as_str()
    }
}

impl Named for ContactMode {
    const ALL: &'static [Self] = &[Self::Stick, Self::Slip];

    fn name(self) -> &'static str {
        self.as_str()
    }
}

impl Named for ContactName {
    const ALL: &'static [Self] = &[Self::Left, Self::Right, Self::Front];

    fn name(self) -> &'static str {
        self.as_str()
    }
}

impl Named for RefinementOutcome {
    const ALL: &'static [Self] =
        &[Self::Fixed, Self::WithinTolerance, Self::StepLimit, Self::GoalLost, Self::Interrupted, Self::NoPlan];

    fn name(self) -> &'static str {
        self.as_str()
    }
}

impl Named for LowerBoundAssumption {
    const ALL: &'static [Self] = &[Self::Friction, Self::YawFriction, Self::DriveTorque, Self::WheelDrive];

    fn name(self) -> &'static str {
        self.as_str()
    }
}
