//! One step of Moreau's (1988) midpoint time-stepping scheme (figure 2 of the paper), in the body frame of the midpoint.
//!
//! ```text
//! q_M = q_A + dt/2 u_A
//! u_E = u_A + M^-1 (h dt + W_T Lambda_T)        M, h, W_T at q_M with u_A, (25)
//! q_E = q_M + dt/2 u_E
//! ```
//!
//! Viscous friction `-C u_E` of the wheels acts at the end of the step, so that it brakes at any step length. Solved for `u_E` it
//! is a torque `-c psidot_A` on wheels of inertia `J + c dt`: with it `M` below is `M + C dt`, and `h` is `h - C u_A`.

use std::ops::{Add, Mul};

use nalgebra::{SMatrix, SVector, Vector3};

use super::turn::{seen_from, sine_and_cosine};
use crate::contact::{ContactSolution, DelassusOperator, OneStepProblem};
use crate::robot::{BodyVector, PerWheel, Robot, State};

/// The constant data of the robot that a step needs (with viscous friction: a step of one length), with `N` friction directions (3, or 5 with front friction).
#[derive(Debug, Clone)]
pub(super) struct StepModel<const N: usize> {
    pub(super) operator: DelassusOperator<N>,
    /// `W_T'`, rows by direction.
    pub(super) slip_map: SMatrix<f64, N, 5>,
    /// P, `M^-1 W_T`.
    impulse_response: SMatrix<f64, 5, N>,
    /// 1 + restitution.
    pub(super) restitution_factor: f64,
    /// Body acceleration (right, forward, yaw) per squared yaw rate.
    pub(super) centrifugal_acceleration: Vector3<f64>,
    /// 1 / J, with viscous friction 1 / (J + c dt).
    pub(super) inverse_spin_inertia: f64,
    /// c of each wheel, N m s/rad.
    pub(super) viscous_friction: f64,
    pub(super) free_normal_force: FreeNormalForce,
}

/// Normal forces without friction: affine in the squared rates and the net torques. Viscous friction, between chassis and wheels,
/// changes them by what it changes of the wheel rates.
#[derive(Debug, Clone)]
pub(super) struct FreeNormalForce {
    pub(super) at_rest: Vector3<f64>,
    pub(super) by_yaw_rate_squared: Vector3<f64>,
    pub(super) by_yaw_rate_wheel_rate: Vector3<f64>,
    pub(super) by_torque: PerWheel<Vector3<f64>>,
}

/// One step with its data: enough to record it and to differentiate it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step<const N: usize> {
    pub(super) end: State,
    /// Sine and cosine of the midpoint's heading.
    pub(super) rotation: (f64, f64),
    /// Velocities at the start and the end in the body frame of the midpoint.
    pub(super) start_velocity: BodyVector,
    pub(super) end_velocity: BodyVector,
    pub(super) contact: ContactSolution<N>,
}

impl<const N: usize> Step<N> {
    /// What the first step of a rollout, of length `dt`, follows: without contacts, it ends as the rollout starts.
    pub(super) fn before(start: &State, dt: f64) -> Self {
        let u = &start.velocity;
        let rotation = (start.configuration.heading - 0.5 * dt * u.yaw_rate).sin_cos();
        let velocity = [u.x, u.y, u.yaw_rate, u.wheel_rate.left, u.wheel_rate.right];
        let velocity = seen_from(rotation, &velocity.into());
        let contact = ContactSolution::default();
        Self { end: *start, rotation, start_velocity: velocity, end_velocity: velocity, contact }
    }
}

