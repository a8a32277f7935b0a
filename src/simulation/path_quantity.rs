//! Quantities of a rollout that a plan must keep small at every step, with their derivatives by what the step is made of.

use nalgebra::{RowSVector, RowVector3, Vector2};

use super::moreau_step::Step;
use super::motor_load::{MotorJudged, MotorLoad};
use super::tape::TapeEntry;
use super::turn::{sine_and_cosine, turned};
use crate::contact::{UtilizationGradient, WheelFriction};
use crate::robot::{BodyVector, Motor, PerWheel};

/// Half of what a search may leave of a limit's excess, as a share of the limit.
const NEGLIGIBLE: f64 = 5e-7;

/// A quantity with one value per step, in the body frame of the step's midpoint. Points of the chassis are given from its centre of
/// mass, (right, forward), m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PathQuantity {
    /// The normal force of a contact (0 left, 1 right, 2 front) with its sign reversed, N: positive where the contact separates.
    Unloading {
        /// The contact.
        contact: usize,
    },
    /// By how much the torque of a wheel (0 left, 1 right) exceeds its motor's curve, as a share of the stall torque.
    MotorTorque {
        /// The wheel.
        wheel: usize,
        /// Its motor.
        motor: Motor,
        /// Where the torque is judged.
        judged: MotorJudged,
    },
    /// The magnitude of a wheel's rate at the end of the step, rad/s.
    WheelRate {
        /// The wheel.
        wheel: usize,
    },
    /// The speed of a point at the end of the step, m/s.
    Speed {
        /// The point.
        point: Vector2<f64>,
    },
    /// The magnitude of the yaw rate at the end of the step, rad/s.
    YawRate,
    /// The magnitude of a point's acceleration, m/s2: with this sign where its speed does not fall, with the other one where it falls.
    Acceleration {
        /// The point.
        point: Vector2<f64>,
        /// 1 for what speeds it up, -1 for what slows it down.
        sign: f64,
    },
    /// The yaw acceleration to one side, rad/s2.
    YawAcceleration {
        /// 1 to the left, -1 to the right.
        sign: f64,
    },
    /// The share of their friction that two sticking wheels need.
    GripUtilization {
        /// Friction coefficient of the wheels.
        friction_coefficient: f64,
        /// Wheels that carry less count as carrying this, N: without normal force there is no share.
        least_normal_force: f64,
    },
    /// The share of its friction that one sticking wheel needs for its longitudinal force alone, in one direction. Never more than
    /// [`Self::GripUtilization`], but where both wheels come to their limits that has a corner, which these are the faces of.
    LengthwiseUtilization {
        /// The wheel.
        wheel: usize,
        /// 1 forwards, -1 backwards.
        sign: f64,
        /// Of the wheels.
        friction_coefficient: f64,
        /// As of [`Self::GripUtilization`], N.
        least_normal_force: f64,
    },
    /// By how far a point is outside an edge at the end of the step, with what its circle around the centre of mass bulges
    /// between two nodes, m; negative inside.
    Outside {
        /// The point.
        point: Vector2<f64>,
        /// Outward unit normal of the edge in the world.
        normal: Vector2<f64>,
        /// Distance of the edge from the origin of the world along its normal, m.
        distance: f64,
        /// Of the point's circle around the centre of mass, m.
        radius: f64,
    },
}

/// What quantities other than normal forces need of a step, beside its tape entry.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PathSample {
    /// Friction impulses of the wheels: left and right longitudinal, lateral, N s.
    friction: [f64; 3],
    /// World position of the chassis centre of mass at the end of the step, m.
    position: [f64; 2],
    /// Sine and cosine of the heading at the end of the step.
    rotation: (f64, f64),
    /// Sagitta of the arc on which a point turns around the centre of mass in the step, as a share of its radius.
    bulge: f64,
    torque: PerWheel<f64>,
    /// s.
    step_length: f64,
}

/// Derivatives of a quantity by the data of its own step.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
pub(super) struct PathGradient<const N: usize> {
    /// By the body velocities at the start and the end of the step.
    pub(super) by_start_velocity: RowSVector<f64, 5>,
    pub(super) by_end_velocity: RowSVector<f64, 5>,
    /// By the friction impulses.
    pub(super) by_impulse: RowSVector<f64, N>,
    /// By the normal impulses.
    pub(super) by_normal_impulse: RowVector3<f64>,
    pub(super) by_torque: PerWheel<f64>,
    /// By the step length.
    pub(super) by_step_length: f64,
    /// By x, y and heading at the end of the step; none where it depends on neither.
    pub(super) by_end_pose: Option<[f64; 3]>,
}

