//! What the fields of a request limit on the way: which quantities of a rollout, and how large they may be.

use nalgebra::Vector2;

use super::aisle::Aisle;
use super::maneuver::{Maneuver, ManeuverLimits, ReferencePoint};
use crate::robot::{Motor, Payload, Robot, RobotParameters};
use crate::simulation::{MotorJudged, PathQuantity};

/// A wheel that carries less than this share of the weight is judged by the friction that this share would give: without normal
/// force no share of the friction is needed or left.
pub(crate) const LEAST_LOAD_FOR_GRIP: f64 = 1e-3;

/// What a floor without friction is judged by: so the share is none of a wheel that needs no friction.
const LEAST_FRICTION_COEFFICIENT: f64 = 1e-6;

/// A quantity and what a field of the request allows of it, beside the normal forces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathLimit {
    /// The field of a solve.
    pub field: &'static str,
    /// The quantity.
    pub quantity: PathQuantity,
    /// The largest value allowed, in the unit of the quantity.
    pub largest: f64,
    /// Excesses are shares of this, in the unit of the quantity.
    pub unit: f64,
}

/// All limits of a request on the way, beside the normal forces.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PathLimits {
    /// Limits of quantities of each step.
    pub path: Vec<PathLimit>,
    /// Largest change of each wheel's torque per time between two intervals, N m/s.
    pub torque_rate: Option<f64>,
    /// Whether the rollouts of the search hold the wheels.
    pub forbids_slip: bool,
}

impl PathLimit {
    /// Whether another limit of the same field is as tight: the search alone needs this one beside it.
    pub fn is_face(&self) -> bool {
        matches!(self.quantity, PathQuantity::LengthwiseUtilization { .. })
    }

    /// What is allowed, in the unit of the field.
    pub fn allowed(&self) -> f64 {
        self.used(self.largest)
    }

    /// What a value uses, in the unit of the field: of a motor its stall torque with the excess over its curve.
    pub fn used(&self, value: f64) -> f64 {
        if let PathQuantity::MotorTorque { motor, .. } = self.quantity {
            motor.stall_torque * (1.0 + value)
        } else {
            value
        }
    }

    /// The largest value of a motion as reports count it: that of an acceleration is negative where the speed only grows, or only falls.
    pub fn counted(&self, value: f64) -> f64 {
        let has_direction = matches!(self.quantity, PathQuantity::Acceleration { .. });
        // What is not a number stays.
        if has_direction && value < 0.0 { 0.0 } else { value }
    }

    /// By how much a value exceeds the limit, as a share of its unit; at most 0 where it is kept.
    pub fn excess(&self, value: f64) -> f64 {
        (value - self.largest) / self.unit
    }
}

impl PathLimits {
    /// The limits of a maneuver.
    pub fn of_maneuver(robot: &Robot, maneuver: &Maneuver, payload: Option<&Payload>, aisle: Option<&Aisle>) -> Self {
        let mut limits = Self::new(robot, (&maneuver.limits, maneuver.reference_point), payload, aisle);
        if maneuver.forbids_slip() {
            limits.forbids_slip = true;
            if maneuver.limits.grip_utilization.is_none() {
                limits.path.extend(holding_limits(robot));
            }
        }
        limits
    }

    /// The limits of a motion, whatever its slip; accelerations and speeds are those of the payload's centre, or of the reference
    /// point.
    pub fn new(
        robot: &Robot,
        (limits, reference_point): (&ManeuverLimits, ReferencePoint),
        payload: Option<&Payload>,
        aisle: Option<&Aisle>,
    ) -> Self {
        let parameters = robot.parameters();
        let point = limited_point(parameters, reference_point, payload);
        let mut path = motor_limits(robot);
        let grip = |share| grip_limits(robot, "maneuver.limits.grip_utilization", share);
        path.extend(limits.grip_utilization.into_iter().flat_map(grip));
        path.extend(rate_limits(limits, point));
        path.extend(aisle.into_iter().flat_map(|aisle| aisle_limits(aisle, parameters.axle_midpoint())));
        Self { path, torque_rate: limits.torque_rate, forbids_slip: false }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.path.is_empty() && self.torque_rate.is_none()
    }

    /// The limited quantities, in their order.
    pub fn quantities(&self) -> Vec<PathQuantity> {
        self.path.iter().map(|limit| limit.quantity).collect()
    }
}

/// The point that limits of speeds and accelerations speak of, relative to the chassis centre of mass, (right, forward), m: the
/// payload's centre, or the reference point.
pub(crate) fn limited_point(
    robot: &RobotParameters,
    reference_point: ReferencePoint,
    payload: Option<&Payload>,
) -> Vector2<f64> {
    match payload.filter(|payload| payload.is_load()) {
        Some(payload) => robot.axle_midpoint() + payload.position(),
        None => reference_point.offset(robot),
    }
}

