//! Requests as they are written in JSON. Field names carry their SI units; absent fields take the defaults.
//!
//! The same types write the completed body of `/validate`: its bytes, with every field present in this order, are what
//! `input_hash` is taken of.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::strict::{Named, object, read_name, some_object, some_value, write_name};
use crate::service::domain::{ContactMethod, Method, ReferencePoint};

/// Body of `POST /solve` and `POST /validate`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct SolveRequest {
    #[serde(deserialize_with = "object")]
    pub(in crate::api) robot: RobotWire,
    #[serde(deserialize_with = "object")]
    pub(in crate::api) maneuver: ManeuverWire,
    #[serde(deserialize_with = "object")]
    pub(in crate::api) grid: SolveGridWire,
    #[serde(deserialize_with = "object")]
    pub(in crate::api) solver: SolverWire,
    #[serde(deserialize_with = "some_object", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) initial_guess: Option<InitialGuessWire>,
    #[serde(deserialize_with = "read_name", serialize_with = "write_name")]
    pub(in crate::api) view: View,
}

/// The robot; the defaults are the reference robot. Lateral is positive to the right, longitudinal forward.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Robot)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct RobotWire {
    pub(in crate::api) chassis_mass_kg: f64,
    pub(in crate::api) wheel_mass_kg: f64,
    pub(in crate::api) chassis_yaw_inertia_kg_m2: f64,
    pub(in crate::api) wheel_diametral_inertia_kg_m2: f64,
    pub(in crate::api) wheel_spin_inertia_kg_m2: f64,
    pub(in crate::api) wheel_radius_m: f64,
    pub(in crate::api) track_width_m: f64,
    pub(in crate::api) axle_to_front_support_m: f64,
    pub(in crate::api) front_support_right_m: f64,
    pub(in crate::api) center_of_mass_right_m: f64,
    pub(in crate::api) center_of_mass_forward_m: f64,
    pub(in crate::api) center_of_mass_height_m: f64,
    pub(in crate::api) wheel_friction_coefficient: f64,
    pub(in crate::api) front_friction_coefficient: f64,
    pub(in crate::api) tangential_restitution: f64,
    pub(in crate::api) gravity_m_s2: f64,
}

/// Start, goal and torque limits, all at the reference point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Maneuver)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct ManeuverWire {
    #[serde(deserialize_with = "read_name", serialize_with = "write_name")]
    pub(in crate::api) reference_point: ReferencePoint,
    #[serde(deserialize_with = "object")]
    pub(in crate::api) start: StateWire,
    #[serde(deserialize_with = "object")]
    pub(in crate::api) goal: GoalWire,
    pub(in crate::api) torque_limit_left_n_m: f64,
    pub(in crate::api) torque_limit_right_n_m: f64,
}

/// A state at the reference point. Heading 0 faces +y.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = State)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct StateWire {
    pub(in crate::api) x_m: f64,
    pub(in crate::api) y_m: f64,
    pub(in crate::api) heading_rad: f64,
    pub(in crate::api) wheel_angle_left_rad: f64,
    pub(in crate::api) wheel_angle_right_rad: f64,
    pub(in crate::api) velocity_x_m_s: f64,
    pub(in crate::api) velocity_y_m_s: f64,
    pub(in crate::api) yaw_rate_rad_s: f64,
    pub(in crate::api) wheel_rate_left_rad_s: f64,
    pub(in crate::api) wheel_rate_right_rad_s: f64,
}

/// The goal. Absent: position and heading are the start's, velocities are 0, wheel angles are free.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Goal)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct GoalWire {
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) x_m: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) y_m: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) heading_rad: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) wheel_angle_left_rad: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) wheel_angle_right_rad: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) velocity_x_m_s: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) velocity_y_m_s: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) yaw_rate_rad_s: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) wheel_rate_left_rad_s: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) wheel_rate_right_rad_s: Option<f64>,
    pub(in crate::api) free: Vec<String>,
}

/// The time grid of a solve. Absent steps are automatic: refined until the plan's replay is within tolerance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = SolveGrid)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct SolveGridWire {
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(in crate::api) steps: Option<u64>,
    pub(in crate::api) control_intervals: u64,
}

/// Search effort and tolerances.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Solver)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct SolverWire {
    #[serde(deserialize_with = "read_name", serialize_with = "write_name")]
    pub(in crate::api) method: Method,
    pub(in crate::api) starts: u64,
    pub(in crate::api) seed: u64,
    pub(in crate::api) time_limit_s: f64,
    pub(in crate::api) rollout_limit: u64,
    pub(in crate::api) goal_tolerance: f64,
    pub(in crate::api) replay_tolerance_m: f64,
    pub(in crate::api) replay_tolerance_rad: f64,
}

/// A start of the search, tried first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = InitialGuess)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct InitialGuessWire {
    pub(in crate::api) final_time_s: f64,
    pub(in crate::api) torque_left_n_m: Vec<f64>,
    pub(in crate::api) torque_right_n_m: Vec<f64>,
}

/// Body of `POST /simulate`.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct SimulateRequest {
    #[serde(default, deserialize_with = "object")]
    pub(in crate::api) robot: RobotWire,
    #[serde(default, deserialize_with = "read_name")]
    pub(in crate::api) reference_point: ReferencePoint,
    #[serde(default, deserialize_with = "object")]
    pub(in crate::api) start: StateWire,
    #[serde(deserialize_with = "object")]
    pub(in crate::api) torque_schedule: TorqueScheduleWire,
    #[serde(default, deserialize_with = "object")]
    pub(in crate::api) grid: SimulateGridWire,
    #[serde(default, deserialize_with = "read_name")]
    pub(in crate::api) contact_solver: ContactMethod,
}

/// Written in answers and read by `/simulate`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = TorqueSchedule)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct TorqueScheduleWire {
    pub(in crate::api) interval_s: f64,
    pub(in crate::api) left_n_m: Vec<f64>,
    pub(in crate::api) right_n_m: Vec<f64>,
}

/// The time grid of a simulation.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, ToSchema)]
#[schema(as = SimulateGrid)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct SimulateGridWire {
    #[serde(deserialize_with = "some_value")]
    pub(in crate::api) steps: Option<u64>,
}

/// How much of the answer is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum View {
    /// Everything.
    #[default]
    Full,
    /// Without trajectory and contacts.
    Plan,
}

impl Named for View {
    const ALL: &'static [Self] = &[Self::Full, Self::Plan];

    fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Plan => "plan",
        }
    }
}

impl Named for ReferencePoint {
    const ALL: &'static [Self] = &[Self::ChassisCenterOfMass, Self::AxleMidpoint];

    fn name(self) -> &'static str {
        match self {
            Self::ChassisCenterOfMass => "chassis_center_of_mass",
            Self::AxleMidpoint => "axle_midpoint",
        }
    }
}

impl Named for Method {
    const ALL: &'static [Self] = &[Self::SequentialLinear, Self::NelderMead];

    fn name(self) -> &'static str {
        self.as_str()
    }
}

impl Named for ContactMethod {
    const ALL: &'static [Self] = &[Self::Exact, Self::FixedPoint];

    fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::FixedPoint => "fixed_point",
        }
    }
}
