//! Derivatives of one step in the body frame of its midpoint, by the chain rule through its friction impulse.
//!
//! ```text
//! u_E = u_A + dt a + P Lambda(free_slip, free_normal)
//! free_slip = (1 + e) W' u_A + W' dt a,    free_normal = dt n,    with a and n of u_A and the net torques
//! ```
//!
//! Derivatives by the step length: with `M = M_0 + C dt` and the friction impulse as it is,
//! `du_E/ddt = M^-1 (h - C u_A - C (u_E - u_A)) = M^-1 (h - C u_E)`, so that viscous friction counts with the rates at the end.

#![expect(clippy::inline_always, reason = "called in a sweep: a call would take derivatives through memory")]

use nalgebra::{SMatrix, SVector, Vector3};

use super::friction_law::FrictionLaw;
use super::moreau_step::{Linear, StepModel};
use super::path_quantity::PathGradient;
use super::tape::TapeEntry;
use crate::contact::ImpulseDerivative;
use crate::robot::{BodyVector, PerWheel};

/// Derivatives by all that goes into a step.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
pub(super) struct ByInput<T> {
    /// By the body velocity at the start: right, forward, yaw, left wheel, right wheel.
    pub(super) by_velocity: [T; 5],
    pub(super) by_torque: PerWheel<T>,
    pub(super) by_step_length: T,
}

impl<T> ByInput<T> {
    pub(super) fn map<U>(&self, map: impl Fn(&T) -> U) -> ByInput<U> {
        ByInput {
            by_velocity: self.by_velocity.each_ref().map(&map),
            by_torque: PerWheel::new(map(&self.by_torque.left), map(&self.by_torque.right)),
            by_step_length: map(&self.by_step_length),
        }
    }
}

/// What the derivatives of all results of a step have in common.
pub(super) struct StepDerivative<'a, const N: usize> {
    model: &'a StepModel<N>,
    free_velocity: FreeVelocity,
    free_normal: ByInput<Vector3<f64>>,
    /// Of the friction impulse.
    impulse: ByInput<SVector<f64, N>>,
}

/// Derivatives of the velocity without friction, `u_A + dt a`, but for ones and zeros.
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
struct FreeVelocity {
    /// Of what the yaw rate changes of (right, forward, yaw).
    by_yaw_rate: Vector3<f64>,
    /// Of each wheel rate.
    by_wheel_rate: f64,
    by_torque: f64,
    by_step_length: BodyVector,
}

impl<'a, const N: usize> StepDerivative<'a, N> {
    /// Of a step with these torques and this length.
    #[inline(always)]
    pub(super) fn new(
        model: &'a StepModel<N>,
        entry: &TapeEntry,
        (torque, dt): (PerWheel<f64>, f64),
        law: FrictionLaw,
    ) -> Self {
        let of_pattern;
        let by_data = if let Some(map) = model.operator.linear_derivative(entry.pattern) {
            map
        } else {
            of_pattern = impulse_derivative(model, entry, law);
            &of_pattern
        };
        let controls = (model.net_torque(torque, &entry.end_velocity), dt);
        let free_velocity = FreeVelocity::new(model, &entry.start_velocity, controls);
        let free_normal = free_normal(model, &entry.start_velocity, controls);
        let impulse = impulse(model, by_data, (&free_velocity, &free_normal));
        Self { model, free_velocity, free_normal, impulse }
    }

    /// Back over the step: of what has these derivatives by the velocity at its end.
    #[inline(always)]
    pub(super) fn back<T: Linear>(&self, by_end_velocity: &[T; 5]) -> ByInput<T> {
        self.through(by_end_velocity, &self.model.by_impulse(by_end_velocity))
    }

