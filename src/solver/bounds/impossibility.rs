//! Maneuvers that are provably impossible, found without any rollout, with the first requirement that fails.
//!
//! Each claim is proved for the equations of motion without separation (`docs/bounds.md`); maneuvers without such a proof
//! are left to the search.

use super::excluded_ends::{End, excluded_end};
use super::standstill::{fields_of_torque_at_rest, stays_at_start};
use super::{Grid, LowerBound, Wanted, lower_bounds};
use crate::shooting::{LONGEST_FINAL_TIME, StateComponent};
use crate::solver::settings::SolveInput;
use crate::solver::solution::{LowerBoundAssumption, Reason};

/// Why no plan can meet the goal; none where that is not proven.
pub(in crate::solver) fn impossibility(input: &SolveInput) -> Option<Reason> {
    let at_an_end = excluded_end(input).or_else(|| End::start(input).unloads(input));
    if at_an_end.is_some() || input.starts_at_goal() {
        return at_an_end;
    }
    cannot_move(input).or_else(|| takes_too_long(input)).or_else(|| End::goal(input).unloads(input))
}

/// Without torque, or with less than friction holds, a robot at rest stays where it is.
fn cannot_move(input: &SolveInput) -> Option<Reason> {
    let maneuver = &input.maneuver;
    stays_at_start(input).then(|| {
        let error = maneuver.goal_error(&maneuver.start);
        let worst = StateComponent::ALL[error.iamax()];
        unreachable_goal(input, worst, "no_torque")
    })
}

/// A lower bound above the longest final time, or one that is infinite.
fn takes_too_long(input: &SolveInput) -> Option<Reason> {
    let bounds = lower_bounds(input, Grid::Continuous, Wanted::Above(LONGEST_FINAL_TIME));
    let too_long = || bounds.iter().filter(|bound| bound.time > LONGEST_FINAL_TIME);
    // A component that the start misses explains more than one that the start already meets.
    let error = input.maneuver.goal_error(&input.maneuver.start);
    let is_missed = |bound: &&LowerBound| error[bound.component.index()].abs() > input.settings.goal_tolerance;
    let bound = too_long().find(is_missed).or_else(|| too_long().next())?;
    Some(if bound.time.is_finite() {
        slow_goal(input, bound)
    } else {
        unreachable_goal(input, bound.component, cause(input, bound))
    })
}

/// What is missing where a bound is infinite.
fn cause(input: &SolveInput, bound: &LowerBound) -> &'static str {
    let has_grip = input.robot.parameters().wheel_friction_coefficient > 0.0;
    match bound.assumption {
        LowerBoundAssumption::Friction | LowerBoundAssumption::YawFriction => "no_friction",
        LowerBoundAssumption::DriveTorque if !has_grip => "no_friction",
        LowerBoundAssumption::DriveTorque | LowerBoundAssumption::WheelDrive | LowerBoundAssumption::Limits => {
            "no_torque"
        }
    }
}

fn unreachable_goal(input: &SolveInput, component: StateComponent, code: &'static str) -> Reason {
    let (field, goal) = goal_field(input, component);
    let error = input.maneuver.goal_error(&input.maneuver.start)[component.index()];
    let tolerance = input.settings.goal_tolerance;
    let missed_by = Reason::told(error.abs(), tolerance);
    let (cause, help) = if code == "no_torque" {
        ("no torque drives the robot there", fields_of_torque_at_rest(input))
    } else {
        ("no friction moves the robot there", "`robot.wheel_friction_coefficient`")
    };
    let message = format!(
        "`{field}` is {goal}, which the start misses by {missed_by} (tolerance {tolerance}), and {cause}; larger {help} help"
    );
    Reason { code, message, field, time: Some(0.0), value: error.abs(), limit: tolerance }
}

fn slow_goal(input: &SolveInput, bound: &LowerBound) -> Reason {
    let (field, goal) = goal_field(input, bound.component);
    let (time, assumption) = (bound.time, bound.assumption.as_str());
    let help = match bound.assumption {
        LowerBoundAssumption::Limits => "wider `maneuver.limits`, more torque",
        LowerBoundAssumption::Friction
        | LowerBoundAssumption::YawFriction
        | LowerBoundAssumption::DriveTorque
        | LowerBoundAssumption::WheelDrive => "more torque and friction",
    };
    let least = Reason::told(time, LONGEST_FINAL_TIME);
    let message = format!(
        "`{field}` is {goal}, which takes at least {least} s (bound `{assumption}`), must be at most \
         {LONGEST_FINAL_TIME} s; {help} or a nearer goal help"
    );
    let code = "final_time_too_long";
    Reason { code, message, field, time: Some(time), value: time, limit: LONGEST_FINAL_TIME }
}

/// The field of a goal component, and what is asked of it.
fn goal_field(input: &SolveInput, component: StateComponent) -> (String, String) {
    let goal = input.maneuver.goal.value(component).map_or("free".to_owned(), |value| value.to_string());
    (format!("maneuver.goal.{}", component.field()), goal)
}
