//! Derivatives of one step in the body frame of its midpoint, given the derivatives of its friction impulse.

#![expect(clippy::inline_always, reason = "called in a sweep: a call would take derivatives through memory")]

use nalgebra::{SMatrix, SVector};

use super::chain::{Chain, product};
use super::friction_law::FrictionLaw;
use super::moreau_step::StepModel;
use super::path_quantity::PathGradient;
use super::tape::TapeEntry;
use crate::contact::ImpulseDerivative;
use crate::robot::{BodyVector, PerWheel};

/// Derivatives of `K` results of one step by its start velocity, torques and length.
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
pub(super) struct StepDerivative<const K: usize> {
    /// By the body velocity at the start of the step.
    pub(super) by_velocity: SMatrix<f64, K, 5>,
    pub(super) by_torque: PerWheel<SVector<f64, K>>,
    pub(super) by_step_length: SVector<f64, K>,
}

impl StepDerivative<5> {
    /// Of the body velocity at the end.
    #[inline(always)]
    pub(super) fn of_motion<const N: usize>(
        model: &StepModel<N>,
        entry: &TapeEntry,
        controls: (PerWheel<f64>, f64),
        law: FrictionLaw,
    ) -> Self {
        let chain_of_pattern;
        let chain = if let Some(chain) = model.linear_chain(entry.pattern) {
            chain
        } else {
            chain_of_pattern = chain_of_step(model, entry, law);
            &chain_of_pattern
        };
        Self::along(chain, model, entry, controls)
    }
}

impl StepDerivative<1> {
    /// Of a path quantity.
    #[inline]
    pub(super) fn of_quantity<const N: usize>(
        model: &StepModel<N>,
        entry: &TapeEntry,
        controls: (PerWheel<f64>, f64),
        (gradient, impulse): (&PathGradient<N>, &ImpulseDerivative<N>),
    ) -> Self {
        Self::along(&model.quantity_chain(gradient, impulse), model, entry, controls)
    }
}

impl<const K: usize> StepDerivative<K> {
    /// With `free_normal = dt n(u_A, torque)`.
    ///
    /// By the step length, with `M = M_0 + C dt` and the friction impulse as it is,
    /// `du_E/ddt = M^-1 (h - C u_A - C (u_E - u_A)) = M^-1 (h - C u_E)`: viscous friction counts with the rates at the end.
    #[inline(always)]
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

        let by_spin = dt * model.inverse_spin_inertia;
        let by_torque = PerWheel::new(
            smooth.column(3) * by_spin + product(by_normal, &(free.by_torque.left * dt)),
            smooth.column(4) * by_spin + product(by_normal, &(free.by_torque.right * dt)),
        );
        if model.viscous_friction > 0.0 {
            for (wheel, by_torque) in [(3, &by_torque.left), (4, &by_torque.right)] {
                let mut column = by_velocity.column_mut(wheel);
                column -= by_torque * model.viscous_friction;
            }
        }
        let torque = model.net_torque(torque, &entry.end_velocity);
        let by_step_length = product(smooth, &model.smooth_acceleration(velocity, torque))
            + product(by_normal, &free.at(velocity, torque));
        Self { by_velocity, by_torque, by_step_length }
    }
}

/// Of the motion, where a contact slips in the plane; apart, so that it leaves the other steps their registers.
#[inline(never)]
fn chain_of_step<const N: usize>(model: &StepModel<N>, entry: &TapeEntry, law: FrictionLaw) -> Chain<5> {
    model.motion_chain(&impulse_derivative(model, entry, law))
}

#[inline]
pub(super) fn impulse_derivative<const N: usize>(
    model: &StepModel<N>,
    entry: &TapeEntry,
    law: FrictionLaw,
) -> ImpulseDerivative<N> {
    let impact_slip = entry.impact_slip.fixed_rows::<N>(0).into_owned();
    model.operator.impulse_derivative(entry.pattern, &impact_slip, &entry.normal_impulse, law.slip_smoothing())
}