impl<const N: usize> StepModel<N> {
    /// For steps of this length, s, which matters with viscous friction alone.
    pub(super) fn new(robot: &Robot, step_length: f64) -> Self {
        let parameters = robot.parameters();
        let responses = robot.responses_within(step_length);
        let inverse_spin_inertia = responses.inverse_mass_matrix[(3, 3)];
        let slip_map = robot.tangent_jacobian().matrix().fixed_rows::<N>(0).into_owned();
        let operator = DelassusOperator::new(
            responses.delassus.fixed_view::<N, N>(0, 0).into_owned(),
            responses.normal_response.fixed_columns::<N>(0).into_owned(),
            parameters.friction_coefficients(),
        );
        let unit_rate = responses.inverse_mass_matrix * robot.smooth_force(1.0, [0.0, 0.0]);
        Self {
            operator,
            slip_map,
            impulse_response: responses.impulse_response.fixed_columns::<N>(0).into_owned(),
            restitution_factor: 1.0 + parameters.tangential_restitution,
            centrifugal_acceleration: unit_rate.fixed_rows::<3>(0).into_owned(),
            inverse_spin_inertia,
            viscous_friction: parameters.wheel_viscous_friction,
            free_normal_force: FreeNormalForce::new(robot, &unit_rate, inverse_spin_inertia),
        }
    }

    /// From one step to the next, of length `dt`, in place: copies would take longer than the step. What solves the friction problem
    /// finds the last step's solution in the place of this one's.
    ///
    /// The frame turns on by `dt omega`, from one midpoint to the next; what rounding adds grows with the root of the number of steps.
    #[expect(clippy::inline_always, reason = "a call would take the step through memory")]
    #[inline(always)]
    pub(super) fn advance(
        &self,
        step: &mut Step<N>,
        torque: PerWheel<f64>,
        dt: f64,
        solve: &mut impl FnMut(&DelassusOperator<N>, &OneStepProblem<N>, &mut ContactSolution<N>),
    ) {
        let (before, turn) = (step.rotation, sine_and_cosine(dt * step.end_velocity[2]));
        let (sin, cos) = (before.0 * turn.1 + before.1 * turn.0, before.1 * turn.1 - before.0 * turn.0);
        let start_velocity = seen_from(turn, &step.end_velocity);

        let torque = self.net_torque(torque, &start_velocity);
        let smooth_change = dt * self.smooth_acceleration(&start_velocity, torque);
        let problem = self.one_step_problem(&start_velocity, torque, &smooth_change, dt);
        solve(&self.operator, &problem, &mut step.contact);
        let end_velocity = start_velocity + smooth_change + self.velocity_change(&step.contact.impulse);

        let half = 0.5 * dt;
        let (q, u) = (&mut step.end.configuration, step.end.velocity);
        let w = &mut step.end.velocity;
        w.x = cos * end_velocity[0] - sin * end_velocity[1];
        w.y = sin * end_velocity[0] + cos * end_velocity[1];
        w.yaw_rate = end_velocity[2];
        w.wheel_rate = PerWheel::new(end_velocity[3], end_velocity[4]);
        q.x += half * (u.x + w.x);
        q.y += half * (u.y + w.y);
        q.heading += half * (u.yaw_rate + w.yaw_rate);
        q.wheel_angle.left += half * (u.wheel_rate.left + w.wheel_rate.left);
        q.wheel_angle.right += half * (u.wheel_rate.right + w.wheel_rate.right);
        (step.rotation, step.start_velocity, step.end_velocity) = ((sin, cos), start_velocity, end_velocity);
    }

    /// What viscous friction at a velocity leaves of the torques.
    #[inline]
    pub(super) fn net_torque(&self, torque: PerWheel<f64>, velocity: &BodyVector) -> PerWheel<f64> {
        // Without viscous friction the torques stay as they are to the bit.
        if self.viscous_friction == 0.0 {
            return torque;
        }
        let viscous = self.viscous_friction;
        PerWheel::new(torque.left - viscous * velocity[3], torque.right - viscous * velocity[4])
    }

    /// `M^-1 h`, with the net torques.
    #[inline]
    pub(super) fn smooth_acceleration(&self, velocity: &BodyVector, torque: PerWheel<f64>) -> BodyVector {
        let rate_squared = velocity[2] * velocity[2];
        let planar = &self.centrifugal_acceleration;
        BodyVector::from([
            rate_squared * planar[0],
            rate_squared * planar[1],
            rate_squared * planar[2],
            self.inverse_spin_inertia * torque.left,
            self.inverse_spin_inertia * torque.right,
        ])
    }

