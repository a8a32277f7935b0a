//! Requests as they are written in JSON. Field names carry their SI units; absent fields take the defaults.
//!
//! The same types write the completed body of `/validate`: its bytes, with every field present in this order, are what
//! `input_hash` is taken of.

use serde::{Deserialize, Serialize};

use super::strict::{Named, object, read_name, some_object, some_value, write_name};
use crate::service::domain::{ContactMethod, Method, ReferencePoint};

/// Body of `POST /solve` and `POST /validate`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SolveRequest {
    #[serde(deserialize_with = "object")]
    pub(super) robot: RobotWire,
    #[serde(deserialize_with = "object")]
    pub(super) maneuver: ManeuverWire,
    #[serde(deserialize_with = "object")]
    pub(super) grid: SolveGridWire,
    #[serde(deserialize_with = "object")]
    pub(super) solver: SolverWire,
    #[serde(deserialize_with = "some_object", skip_serializing_if = "Option::is_none")]
    pub(super) initial_guess: Option<InitialGuessWire>,
    #[serde(deserialize_with = "read_name", serialize_with = "write_name")]
    pub(super) view: View,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RobotWire {
    pub(super) chassis_mass_kg: f64,
    pub(super) wheel_mass_kg: f64,
    pub(super) chassis_yaw_inertia_kg_m2: f64,
    pub(super) wheel_diametral_inertia_kg_m2: f64,
    pub(super) wheel_spin_inertia_kg_m2: f64,
    pub(super) wheel_radius_m: f64,
    pub(super) track_width_m: f64,
    pub(super) axle_to_front_support_m: f64,
    pub(super) front_support_right_m: f64,
    pub(super) center_of_mass_right_m: f64,
    pub(super) center_of_mass_forward_m: f64,
    pub(super) center_of_mass_height_m: f64,
    pub(super) wheel_friction_coefficient: f64,
    pub(super) front_friction_coefficient: f64,
    pub(super) tangential_restitution: f64,
    pub(super) gravity_m_s2: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ManeuverWire {
    #[serde(deserialize_with = "read_name", serialize_with = "write_name")]
    pub(super) reference_point: ReferencePoint,
    #[serde(deserialize_with = "object")]
    pub(super) start: StateWire,
    #[serde(deserialize_with = "object")]
    pub(super) goal: GoalWire,
    pub(super) torque_limit_left_n_m: f64,
    pub(super) torque_limit_right_n_m: f64,
}

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct StateWire {
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) heading_rad: f64,
    pub(super) wheel_angle_left_rad: f64,
    pub(super) wheel_angle_right_rad: f64,
    pub(super) velocity_x_m_s: f64,
    pub(super) velocity_y_m_s: f64,
    pub(super) yaw_rate_rad_s: f64,
    pub(super) wheel_rate_left_rad_s: f64,
    pub(super) wheel_rate_right_rad_s: f64,
}

/// Absent fields differ in meaning: see [`super::convert_goal`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct GoalWire {
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) x_m: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) y_m: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) heading_rad: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) wheel_angle_left_rad: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) wheel_angle_right_rad: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) velocity_x_m_s: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) velocity_y_m_s: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) yaw_rate_rad_s: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) wheel_rate_left_rad_s: Option<f64>,
    #[serde(deserialize_with = "some_value", skip_serializing_if = "Option::is_none")]
    pub(super) wheel_rate_right_rad_s: Option<f64>,
    pub(super) free: Vec<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SolveGridWire {
    pub(super) steps: u64,
    pub(super) control_intervals: u64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SolverWire {
    #[serde(deserialize_with = "read_name", serialize_with = "write_name")]
    pub(super) method: Method,
    pub(super) starts: u64,
    pub(super) seed: u64,
    pub(super) time_limit_s: f64,
    pub(super) rollout_limit: u64,
    pub(super) goal_tolerance: f64,
    pub(super) replay_tolerance_m: f64,
    pub(super) replay_tolerance_rad: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct InitialGuessWire {
    pub(super) final_time_s: f64,
    pub(super) torque_left_n_m: Vec<f64>,
    pub(super) torque_right_n_m: Vec<f64>,
}

/// Body of `POST /simulate`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SimulateRequest {
    #[serde(default, deserialize_with = "object")]
    pub(super) robot: RobotWire,
    #[serde(default, deserialize_with = "read_name")]
    pub(super) reference_point: ReferencePoint,
    #[serde(default, deserialize_with = "object")]
    pub(super) start: StateWire,
    #[serde(deserialize_with = "object")]
    pub(super) torque_schedule: TorqueScheduleWire,
    #[serde(default, deserialize_with = "object")]
    pub(super) grid: SimulateGridWire,
    #[serde(default, deserialize_with = "read_name")]
    pub(super) contact_solver: ContactMethod,
}

/// Written in answers and read by `/simulate`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TorqueScheduleWire {
    pub(super) interval_s: f64,
    pub(super) left_n_m: Vec<f64>,
    pub(super) right_n_m: Vec<f64>,
}

#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SimulateGridWire {
    #[serde(deserialize_with = "some_value")]
    pub(super) steps: Option<u64>,
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
