//! Rolling without slip: turns, drives and braking in segments of constant torque.

use nalgebra::Vector2;

use super::super::segments::Segment;
use super::super::settings::SolveInput;
use crate::motion::ROUNDING;
use crate::robot::{Motor, PerWheel, State};
use crate::shooting::ManeuverLimits;

/// Torques of the plans, as shares of their limits: away from the limit, every torque can move both ways.
pub(super) const AMPLITUDES: [f64; 2] = [0.8, 0.5];

/// Pose of the axle midpoint.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub(super) position: Vector2<f64>,
    pub(super) heading: f64,
}

/// A way to roll: straight on, or about the axle midpoint.
#[derive(Debug, Clone, Copy)]
pub(super) struct Roll {
    /// The largest ones forwards or to the left, N m.
    pub(super) torque: PerWheel<f64>,
    /// From the force of both rims to what accelerates: 1, or half the track, m.
    lever: f64,
    /// kg, or kg m2 about the axle midpoint.
    inertia: f64,
    /// What the speed or yaw rate may be, m/s or rad/s.
    top_speed: f64,
}

/// Rolling without slip, from which the legs are computed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rolling {
    /// Its torques differ where the centre of mass is off the middle, so that the robot goes straight: a long drive that turns a little
    /// ends far from its goal.
    pub(super) drive: Roll,
    pub(super) turn: Roll,
    /// m
    wheel_radius: f64,
}

impl Rolling {
    pub(super) fn new(input: &SolveInput, amplitude: f64) -> Self {
        let robot = input.robot.parameters();
        let half_track = robot.track_width / 2.0;
        let axle_load = robot.weight()
            - robot.chassis_mass * robot.gravity * robot.center_of_mass_forward / robot.axle_to_front_support;
        let grip = robot.wheel_friction_coefficient * axle_load / 2.0 * robot.wheel_radius;
        let limits = &input.maneuver.limits;
        let share = amplitude * limits.grip_utilization.unwrap_or(1.0);
        let limited = |limit: f64| share * limit.min(if grip > 0.0 { grip } else { f64::INFINITY });
        let limit = input.robot.torques_near_grip(input.maneuver.torque_limit);
        let torque = PerWheel::new(limited(limit.left), limited(limit.right));
        let spin = 2.0 * robot.wheel_spin_inertia / robot.wheel_radius.powi(2);
        let mass = robot.total_mass() + spin;
        let straight = straightened(torque, robot.chassis_mass * robot.center_of_mass_right / (mass * half_track));
        let rim_speed = robot.wheel_radius * top_wheel_rate(robot.motor, limits, torque);
        let top_speed = rim_speed.min(limits.speed.unwrap_or(f64::INFINITY));
        let drive = Roll { torque: straight, lever: 1.0, inertia: mass, top_speed };
        let top_speed = (rim_speed / half_track).min(limits.yaw_rate.unwrap_or(f64::INFINITY));
        let torque = PerWheel::new(-torque.left, torque.right);
        let turn = Roll { torque, lever: half_track, inertia: robot.rolling_yaw_inertia(), top_speed };
        Self { drive, turn, wheel_radius: robot.wheel_radius }.gentle(limits)
    }

    /// With as much of the torques as the limits of the accelerations allow.
    fn gentle(mut self, limits: &ManeuverLimits) -> Self {
        let largest = |limit: Option<f64>, rate: f64| limit.map_or(1.0, |limit| (limit / rate).min(1.0));
        let [along, about] = [self.drive, self.turn].map(|roll| self.effort(&roll) / roll.inertia);
        let share = largest(limits.acceleration, along)
            .min(largest(limits.deceleration, along))
            .min(largest(limits.yaw_acceleration, about));
        self.drive.torque = times(self.drive.torque, (share, share));
        self.turn.torque = times(self.turn.torque, (share, share));
        self
    }

    /// The largest torques of each wheel, N m.
    pub(super) fn largest_torques(&self) -> PerWheel<f64> {
        PerWheel::new(-self.turn.torque.left, self.turn.torque.right)
    }