    /// `P Lambda`, skipping the zeros of P: friction turns a wheel by its own lengthwise impulse alone.
    #[inline]
    fn velocity_change(&self, impulse: &SVector<f64, N>) -> BodyVector {
        let response = &self.impulse_response;
        let mut change =
            BodyVector::from([0.0, 0.0, 0.0, response[(3, 0)] * impulse[0], response[(4, 1)] * impulse[1]]);
        for direction in 0..N {
            for velocity in 0..3 {
                change[velocity] += response[(velocity, direction)] * impulse[direction];
            }
        }
        change
    }

    /// `P'` times derivatives by the velocities at the end, likewise: those by the friction impulse.
    #[expect(clippy::inline_always, reason = "called in a sweep: a call would take derivatives through memory")]
    #[inline(always)]
    pub(super) fn by_impulse<T: Linear>(&self, [right, forward, yaw, left_wheel, right_wheel]: &[T; 5]) -> [T; N] {
        let response = &self.impulse_response;
        let mut by_impulse = [*right; N];
        for (direction, by_impulse) in by_impulse.iter_mut().enumerate() {
            *by_impulse = *right * response[(0, direction)]
                + *forward * response[(1, direction)]
                + *yaw * response[(2, direction)];
        }
        by_impulse[0] = by_impulse[0] + *left_wheel * response[(3, 0)];
        by_impulse[1] = by_impulse[1] + *right_wheel * response[(4, 1)];
        by_impulse
    }

    /// The data of the one-step friction problem.
    #[inline]
    fn one_step_problem(
        &self,
        velocity: &BodyVector,
        torque: PerWheel<f64>,
        smooth_change: &BodyVector,
        dt: f64,
    ) -> OneStepProblem<N> {
        OneStepProblem {
            free_slip: self.slip(&(velocity * self.restitution_factor + smooth_change)),
            free_normal: dt * self.free_normal_force.at(velocity, torque),
        }
    }

    /// `W_T'` times a body velocity, skipping the zeros of `W_T'`.
    #[inline]
    pub(super) fn slip(&self, velocity: &BodyVector) -> SVector<f64, N> {
        let map = &self.slip_map;
        let mut slip = SVector::zeros();
        slip[0] = velocity[1] + map[(0, 2)] * velocity[2] + map[(0, 3)] * velocity[3];
        slip[1] = velocity[1] + map[(1, 2)] * velocity[2] + map[(1, 4)] * velocity[4];
        slip[2] = velocity[0] + map[(2, 2)] * velocity[2];
        if N == 5 {
            slip[3] = velocity[1] + map[(3, 2)] * velocity[2];
            slip[4] = velocity[0] + map[(4, 2)] * velocity[2];
        }
        slip
    }
}

/// What linear maps take: a number, or its derivatives.
pub(super) trait Linear: Copy + Add<Output = Self> + Mul<f64, Output = Self> {}

impl<T: Copy + Add<Output = T> + Mul<f64, Output = T>> Linear for T {}

impl FreeNormalForce {
    fn new(robot: &Robot, unit_rate: &BodyVector, inverse_spin: f64) -> Self {
        let projection = robot.normal_force_projection();
        let by_change = &projection.velocity_change_map;
        Self {
            at_rest: projection.static_force,
            by_yaw_rate_squared: projection.centrifugal + by_change * unit_rate,
            by_yaw_rate_wheel_rate: projection.gyroscopic,
            by_torque: PerWheel::new(by_change.column(3) * inverse_spin, by_change.column(4) * inverse_spin),
        }
    }

    /// Normal forces without friction at net torques, N.
    #[inline]
    pub(super) fn at(&self, velocity: &BodyVector, torque: PerWheel<f64>) -> Vector3<f64> {
        let yaw_rate = velocity[2];
        self.at_rest
            + self.by_yaw_rate_squared * (yaw_rate * yaw_rate)
            + self.by_yaw_rate_wheel_rate * (yaw_rate * (velocity[3] + velocity[4]))
            + self.by_torque.left * torque.left
            + self.by_torque.right * torque.right
    }
}
