//! What several kinds of jobs share: messages as domain values and back.
//!
//! Each message is taken apart field by field, so that a field cannot be added and then forgotten.

use nalgebra::Vector2;

use super::error_table::ErrorCode;
use super::goal::{goal_of_message, message_of_goal};
use super::message;
use super::problem::{Problem, pointer_of_path};
use crate::contact::{ContactMode, ContactName, PerContact};
use crate::motion::{ChangedParameter, LimitUse};
use crate::robot::{Motor, Payload, PerWheel, RobotParameters, State};
use crate::rules::Checks;
use crate::shooting::{AisleCorners, Maneuver, ManeuverLimits, ReferencePoint, SlipPolicy, check_state};
use crate::simulation::{ContactMethod, ContactModeSpan, ContactSample, NormalLoad, Separation, TorqueSchedule};
use crate::solver::{Choice, Method};

/// Both directions between the numbers of a message, which are optional, and those of a domain struct; absent is the default of
/// the domain. What is listed as apart belongs to neither function.
macro_rules! same_numbers {
    (
        $read:ident, $write:ident: $message:ident = $domain:ident { $($field:ident: $name:ident),* $(,)? }
        apart from { $($of_message:ident),* } and { $($of_domain:ident),* }
    ) => {
        fn $read(given: &message::$message) -> $domain {
            let message::$message { $($field,)* $($of_message: _),* } = *given;
            let default = $domain::default();
            $domain { $($name: $field.unwrap_or(default.$name),)* ..default }
        }

        fn $write(domain: &$domain) -> message::$message {
            let $domain { $($name,)* $($of_domain: _),* } = *domain;
            message::$message { $($field: Some($name),)* ..message::$message::default() }
        }
    };
}

same_numbers!(
    numbers_of_robot, message_of_numbers: Robot = RobotParameters {
        chassis_mass_kg: chassis_mass,
        wheel_mass_kg: wheel_mass,
        chassis_yaw_inertia_kg_m2: chassis_yaw_inertia,
        wheel_diametral_inertia_kg_m2: wheel_diametral_inertia,
        wheel_spin_inertia_kg_m2: wheel_spin_inertia,
        wheel_radius_m: wheel_radius,
        track_width_m: track_width,
        axle_to_front_support_m: axle_to_front_support,
        front_support_right_m: front_support_right,
        center_of_mass_right_m: center_of_mass_right,
        center_of_mass_forward_m: center_of_mass_forward,
        center_of_mass_height_m: center_of_mass_height,
        wheel_friction_coefficient: wheel_friction_coefficient,
        front_friction_coefficient: front_friction_coefficient,
        tangential_restitution: tangential_restitution,
        gravity_m_s2: gravity,
    }
    apart from { motor_stall_torque_n_m, motor_free_speed_rad_s, wheel_viscous_friction_n_m_s, footprint }
    and { motor, wheel_viscous_friction, bare_center_of_mass, product_of_inertia }
);

/// The robot that is meant, without its footprint; a motor that is half given goes to `checks`.
pub(crate) fn robot(given: &message::Robot, checks: &mut Checks) -> RobotParameters {
    let motor = checks.within("robot", |checks| motor(given, checks));
    let wheel_viscous_friction = given.wheel_viscous_friction_n_m_s.unwrap_or_default();
    RobotParameters { motor, wheel_viscous_friction, ..numbers_of_robot(given) }
}

fn motor(given: &message::Robot, checks: &mut Checks) -> Option<Motor> {
    let given = [given.motor_stall_torque_n_m, given.motor_free_speed_rad_s];
    if let [Some(stall_torque), Some(free_speed)] = given {
        return Some(Motor { stall_torque, free_speed });
    }
    for (index, (field, _, rule)) in Motor::RULES.into_iter().enumerate() {
        let (other, other_value) = (Motor::RULES[1 - index].0, given[1 - index]);
        if let Some(value) = given[index] {
            checks.bounds(field, value, &rule);
        } else {
            let rule = format!("given where `{other}` is");
            checks.require(field, "absent", other_value.is_none(), rule, None);
        }
    }
    None
}