impl PathSample {
    #[inline]
    pub(super) fn new<const N: usize>(step: &Step<N>, torque: PerWheel<f64>, step_length: f64) -> Self {
        let impulse = &step.contact.impulse;
        let end = &step.end.configuration;
        Self {
            friction: [impulse[0], impulse[1], impulse[2]],
            position: [end.x, end.y],
            rotation: end.heading.sin_cos(),
            // radius (omega dt)^2 / 8.
            bulge: (step.end_velocity[2] * step_length).powi(2) / 8.0,
            torque,
            step_length,
        }
    }
}

impl PathQuantity {
    /// With the torque of a motor judged at the ends of steps.
    #[must_use]
    pub(crate) fn judged_at_ends(mut self) -> Self {
        if let Self::MotorTorque { judged, .. } = &mut self {
            *judged = MotorJudged::AtEnds;
        }
        self
    }

    /// Whether the quantity is an impulse or a change of velocity over the length of its step.
    pub(super) const fn is_per_step_length(self) -> bool {
        match self {
            Self::Unloading { .. } | Self::Acceleration { .. } | Self::YawAcceleration { .. } => true,
            Self::MotorTorque { .. }
            | Self::WheelRate { .. }
            | Self::Speed { .. }
            | Self::YawRate
            | Self::GripUtilization { .. }
            | Self::LengthwiseUtilization { .. }
            | Self::Outside { .. } => false,
        }
    }

    /// Whether the quantity jumps where the torques do, rather than to follow speeds or positions.
    pub const fn jumps_with_torque(self) -> bool {
        match self {
            Self::MotorTorque { judged: MotorJudged::AtNodes, .. }
            | Self::Acceleration { .. }
            | Self::YawAcceleration { .. }
            | Self::GripUtilization { .. }
            | Self::LengthwiseUtilization { .. } => true,
            Self::MotorTorque { judged: MotorJudged::AtEnds, .. }
            | Self::Unloading { .. }
            | Self::WheelRate { .. }
            | Self::Speed { .. }
            | Self::YawRate
            | Self::Outside { .. } => false,
        }
    }

    /// Whether the quantity depends on where the robot is.
    pub(super) const fn depends_on_pose(self) -> bool {
        match self {
            Self::Outside { .. } => true,
            Self::Unloading { .. }
            | Self::MotorTorque { .. }
            | Self::WheelRate { .. }
            | Self::Speed { .. }
            | Self::YawRate
            | Self::Acceleration { .. }
            | Self::YawAcceleration { .. }
            | Self::GripUtilization { .. }
            | Self::LengthwiseUtilization { .. } => false,
        }
    }

    /// A difference from a value that is negligible.
    pub(super) fn negligible(self, value: f64) -> f64 {
        let unit = match self {
            Self::MotorTorque { .. } => 1.0,
            Self::Outside { radius, .. } => radius,
            Self::Unloading { .. }
            | Self::WheelRate { .. }
            | Self::Speed { .. }
            | Self::YawRate
            | Self::Acceleration { .. }
            | Self::YawAcceleration { .. }
            | Self::GripUtilization { .. }
            | Self::LengthwiseUtilization { .. } => value.abs(),
        };
        NEGLIGIBLE * unit
    }

    /// The value of a step, times the step length where the quantity is per step length.
    #[inline]
    pub(super) fn of_step(self, entry: &TapeEntry, sample: &PathSample) -> f64 {
        let (start, end) = (&entry.start_velocity, &entry.end_velocity);
        match self {
            Self::Unloading { contact } => -entry.normal_impulse[contact],
            Self::MotorTorque { wheel, motor, judged } => {
                MotorLoad::of_step((wheel, motor, judged), entry, sample.torque).excess
            }
            Self::WheelRate { wheel } => end[3 + wheel].abs(),
            Self::Speed { point } => velocity_at(point, end).norm(),
            Self::YawRate => end[2].abs(),
            Self::Acceleration { point, sign } => sign * PointChange::new(point, entry, sample).signed(),
            Self::YawAcceleration { sign } => sign * (end[2] - start[2]),
            Self::GripUtilization { friction_coefficient, least_normal_force } => {
                wheel_friction(entry, sample, friction_coefficient, least_normal_force).utilization()
            }
            Self::LengthwiseUtilization { wheel, sign, friction_coefficient, least_normal_force } => {
                let friction = wheel_friction(entry, sample, friction_coefficient, least_normal_force);
                sign * friction.longitudinal[wheel] / friction.radius[wheel]
            }
            Self::Outside { point, normal, distance, radius } => {
                Corner::new(point, radius, sample).outside(normal, distance)
            }
        }
    }

