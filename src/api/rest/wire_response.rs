//! Answers as they are written in JSON. Field names carry their SI units.
//!
//! JSON has no infinities: a number that is not finite, as in the trajectory of a diverged iterate, is written as `null`.

use serde::Serialize;

use super::wire_request::{SolveRequest, TorqueScheduleWire};

/// Answer of `POST /solve`.
#[derive(Debug, Serialize)]
pub(super) struct SolveAnswer<'a> {
    pub(super) status: &'static str,
    pub(super) stop_reason: &'static str,
    pub(super) executable: bool,
    pub(super) reason: Option<ReasonWire>,
    pub(super) final_time_s: f64,
    pub(super) torque_schedule: TorqueScheduleWire,
    pub(super) contact_modes: Vec<ContactModeWire>,
    pub(super) goal_error: GoalErrorWire,
    /// Left out of the view `plan`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) trajectory: Option<TrajectoryWire>,
    /// Left out of the view `plan`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) contacts: Option<ContactsWire>,
    pub(super) report: ReportWire,
    pub(super) applied_limits: AppliedLimitsWire,
    pub(super) solver_version: &'static str,
    pub(super) input_hash: &'a str,
}

#[derive(Debug, Serialize)]
pub(super) struct ReasonWire {
    pub(super) code: &'static str,
    pub(super) field: String,
    pub(super) time_s: f64,
    pub(super) value: f64,
    pub(super) limit: f64,
    pub(super) message: String,
}

#[derive(Debug, Serialize)]
pub(super) struct ContactModeWire {
    pub(super) start_s: f64,
    pub(super) end_s: f64,
    pub(super) left: &'static str,
    pub(super) right: &'static str,
    pub(super) front: &'static str,
    pub(super) degrees_of_freedom: u8,
}

/// Wheel angles appear only where the goal constrains them.
#[derive(Debug, Serialize)]
pub(super) struct GoalErrorWire {
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) heading_rad: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) wheel_angle_left_rad: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) wheel_angle_right_rad: Option<f64>,
    pub(super) velocity_x_m_s: f64,
    pub(super) velocity_y_m_s: f64,
    pub(super) yaw_rate_rad_s: f64,
    pub(super) wheel_rate_left_rad_s: f64,
    pub(super) wheel_rate_right_rad_s: f64,
}

/// One array per component, one entry per node.
#[derive(Debug, Default, Serialize)]
pub(super) struct TrajectoryWire {
    pub(super) time_s: Vec<f64>,
    pub(super) x_m: Vec<f64>,
    pub(super) y_m: Vec<f64>,
    pub(super) heading_rad: Vec<f64>,
    pub(super) wheel_angle_left_rad: Vec<f64>,
    pub(super) wheel_angle_right_rad: Vec<f64>,
    pub(super) velocity_x_m_s: Vec<f64>,
    pub(super) velocity_y_m_s: Vec<f64>,
    pub(super) yaw_rate_rad_s: Vec<f64>,
    pub(super) wheel_rate_left_rad_s: Vec<f64>,
    pub(super) wheel_rate_right_rad_s: Vec<f64>,
}

#[derive(Debug, Serialize)]
pub(super) struct ContactsWire {
    pub(super) left: ContactWire,
    pub(super) right: ContactWire,
    pub(super) front: ContactWire,
}

/// One array per component, one entry per step.
#[derive(Debug, Default, Serialize)]
pub(super) struct ContactWire {
    pub(super) normal_force_n: Vec<f64>,
    pub(super) lateral_force_n: Vec<f64>,
    pub(super) longitudinal_force_n: Vec<f64>,
    pub(super) lateral_slip_m_s: Vec<f64>,
    pub(super) longitudinal_slip_m_s: Vec<f64>,
}

#[derive(Debug, Serialize)]
pub(super) struct ReportWire {
    pub(super) method: &'static str,
    pub(super) steps: usize,
    pub(super) control_intervals: usize,
    pub(super) iterations: u64,
    pub(super) rollouts: u64,
    pub(super) solve_time_s: f64,
    pub(super) starts_tried: usize,
    pub(super) distinct_optima: Vec<DistinctOptimumWire>,
    pub(super) worst_contact_residual: f64,
    pub(super) predicted_decrease_s: f64,
    pub(super) lower_bound_s: f64,
    pub(super) lower_bound_assumption: &'static str,
    pub(super) separations: Vec<SeparationWire>,
    pub(super) indeterminate_steps: usize,
    pub(super) slip_reversals: usize,
    pub(super) replay: ReplayWire,
}

#[derive(Debug, Serialize)]
pub(super) struct DistinctOptimumWire {
    pub(super) final_time_s: f64,
    pub(super) count: usize,
}

#[derive(Debug, Serialize)]
pub(super) struct SeparationWire {
    pub(super) time_s: f64,
    pub(super) contact: &'static str,
    pub(super) normal_force_n: f64,
}

#[derive(Debug, Serialize)]
pub(super) struct ReplayWire {
    pub(super) steps: usize,
    pub(super) miss_m: f64,
    pub(super) miss_heading_rad: f64,
    pub(super) miss_speed_m_s: f64,
    pub(super) within_tolerance: bool,
}

#[derive(Debug, Serialize)]
pub(super) struct AppliedLimitsWire {
    pub(super) time_limit_s: f64,
}

/// Answer of `POST /simulate`.
#[derive(Debug, Serialize)]
pub(super) struct SimulateAnswer {
    pub(super) trajectory: TrajectoryWire,
    pub(super) contacts: ContactsWire,
    pub(super) contact_modes: Vec<ContactModeWire>,
    pub(super) separations: Vec<SeparationWire>,
    pub(super) worst_contact_residual: f64,
    pub(super) indeterminate_steps: usize,
    pub(super) slip_reversals: usize,
}

/// Answer of `POST /validate`: the completed body and its hash.
#[derive(Debug, Serialize)]
pub(super) struct ValidateAnswer<'a> {
    #[serde(flatten)]
    pub(super) completed: &'a SolveRequest,
    pub(super) input_hash: &'a str,
}