/// The motors' curves.
fn motor_limits(robot: &Robot) -> Vec<PathLimit> {
    let of_wheel = |motor: Motor, wheel: usize| PathLimit {
        field: "robot.motor_stall_torque_n_m",
        quantity: PathQuantity::MotorTorque { wheel, motor, judged: MotorJudged::AtNodes },
        largest: 0.0,
        unit: 1.0,
    };
    robot.parameters().motor.into_iter().flat_map(|motor| [0, 1].map(|wheel| of_wheel(motor, wheel))).collect()
}

/// What keeps wheels that rollouts hold from slipping: they use no more than all of their friction.
pub(super) fn holding_limits(robot: &Robot) -> [PathLimit; 5] {
    grip_limits(robot, "maneuver.slip", 1.0)
}

/// What both wheels together may use of their friction, and what each may use lengthwise, which is no more.
fn grip_limits(robot: &Robot, field: &'static str, share: f64) -> [PathLimit; 5] {
    let friction_coefficient = match robot.parameters().wheel_friction_coefficient {
        0.0 => LEAST_FRICTION_COEFFICIENT,
        known => known,
    };
    let least_normal_force = LEAST_LOAD_FOR_GRIP * robot.parameters().weight();
    let of = |quantity| PathLimit { field, quantity, largest: share, unit: share };
    let lengthwise =
        |wheel, sign| of(PathQuantity::LengthwiseUtilization { wheel, sign, friction_coefficient, least_normal_force });
    let both = of(PathQuantity::GripUtilization { friction_coefficient, least_normal_force });
    [both, lengthwise(0, 1.0), lengthwise(0, -1.0), lengthwise(1, 1.0), lengthwise(1, -1.0)]
}

/// Limits of rates, speeds and accelerations.
fn rate_limits(limits: &ManeuverLimits, point: Vector2<f64>) -> Vec<PathLimit> {
    let wheel_rate = |wheel| PathQuantity::WheelRate { wheel };
    let acceleration = |sign| PathQuantity::Acceleration { point, sign };
    let yaw_acceleration = |sign| PathQuantity::YawAcceleration { sign };
    [
        ("maneuver.limits.wheel_rate_rad_s", wheel_rate(0), limits.wheel_rate),
        ("maneuver.limits.wheel_rate_rad_s", wheel_rate(1), limits.wheel_rate),
        ("maneuver.limits.speed_m_s", PathQuantity::Speed { point }, limits.speed),
        ("maneuver.limits.yaw_rate_rad_s", PathQuantity::YawRate, limits.yaw_rate),
        ("maneuver.limits.acceleration_m_s2", acceleration(1.0), limits.acceleration),
        ("maneuver.limits.deceleration_m_s2", acceleration(-1.0), limits.deceleration),
        ("maneuver.limits.yaw_acceleration_rad_s2", yaw_acceleration(1.0), limits.yaw_acceleration),
        ("maneuver.limits.yaw_acceleration_rad_s2", yaw_acceleration(-1.0), limits.yaw_acceleration),
    ]
    .into_iter()
    .filter_map(|(field, quantity, largest)| Some(PathLimit { field, quantity, largest: largest?, unit: largest? }))
    .collect()
}

/// Every corner of the robot inside every edge of the aisle, as shares of the farthest corner's distance from the centre of mass.
fn aisle_limits(aisle: &Aisle, axle_midpoint: Vector2<f64>) -> Vec<PathLimit> {
    let points: Vec<_> = aisle.footprint.corners().iter().map(|corner| axle_midpoint + corner).collect();
    let unit = points.iter().map(Vector2::norm).fold(0.0, f64::max);
    let of = |point: Vector2<f64>| {
        aisle.keep_in.edges().map(move |edge| PathLimit {
            field: "maneuver.keep_in",
            quantity: PathQuantity::Outside { point, normal: edge.normal, distance: edge.offset, radius: point.norm() },
            largest: 0.0,
            unit,
        })
    };
    points.into_iter().flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn load_without_mass_leaves_the_limited_point() {
        let robot = RobotParameters::default();
        let point = |mass| {
            let payload = Payload { mass, right: 0.1, forward: 0.2, height: 0.1, yaw_inertia: 0.0 };
            limited_point(&robot, ReferencePoint::AxleMidpoint, Some(&payload)) - robot.axle_midpoint()
        };
        // Sums of a few numbers below 1.
        assert!(point(0.0).norm() < 1e-15 && (point(1.0) - Vector2::new(0.1, 0.2)).norm() < 1e-15);
    }
}