/// The parameters as a message; without a footprint, which is no parameter.
impl From<&RobotParameters> for message::Robot {
    fn from(robot: &RobotParameters) -> Self {
        Self {
            motor_stall_torque_n_m: robot.motor.map(|motor| motor.stall_torque),
            motor_free_speed_rad_s: robot.motor.map(|motor| motor.free_speed),
            // None is what an absent one means.
            wheel_viscous_friction_n_m_s: Some(robot.wheel_viscous_friction).filter(|&friction| friction != 0.0),
            ..message_of_numbers(robot)
        }
    }
}

/// The payload that is meant.
pub(crate) fn payload(given: message::Payload) -> Result<Payload, Problem> {
    let message::Payload { mass_kg, right_m, forward_m, height_m, yaw_inertia_kg_m2 } = given;
    Ok(Payload {
        mass: required(mass_kg, "payload.mass_kg")?,
        right: right_m.unwrap_or_default(),
        forward: forward_m.unwrap_or_default(),
        height: required(height_m, "payload.height_m")?,
        yaw_inertia: yaw_inertia_kg_m2.unwrap_or_default(),
    })
}

impl From<&Payload> for message::Payload {
    fn from(payload: &Payload) -> Self {
        let Payload { mass, right, forward, height, yaw_inertia } = *payload;
        Self {
            mass_kg: Some(mass),
            right_m: Some(right),
            forward_m: Some(forward),
            height_m: Some(height),
            yaw_inertia_kg_m2: Some(yaw_inertia),
        }
    }
}

/// The corners of an aisle and of the footprint.
pub(crate) fn aisle_corners(keep_in: &[message::WorldPoint], footprint: &[message::BodyPoint]) -> AisleCorners {
    AisleCorners {
        keep_in: keep_in.iter().map(|&message::WorldPoint { x_m, y_m }| Vector2::new(x_m, y_m)).collect(),
        footprint: footprint
            .iter()
            .map(|&message::BodyPoint { right_m, forward_m }| Vector2::new(right_m, forward_m))
            .collect(),
    }
}

/// The outline of a robot as a message.
pub(crate) fn footprint(corners: &[Vector2<f64>]) -> Vec<message::BodyPoint> {
    corners.iter().map(|corner| message::BodyPoint { right_m: corner.x, forward_m: corner.y }).collect()
}

impl From<message::ManeuverLimits> for ManeuverLimits {
    fn from(given: message::ManeuverLimits) -> Self {
        let message::ManeuverLimits {
            normal_load_share,
            grip_utilization,
            wheel_rate_rad_s: wheel_rate,
            speed_m_s: speed,
            yaw_rate_rad_s: yaw_rate,
            acceleration_m_s2: acceleration,
            deceleration_m_s2: deceleration,
            yaw_acceleration_rad_s2: yaw_acceleration,
            torque_rate_n_m_s: torque_rate,
        } = given;
        Self {
            normal_load_share: normal_load_share.unwrap_or(Self::default().normal_load_share),
            grip_utilization,
            wheel_rate,
            speed,
            yaw_rate,
            acceleration,
            deceleration,
            yaw_acceleration,
            torque_rate,
        }
    }
}

impl From<&ManeuverLimits> for message::ManeuverLimits {
    fn from(limits: &ManeuverLimits) -> Self {
        let ManeuverLimits {
            normal_load_share,
            grip_utilization,
            wheel_rate,
            speed,
            yaw_rate,
            acceleration,
            deceleration,
            yaw_acceleration,
            torque_rate,
        } = *limits;
        Self {
            normal_load_share: Some(normal_load_share),
            grip_utilization,
            wheel_rate_rad_s: wheel_rate,
            speed_m_s: speed,
            yaw_rate_rad_s: yaw_rate,
            acceleration_m_s2: acceleration,
            deceleration_m_s2: deceleration,
            yaw_acceleration_rad_s2: yaw_acceleration,
            torque_rate_n_m_s: torque_rate,
        }
    }
}

