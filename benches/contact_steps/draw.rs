//! Random robots and rollouts whose contact steps are solved one by one.

use nalgebra::{SMatrix, SVector};
use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::contact::{DelassusOperator, OneStepProblem};
use slipdrive::robot::{BodyVector, Robot};

use crate::robots;

/// Steps between two draws of the torques.
const CONTROL_STEPS: usize = 5;

/// A robot that is accepted: log-uniform over decades about the reference robot, or within a factor of about two.
pub(crate) fn robot(random: &mut Xoshiro256PlusPlus, is_far: bool) -> Robot {
    let reach = if is_far { 1.0 } else { 0.2 };
    robots::accepted(|| {
        let mut parameters = robots::spread(random, reach, 0.4);
        parameters.tangential_restitution = if random.random_bool(0.7) { 0.0 } else { random.random_range(0.0..0.8) };
        parameters
    })
}

/// The matrices of a robot in `N` friction directions.
pub(crate) struct Drawn<const N: usize> {
    pub(crate) operator: DelassusOperator<N>,
    robot: Robot,
    impulse_response: SMatrix<f64, 5, N>,
}

impl<const N: usize> Drawn<N> {
    pub(crate) fn new(robot: &Robot) -> Self {
        Self {
            operator: DelassusOperator::new(
                robot.delassus().fixed_view::<N, N>(0, 0).into_owned(),
                robot.normal_response().fixed_columns::<N>(0).into_owned(),
                robot.parameters().friction_coefficients(),
            ),
            robot: robot.clone(),
            impulse_response: robot.impulse_response().fixed_columns::<N>(0).into_owned(),
        }
    }
}

/// The velocity of a robot in its own frame under random torques.
pub(crate) struct Motion {
    velocity: BodyVector,
    /// Without friction, in the current step.
    smooth_change: BodyVector,
    step_length: f64,
    torque: [f64; 2],
    torque_limit: f64,
}

impl Motion {
    /// Rests, rolls, or slips; steps of 0.1 to 300 ms, torques about those at which the wheels begin to slip.
    pub(crate) fn new(robot: &Robot, random: &mut Xoshiro256PlusPlus) -> Self {
        let parameters = robot.parameters();
        let radius = parameters.wheel_radius;
        let grip = parameters.wheel_friction_coefficient * parameters.total_mass() * parameters.gravity * radius;
        let speed = if random.random_bool(0.3) { 1e-9 } else { 10.0_f64.powf(random.random_range(-3.0..0.5)) };
        let (forward, yaw_rate) = (random.random_range(-speed..speed), random.random_range(-2.0..2.0) * speed);
        let rolls = random.random_bool(0.5);
        let sideways = if rolls { 0.0 } else { random.random_range(-0.5..0.5) * speed };
        let [left, right, _] = parameters.contact_points();
        let mut spin = |point_right: f64| {
            let rolling_rate = (forward + point_right * yaw_rate) / radius;
            let grips = rolls || random.random_bool(0.4);
            if grips { rolling_rate } else { rolling_rate + random.random_range(-20.0..20.0) * speed }
        };
        let velocity = [left.y * yaw_rate + sideways, forward, yaw_rate, spin(left.x), spin(right.x)];
        Self {
            velocity: BodyVector::from(velocity),
            smooth_change: BodyVector::zeros(),
            step_length: 10.0_f64.powf(random.random_range(-4.0..-0.5)),
            torque: [0.0; 2],
            torque_limit: 10.0_f64.powf(random.random_range(-1.0..0.5)) * grip,
        }
    }

    /// Goes to the midpoint of the next step; the friction problem there.
    pub(crate) fn problem<const N: usize>(
        &mut self,
        drawn: &Drawn<N>,
        step: usize,
        random: &mut Xoshiro256PlusPlus,
    ) -> OneStepProblem<N> {
        if step.is_multiple_of(CONTROL_STEPS) {
            self.torque = [0, 1].map(|_| random.random_range(-self.torque_limit..self.torque_limit));
        }
        self.turn();
        let (robot, dt, velocity) = (&drawn.robot, self.step_length, self.velocity);
        let yaw_rate = velocity[2];
        self.smooth_change = robot.inverse_mass_matrix() * robot.smooth_force(yaw_rate, self.torque) * dt;
        let projection = robot.normal_force_projection();
        let rates = yaw_rate * yaw_rate * projection.centrifugal
            + yaw_rate * (velocity[3] + velocity[4]) * projection.gyroscopic;
        let free = velocity * (1.0 + robot.parameters().tangential_restitution) + self.smooth_change;
        OneStepProblem {
            free_slip: (robot.tangent_jacobian().matrix() * free).fixed_rows::<N>(0).into_owned(),
            free_normal: (projection.static_force + rates) * dt + projection.velocity_change_map * self.smooth_change,
        }
    }

    /// Goes to the end of the step.
    pub(crate) fn advance<const N: usize>(&mut self, drawn: &Drawn<N>, impulse: &SVector<f64, N>) {
        self.velocity += self.smooth_change + drawn.impulse_response * impulse;
        self.turn();
    }

    /// Half a step's turn of the body frame.
    fn turn(&mut self) {
        let (sin, cos) = (0.5 * self.step_length * self.velocity[2]).sin_cos();
        let (right, forward) = (self.velocity[0], self.velocity[1]);
        self.velocity[0] = cos * right + sin * forward;
        self.velocity[1] = cos * forward - sin * right;
    }
}