    /// Of a path quantity, apart from what the start velocity, the torques and the step length change of it by themselves.
    #[inline]
    pub(super) fn of_quantity(&self, gradient: &PathGradient<N>) -> ByInput<f64> {
        let PathGradient { by_end_velocity, by_impulse, by_normal_impulse, .. } = gradient;
        let by_end_velocity: [f64; 5] = (*by_end_velocity).into();
        let mut by_all_impulse = self.model.by_impulse(&by_end_velocity);
        let by_impulse = by_impulse + by_normal_impulse * self.model.operator.normal_response();
        for (sum, by_impulse) in by_all_impulse.iter_mut().zip(by_impulse.iter()) {
            *sum += by_impulse;
        }
        let mut by_input = self.through(&by_end_velocity, &by_all_impulse);
        let along = |of_normal: &Vector3<f64>| (by_normal_impulse * of_normal)[0];
        for (by_velocity, of_normal) in by_input.by_velocity.iter_mut().zip(&self.free_normal.by_velocity) {
            *by_velocity += along(of_normal);
        }
        by_input.by_torque.left += along(&self.free_normal.by_torque.left);
        by_input.by_torque.right += along(&self.free_normal.by_torque.right);
        by_input.by_step_length += along(&self.free_normal.by_step_length);
        by_input
    }

    /// The chain rule, from the derivatives by the velocity at the end, with the friction impulse as it is, and by that.
    #[inline(always)]
    fn through<T: Linear>(&self, by_velocity: &[T; 5], by_impulse: &[T; N]) -> ByInput<T> {
        let Self { free_velocity: free, impulse, .. } = self;
        let along = |of_impulse: &SVector<f64, N>| sum(by_impulse, of_impulse);
        let [right, forward, yaw, left_wheel, right_wheel] = *by_velocity;
        let [by_right, by_forward, by_yaw, by_left_wheel, by_right_wheel] = &impulse.by_velocity;
        let turned = right * free.by_yaw_rate[0] + forward * free.by_yaw_rate[1] + yaw * free.by_yaw_rate[2];
        ByInput {
            // One by one: the map of an array may be a call.
            by_velocity: [
                right + along(by_right),
                forward + along(by_forward),
                yaw + turned + along(by_yaw),
                left_wheel * free.by_wheel_rate + along(by_left_wheel),
                right_wheel * free.by_wheel_rate + along(by_right_wheel),
            ],
            by_torque: PerWheel::new(
                left_wheel * free.by_torque + along(&impulse.by_torque.left),
                right_wheel * free.by_torque + along(&impulse.by_torque.right),
            ),
            by_step_length: sum(by_velocity, &free.by_step_length) + along(&impulse.by_step_length),
        }
    }
}

impl FreeVelocity {
    #[inline(always)]
    fn new<const N: usize>(
        model: &StepModel<N>,
        velocity: &BodyVector,
        (net_torque, dt): (PerWheel<f64>, f64),
    ) -> Self {
        let by_torque = dt * model.inverse_spin_inertia;
        Self {
            by_yaw_rate: model.centrifugal_acceleration * (2.0 * velocity[2] * dt),
            by_wheel_rate: 1.0 - by_torque * model.viscous_friction,
            by_torque,
            by_step_length: model.smooth_acceleration(velocity, net_torque),
        }
    }
}

/// Of the normal impulses without friction.
#[inline(always)]
fn free_normal<const N: usize>(
    model: &StepModel<N>,
    velocity: &BodyVector,
    (net_torque, dt): (PerWheel<f64>, f64),
) -> ByInput<Vector3<f64>> {
    let free = &model.free_normal_force;
    let (yaw_rate, wheel_rates) = (velocity[2], velocity[3] + velocity[4]);
    let by_yaw_rate = free.by_yaw_rate_squared * (2.0 * yaw_rate) + free.by_yaw_rate_wheel_rate * wheel_rates;
    let by_wheel_rate = free.by_yaw_rate_wheel_rate * (yaw_rate * dt);
    let (left, right) = (free.by_torque.left * dt, free.by_torque.right * dt);
    let viscous = model.viscous_friction;
    let none = Vector3::zeros();
    ByInput {
        by_velocity: [none, none, by_yaw_rate * dt, by_wheel_rate - left * viscous, by_wheel_rate - right * viscous],
        by_torque: PerWheel::new(left, right),
        by_step_length: free.at(velocity, net_torque),
    }
}