    /// The node of a step that has its value: 0 is its start, 1 its end, also for what is of the whole step.
    pub(super) fn node(self, entry: &TapeEntry, sample: &PathSample) -> usize {
        if let Self::MotorTorque { wheel, motor, judged } = self {
            MotorLoad::of_step((wheel, motor, judged), entry, sample.torque).node
        } else {
            1
        }
    }

    /// Shows `note` the value of each quantity, with its place. Each corner is turned once: its edges follow each other.
    #[inline]
    pub(super) fn each_of_step(
        quantities: &[Self],
        entry: &TapeEntry,
        sample: &PathSample,
        mut note: impl FnMut(usize, f64),
    ) {
        let mut corner: Option<Corner> = None;
        for (place, quantity) in quantities.iter().enumerate() {
            let value = if let Self::Outside { point, normal, distance, radius } = *quantity {
                let known = corner.filter(|known| known.point == point);
                let known = known.unwrap_or_else(|| Corner::new(point, radius, sample));
                corner = Some(known);
                known.outside(normal, distance)
            } else {
                quantity.of_step(entry, sample)
            };
            note(place, value);
        }
    }

    /// Derivatives of [`Self::of_step`].
    pub(super) fn gradient<const N: usize>(self, entry: &TapeEntry, sample: &PathSample) -> PathGradient<N> {
        let mut gradient = PathGradient::zero();
        let (start, end) = (&entry.start_velocity, &entry.end_velocity);
        match self {
            Self::Unloading { contact } => gradient.by_normal_impulse[contact] = -1.0,
            Self::MotorTorque { wheel, motor, judged } => {
                let load = MotorLoad::of_step((wheel, motor, judged), entry, sample.torque);
                let [by_start, by_end] = load.by_rate.map(|by_rate| by_rate / motor.free_speed);
                gradient.by_start_velocity[3 + wheel] = by_start;
                gradient.by_end_velocity[3 + wheel] = by_end;
                let by_torque = load.by_torque / motor.stall_torque;
                gradient.by_torque =
                    if wheel == 0 { PerWheel::new(by_torque, 0.0) } else { PerWheel::new(0.0, by_torque) };
            }
            Self::WheelRate { wheel } => gradient.by_end_velocity[3 + wheel] = end[3 + wheel].signum(),
            Self::Speed { point } => {
                gradient.by_end_velocity = by_velocity_of(point, unit(velocity_at(point, end)));
            }
            Self::YawRate => gradient.by_end_velocity[2] = end[2].signum(),
            Self::Acceleration { point, sign } => {
                let change = PointChange::new(point, entry, sample);
                let by_change = sign * change.signed().signum() * change.direction();
                let by_velocity = by_velocity_of(point, by_change);
                (gradient.by_end_velocity, gradient.by_start_velocity) = (by_velocity, -by_velocity);
                // Of the turn of the point.
                let (along, yaw_rate) = (by_change.dot(&point), start[2]);
                gradient.by_start_velocity[2] -= along * 2.0 * yaw_rate * sample.step_length;
                gradient.by_step_length = -along * yaw_rate * yaw_rate;
            }
            Self::YawAcceleration { sign } => {
                (gradient.by_end_velocity[2], gradient.by_start_velocity[2]) = (sign, -sign);
            }
            Self::GripUtilization { friction_coefficient, least_normal_force } => {
                let of = wheel_friction(entry, sample, friction_coefficient, least_normal_force).gradient();
                gradient.add_utilization(&of, (entry, sample), (friction_coefficient, least_normal_force));
            }
            Self::LengthwiseUtilization { wheel, sign, friction_coefficient, least_normal_force } => {
                let friction = wheel_friction(entry, sample, friction_coefficient, least_normal_force);
                let (force, radius) = (sign * friction.longitudinal[wheel], friction.radius[wheel]);
                let mut of = UtilizationGradient::default();
                of.by_longitudinal[wheel] = sign / radius;
                of.by_radius[wheel] = -force / (radius * radius);
                gradient.add_utilization(&of, (entry, sample), (friction_coefficient, least_normal_force));
            }
            Self::Outside { point, normal, distance: _, radius } => {
                let corner = turned(point, sample.rotation);
                let by_heading = normal.y * corner.x - normal.x * corner.y;
                gradient.by_end_pose = Some([normal.x, normal.y, by_heading]);
                let angle = end[2] * sample.step_length;
                gradient.by_end_velocity[2] = radius * angle * sample.step_length / 4.0;
                gradient.by_step_length = radius * angle * end[2] / 4.0;
            }
        }
        gradient
    }
}

