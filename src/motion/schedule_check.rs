//! Rules for torque schedules that callers send.

use super::ROUNDING;
use crate::robot::PerWheel;
use crate::rules::{Checks, Number, Rule, RuleSet};
use crate::simulation::TorqueSchedule;

/// The length of a schedule or of one of its intervals: those of every answer.
/// Shorter ones move nothing, and the impulses within them come near the smallest numbers there are.
pub(crate) const TIME_RULE: Rule = Rule::at_least(1e-12, "s");
const LENGTH_RULE: Rule = Rule::at_least(1.0, Rule::ITEMS);

/// The rules of a schedule with the given names of its time and of its left and right arrays.
pub(crate) fn rules_of_schedule(time_field: &str, (left_field, right_field): (&str, &str)) -> RuleSet {
    RuleSet::of([(time_field, TIME_RULE), (left_field, LENGTH_RULE), (right_field, LENGTH_RULE)])
        .across(&[left_field, right_field], "both wheels have the same number of torques")
}

/// Adds the violated rules of a schedule under the given names of its left and right arrays; `limit` is that of the
/// torques per wheel, if any.
pub(crate) fn check_schedule(
    schedule: &TorqueSchedule,
    (left_field, right_field): (&str, &str),
    limit: Option<PerWheel<f64>>,
    checks: &mut Checks,
) {
    let (left_count, right_count) = (schedule.left.len(), schedule.right.len());
    checks.length(left_field, left_count, &LENGTH_RULE);
    checks.length(right_field, right_count, &LENGTH_RULE);
    let rule = format!("{left_count} items long, as {left_field} is");
    let right_length = format!("{right_count} items long");
    checks.require(right_field, right_length, right_count == left_count, &rule, Some(left_count as f64));
    let sides =
        [(left_field, &schedule.left, limit.map(|l| l.left)), (right_field, &schedule.right, limit.map(|l| l.right))];
    for (field, torques, limit) in sides {
        let (largest, rule) = match limit {
            // A schedule may carry rounding when it is sent back.
            Some(limit) => (limit * (1.0 + ROUNDING), format!("within the torque limit of {} N m", Number(limit))),
            None => (f64::MAX, "finite".to_owned()),
        };
        for (index, &torque) in torques.iter().enumerate() {
            checks.require(&format!("{field}[{index}]"), Number(torque), torque.abs() <= largest, &rule, limit);
        }
    }
}
