//! The reason of a plan that misses the goal or exceeds a limit: what is missed most, and what would help.

use nalgebra::SVector;

use super::bounds::{fields_of_torque_at_rest, may_stay_at_start, slip_by_wheel_rates};
use super::course::steps_on_course;
use super::settings::{Method, SolveInput};
use super::solution::{Reason, StopReason};
use crate::motion::{LimitUse, STEP_LIMIT};
use crate::robot::State;
use crate::shooting::{SHORTEST_FINAL_TIME, StateComponent, decision_len};
use crate::simulation::TorqueSchedule;

/// A miss up to this (m, rad, m/s, rad/s), whatever the tolerance, may be rounding or a kink of the friction law; a larger one is not near
/// the goal.
const NEAR_MISS: f64 = 1e-3;

/// The goal component that a plan misses most, the limit that it exceeds beside, and what would help.
pub(super) fn goal_missed(
    input: &SolveInput,
    plan: &TorqueSchedule,
    goal_error: &SVector<f64, { State::LEN }>,
    (exceeded, stop_reason): (Option<&LimitUse>, StopReason),
) -> Reason {
    let error = |component: StateComponent| goal_error[component.index()];
    let (component, goal) = input
        .maneuver
        .goal
        .constrained()
        .max_by(|(a, _), (b, _)| error(*a).abs().total_cmp(&error(*b).abs()))
        .expect("a validated goal constrains something");
    let miss = error(component);
    let tolerance = input.settings.goal_tolerance;
    let field = format!("maneuver.goal.{}", component.field());
    // The search has no shorter plans, but for rounding: such a final time means that every motion diverged.
    let diverges = plan.final_time < 0.5 * SHORTEST_FINAL_TIME;
    let (code, subject, help) = if diverges {
        let help = "more `grid.steps` or a slower start".to_owned();
        ("motion_diverges", "every motion that was tried diverges, and the start", help)
    } else {
        let for_search = help_for_search(input, miss, (exceeded, stop_reason));
        ("goal_missed", "the best plan", with_fitting_wheel_rates(input, miss.abs(), &for_search))
    };
    let beside = exceeded.map(|used| format!(", where it {}", excess(used))).unwrap_or_default();
    let missed_by = Reason::told(miss.abs(), tolerance);
    let message = format!(
        "`{field}` is {goal}, {subject} misses it by {missed_by}, must be within {tolerance}{beside}; {help} would help"
    );
    let time = (!diverges).then_some(plan.final_time);
    Reason { code, message, field, time, value: miss.abs(), limit: tolerance }
}

/// The limit that a plan exceeds most, and what would help.
pub(super) fn limit_missed(input: &SolveInput, used: &LimitUse, stop_reason: StopReason) -> Reason {
    let help = with_fitting_wheel_rates(input, 0.0, &help_for_search(input, 0.0, (Some(used), stop_reason)));
    let message = format!("the best plan that meets the goal {}; {help} would help", excess(used));
    let LimitUse { limit, value, largest, time, .. } = *used;
    let (code, field) = (Reason::LIMIT_EXCEEDED, limit.to_owned());
    Reason { code, message, field, time: Some(time), value: largest, limit: value }
}

/// What a plan does that a limit does not allow.
fn excess(&LimitUse { limit, value, largest, .. }: &LimitUse) -> String {
    let largest = Reason::told(largest, value);
    if limit == AISLE {
        return format!("has a corner of `robot.footprint` {largest} m outside `{limit}`");
    }
    if limit == MOTOR {
        return format!(
            "asks at its speeds for a motor of {largest} N m, or a faster one, where `{limit}` is {value} and \
             `robot.motor_free_speed_rad_s` what it is"
        );
    }
    format!("takes {largest} where `{limit}` allows {value}")
}