/// Of the friction impulse, by the data of the friction problem.
#[inline(always)]
fn impulse<const N: usize>(
    model: &StepModel<N>,
    by_data: &ImpulseDerivative<N>,
    (free, free_normal): (&FreeVelocity, &ByInput<Vector3<f64>>),
) -> ByInput<SVector<f64, N>> {
    let ImpulseDerivative { by_free_slip: by_slip, by_free_normal: by_normal } = by_data;
    let of_slip = |velocity: &BodyVector| product(by_slip, &model.slip(velocity));
    let of_normal = |normal: &Vector3<f64>| product(by_normal, normal);
    // What a slip in each direction depends on, as in `StepModel::slip`.
    let (mut right, mut forward) = (by_slip.column(2).into_owned(), by_slip.column(0) + by_slip.column(1));
    if N == 5 {
        right += by_slip.column(4);
        forward += by_slip.column(3);
    }
    let left_wheel = by_slip.column(0) * model.slip_map[(0, 3)];
    let right_wheel = by_slip.column(1) * model.slip_map[(1, 4)];
    let restitution = model.restitution_factor - 1.0;
    let turned = &free.by_yaw_rate;
    let by_yaw_rate = BodyVector::from([turned[0], turned[1], 1.0 + restitution + turned[2], 0.0, 0.0]);
    let by_wheel_rate = free.by_wheel_rate + restitution;
    let [_, _, normal_by_yaw, normal_by_left_wheel, normal_by_right_wheel] = &free_normal.by_velocity;
    ByInput {
        by_velocity: [
            right * model.restitution_factor,
            forward * model.restitution_factor,
            of_slip(&by_yaw_rate) + of_normal(normal_by_yaw),
            left_wheel * by_wheel_rate + of_normal(normal_by_left_wheel),
            right_wheel * by_wheel_rate + of_normal(normal_by_right_wheel),
        ],
        by_torque: PerWheel::new(
            left_wheel * free.by_torque + of_normal(&free_normal.by_torque.left),
            right_wheel * free.by_torque + of_normal(&free_normal.by_torque.right),
        ),
        by_step_length: of_slip(&free.by_step_length) + of_normal(&free_normal.by_step_length),
    }
}

/// Apart, so that it leaves steps in linear patterns their registers.
#[inline(never)]
fn impulse_derivative<const N: usize>(
    model: &StepModel<N>,
    entry: &TapeEntry,
    law: FrictionLaw,
) -> ImpulseDerivative<N> {
    let impact_slip = entry.impact_slip.fixed_rows::<N>(0).into_owned();
    model.operator.impulse_derivative(entry.pattern, &impact_slip, &entry.normal_impulse, law.slip_smoothing())
}

/// Unrolled for its size, unlike nalgebra's products, whose strides are not known at compile time.
#[inline(always)]
fn product<const R: usize, const C: usize>(matrix: &SMatrix<f64, R, C>, of: &SVector<f64, C>) -> SVector<f64, R> {
    let mut result = SVector::zeros();
    for (column, factor) in matrix.data.0.iter().zip(&of.data.0[0]) {
        for (sum, value) in result.data.0[0].iter_mut().zip(column) {
            *sum += value * factor;
        }
    }
    result
}

/// Of what has these derivatives by some values, which have these by another.
#[inline(always)]
fn sum<T: Linear, const K: usize>(by: &[T; K], of: &SVector<f64, K>) -> T {
    let mut sum = by[0] * of[0];
    for index in 1..K {
        sum = sum + by[index] * of[index];
    }
    sum
}
