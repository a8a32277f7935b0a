//! Seeded random robots, states and torque schedules for the physics tests.

use nalgebra::SVector;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::robot::{PerWheel, Robot, RobotParameters, State};
use slipdrive::simulation::TorqueSchedule;

/// A source of random cases whose seed a failing test can print.
pub(crate) struct RandomCases {
    rng: Xoshiro256PlusPlus,
}

impl RandomCases {
    pub(crate) fn new(seed: u64) -> Self {
        Self { rng: Xoshiro256PlusPlus::seed_from_u64(seed) }
    }

    pub(crate) fn between(&mut self, lower: f64, upper: f64) -> f64 {
        self.rng.random_range(lower..upper)
    }

    pub(crate) fn whole(&mut self, lower: u64, upper: u64) -> u64 {
        self.rng.random_range(lower..upper)
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.rng.random_bool(probability)
    }

    /// A valid robot within a factor of about two around the reference robot.
    pub(crate) fn robot(&mut self) -> Robot {
        let reference = RobotParameters::default();
        loop {
            let parameters = RobotParameters {
                chassis_mass: reference.chassis_mass * self.between(0.5, 2.0),
                wheel_mass: reference.wheel_mass * self.between(0.3, 2.0),
                chassis_yaw_inertia: reference.chassis_yaw_inertia * self.between(0.5, 2.0),
                wheel_diametral_inertia: reference.wheel_diametral_inertia * self.between(0.5, 2.0),
                wheel_spin_inertia: reference.wheel_spin_inertia * self.between(0.3, 3.0),
                wheel_radius: reference.wheel_radius * self.between(0.7, 1.5),
                track_width: reference.track_width * self.between(0.7, 1.5),
                axle_to_front_support: reference.axle_to_front_support * self.between(0.8, 1.5),
                front_support_right: self.between(-0.05, 0.05),
                center_of_mass_right: self.between(-0.04, 0.04),
                center_of_mass_forward: self.between(0.02, 0.12),
                center_of_mass_height: self.between(0.0, 0.2),
                wheel_friction_coefficient: self.between(0.05, 0.9),
                front_friction_coefficient: if self.chance(0.5) { 0.0 } else { self.between(0.02, 0.5) },
                tangential_restitution: if self.chance(0.7) { 0.0 } else { self.between(0.0, 0.8) },
                gravity: 9.81,
                ..reference
            };
            if let Ok(robot) = Robot::new(parameters) {
                return robot;
            }
        }
    }

    /// A state near the origin with velocities up to `speed` m/s, or exactly rolling.
    pub(crate) fn state(&mut self, robot: &Robot, speed: f64) -> State {
        let radius = robot.parameters().wheel_radius;
        let heading = self.between(-3.0, 3.0);
        let (forward, yaw_rate) = (self.between(-speed, speed), self.between(-2.0, 2.0) * speed);
        let rolling = self.chance(0.5);
        let sideways = if rolling { 0.0 } else { self.between(-0.5, 0.5) * speed };
        let [left, right, _] = robot.parameters().contact_points();
        // The axle's lateral velocity vanishes when rolling: v_r = p_f omega.
        let body = [left.y * yaw_rate + sideways, forward];
        let spin = |point_right: f64, cases: &mut Self| {
            let rolling_rate = (forward + point_right * yaw_rate) / radius;
            if rolling || cases.chance(0.4) { rolling_rate } else { rolling_rate + cases.between(-20.0, 20.0) * speed }
        };
        let rates = PerWheel::new(spin(left.x, self), spin(right.x, self));
        let (sin, cos) = heading.sin_cos();
        let (x, y) = (cos * body[0] - sin * body[1], sin * body[0] + cos * body[1]);
        State::from_vector(&SVector::from([0.0, 0.0, heading, 0.0, 0.0, x, y, yaw_rate, rates.left, rates.right]))
    }

    /// Uniform torques up to `limit` N m.
    pub(crate) fn schedule(&mut self, control_count: usize, final_time: f64, limit: f64) -> TorqueSchedule {
        let mut torques = || (0..control_count).map(|_| self.between(-limit, limit)).collect::<Vec<_>>();
        TorqueSchedule { final_time, left: torques(), right: torques() }
    }
}
