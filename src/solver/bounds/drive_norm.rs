//! The drive norm: kinetic energy that counts the spin of a wheel only as far as the floor can return it
//! (`docs/bounds.md`).
//!
//! Velocities are those of the whole robot's centre of mass G, in which translation, yaw and wheels have a diagonal mass
//! matrix.

use nalgebra::Vector2;

use crate::robot::PerWheel;

/// Magnitudes of the velocities that the drive norm weighs: G, m/s; yaw and wheels, rad/s.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Speeds {
    pub(super) translation: f64,
    pub(super) yaw: f64,
    pub(super) wheel: PerWheel<f64>,
}

/// The norm of one robot, (kg m2/s2)^1/2.
#[derive(Debug, Clone, Copy)]
pub(super) struct DriveNorm {
    mass: f64,
    /// Yaw inertia about G, kg m2.
    yaw_inertia: f64,
    pub(super) spin_inertia: f64,
    pub(super) wheel_radius: f64,
    /// Contacts relative to G (right, forward), m.
    levers: [Vector2<f64>; 3],
    /// Drive norm per angular impulse at a wheel, 1/(kg^1/2 m).
    pub(super) gain: PerWheel<f64>,
}

/// The bodies whose motion the norm weighs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bodies {
    pub(super) mass: f64,
    pub(super) yaw_inertia: f64,
    pub(super) spin_inertia: f64,
    pub(super) wheel_radius: f64,
    pub(super) levers: [Vector2<f64>; 3],
    /// Whether friction can act on the wheels: without, no torque ever reaches the floor.
    pub(super) has_grip: bool,
}

impl DriveNorm {
    pub(super) fn new(bodies: Bodies) -> Self {
        let Bodies { mass, yaw_inertia, spin_inertia, wheel_radius, levers, has_grip } = bodies;
        let gain = |lever: f64| {
            // Squared speed of a contact along the wheel per unit of squared norm.
            let contact_gain = if has_grip { 1.0 / mass + lever * lever / yaw_inertia } else { 0.0 };
            (contact_gain / (wheel_radius * wheel_radius + spin_inertia * contact_gain)).sqrt()
        };
        let gain = PerWheel::new(gain(levers[0].x), gain(levers[1].x));
        Self { mass, yaw_inertia, spin_inertia, wheel_radius, levers, gain }
    }

    /// Speed of G per unit of the norm, at most.
    pub(super) fn translation_scale(&self) -> f64 {
        1.0 / self.mass.sqrt()
    }

    /// Yaw rate per unit of the norm, at most.
    pub(super) fn yaw_scale(&self) -> f64 {
        1.0 / self.yaw_inertia.sqrt()
    }

    /// Change of a contact's lengthwise speed per lengthwise force: at the same wheel (left, right), and at the other one.
    pub(super) fn contact_response(&self) -> ([f64; 2], f64) {
        let response = |a: usize, b: usize| 1.0 / self.mass + self.levers[a].x * self.levers[b].x / self.yaw_inertia;
        ([response(0, 0), response(1, 1)], response(0, 1))
    }

    /// Velocities by lengthwise impulses (left, right), with wheel rates.
    pub(super) fn speeds_by(&self, impulse: Vector2<f64>, wheel: PerWheel<f64>) -> Speeds {
        let moment = impulse.x * self.levers[0].x + impulse.y * self.levers[1].x;
        Speeds { translation: impulse.sum().abs() / self.mass, yaw: moment.abs() / self.yaw_inertia, wheel }
    }

    /// Largest sum of the contacts' slips in a velocity that the norm admits, m/s.
    pub(super) fn largest_slips(&self) -> f64 {
        let of_body = |lever: &Vector2<f64>| (1.0 / self.mass + lever.norm_squared() / self.yaw_inertia).sqrt();
        let of_wheels = self.wheel_radius * (self.gain.left + self.gain.right);
        self.levers.iter().map(of_body).sum::<f64>() + of_wheels
    }

    /// Squared yaw rate per squared norm, at most.
    pub(super) fn largest_yaw_squared(&self) -> f64 {
        1.0 / self.yaw_inertia
    }