/// An enum of the contract and the one of the domain with the same values. Back from the contract, unspecified is the domain's default
/// (`default`) or nothing (`known`).
macro_rules! same_values {
    ($message:ident = $domain:ident { $($value:ident),* $(,)? }) => {
        impl From<$domain> for message::$message {
            fn from(domain: $domain) -> Self {
                match domain { $($domain::$value => Self::$value),* }
            }
        }
    };
    (default $message:ident = $domain:ident { $($value:ident),* $(,)? }) => {
        same_values!($message = $domain { $($value),* });

        impl From<message::$message> for $domain {
            fn from(given: message::$message) -> Self {
                match given {
                    message::$message::Unspecified => Self::default(),
                    $(message::$message::$value => Self::$value),*
                }
            }
        }
    };
    (known $message:ident = $domain:ident { $($value:ident),* $(,)? }) => {
        same_values!($message = $domain { $($value),* });

        impl From<message::$message> for Option<$domain> {
            fn from(given: message::$message) -> Self {
                match given {
                    message::$message::Unspecified => None,
                    $(message::$message::$value => Some($domain::$value)),*
                }
            }
        }
    };
}
pub(crate) use same_values;

same_values!(default ReferencePoint = ReferencePoint { ChassisCenterOfMass, AxleMidpoint });
same_values!(default SlipPolicy = SlipPolicy { Allowed, Forbidden });
same_values!(default ContactSolver = ContactMethod { Exact, FixedPoint });
same_values!(default Choice = Choice { Fastest, Steadiest });
same_values!(default Method = Method { SequentialLinear, NelderMead });
same_values!(ContactMode = ContactMode { Stick, Slip });
same_values!(ContactName = ContactName { Left, Right, Front });
same_values!(
    known ChangedParameter = ChangedParameter {
        Friction,
        Mass,
        CenterOfMassRight,
        CenterOfMassForward,
        Torque,
        TorqueLeft,
        StartHeading,
        TorqueRight,
        PayloadMass,
        PayloadRight,
        PayloadForward,
        StartX,
        StartY,
        DelayLeft,
        DelayRight,
    }
);

/// Enums of proto3 are open: a number without a name is refused as JSON refuses an unknown name.
pub(crate) fn named<T: TryFrom<i32>>(number: i32, field: &str) -> Result<T, Problem> {
    T::try_from(number).map_err(|_| invalid_field(field, &format!("unknown value {number}")))
}

/// A field without a default.
pub(crate) fn required<T>(given: Option<T>, field: &str) -> Result<T, Problem> {
    given.ok_or_else(|| invalid_field(field, "missing field"))
}

fn invalid_field(field: &str, fault: &str) -> Problem {
    Problem::at_field(ErrorCode::InvalidField, pointer_of_path(field), format!("`{field}`: {fault}"))
}

