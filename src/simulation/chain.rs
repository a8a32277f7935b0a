//! The chain rule through the friction impulse of one step.

#![expect(clippy::inline_always, reason = "called in a sweep: a call would take derivatives through memory")]

use nalgebra::SMatrix;

use crate::contact::ImpulseDerivative;

/// Derivatives of `K` results of a step by its smooth velocity change, its start velocity and its free normal impulses.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
pub(super) struct Chain<const K: usize> {
    /// By the velocity change without friction.
    pub(super) by_smooth_change: SMatrix<f64, K, 5>,
    /// By the body velocity at the start.
    pub(super) by_velocity: SMatrix<f64, K, 5>,
    /// By the normal impulses without friction.
    pub(super) by_free_normal: SMatrix<f64, K, 3>,
}

impl<const K: usize> Chain<K> {
    /// Derivatives of `motion (u_A + dt a) + normal free_normal + response Lambda`, where
    /// `free_slip = (1 + e) W' u_A + W' dt a`; `slip_map` is `W'` and `restitution_factor` is `1 + e`.
    #[inline(always)]
    pub(super) fn new<const N: usize>(
        (slip_map, restitution_factor): (&SMatrix<f64, N, 5>, f64),
        motion: &SMatrix<f64, K, 5>,
        normal: &SMatrix<f64, K, 3>,
        (response, impulse): (&SMatrix<f64, K, N>, &ImpulseDerivative<N>),
    ) -> Self {
        let by_slip = product(&product(response, &impulse.by_free_slip), slip_map);
        Self {
            by_smooth_change: motion + by_slip,
            by_velocity: motion + by_slip * restitution_factor,
            by_free_normal: normal + product(response, &impulse.by_free_normal),
        }
    }
}

/// The matrix product, one column of the result at a time: unrolled for its size it takes a fraction of the time of
/// nalgebra's, whose strides are not known at compile time.
#[inline(always)]
pub(super) fn product<const R: usize, const K: usize, const C: usize>(
    left: &SMatrix<f64, R, K>,
    right: &SMatrix<f64, K, C>,
) -> SMatrix<f64, R, C> {
    let mut result = SMatrix::<f64, R, C>::zeros();
    for (column, factors) in result.data.0.iter_mut().zip(&right.data.0) {
        for (&factor, addend) in factors.iter().zip(&left.data.0) {
            for (sum, value) in column.iter_mut().zip(addend) {
                *sum += value * factor;
            }
        }
    }
    result
}