const AISLE: &str = "maneuver.keep_in";
const MOTOR: &str = "robot.motor_stall_torque_n_m";
const MORE_TIME: &str = "more time (`solver.time_limit_s` or the deadline)";
const MORE_ROLLOUTS: &str = "a larger `solver.rollout_limit`";
const MORE_TIME_OR_WIDER_LIMIT: &str = "more time (`solver.time_limit_s` or the deadline) or a wider limit";
const WIDER_LIMIT: &str = "more `solver.starts`, more `grid.control_intervals` or a wider limit";

/// First another goal where this one asks for slip, as those do that give a speed and leave the wheel rates at 0, or give them with few
/// digits. A slip far below what is missed is not its cause.
fn with_fitting_wheel_rates(input: &SolveInput, miss: f64, for_search: &str) -> String {
    let Some(slip) = slip_by_wheel_rates(input).filter(|slip| *slip > 0.1 * miss.min(NEAR_MISS)) else {
        return for_search.to_owned();
    };
    format!(
        "a goal whose wheel rates fit its velocity or are free (as asked, a wheel slips by {} m/s), else {for_search}",
        Reason::told(slip, 0.0)
    )
}

/// What would help the search to the goal, for the most certain cause first.
fn help_for_search(input: &SolveInput, miss: f64, (exceeded, stop_reason): (Option<&LimitUse>, StopReason)) -> String {
    let settings = &input.settings;
    let requirements = input.maneuver.goal.constrained().count();
    let on_course = steps_on_course(input.robot.parameters(), &input.maneuver);
    if miss.abs() > NEAR_MISS && may_stay_at_start(input) {
        let fields = fields_of_torque_at_rest(input);
        return format!("less `robot.front_friction_coefficient`, which can hold the robot fast, or larger {fields}");
    }
    let help = match stop_reason {
        StopReason::Finished if decision_len(settings.control_count) < requirements => {
            "more `grid.control_intervals`, of which there are too few for so many goal fields,"
        }
        // Its penalty trades the goal for time, however long it searches.
        StopReason::Stopped | StopReason::RolloutLimit | StopReason::Finished
            if settings.method == Method::NelderMead =>
        {
            "the method `sequential_linear`"
        }
        StopReason::Stopped if exceeded.is_some() => MORE_TIME_OR_WIDER_LIMIT,
        StopReason::Stopped => MORE_TIME,
        StopReason::RolloutLimit => MORE_ROLLOUTS,
        StopReason::Finished if miss.abs() <= NEAR_MISS && exceeded.is_some() => WIDER_LIMIT,
        StopReason::Finished if miss.abs() <= NEAR_MISS => "a larger `solver.goal_tolerance` or more `grid.steps`",
        // Automatic steps begin on that many, if they may.
        StopReason::Finished if settings.finest_step_count() < on_course => {
            return if on_course <= STEP_LIMIT {
                format!(
                    "a shorter way, more `solver.starts`, or {on_course} or more `grid.steps`, on which the robot keeps its \
                     course so far,"
                )
            } else {
                format!("a shorter way, on which the robot keeps its course with {STEP_LIMIT} `grid.steps`,")
            };
        }
        StopReason::Finished => "more `grid.control_intervals`, `grid.steps` or `solver.starts`, or fewer goal fields",
    };
    help.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shooting::{Goal, Maneuver, decision_from_schedule, schedule_from_decision};
    use crate::solver::settings::Refinement;

    #[test]
    fn the_shortest_plan_is_no_divergence() {
        let input = SolveInput::forward_drive();
        for control_count in [1, 20, 25, 50, 100, 999] {
            let plan = schedule_from_decision(&decision_from_schedule(&TorqueSchedule::without_torque(
                SHORTEST_FINAL_TIME,
                control_count,
            )));
            let missed = |plan: &TorqueSchedule| {
                let reason = goal_missed(&input, plan, &SVector::repeat(1.0), (None, StopReason::Finished));
                (reason.code, reason.time)
            };
            assert_eq!(missed(&plan), ("goal_missed", Some(plan.final_time)), "{control_count}");
            let shorter = TorqueSchedule { final_time: 0.1 * SHORTEST_FINAL_TIME, ..plan };
            assert_eq!(missed(&shorter), ("motion_diverges", None), "{control_count}");
        }
    }

    #[test]
    fn numbers_are_short_where_that_tells_them_from_their_limit() {
        let told = |value, limit| Reason::told(value, limit);
        assert_eq!([told(0.881_157_056_8, 1e-6), told(-1.042_942_98, 0.05), told(0.0, 1.0)], [0.8812, -1.043, 0.0]);
        assert_eq!([told(0.800_002, 0.8), told(0.799_999, 0.8)], [0.800_002, 0.8]);
        assert!(told(f64::NAN, 1.0).is_nan() && told(f64::INFINITY, 1.0).is_infinite());
    }

    #[test]
    fn a_wider_limit_helps_where_one_is_exceeded_beside_a_near_miss() {
        let used = LimitUse {
            limit: "maneuver.limits.speed_m_s",
            value: 1.0,
            largest: 2.0,
            time: 0.0,
            excess: 1.0,
            replay_excess: None,
        };
        let help = |exceeded| help_for_search(&SolveInput::forward_drive(), 3e-6, (exceeded, StopReason::Finished));
        assert!(help(Some(&used)).contains("wider limit") && !help(Some(&used)).contains("goal_tolerance"));
        assert!(help(None).contains("goal_tolerance"));
    }

    #[test]
    fn fitting_wheel_rates_are_advised_where_a_limit_keeps_the_goal_from_slipping() {
        let mut input = SolveInput::forward_drive();
        let used = LimitUse { limit: MOTOR, value: 0.3, largest: 0.4, time: 0.0, excess: 0.3, replay_excess: None };
        let advice = "a goal whose wheel rates fit its velocity or are free";
        assert!(!limit_missed(&input, &used, StopReason::Finished).message.contains(advice));
        input.maneuver.goal.set(StateComponent::VelocityY, Some(0.15));
        assert!(limit_missed(&input, &used, StopReason::Finished).message.contains(advice));
        // Six digits of a fitting rate: all tolerances together would allow the slip.
        let rounded = |input: &SolveInput, miss| with_fitting_wheel_rates(input, miss, "more time").contains(advice);
        input.maneuver.goal.set(StateComponent::VelocityY, Some(2e-6));
        assert!(rounded(&input, 4e-6) && !rounded(&input, 5.0));
        input.maneuver.goal.set(StateComponent::VelocityY, Some(0.9e-6));
        assert!(!rounded(&input, 2e-6));
    }

    #[test]
    fn no_more_steps_are_advised_than_there_may_be() {
        let mut input = SolveInput::forward_drive();
        input.maneuver = Maneuver { goal: Goal::at_rest(0.0, 1e4, 0.0), ..input.maneuver };
        let help = help_for_search(&input, 50.0, (None, StopReason::Finished));
        assert!(help.starts_with("a shorter way, on which") && help.contains("10000 `grid.steps`"), "{help}");
    }

    #[test]
    fn steps_on_course_are_advised_where_the_search_had_fewer() {
        for (refinement, is_advised) in [
            (Refinement::Fixed, true),
            (Refinement::UntilConfirmed { step_limit: 400 }, true),
            (Refinement::UntilConfirmed { step_limit: 10_000 }, false),
        ] {
            let mut input = SolveInput::forward_drive();
            input.maneuver = Maneuver { goal: Goal::at_rest(0.0, 100.0, 0.0), ..input.maneuver };
            input.settings.refinement = refinement;
            let help = help_for_search(&input, 50.0, (None, StopReason::Finished));
            assert_eq!(help.contains("or 452 or more `grid.steps`"), is_advised, "{refinement:?}: {help}");
        }
    }
}
