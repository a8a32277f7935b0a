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

/// Inertias and torques of rolling without slip, from which the legs are computed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rolling {
    /// The largest of each wheel, N m: those of a turn.
    pub(super) torque: PerWheel<f64>,
    /// Of a drive, N m. They differ where the centre of mass is off the middle, so that the robot goes straight: a long drive that turns
    /// a little ends far from its goal.
    drive_torque: PerWheel<f64>,
    /// m
    wheel_radius: f64,
    half_track: f64,
    /// kg
    mass: f64,
    /// About the axle midpoint, kg m2.
    yaw_inertia: f64,
    /// What speed and yaw rate may be, m/s and rad/s.
    top_speed: f64,
    top_yaw_rate: f64,
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
        let drive_torque = straightened(torque, robot.chassis_mass * robot.center_of_mass_right / (mass * half_track));
        let rim_speed = robot.wheel_radius * top_wheel_rate(robot.motor, limits, torque);
        Self {
            torque,
            drive_torque,
            wheel_radius: robot.wheel_radius,
            half_track,
            mass,
            yaw_inertia: robot.rolling_yaw_inertia(),
            top_speed: rim_speed.min(limits.speed.unwrap_or(f64::INFINITY)),
            top_yaw_rate: (rim_speed / half_track).min(limits.yaw_rate.unwrap_or(f64::INFINITY)),
        }
        .gentle(limits)
    }

    /// With as much of the torques as the limits of the accelerations allow.
    fn gentle(mut self, limits: &ManeuverLimits) -> Self {
        let largest = |limit: Option<f64>, rate: f64| limit.map_or(1.0, |limit| (limit / rate).min(1.0));
        let along = self.force() / self.mass;
        let share = largest(limits.acceleration, along)
            .min(largest(limits.deceleration, along))
            .min(largest(limits.yaw_acceleration, self.moment() / self.yaw_inertia));
        self.torque = times(self.torque, (share, share));
        self.drive_torque = times(self.drive_torque, (share, share));
        self
    }

    /// With the largest torques in drives, too, which then turn where the centre of mass is off the middle.
    pub(super) fn with_largest_torques(self) -> Self {
        Self { drive_torque: self.torque, ..self }
    }

    /// Of a drive at the floor, N.
    fn force(&self) -> f64 {
        (self.drive_torque.left + self.drive_torque.right) / self.wheel_radius
    }

    /// Of a turn about the axle midpoint, N m.
    fn moment(&self) -> f64 {
        (self.torque.left + self.torque.right) / self.wheel_radius * self.half_track
    }

    /// Full effort over half the distance, full braking over the rest; at the top speed in between.
    pub(super) fn drive(&self, distance: f64, segments: &mut Vec<Segment>) {
        let sign = distance.signum();
        let torque = times(self.drive_torque, (sign, sign));
        let half = (distance.abs() * self.mass / self.force()).sqrt();
        push_trapezoid((half, distance.abs() / self.top_speed), torque, segments);
    }

    /// Positive angles turn left: the right wheel drives forward.
    pub(super) fn turn(&self, angle: f64, segments: &mut Vec<Segment>) {
        let sign = angle.signum();
        let torque = times(self.torque, (-sign, sign));
        let half = (angle.abs() * self.yaw_inertia / self.moment()).sqrt();
        push_trapezoid((half, angle.abs() / self.top_yaw_rate), torque, segments);
    }

    /// Brakes a moving state to rest; returns where the axle then stands.
    pub(super) fn brake(&self, state: &State, segments: &mut Vec<Segment>) -> Pose {
        let q = &state.configuration;
        let forward = Vector2::new(-q.heading.sin(), q.heading.cos());
        let speed = forward.dot(&Vector2::new(state.velocity.x, state.velocity.y));
        let yaw_rate = state.velocity.yaw_rate;
        let mut pose = Pose { position: Vector2::new(q.x, q.y), heading: q.heading };
        if speed.abs() > ROUNDING {
            let duration = speed.abs() * self.mass / self.force();
            let sign = -speed.signum();
            segments.push(Segment { duration, torque: times(self.drive_torque, (sign, sign)) });
            pose.position += forward * (speed * duration / 2.0);
        }
        if yaw_rate.abs() > ROUNDING {
            let duration = yaw_rate.abs() * self.yaw_inertia / self.moment();
            let sign = -yaw_rate.signum();
            segments.push(Segment { duration, torque: times(self.torque, (-sign, sign)) });
            pose.heading += yaw_rate * duration / 2.0;
        }
        pose
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

/// Full effort and full braking of a half each; where that passes the top speed, at which the way takes `at_top_speed`, coasting in
/// between. Times in s.
fn push_trapezoid((half, at_top_speed): (f64, f64), torque: PerWheel<f64>, segments: &mut Vec<Segment>) {
    if half > 0.0 {
        let braking = PerWheel::new(-torque.left, -torque.right);
        // The speed in the middle is the way over a half; at the top speed the effort is as much shorter.
        let effort = half * (half / at_top_speed).min(1.0);
        segments.push(Segment { duration: effort, torque });
        if effort < half {
            segments.push(Segment { duration: at_top_speed - effort, torque: PerWheel::new(0.0, 0.0) });
        }
        segments.push(Segment { duration: effort, torque: braking });
    }
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