    /// Yaw rate times sum of the wheel rates per squared norm, at most.
    ///
    /// For a velocity w of yaw a / sqrt(I) and equal wheel rates c the norm is at least `a sqrt(I) omega + J c Psi`, so the
    /// product is at most its square over `4 a c J sqrt(I)`.
    pub(super) fn largest_yaw_times_wheels(&self) -> f64 {
        let wheel_rate = self.gain.left.min(self.gain.right).min(0.5 / self.spin_inertia.sqrt());
        let yaw = (1.0 - 2.0 * self.spin_inertia * wheel_rate * wheel_rate).sqrt();
        1.0 / (4.0 * yaw * wheel_rate * self.spin_inertia * self.yaw_inertia.sqrt())
    }

    /// At least the drive norm of these speeds: any split of the wheel rates gives such a bound.
    pub(super) fn at_most(&self, speeds: &Speeds) -> f64 {
        let (norm, kept) = self.kept_rates(speeds);
        let excess = |gain: f64, rate: f64, kept: f64| gain * self.spin_inertia * (rate - kept);
        norm + excess(self.gain.left, speeds.wheel.left, kept.left)
            + excess(self.gain.right, speeds.wheel.right, kept.right)
    }

    /// At most the drive norm of these speeds: any velocity of norm at most 1 within the gains gives such a bound.
    pub(super) fn at_least(&self, speeds: &Speeds) -> f64 {
        let (norm, kept) = self.kept_rates(speeds);
        let wheels = kept.left * speeds.wheel.left + kept.right * speeds.wheel.right;
        let product = self.body_norm_squared(speeds) + self.spin_inertia * wheels;
        if norm > 0.0 { product / norm } else { 0.0 }
    }

    /// The least norm whose gains take from the wheels what exceeds them, with the rates that they keep.
    ///
    /// A wheel is cut where its rate exceeds its gain times the norm, and the norm falls with each one that is cut.
    fn kept_rates(&self, speeds: &Speeds) -> (f64, PerWheel<f64>) {
        let body = self.body_norm_squared(speeds);
        let wheels = [(speeds.wheel.left, self.gain.left), (speeds.wheel.right, self.gain.right)];
        let norm_with = |is_cut: [bool; 2]| {
            let (mut squared, mut share) = (body, 1.0);
            for ((rate, gain), is_cut) in wheels.into_iter().zip(is_cut) {
                if is_cut {
                    share -= self.spin_inertia * gain * gain;
                } else {
                    squared += self.spin_inertia * rate * rate;
                }
            }
            (squared / share).sqrt()
        };
        let mut is_cut = [false; 2];
        let mut norm = norm_with(is_cut);
        while let Some(next) = (0..2).find(|&wheel| !is_cut[wheel] && wheels[wheel].0 > wheels[wheel].1 * norm) {
            is_cut[next] = true;
            norm = norm_with(is_cut);
        }
        let [left, right] = wheels.map(|(rate, gain)| rate.min(gain * norm));
        (norm, PerWheel::new(left, right))
    }

    fn body_norm_squared(&self, speeds: &Speeds) -> f64 {
        self.mass * speeds.translation * speeds.translation + self.yaw_inertia * speeds.yaw * speeds.yaw
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, RobotParameters};
    use crate::solver::bounds::capacity::bodies;

    fn reference() -> DriveNorm {
        DriveNorm::new(bodies(&Robot::new(RobotParameters::default()).unwrap()))
    }

    #[test]
    fn both_sides_of_the_drive_norm_meet() {
        let norm = reference();
        for wheel in [PerWheel::new(0.0, 0.0), PerWheel::new(10.0, 20.0), PerWheel::new(1000.0, 2.0)] {
            let speeds = Speeds { translation: 1.5, yaw: 2.0, wheel };
            let (least, most) = (norm.at_least(&speeds), norm.at_most(&speeds));
            assert!((least - most).abs() <= 1e-14 * most, "{least} {most}");
        }
    }

    #[test]
    fn rolling_wheels_keep_their_rates() {
        let norm = reference();
        let rolling = Speeds { translation: 1.0, yaw: 0.0, wheel: PerWheel::new(1.0 / 0.06, 1.0 / 0.06) };
        let energy = 0.5 * norm.mass + 0.003 / 0.06_f64.powi(2);
        // One square root and its square round to a few ulp.
        assert!((norm.at_most(&rolling) - (2.0 * energy).sqrt()).abs() < 1e-12);
    }
}