    /// With the largest torques in drives, too, which then turn where the centre of mass is off the middle.
    pub(super) fn with_largest_torques(mut self) -> Self {
        self.drive.torque = self.largest_torques();
        self
    }

    /// What accelerates at full effort, N or N m.
    fn effort(&self, roll: &Roll) -> f64 {
        (roll.torque.left.abs() + roll.torque.right.abs()) / self.wheel_radius * roll.lever
    }

    /// From rest to rest: full effort over half the way, full braking over the rest; at the top speed in between. Positive ways are
    /// forwards, m, or to the left, rad.
    pub(super) fn go(&self, roll: &Roll, way: f64, segments: &mut Vec<Segment>) {
        let half = (way.abs() * roll.inertia / self.effort(roll)).sqrt();
        if half > 0.0 {
            // The speed in the middle is the way over a half; at the top speed the effort is as much shorter.
            let at_top_speed = way.abs() / roll.top_speed;
            let effort = half * (half / at_top_speed).min(1.0);
            let sign = way.signum();
            segments.push(Segment { duration: effort, torque: times(roll.torque, (sign, sign)) });
            if effort < half {
                segments.push(Segment { duration: at_top_speed - effort, torque: PerWheel::new(0.0, 0.0) });
            }
            segments.push(Segment { duration: effort, torque: times(roll.torque, (-sign, -sign)) });
        }
    }

    /// From a speed to rest; the way.
    fn stop(&self, roll: &Roll, speed: f64, segments: &mut Vec<Segment>) -> f64 {
        if speed.abs() <= ROUNDING {
            return 0.0;
        }
        let duration = speed.abs() * roll.inertia / self.effort(roll);
        let sign = -speed.signum();
        segments.push(Segment { duration, torque: times(roll.torque, (sign, sign)) });
        speed * duration / 2.0
    }

    /// Brakes a moving state to rest; returns where the axle then stands.
    pub(super) fn brake(&self, state: &State, segments: &mut Vec<Segment>) -> Pose {
        let (q, u) = (&state.configuration, &state.velocity);
        let forward = Vector2::new(-q.heading.sin(), q.heading.cos());
        let way = self.stop(&self.drive, forward.dot(&Vector2::new(u.x, u.y)), segments);
        let turned = self.stop(&self.turn, u.yaw_rate, segments);
        Pose { position: Vector2::new(q.x, q.y) + forward * way, heading: q.heading + turned }
    }
}

/// Torques at most these under which the robot goes straight: the force of the right wheel exceeds the mean by a share, and that of the left
/// one falls short of it. With a centre of mass beyond a wheel one would have to brake: there they stay as they are.
fn straightened(torque: PerWheel<f64>, share: f64) -> PerWheel<f64> {
    if share.abs() >= 1.0 {
        return torque;
    }
    let largest = 1.0 + share.abs();
    times(torque, ((1.0 - share) / largest, (1.0 + share) / largest))
}

fn times(torque: PerWheel<f64>, (left, right): (f64, f64)) -> PerWheel<f64> {
    PerWheel::new(left * torque.left, right * torque.right)
}

/// The rate at which a wheel may turn under its torque, rad/s.
fn top_wheel_rate(motor: Option<Motor>, limits: &ManeuverLimits, torque: PerWheel<f64>) -> f64 {
    let of_motor = |motor: Motor| {
        let share = torque.left.max(torque.right) / motor.stall_torque;
        motor.free_speed * (1.0 - share).max(1.0 - AMPLITUDES[0])
    };
    motor.map_or(f64::INFINITY, of_motor).min(limits.wheel_rate.unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drives_go_straight_with_the_centre_of_mass_between_the_wheels() {
        let torque = PerWheel::new(1.0, 1.0);
        assert_eq!(straightened(torque, 0.0), torque);
        assert_eq!(straightened(torque, 0.25), PerWheel::new(0.6, 1.0));
        assert_eq!(straightened(torque, -0.25), PerWheel::new(1.0, 0.6));
        assert_eq!(straightened(torque, 1.0), torque);
    }
}
