//! What several kinds of jobs share: messages as domain values and back.
//!
//! Each message is taken apart field by field, so that a field cannot be added and then forgotten.

use super::error_table::ErrorCode;
use super::goal::{goal_of_message, message_of_goal};
use super::message;
use super::problem::Problem;
use crate::contact::{ContactMode, ContactName, PerContact};
use crate::robot::{PerWheel, RobotParameters, State};
use crate::rules::Checks;
use crate::shooting::{Maneuver, ManeuverLimits, ReferencePoint, SlipPolicy};
use crate::simulation::{ContactMethod, ContactModeSpan, ContactSample, NormalLoad, Separation, TorqueSchedule};
use crate::solver::Method;

/// A message of optional numbers and the domain struct of the same numbers, in both directions; absent is the default of
/// the domain.
macro_rules! same_numbers {
    ($message:ident = $domain:ident { $($field:ident: $name:ident),* $(,)? } without { $($beside:ident),* }) => {
        impl From<message::$message> for $domain {
            fn from(given: message::$message) -> Self {
                let message::$message { $($field),* } = given;
                let default = Self::default();
                Self { $($name: $field.unwrap_or(default.$name),)* ..default }
            }
        }

        impl From<&$domain> for message::$message {
            fn from(domain: &$domain) -> Self {
                let $domain { $($name,)* $($beside: _),* } = *domain;
                Self { $($field: Some($name)),* }
            }
        }
    };
}

same_numbers!(
    Robot = RobotParameters {
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
    } without { motor, wheel_viscous_friction, bare_center_of_mass }
);

same_numbers!(ManeuverLimits = ManeuverLimits { normal_load_share: normal_load_share } without {
    grip_utilization, wheel_rate, speed, yaw_rate, acceleration, deceleration, yaw_acceleration, torque_rate
});

/// An enum of the contract and the one of the domain with the same values; unspecified is the default of the domain.
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
}
pub(crate) use same_values;

same_values!(default ReferencePoint = ReferencePoint { ChassisCenterOfMass, AxleMidpoint });
same_values!(default ContactSolver = ContactMethod { Exact, FixedPoint });
same_values!(default Method = Method { SequentialLinear, NelderMead });
same_values!(ContactMode = ContactMode { Stick, Slip });
same_values!(ContactName = ContactName { Left, Right, Front });

/// Enums of proto3 are open: a number without a name is refused as JSON refuses an unknown name.
pub(crate) fn named<T: TryFrom<i32>>(number: i32, field: &str) -> Result<T, Problem> {
    T::try_from(number).map_err(|_| invalid_field(field, &format!("unknown value {number}")))
}

/// A field without a default.
pub(crate) fn required<T>(given: Option<T>, field: &str) -> Result<T, Problem> {
    given.ok_or_else(|| invalid_field(field, "missing field"))
}

fn invalid_field(field: &str, fault: &str) -> Problem {
    let pointer = format!("#/{}", field.replace('.', "/"));
    Problem::at_field(ErrorCode::InvalidField, pointer, format!("`{field}`: {fault}"))
}

/// Counts are bounded by the limits on grids and starts, far below this.
pub(crate) fn count(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

/// The maneuver that is meant; faults of the goal go to `checks`.
pub(crate) fn maneuver(given: message::Maneuver, checks: &mut Checks) -> Result<Maneuver, Problem> {
    let message::Maneuver { reference_point, start, goal, torque_limit_left_n_m, torque_limit_right_n_m, limits } =
        given;
    let reference_point: message::ReferencePoint = named(reference_point, "maneuver.reference_point")?;
    let start = State::from(start.unwrap_or_default());
    let goal = goal.unwrap_or_default();
    let goal =
        checks.within("maneuver", |checks| checks.within("goal", |checks| goal_of_message(&goal, &start, checks)));
    let default = Maneuver::forward_drive().torque_limit;
    let torque_limit =
        PerWheel::new(torque_limit_left_n_m.unwrap_or(default.left), torque_limit_right_n_m.unwrap_or(default.right));
    let limits = limits.unwrap_or_default().into();
    let slip = SlipPolicy::default();
    Ok(Maneuver { reference_point: reference_point.into(), start, goal, torque_limit, limits, slip })
}

impl From<&Maneuver> for message::Maneuver {
    fn from(maneuver: &Maneuver) -> Self {
        let Maneuver { reference_point, start, goal, torque_limit, limits, slip: _ } = maneuver;
        Self {
            reference_point: message::ReferencePoint::from(*reference_point).into(),
            start: Some(start.into()),
            goal: Some(message_of_goal(goal)),
            torque_limit_left_n_m: Some(torque_limit.left),
            torque_limit_right_n_m: Some(torque_limit.right),
            limits: Some(limits.into()),
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
