//! The data that one time step adds to the Delassus operator.

use nalgebra::{SVector, Vector3};

/// The data of one time step: impact slip and normal impulses as they would be without friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneStepProblem<const N: usize> {
    /// Impact slip without friction, `(1 + e) gamma_A + W' M^-1 h dt`, m/s.
    pub free_slip: SVector<f64, N>,
    /// Normal impulses without friction (left, right, front), N s.
    pub free_normal: Vector3<f64>,
}

impl<const N: usize> OneStepProblem<N> {
    /// The weight's impulse m g dt, N s: friction never changes the sum of the normal impulses.
    #[inline]
    pub fn weight_impulse(&self) -> f64 {
        self.free_normal[0] + self.free_normal[1] + self.free_normal[2]
    }
}
