//! Maneuvers that are provably impossible, found without any rollout, with the first requirement that fails.
//!
//! Each claim is proved for the equations of motion without separation (`docs/bounds.md`); maneuvers without such a proof
//! are left to the search.

use super::excluded_ends::excluded_end;
use super::largest_normal_force::{Rates, largest_normal_forces};
use super::lower_bound::{Grid, LowerBound, Wanted, lower_bounds};
use super::settings::{ROUNDING, SolveInput};
use super::solution::{LowerBoundAssumption, Reason};
use super::standstill::stands_still;
use crate::contact::ContactName;
use crate::robot::Velocity;
use crate::shooting::{LONGEST_FINAL_TIME, StateComponent};

/// Why no plan can meet the goal; none where that is not proven.
pub(super) fn impossibility(input: &SolveInput) -> Option<Reason> {
    let at_an_end = excluded_end(input).or_else(|| start_unloads(input));
    if at_an_end.is_some() || input.starts_at_goal() {
        return at_an_end;
    }
    cannot_move(input).or_else(|| takes_too_long(input)).or_else(|| goal_unloads(input))
}

fn start_unloads(input: &SolveInput) -> Option<Reason> {
    let velocity = &input.maneuver.start.velocity;
    let wheels = velocity.wheel_rate.left + velocity.wheel_rate.right;
    let rates = Rates { yaw: (velocity.yaw_rate, velocity.yaw_rate), wheels: (wheels, wheels) };
    let codes = ["start_separates", "start_below_load_share"];
    unloaded(input, &rates, codes, ("start", velocity.yaw_rate), Some(0.0))
}

fn goal_unloads(input: &SolveInput) -> Option<Reason> {
    let goal = &input.maneuver.goal;
    let yaw_rate = goal.value(StateComponent::YawRate)?;
    let wheels = goal.value(StateComponent::WheelRateLeft)? + goal.value(StateComponent::WheelRateRight)?;
    let tolerance = input.settings.goal_tolerance;
    let around = |value: f64, slack: f64| (value - slack, value + slack);
    let rates = Rates { yaw: around(yaw_rate, tolerance), wheels: around(wheels, 2.0 * tolerance) };
    let codes = ["goal_separates", "goal_below_load_share"];
    unloaded(input, &rates, codes, ("goal", yaw_rate), None)
}

/// The contact whose normal force stays furthest below what it must be; the first code where it separates, the second where
/// it only misses its least load.
fn unloaded(
    input: &SolveInput,
    rates: &Rates,
    [separates, below_share]: [&'static str; 2],
    (end, yaw_rate): (&str, f64),
    time: Option<f64>,
) -> Option<Reason> {
    let forces = largest_normal_forces(&input.robot, input.maneuver.torque_limit, rates);
    let parameters = input.robot.parameters();
    let weight = parameters.total_mass() * parameters.gravity;
    let least = input.maneuver.limits.least_normal_loads(&input.robot) * weight;
    let missing = |contact: &ContactName| least[*contact as usize] - forces[*contact as usize];
    let contact = ContactName::ALL.into_iter().max_by(|a, b| missing(a).total_cmp(&missing(b)))?;
    if missing(&contact) <= ROUNDING * weight {
        return None;
    }
    let force = forces[contact as usize];
    let is_separation = force < -ROUNDING * weight;
    let (code, limit) = if is_separation { (separates, 0.0) } else { (below_share, least[contact as usize]) };
    let field = format!("maneuver.{end}.{}", StateComponent::YawRate.field());
    let name = match contact {
        ContactName::Front => "front support".to_owned(),
        ContactName::Left | ContactName::Right => format!("{} wheel", contact.as_str()),
    };
    let (effect, help) =
        if is_separation { ("lifts", "") } else { ("unloads", "a smaller `maneuver.limits.normal_load_share`, ") };
    Some(Reason {
        code,
        message: format!(
            "`{field}` is {yaw_rate}, which {effect} the {name} whatever the torques: its normal force is at most {force} N, \
             must be >= {limit} N; {help}a slower spin or a lower centre of mass helps"
        ),
        field,
        time,
        value: force,
        limit,
    })
}

/// Without torque, or with less than friction holds, a robot at rest stays where it is.
fn cannot_move(input: &SolveInput) -> Option<Reason> {
    let maneuver = &input.maneuver;
    let rests = maneuver.start.velocity == Velocity::default();
    (rests && stands_still(&input.robot, maneuver.torque_limit)).then(|| {
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
    let (cause, help) = if code == "no_torque" {
        ("no torque drives the robot there", "`maneuver.torque_limit_left_n_m`, `maneuver.torque_limit_right_n_m`")
    } else {
        ("no friction moves the robot there", "`robot.wheel_friction_coefficient`")
    };
    Reason {
        code,
        message: format!(
            "`{field}` is {goal}, which the start misses by {error} (tolerance {tolerance}), and {cause}; larger {help} help"
        ),
        field,
        time: Some(0.0),
        value: error.abs(),
        limit: tolerance,
    }
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
    Reason {
        code: "final_time_too_long",
        message: format!(
            "`{field}` is {goal}, which takes at least {time} s (bound `{assumption}`), must be at most \
             {LONGEST_FINAL_TIME} s; {help} or a nearer goal help"
        ),
        field,
        time: Some(time),
        value: time,
        limit: LONGEST_FINAL_TIME,
    }
}

/// The field of a goal component, and what is asked of it.
fn goal_field(input: &SolveInput, component: StateComponent) -> (String, String) {
    let goal = input.maneuver.goal.value(component).map_or("free".to_owned(), |value| value.to_string());
    (format!("maneuver.goal.{}", component.field()), goal)
}
