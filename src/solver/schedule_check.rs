//! Rules for torque schedules that callers send.

use crate::robot::PerWheel;
use crate::simulation::TorqueSchedule;
use crate::violation::Checks;

/// Rounding that a schedule may carry above a limit when it is sent back: a few units in the last place.
const LIMIT_SLACK: f64 = 1e-12;

/// Adds the violated rules of a schedule under the given names of its left and right arrays.
pub(crate) fn violations_of_schedule(
    schedule: &TorqueSchedule,
    (left_field, right_field): (&str, &str),
    limit: Option<PerWheel<f64>>,
    checks: &mut Checks,
) {
    let count = schedule.left.len();
    checks.require(left_field, "empty", count > 0, "at least one torque long", Some(1.0));
    let rule = format!("{count} torques long, as {left_field} is");
    let right_count = schedule.right.len();
    let right_length = format_args!("{right_count} torques long").to_string();
    checks.require(right_field, right_length, right_count == count, &rule, Some(count as f64));
    let sides =
        [(left_field, &schedule.left, limit.map(|l| l.left)), (right_field, &schedule.right, limit.map(|l| l.right))];
    for (field, torques, limit) in sides {
        for (index, &torque) in torques.iter().enumerate() {
            check_torque(&format!("{field}[{index}]"), torque, limit, checks);
        }
    }
}

fn check_torque(field: &str, torque: f64, limit: Option<f64>, checks: &mut Checks) {
    match limit {
        Some(limit) => {
            let rule = format!("within the torque limit of {limit} N m");
            checks.require(field, torque, torque.abs() <= limit * (1.0 + LIMIT_SLACK), &rule, Some(limit));
        }
        None => checks.require(field, torque, torque.is_finite(), "finite", None),
    }
}
