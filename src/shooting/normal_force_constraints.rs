//! Normal forces as inequality constraints of the search: no contact may separate or carry less than its least load.

use nalgebra::{DVector, Dyn, MatrixViewMut, U1, Vector3};

use super::maneuver::{ManeuverLimits, static_loads};
use crate::robot::Robot;
use crate::simulation::{LeastNormalForces, NormalForceDerivative};

/// How exactly the search keeps the least loads, as a share of the weight: a thousandth of what counts, and far above the
/// rounding of a rollout.
pub const NORMAL_LOAD_TOLERANCE: f64 = 1e-6;
/// Contacts with less than this share of the weight above their least load may fall below it within one step of the search.
const WORKING_SET_SHARE: f64 = 0.1;

/// The constraints of one robot: `least load - normal force / weight <= 0` for the least normal forces of a rollout.
#[derive(Debug, Clone)]
pub(super) struct NormalForceConstraints {
    weight: f64,
    /// Least loads of the search, as shares of the weight.
    least: Vector3<f64>,
    /// By how much they may be missed.
    tolerance: Vector3<f64>,
}

impl NormalForceConstraints {
    pub(super) fn new(robot: &Robot, limits: ManeuverLimits) -> Self {
        let parameters = robot.parameters();
        // Without a least load the search keeps its tolerance away from separation; a contact that carries next to nothing
        // has a smaller one.
        let tolerance = static_loads(robot).map(|load| (0.5 * load).clamp(0.0, NORMAL_LOAD_TOLERANCE));
        let least = limits.least_normal_loads(robot).sup(&tolerance);
        Self { weight: parameters.total_mass() * parameters.gravity, least, tolerance }
    }

    pub(super) fn write_inequality_values(&self, forces: &LeastNormalForces, values: &mut DVector<f64>) {
        for (index, value) in values.iter_mut().enumerate() {
            *value = self.least[LeastNormalForces::contact(index)] - forces.force(index) / self.weight;
        }
    }

    pub(super) fn select_working_set(values: &DVector<f64>, working_set: &mut Vec<usize>) {
        working_set.clear();
        working_set.extend(
            values.iter().enumerate().filter(|(_, value)| **value > -WORKING_SET_SHARE).map(|(index, _)| index),
        );
    }

    pub(super) fn write_row(&self, derivative: &NormalForceDerivative, mut row: MatrixViewMut<f64, U1, Dyn, U1, Dyn>) {
        let torques = derivative.by_left_torque.iter().chain(&derivative.by_right_torque);
        for (value, force) in row.iter_mut().zip(torques.chain([&derivative.by_final_time])) {
            *value = -force / self.weight;
        }
    }

    /// Whether a contact carries less than its least load.
    pub(super) fn are_broken(&self, values: &DVector<f64>) -> bool {
        values.iter().enumerate().any(|(index, value)| *value > self.tolerance[LeastNormalForces::contact(index)])
    }
}
