//! Derivatives of one step, in the body frame of its midpoint, for given impulses' derivatives in its contact pattern.

use nalgebra::{SMatrix, SVector, Vector3};

use super::moreau_step::StepModel;
use super::sensitivity::TapeEntry;
use crate::contact::ImpulseDerivative;
use crate::robot::{BodyVector, PerWheel};

/// Derivatives of `K` results of one step by what it starts from.
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
pub(super) struct StepDerivative<const K: usize> {
    /// By the body velocity at the start of the step.
    pub(super) by_velocity: SMatrix<f64, K, 5>,
    pub(super) by_torque: PerWheel<SVector<f64, K>>,
    pub(super) by_step_length: SVector<f64, K>,
}

/// How `K` results follow from what a step is made of, at rest.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
pub(super) struct Chain<const K: usize> {
    /// By the velocity change without friction.
    by_smooth_change: SMatrix<f64, K, 5>,
    /// By the body velocity at the start.
    by_velocity: SMatrix<f64, K, 5>,
    /// By the normal impulses without friction.
    by_free_normal: SMatrix<f64, K, 3>,
}

impl Chain<5> {
    /// Of the body velocity at the end: `u_E = u_A + dt a + P Lambda`.
    #[inline]
    pub(super) fn of_motion<const N: usize>(model: &StepModel<N>, impulse: &ImpulseDerivative<N>) -> Self {
        Self::new(model, &SMatrix::identity(), &SMatrix::zeros(), (&model.impulse_response, impulse))
    }
}

impl Chain<3> {
    /// Of the normal impulses: `free_normal + R Lambda`.
    #[inline]
    fn of_normal_impulse<const N: usize>(model: &StepModel<N>, impulse: &ImpulseDerivative<N>) -> Self {
        Self::new(model, &SMatrix::zeros(), &SMatrix::identity(), (model.operator.normal_response(), impulse))
    }
}

impl<const K: usize> Chain<K> {
    /// Of `motion (u_A + dt a) + normal free_normal + response Lambda`, where `free_slip = (1 + e) W' u_A + W' dt a`.
    #[inline]
    fn new<const N: usize>(
        model: &StepModel<N>,
        motion: &SMatrix<f64, K, 5>,
        normal: &SMatrix<f64, K, 3>,
        (response, impulse): (&SMatrix<f64, K, N>, &ImpulseDerivative<N>),
    ) -> Self {
        let by_slip = product(&product(response, &impulse.by_free_slip), &model.slip_map);
        Self {
            by_smooth_change: motion + by_slip,
            by_velocity: motion + by_slip * model.restitution_factor,
            by_free_normal: normal + product(response, &impulse.by_free_normal),
        }
    }
}

impl StepDerivative<5> {
    /// Of the body velocity at the end.
    #[inline]
    pub(super) fn of_motion<const N: usize>(
        model: &StepModel<N>,
        entry: &TapeEntry,
        controls: (PerWheel<f64>, f64),
        slip_smoothing: f64,
    ) -> Self {
        if let Some(chain) = model.linear_chain(entry.pattern) {
            return Self::along(chain, model, entry, controls);
        }
        let impulse = impulse_derivative(model, entry, slip_smoothing);
        Self::along(&Chain::<5>::of_motion(model, &impulse), model, entry, controls)
    }
}

impl StepDerivative<3> {
    /// Of the normal impulses.
    #[inline]
    pub(super) fn of_normal_impulse<const N: usize>(
        model: &StepModel<N>,
        entry: &TapeEntry,
        controls: (PerWheel<f64>, f64),
        slip_smoothing: f64,
    ) -> Self {
        let impulse = impulse_derivative(model, entry, slip_smoothing);
        Self::along(&Chain::<3>::of_normal_impulse(model, &impulse), model, entry, controls)
    }
}

impl<const K: usize> StepDerivative<K> {
    /// With `free_normal = dt n(u_A, torque)`.
    #[inline]
    fn along<const N: usize>(
        chain: &Chain<K>,
        model: &StepModel<N>,
        entry: &TapeEntry,
        (torque, dt): (PerWheel<f64>, f64),
    ) -> Self {
        let velocity = &entry.start_velocity;
        let (smooth, by_normal) = (&chain.by_smooth_change, &chain.by_free_normal);
        let mut by_velocity = chain.by_velocity;

        let planar = &model.centrifugal_acceleration;
        let by_rate = BodyVector::from([planar[0], planar[1], planar[2], 0.0, 0.0]) * (2.0 * velocity[2] * dt);
        let free = &model.free_normal_force;
        let wheel_rates = velocity[3] + velocity[4];
        let force_by_rate =
            (free.by_yaw_rate_squared * (2.0 * velocity[2]) + free.by_yaw_rate_wheel_rate * wheel_rates) * dt;
        let mut yaw_column = by_velocity.column_mut(2);
        yaw_column += product(smooth, &by_rate) + product(by_normal, &force_by_rate);
        let gyroscopic = product(by_normal, &(free.by_yaw_rate_wheel_rate * (velocity[2] * dt)));
        for wheel in [3, 4] {
            let mut column = by_velocity.column_mut(wheel);
            column += gyroscopic;
        }

        let by_torque = |wheel: usize, force: &Vector3<f64>| {
            smooth.column(wheel) * (dt * model.inverse_spin_inertia) + product(by_normal, &(force * dt))
        };
        let by_step_length = product(smooth, &model.smooth_acceleration(velocity, torque))
            + product(by_normal, &model.free_normal_force.at(velocity, torque));
        Self {
            by_velocity,
            by_torque: PerWheel::new(by_torque(3, &free.by_torque.left), by_torque(4, &free.by_torque.right)),
            by_step_length,
        }
    }
}

#[inline]
fn impulse_derivative<const N: usize>(
    model: &StepModel<N>,
    entry: &TapeEntry,
    slip_smoothing: f64,
) -> ImpulseDerivative<N> {
    let impact_slip = entry.impact_slip.fixed_rows::<N>(0).into_owned();
    model.operator.impulse_derivative(entry.pattern, &impact_slip, &entry.normal_impulse, slip_smoothing).unwrap_or(
        // The slip direction is undefined only where the slip is exactly zero: friction then changes nothing.
        ImpulseDerivative { by_free_slip: SMatrix::zeros(), by_free_normal: SMatrix::zeros() },
    )
}

/// The matrix product, a column of the result at a time: unrolled for its size it takes a fraction of the library's, which
/// walks strides that it does not know.
#[inline]
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
