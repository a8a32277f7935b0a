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

/// How `K` results follow from what a friction problem is made of.
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
struct Chain<const K: usize, const N: usize> {
    by_free_motion: SMatrix<f64, K, 5>,
    by_free_slip: SMatrix<f64, K, N>,
    by_free_normal: SMatrix<f64, K, 3>,
}

impl StepDerivative<5> {
    /// Of the body velocity at the end: `u_E = u_A + dt a + P Lambda`.
    #[inline]
    pub(super) fn of_motion<const N: usize>(
        model: &StepModel<N>,
        entry: &TapeEntry,
        controls: (PerWheel<f64>, f64),
        slip_smoothing: f64,
    ) -> Self {
        let impulse = impulse_derivative(model, entry, slip_smoothing);
        let chain = Chain {
            by_free_motion: SMatrix::identity(),
            by_free_slip: model.impulse_response * impulse.by_free_slip,
            by_free_normal: model.impulse_response * impulse.by_free_normal,
        };
        Self::along(&chain, model, entry, controls)
    }
}

impl StepDerivative<3> {
    /// Of the normal impulses: `free_normal + R Lambda`.
    #[inline]
    pub(super) fn of_normal_impulse<const N: usize>(
        model: &StepModel<N>,
        entry: &TapeEntry,
        controls: (PerWheel<f64>, f64),
        slip_smoothing: f64,
    ) -> Self {
        let impulse = impulse_derivative(model, entry, slip_smoothing);
        let response = model.system.normal_response();
        let chain = Chain {
            by_free_motion: SMatrix::zeros(),
            by_free_slip: response * impulse.by_free_slip,
            by_free_normal: SMatrix::identity() + response * impulse.by_free_normal,
        };
        Self::along(&chain, model, entry, controls)
    }
}

impl<const K: usize> StepDerivative<K> {
    /// With `free_slip = (1 + e) W' u_A + W' dt a` and `free_normal = dt n`.
    #[inline]
    fn along<const N: usize>(
        chain: &Chain<K, N>,
        model: &StepModel<N>,
        entry: &TapeEntry,
        (torque, dt): (PerWheel<f64>, f64),
    ) -> Self {
        let velocity = &entry.start_velocity;
        let by_normal = &chain.by_free_normal;
        let slip = chain.by_free_slip * model.slip_map;
        let smooth = chain.by_free_motion + slip;
        let mut by_velocity = chain.by_free_motion + slip * model.restitution_factor;

        let planar = &model.centrifugal_acceleration;
        let by_rate = BodyVector::from([planar[0], planar[1], planar[2], 0.0, 0.0]) * (2.0 * velocity[2] * dt);
        let load = &model.load;
        let wheel_rates = velocity[3] + velocity[4];
        let load_by_rate =
            (load.by_yaw_rate_squared * (2.0 * velocity[2]) + load.by_yaw_rate_wheel_rate * wheel_rates) * dt;
        let mut yaw_column = by_velocity.column_mut(2);
        yaw_column += smooth * by_rate + by_normal * load_by_rate;
        let gyroscopic = by_normal * (load.by_yaw_rate_wheel_rate * (velocity[2] * dt));
        for wheel in [3, 4] {
            let mut column = by_velocity.column_mut(wheel);
            column += gyroscopic;
        }

        let by_torque = |wheel: usize, load: &Vector3<f64>| {
            smooth.column(wheel) * (dt * model.inverse_spin_inertia) + by_normal * (load * dt)
        };
        let by_step_length = smooth * model.smooth_acceleration(velocity, torque)
            + by_normal * model.load.normal_force(velocity, torque);
        Self {
            by_velocity,
            by_torque: PerWheel::new(by_torque(3, &load.by_torque.left), by_torque(4, &load.by_torque.right)),
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
    model.system.impulse_derivative(entry.pattern, &impact_slip, &entry.normal_impulse, slip_smoothing).unwrap_or(
        // The slip direction is undefined only where the slip is exactly zero: friction then changes nothing.
        ImpulseDerivative { by_free_slip: SMatrix::zeros(), by_free_normal: SMatrix::zeros() },
    )
}
