//! The largest accelerations that friction and torque can cause, and the drive norm.
//!
//! Without separation the normal forces add up to m g, so the friction forces add up to at most max(mu) m g. Velocities are
//! those of the whole robot's centre of mass G, in which translation, yaw and wheels have a diagonal mass matrix.

use nalgebra::Vector2;

use crate::robot::{PerWheel, Robot};

/// The contact solver keeps the friction law to 1e-10 of the weight: capacities are enlarged by more than that.
const LAW_ROUNDING: f64 = 1.0 + 1e-9;
/// Steps of the fixed point of [`Capacity::kept_rates`], which converges geometrically and is safe after any number.
const KEPT_RATE_STEPS: usize = 60;

/// The largest accelerations, and the growth of the drive norm (`docs/bounds.md`).
#[derive(Debug, Clone, Copy)]
pub(super) struct Capacity {
    /// kg
    pub(super) mass: f64,
    /// Yaw inertia about G, kg m2.
    pub(super) yaw_inertia: f64,
    /// G relative to the chassis centre of mass, m.
    pub(super) center: Vector2<f64>,
    /// Largest acceleration of G, m/s2.
    pub(super) acceleration: f64,
    /// Largest yaw acceleration, rad/s2.
    pub(super) yaw_acceleration: f64,
    /// Largest wheel acceleration, rad/s2.
    pub(super) wheel_acceleration: PerWheel<f64>,
    /// Largest growth of the drive norm per second; none with restitution, under which friction may raise it.
    pub(super) drive_rate: Option<f64>,
    spin_inertia: f64,
    /// Drive norm per angular impulse at a wheel, 1/(kg^1/2 m).
    wheel_gain: PerWheel<f64>,
}

/// Magnitudes of the velocities that the drive norm weighs: G, m/s; yaw and wheels, rad/s.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Speeds {
    pub(super) translation: f64,
    pub(super) yaw: f64,
    pub(super) wheel: PerWheel<f64>,
}

impl Capacity {
    pub(super) fn new(robot: &Robot, torque_limit: PerWheel<f64>) -> Self {
        let parameters = robot.parameters();
        let center = parameters.whole_center_of_mass();
        let mass = parameters.total_mass();
        let yaw_inertia = robot.mass_matrix()[(2, 2)] - mass * center.norm_squared();
        let levers = parameters.contact_points().map(|point| point - center);
        let (wheel, front) = (parameters.wheel_friction_coefficient, parameters.front_friction_coefficient);
        let moment = wheel * levers[0].norm().max(levers[1].norm());
        let weight = LAW_ROUNDING * mass * parameters.gravity;

        let spin_inertia = parameters.wheel_spin_inertia;
        let radius = parameters.wheel_radius;
        let wheel_acceleration = |torque: f64| (LAW_ROUNDING * torque + radius * wheel * weight) / spin_inertia;
        // Squared speed of a contact along the wheel per unit of squared drive norm.
        let contact_gain = |lever: f64| 1.0 / mass + lever * lever / yaw_inertia;
        let wheel_gain = |lever: f64| {
            // Without grip no torque ever reaches the floor.
            let gain = if wheel > 0.0 { contact_gain(lever) } else { 0.0 };
            (gain / (radius * radius + spin_inertia * gain)).sqrt()
        };
        let wheel_gain = PerWheel::new(wheel_gain(levers[0].x), wheel_gain(levers[1].x));
        let drive_rate = wheel_gain.left * torque_limit.left + wheel_gain.right * torque_limit.right;
        Self {
            mass,
            yaw_inertia,
            center,
            acceleration: wheel.max(front) * weight / mass,
            yaw_acceleration: moment.max(front * levers[2].norm()) * weight / yaw_inertia,
            wheel_acceleration: PerWheel::new(
                wheel_acceleration(torque_limit.left),
                wheel_acceleration(torque_limit.right),
            ),
            drive_rate: (parameters.tangential_restitution == 0.0).then_some(LAW_ROUNDING * drive_rate),
            spin_inertia,
            wheel_gain,
        }
    }

    /// At least the drive norm of these speeds: any split of the wheel rates gives such a bound.
    pub(super) fn drive_norm_at_most(&self, speeds: &Speeds) -> f64 {
        let (_, kept, norm) = self.kept_rates(speeds);
        let excess = |gain: f64, rate: f64, kept: f64| gain * self.spin_inertia * (rate - kept);
        norm + excess(self.wheel_gain.left, speeds.wheel.left, kept.left)
            + excess(self.wheel_gain.right, speeds.wheel.right, kept.right)
    }

    /// At most the drive norm of these speeds: any velocity of norm at most 1 within the gains gives such a bound.
    pub(super) fn drive_norm_at_least(&self, speeds: &Speeds) -> f64 {
        let (scale, kept, _) = self.kept_rates(speeds);
        let wheels = kept.left * speeds.wheel.left + kept.right * speeds.wheel.right;
        let product = self.body_norm_squared(speeds) + self.spin_inertia * wheels;
        if scale > 0.0 { product / scale } else { 0.0 }
    }

    /// (norm before the last step, wheel rates kept by it, norm with them); the norms decrease.
    fn kept_rates(&self, speeds: &Speeds) -> (f64, PerWheel<f64>, f64) {
        let body = self.body_norm_squared(speeds);
        let norm =
            |rate: PerWheel<f64>| (body + self.spin_inertia * (rate.left * rate.left + rate.right * rate.right)).sqrt();
        let (mut scale, mut kept) = (norm(speeds.wheel), speeds.wheel);
        for _ in 0..KEPT_RATE_STEPS {
            scale = norm(kept);
            kept.left = kept.left.min(self.wheel_gain.left * scale);
            kept.right = kept.right.min(self.wheel_gain.right * scale);
        }
        (scale, kept, norm(kept))
    }

    fn body_norm_squared(&self, speeds: &Speeds) -> f64 {
        self.mass * speeds.translation * speeds.translation + self.yaw_inertia * speeds.yaw * speeds.yaw
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::RobotParameters;

    #[test]
    fn both_sides_of_the_drive_norm_meet() {
        let robot = Robot::new(RobotParameters::default()).unwrap();
        let capacity = Capacity::new(&robot, PerWheel::new(1.0, 1.0));
        for wheel in [PerWheel::new(0.0, 0.0), PerWheel::new(10.0, 20.0), PerWheel::new(1000.0, 2.0)] {
            let speeds = Speeds { translation: 1.5, yaw: 2.0, wheel };
            let (least, most) = (capacity.drive_norm_at_least(&speeds), capacity.drive_norm_at_most(&speeds));
            // The fixed point contracts by the share of the wheels in the rolling inertia, about a tenth.
            assert!(least <= most * (1.0 + 1e-14) && most <= least * (1.0 + 1e-12), "{least} {most}");
        }
    }

    #[test]
    fn rolling_wheels_keep_their_rates() {
        let robot = Robot::new(RobotParameters::default()).unwrap();
        let capacity = Capacity::new(&robot, PerWheel::new(1.0, 1.0));
        let rolling = Speeds { translation: 1.0, yaw: 0.0, wheel: PerWheel::new(1.0 / 0.06, 1.0 / 0.06) };
        let energy = 0.5 * capacity.mass + 0.003 / 0.06_f64.powi(2);
        // One square root and its square round to a few ulp.
        assert!((capacity.drive_norm_at_most(&rolling) - (2.0 * energy).sqrt()).abs() < 1e-12);
    }
}
