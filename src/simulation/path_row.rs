//! The derivatives of a path quantity: by the data of its own step, and by torques and final time.

use super::path_quantity::{PathQuantity, PathSample};
use super::step_derivative::{ByInput, StepDerivative};
use super::tape::TapeEntry;

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
pub(super) struct PathRow {
    pub(super) by_input: ByInput<f64>,
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
        (entry, dt): (&TapeEntry, f64),
        by_step: &StepDerivative<N>,
    ) -> Self {
        let gradient = quantity.gradient(entry, sample);
        let mut by_input = by_step.of_quantity(&gradient);
        for (by_velocity, own) in by_input.by_velocity.iter_mut().zip(gradient.by_start_velocity.iter()) {
            *by_velocity += own;
        }
        by_input.by_torque.left += gradient.by_torque.left;
        by_input.by_torque.right += gradient.by_torque.right;
        by_input.by_step_length += gradient.by_step_length;
        if quantity.is_per_step_length() {
            by_input.by_step_length -= quantity.of_step(entry, sample) / dt;
            by_input = by_input.map(|derivative| derivative / dt);
        }
        Self { by_input, by_end_pose: gradient.by_end_pose }
    }
}