/// Counts are bounded by the limits on grids and starts, far below this.
pub(crate) fn count(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

/// The maneuver of this robot that is meant, without its aisle; faults of the goal go to `checks`.
pub(crate) fn maneuver(
    given: message::Maneuver,
    robot: &RobotParameters,
    checks: &mut Checks,
) -> Result<Maneuver, Problem> {
    let message::Maneuver {
        reference_point,
        start,
        goal,
        torque_limit_left_n_m,
        torque_limit_right_n_m,
        limits,
        slip,
        keep_in: _,
    } = given;
    let reference_point: message::ReferencePoint = named(reference_point, "maneuver.reference_point")?;
    let start = State::from(start.unwrap_or_default());
    let goal = goal.unwrap_or_default();
    // A start that breaks its rules is refused as itself, not as the goal that it would be too.
    let mut of_start = Checks::new();
    check_state(&start, &mut of_start);
    let stay = if of_start.count() == 0 { start } else { State::default() };
    let goal =
        checks.within("maneuver", |checks| checks.within("goal", |checks| goal_of_message(&goal, &stay, checks)));
    let default = Maneuver::default_torque_limit(robot);
    let torque_limit =
        PerWheel::new(torque_limit_left_n_m.unwrap_or(default), torque_limit_right_n_m.unwrap_or(default));
    let limits: ManeuverLimits = limits.unwrap_or_default().into();
    let slip: message::SlipPolicy = named(slip, "maneuver.slip")?;
    let contradicts = slip == message::SlipPolicy::Allowed && limits.grip_utilization.is_some();
    let rule = "forbidden, or left out, beside `maneuver.limits.grip_utilization`";
    checks.within("maneuver", |checks| checks.require("slip", "allowed", !contradicts, rule, None));
    let slip = slip.into();
    Ok(Maneuver { reference_point: reference_point.into(), start, goal, torque_limit, limits, slip })
}

/// The maneuver as a message; without an aisle, which is no part of it.
impl From<&Maneuver> for message::Maneuver {
    fn from(maneuver: &Maneuver) -> Self {
        let Maneuver { reference_point, start, goal, torque_limit, limits, slip: _ } = maneuver;
        let slip =
            if maneuver.forbids_slip() { message::SlipPolicy::Forbidden } else { message::SlipPolicy::Unspecified };
        Self {
            reference_point: message::ReferencePoint::from(*reference_point).into(),
            start: Some(start.into()),
            goal: Some(message_of_goal(goal)),
            torque_limit_left_n_m: Some(torque_limit.left),
            torque_limit_right_n_m: Some(torque_limit.right),
            limits: Some(limits.into()),
            slip: slip.into(),
            keep_in: Vec::new(),
        }
    }
}

/// A schedule that a caller wrote.
pub(crate) fn schedule(given: message::TorqueSchedule, field: &str) -> Result<TorqueSchedule, Problem> {
    let message::TorqueSchedule { interval_s, left_n_m: left, right_n_m: right } = given;
    let interval = required(interval_s, &format!("{field}.interval_s"))?;
    Ok(TorqueSchedule { final_time: interval * left.len() as f64, left, right })
}

impl From<&TorqueSchedule> for message::TorqueSchedule {
    fn from(schedule: &TorqueSchedule) -> Self {
        let TorqueSchedule { final_time: _, left, right } = schedule;
        Self { interval_s: Some(schedule.interval()), left_n_m: left.clone(), right_n_m: right.clone() }
    }
}

impl From<&ContactModeSpan> for message::ContactModeSpan {
    fn from(span: &ContactModeSpan) -> Self {
        let ContactModeSpan { start, end, mode: PerContact { left, right, front }, degrees_of_freedom } = *span;
        let number = |mode: ContactMode| message::ContactMode::from(mode).into();
        let (left, right, front) = (number(left), number(right), number(front));
        Self { start_s: start, end_s: end, left, right, front, degrees_of_freedom: degrees_of_freedom.into() }
    }
}

impl From<&Separation> for message::Separation {
    fn from(separation: &Separation) -> Self {
        let Separation { time, contact, normal_force } = *separation;
        let contact = message::ContactName::from(contact).into();
        Self { time_s: time, contact, normal_force_n: normal_force }
    }
}

impl From<&NormalLoad> for message::NormalLoad {
    fn from(load: &NormalLoad) -> Self {
        let NormalLoad { share, contact, time } = *load;
        Self { share, contact: message::ContactName::from(contact).into(), time_s: time }
    }
}

impl From<&LimitUse> for message::LimitUse {
    fn from(used: &LimitUse) -> Self {
        let LimitUse { limit, value, largest, time, excess, replay_excess } = *used;
        Self { limit: limit.to_owned(), value, largest, time_s: time, excess, replay_excess }
    }
}

/// Forces and slips of all contacts, in columns.
pub(crate) fn contacts(steps: &[PerContact<ContactSample>]) -> message::Contacts {
    message::Contacts {
        left: Some(contact(steps.iter().map(|step| &step.left))),
        right: Some(contact(steps.iter().map(|step| &step.right))),
        front: Some(contact(steps.iter().map(|step| &step.front))),
    }
}

fn contact<'a>(samples: impl Iterator<Item = &'a ContactSample>) -> message::Contact {
    let mut columns = message::Contact::default();
    for sample in samples {
        let ContactSample {
            normal_force,
            lateral_force,
            longitudinal_force,
            lateral_slip,
            longitudinal_slip,
            // `contact_modes` has them as spans.
            mode: _,
        } = *sample;
        columns.normal_force_n.push(normal_force);
        columns.lateral_force_n.push(lateral_force);
        columns.longitudinal_force_n.push(longitudinal_force);
        columns.lateral_slip_m_s.push(lateral_slip);
        columns.longitudinal_slip_m_s.push(longitudinal_slip);
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_of_a_field_is_a_segment_of_its_pointer() {
        let field = "uncertain[0].parameter";
        for problem in
            [required::<()>(None, field).unwrap_err(), named::<message::ChangedParameter>(99, field).unwrap_err()]
        {
            assert_eq!(problem.errors()[0].pointer, "#/uncertain/0/parameter");
            assert!(problem.detail().starts_with("`uncertain[0].parameter`: "), "{problem}");
        }
    }
}
