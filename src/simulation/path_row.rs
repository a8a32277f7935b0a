//! The derivatives of a path quantity: by the data of its own step, and by torques and final time.

use nalgebra::RowSVector;

use super::moreau_step::StepModel;
use super::path_quantity::{PathQuantity, PathSample};
use super::step_derivative::StepDerivative;
use super::tape::TapeEntry;
use crate::contact::ImpulseDerivative;
use crate::robot::PerWheel;

/// Derivatives of one path quantity at one step, in its unit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PathDerivative {
    /// By the left torque of each interval, per N m.
    pub by_left_torque: Vec<f64>,
    /// By the right torque of each interval, per N m.
    pub by_right_torque: Vec<f64>,
    /// By the final time, per s.
    pub by_final_time: f64,
}

/// Derivatives of one path quantity by what goes into its step, in its unit.
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
pub(super) struct PathRow {
    /// By the body velocity at the start of the step.
    pub(super) by_velocity: RowSVector<f64, 5>,
    pub(super) by_torque: PerWheel<f64>,
    pub(super) by_step_length: f64,
    /// By x, y and heading at the end of the step; none where it depends on neither.
    pub(super) by_end_pose: Option<[f64; 3]>,
}

impl PathDerivative {
    pub(super) fn zero(control_count: usize) -> Self {
        Self { by_left_torque: vec![0.0; control_count], by_right_torque: vec![0.0; control_count], by_final_time: 0.0 }
    }
}

impl PathRow {
    pub(super) fn new<const N: usize>(
        (quantity, sample): (PathQuantity, &PathSample),
        model: &StepModel<N>,
        (entry, impulse): (&TapeEntry, &ImpulseDerivative<N>),
        (torque, dt): (PerWheel<f64>, f64),
    ) -> Self {
        let gradient = quantity.gradient(entry, sample);
        let derivative = StepDerivative::of_quantity(model, entry, (torque, dt), (&gradient, impulse));
        let PerWheel { left, right } = derivative.by_torque;
        let row = Self {
            by_velocity: derivative.by_velocity + gradient.by_start_velocity,
            by_torque: PerWheel::new(left[0] + gradient.by_torque.left, right[0] + gradient.by_torque.right),
            by_step_length: derivative.by_step_length[0] + gradient.by_step_length,
            by_end_pose: gradient.by_end_pose,
        };
        if quantity.is_per_step_length() { row.per_step_length(quantity.of_step(entry, sample), dt) } else { row }
    }

    /// From the derivatives of `value` to those of `value / dt`.
    fn per_step_length(self, value: f64, dt: f64) -> Self {
        Self {
            by_velocity: self.by_velocity / dt,
            by_torque: PerWheel::new(self.by_torque.left / dt, self.by_torque.right / dt),
            by_step_length: (self.by_step_length - value / dt) / dt,
            by_end_pose: self.by_end_pose,
        }
    }
}
