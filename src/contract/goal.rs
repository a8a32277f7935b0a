//! The goal: what an absent field means, and which fields are free.
//!
//! Absent `x_m`, `y_m`, `heading_rad` mean the start's value; absent velocities mean 0; absent wheel angles are free.
//! `goal.free` names fields that are free; a field both given and free contradicts itself.

use super::message;
use super::state::{goal_of_values, values_of_goal};
use crate::robot::State;
use crate::rules::{Checks, Rule};
use crate::shooting::{Goal, StateComponent};

/// The goal that is meant; faults of `goal.free` go to `checks`, below the goal.
pub(super) fn goal_of_message(message: &message::Goal, start: &State, checks: &mut Checks) -> Goal {
    let given = values_of_goal(message);
    let free = free_components(&message.free, &given, checks);
    let start = start.to_vector();
    let mut goal = Goal::default();
    for component in StateComponent::ALL {
        let value = given[component.index()].or_else(|| default_value(component, start[component.index()]));
        goal.set(component, value.filter(|_| !free.contains(&component)));
    }
    goal
}

/// The goal with every field either given or named as free.
pub(super) fn message_of_goal(goal: &Goal) -> message::Goal {
    let is_free = |component: &StateComponent| goal.value(*component).is_none();
    let free = StateComponent::ALL.into_iter().filter(is_free).map(|component| component.field().to_owned());
    goal_of_values(StateComponent::ALL.map(|component| goal.value(component)), free.collect())
}

fn default_value(component: StateComponent, at_start: f64) -> Option<f64> {
    match component {
        StateComponent::X | StateComponent::Y | StateComponent::Heading => Some(at_start),
        StateComponent::WheelAngleLeft | StateComponent::WheelAngleRight => None,
        StateComponent::VelocityX
        | StateComponent::VelocityY
        | StateComponent::YawRate
        | StateComponent::WheelRateLeft
        | StateComponent::WheelRateRight => Some(0.0),
    }
}

fn free_components(names: &[String], given: &[Option<f64>], checks: &mut Checks) -> Vec<StateComponent> {
    let mut free = Vec::new();
    if names.len() > State::LEN {
        checks.length("free", names.len(), &Rule::between(0.0, State::LEN as f64, Rule::ITEMS));
        return free;
    }
    for name in names {
        let quoted = format!("\"{name}\"");
        let Some(component) = StateComponent::ALL.into_iter().find(|component| component.field() == name) else {
            checks.require("free", quoted, false, "a field of the goal", None);
            continue;
        };
        let is_given = given[component.index()].is_some();
        checks.require("free", &quoted, !is_given, "a field without a value: it has one too", None);
        checks.require("free", &quoted, !free.contains(&component), "named once", None);
        free.push(component);
    }
    free
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goal_of(message: &message::Goal, start: &State) -> (Goal, Vec<String>) {
        let mut checks = Checks::new();
        let goal = checks.within("goal", |checks| goal_of_message(message, start, checks));
        let messages = match checks.finish() {
            Ok(()) => Vec::new(),
            Err(violations) => violations.list().iter().map(|violation| violation.message.clone()).collect(),
        };
        (goal, messages)
    }

    fn free(names: &[&str]) -> message::Goal {
        message::Goal { free: names.iter().map(|name| (*name).to_owned()).collect(), ..message::Goal::default() }
    }

    #[test]
    fn absent_pose_is_the_start_and_absent_velocities_are_rest() {
        let mut start = State::default();
        start.configuration.x = 3.0;
        start.velocity.y = 1.0;
        let (goal, messages) = goal_of(&message::Goal { y_m: Some(5.0), ..message::Goal::default() }, &start);
        assert_eq!((goal, messages), (Goal::at_rest(3.0, 5.0, 0.0), Vec::new()));
    }

    #[test]
    fn freed_field_is_unconstrained() {
        let (goal, messages) = goal_of(&free(&["heading_rad", "wheel_angle_left_rad"]), &State::default());
        assert_eq!((goal.value(StateComponent::Heading), messages.len()), (None, 0));
    }

    #[test]
    fn completed_goal_means_the_same() {
        let wire = message::Goal { wheel_angle_left_rad: Some(1.0), ..free(&["x_m", "yaw_rate_rad_s"]) };
        let (goal, _) = goal_of(&wire, &State::default());
        let completed = message_of_goal(&goal);
        assert_eq!(completed.free, ["x_m", "wheel_angle_right_rad", "yaw_rate_rad_s"]);
        assert_eq!(goal_of(&completed, &State::default()), (goal, Vec::new()));
    }

    #[test]
    fn contradictions_in_free_are_named() {
        let cases = [
            (
                message::Goal { x_m: Some(1.0), ..free(&["x_m"]) },
                "`goal.free` is \"x_m\", must be a field without a value: it has one too",
            ),
            (free(&["speed"]), "`goal.free` is \"speed\", must be a field of the goal"),
            (free(&["x_m", "x_m"]), "`goal.free` is \"x_m\", must be named once"),
            (free(&["x_m"; 11]), "`goal.free` is 11 items long, must be between 0 and 10 items"),
        ];
        for (wire, expected) in cases {
            let (_, messages) = goal_of(&wire, &State::default());
            assert_eq!(messages.len(), 1, "{messages:?}");
            assert!(messages[0].starts_with(expected), "{messages:?}");
        }
    }
}
