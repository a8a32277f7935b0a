//! Normal forces as inequality constraints of the search: no contact may separate.

use nalgebra::{DVector, Dyn, MatrixViewMut, U1, Vector3};

use crate::robot::Robot;
use crate::simulation::{LeastNormalForces, NormalForceDerivative};

/// The search keeps the normal force of every contact above this share of the weight, so that the last corrections of a
/// plan cause no separation.
const MARGIN: f64 = 1e-3;
/// Inequality values up to this much, as a share of the weight, mean no separation.
pub const NORMAL_FORCE_TOLERANCE: f64 = MARGIN / 2.0;
/// A contact with a small static normal force keeps at least this share of it.
const STATIC_SHARE: f64 = 0.5;
/// Contacts with less than this share of the weight above their margin may separate within one step of the search.
const WORKING_SET_SHARE: f64 = 0.1;

/// The constraints of one robot: `margin - normal force / weight <= 0` for the least normal forces of a rollout.
#[derive(Debug, Clone)]
pub(super) struct NormalForceConstraints {
    weight: f64,
    margin: Vector3<f64>,
}

impl NormalForceConstraints {
    pub(super) fn new(robot: &Robot) -> Self {
        let weight = robot.parameters().total_mass() * robot.parameters().gravity;
        let margin = robot
            .normal_force_projection()
            .static_force
            .map(|force| (STATIC_SHARE * force / weight).clamp(0.0, MARGIN));
        Self { weight, margin }
    }

    pub(super) fn write_inequality_values(&self, forces: &LeastNormalForces, values: &mut DVector<f64>) {
        for (index, value) in values.iter_mut().enumerate() {
            *value = self.margin[LeastNormalForces::contact(index)] - forces.force(index) / self.weight;
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

    pub(super) fn has_separation(&self, values: &DVector<f64>) -> bool {
        values.iter().enumerate().any(|(index, value)| *value > self.margin[LeastNormalForces::contact(index)])
    }
}
