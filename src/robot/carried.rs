//! A robot and what it carries, as callers give them.

use super::{Payload, RobotParameters};
use crate::rules::Checks;

/// Adds the violated rules of both to `checks`. What the two break together is said of the payload, where either is valid.
pub(crate) fn check_robot(robot: &RobotParameters, payload: Option<&Payload>, checks: &mut Checks) {
    let before = checks.count();
    checks.within("robot", |checks| robot.check(checks));
    let Some(payload) = payload else { return };
    checks.within("payload", |checks| {
        payload.check(checks);
        if checks.count() == before {
            payload.check_joined(robot, checks);
        }
    });
}

/// The robot that moves.
pub(crate) fn joined(robot: &RobotParameters, payload: Option<&Payload>) -> RobotParameters {
    payload.map_or(*robot, |payload| robot.with_payload(payload))
}