impl<const N: usize> PathGradient<N> {
    fn zero() -> Self {
        Self {
            by_start_velocity: RowSVector::zeros(),
            by_end_velocity: RowSVector::zeros(),
            by_impulse: RowSVector::zeros(),
            by_normal_impulse: RowVector3::zeros(),
            by_torque: PerWheel::new(0.0, 0.0),
            by_step_length: 0.0,
            by_end_pose: None,
        }
    }

    fn add_utilization(
        &mut self,
        of_friction: &UtilizationGradient,
        (entry, sample): (&TapeEntry, &PathSample),
        (coefficient, least_force): (f64, f64),
    ) {
        let least = least_force * sample.step_length;
        let [left, right] = of_friction.by_longitudinal;
        (self.by_impulse[0], self.by_impulse[1], self.by_impulse[2]) = (left, right, of_friction.by_lateral);
        for wheel in 0..2 {
            let by_normal = coefficient * of_friction.by_radius[wheel];
            if entry.normal_impulse[wheel] > least {
                self.by_normal_impulse[wheel] = by_normal;
            } else {
                self.by_step_length += by_normal * least_force;
            }
        }
    }
}

/// A point of the robot in the world at the end of a step.
#[derive(Debug, Clone, Copy)]
struct Corner {
    /// From the centre of mass, (right, forward), m.
    point: Vector2<f64>,
    position: Vector2<f64>,
    /// What its circle bulges between two nodes, m.
    bulge: f64,
}

impl Corner {
    #[inline]
    fn new(point: Vector2<f64>, radius: f64, sample: &PathSample) -> Self {
        let ([x, y], turned) = (sample.position, turned(point, sample.rotation));
        Self { point, position: Vector2::new(x + turned.x, y + turned.y), bulge: radius * sample.bulge }
    }

    /// By how far it is outside an edge, m.
    #[inline]
    fn outside(&self, normal: Vector2<f64>, distance: f64) -> f64 {
        normal.x * self.position.x + normal.y * self.position.y - distance + self.bulge
    }
}

/// Velocity of a point of the chassis, (right, forward), m/s.
fn velocity_at(point: Vector2<f64>, velocity: &BodyVector) -> Vector2<f64> {
    Vector2::new(velocity[0] - point.y * velocity[2], velocity[1] + point.x * velocity[2])
}

/// Derivatives by the body velocity of something with derivatives by the velocity of a point.
fn by_velocity_of(point: Vector2<f64>, by_point: Vector2<f64>) -> RowSVector<f64, 5> {
    let by_yaw_rate = by_point.y * point.x - by_point.x * point.y;
    RowSVector::from([[by_point.x], [by_point.y], [by_yaw_rate], [0.0], [0.0]])
}

/// The direction of a vector; none of a zero vector.
fn unit(vector: Vector2<f64>) -> Vector2<f64> {
    vector.try_normalize(0.0).unwrap_or_else(Vector2::zeros)
}

/// The velocity of a point of the chassis at both ends of a step, m/s.
struct PointChange {
    start: Vector2<f64>,
    end: Vector2<f64>,
    /// Whether the speed is not less than at the end of the step before.
    grows: bool,
}

impl PointChange {
    /// The frame of the step turns the point, which is what its centripetal acceleration `-omega^2 p` counts: at the start it is
    /// behind where it is at the end.
    fn new(point: Vector2<f64>, entry: &TapeEntry, sample: &PathSample) -> Self {
        let (start, end) = (&entry.start_velocity, &entry.end_velocity);
        let angle = start[2] * sample.step_length;
        let behind = turned(point, sine_and_cosine(-angle));
        let (before, end) = (velocity_at(behind, start), velocity_at(point, end));
        let start = velocity_at(point, start) + start[2] * angle * point;
        Self { start, end, grows: end.norm_squared() >= before.norm_squared() }
    }

    /// The magnitude of the change; negative where the speed falls.
    fn signed(&self) -> f64 {
        let change = (self.end - self.start).norm();
        if self.grows { change } else { -change }
    }

    fn direction(&self) -> Vector2<f64> {
        unit(self.end - self.start)
    }
}

fn wheel_friction(entry: &TapeEntry, sample: &PathSample, coefficient: f64, least_force: f64) -> WheelFriction {
    let [left, right, lateral] = sample.friction;
    let least = least_force * sample.step_length;
    let radius = [0, 1].map(|wheel| coefficient * entry.normal_impulse[wheel].max(least));
    WheelFriction { longitudinal: [left, right], lateral, radius }
}
