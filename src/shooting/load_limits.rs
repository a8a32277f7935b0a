//! Normal loads as limits of the search: no contact may have to pull.

use nalgebra::{DVector, Dyn, MatrixViewMut, U1, Vector3};

use crate::robot::Robot;
use crate::simulation::{LeastLoads, LoadDerivative};

/// The search keeps this share of the weight on every contact, so that last corrections of a plan lift nothing.
const MARGIN: f64 = 1e-3;
/// Excess, as a share of the weight, that still lifts nothing.
pub const LOAD_TOLERANCE: f64 = MARGIN / 2.0;
/// A contact that carries little at rest keeps at least this share of that.
const STATIC_SHARE: f64 = 0.5;
/// Contacts with less than this share of the weight above their margin may lift within one step of the search.
const NEAR: f64 = 0.1;

/// The limits of one robot: `excess = margin - load / weight <= 0` for the least loads of a rollout.
#[derive(Debug, Clone)]
pub(super) struct LoadLimits {
    weight: f64,
    margin: Vector3<f64>,
}

impl LoadLimits {
    pub(super) fn new(robot: &Robot) -> Self {
        let weight = robot.parameters().total_mass() * robot.parameters().gravity;
        let margin = robot.normal_load().static_force.map(|load| (STATIC_SHARE * load / weight).clamp(0.0, MARGIN));
        Self { weight, margin }
    }

    pub(super) fn write_excess(&self, loads: &LeastLoads, excess: &mut DVector<f64>) {
        for (index, value) in excess.iter_mut().enumerate() {
            *value = self.margin[LeastLoads::contact(index)] - loads.force(index) / self.weight;
        }
    }

    pub(super) fn list_near(excess: &DVector<f64>, near: &mut Vec<usize>) {
        near.clear();
        near.extend(excess.iter().enumerate().filter(|(_, excess)| **excess > -NEAR).map(|(index, _)| index));
    }

    pub(super) fn write_row(&self, derivative: &LoadDerivative, mut row: MatrixViewMut<f64, U1, Dyn, U1, Dyn>) {
        let torques = derivative.by_left_torque.iter().chain(&derivative.by_right_torque);
        for (value, load) in row.iter_mut().zip(torques.chain([&derivative.by_final_time])) {
            *value = -load / self.weight;
        }
    }

    pub(super) fn are_broken(&self, excess: &DVector<f64>) -> bool {
        excess.iter().enumerate().any(|(index, excess)| *excess > self.margin[LeastLoads::contact(index)])
    }
}
