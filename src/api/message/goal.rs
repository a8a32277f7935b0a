//! The goal: what an absent field means, and which fields are free.
//!
//! Absent `x_m`, `y_m`, `heading_rad` mean the start's value; absent velocities mean 0; absent wheel angles are free.
//! `goal.free` names fields that are free; a field both given and free contradicts itself.

use super::request::GoalWire;
use crate::service::domain::{Goal, State, StateComponent};
use crate::violation::Checks;

/// The goal that is meant; faults of `goal.free` go to `checks`, below the goal.
pub(in crate::api) fn goal_from_wire(wire: &GoalWire, start: &State, checks: &mut Checks) -> Goal {
    let given = given_values(wire);
    let free = free_components(wire, &given, checks);
    let start = start.to_vector();
    let mut goal = Goal::default();
    for component in StateComponent::ALL {
        let value = given[component.index()].or_else(|| default_value(component, start[component.index()]));
        goal.set(component, value.filter(|_| !free.contains(&component)));
    }
    goal
}

/// The goal with every field either given or named as free.
pub(in crate::api) fn goal_to_wire(goal: &Goal) -> GoalWire {
    let is_free = |component: &StateComponent| goal.value(*component).is_none();
    GoalWire {
        x_m: goal.value(StateComponent::X),
        y_m: goal.value(StateComponent::Y),
        heading_rad: goal.value(StateComponent::Heading),
        wheel_angle_left_rad: goal.value(StateComponent::WheelAngleLeft),
        wheel_angle_right_rad: goal.value(StateComponent::WheelAngleRight),
        velocity_x_m_s: goal.value(StateComponent::VelocityX),
        velocity_y_m_s: goal.value(StateComponent::VelocityY),
        yaw_rate_rad_s: goal.value(StateComponent::YawRate),
        wheel_rate_left_rad_s: goal.value(StateComponent::WheelRateLeft),
        wheel_rate_right_rad_s: goal.value(StateComponent::WheelRateRight),
        free: StateComponent::ALL.into_iter().filter(is_free).map(|component| component.field().to_owned()).collect(),
    }
}

/// In the order of [`StateComponent::ALL`].
fn given_values(wire: &GoalWire) -> [Option<f64>; State::LEN] {
    let GoalWire {
        x_m,
        y_m,
        heading_rad,
        wheel_angle_left_rad,
        wheel_angle_right_rad,
        velocity_x_m_s,
        velocity_y_m_s,
        yaw_rate_rad_s,
        wheel_rate_left_rad_s,
        wheel_rate_right_rad_s,
        free: _,
    } = wire;
    [
        *x_m,
        *y_m,
        *heading_rad,
        *wheel_angle_left_rad,
        *wheel_angle_right_rad,
        *velocity_x_m_s,
        *velocity_y_m_s,
        *yaw_rate_rad_s,
        *wheel_rate_left_rad_s,
        *wheel_rate_right_rad_s,
    ]
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

fn free_components(wire: &GoalWire, given: &[Option<f64>], checks: &mut Checks) -> Vec<StateComponent> {
    let mut free = Vec::new();
    if wire.free.len() > State::LEN {
        let count = format!("{} names long", wire.free.len());
        let rule = format!("at most {} names long", State::LEN);
        checks.require("free", count, false, &rule, Some(State::LEN as f64));
        return free;
    }
    for name in &wire.free {
        let quoted = format!("\"{name}\"");
        let Some(component) = StateComponent::ALL.into_iter().find(|component| component.field() == name) else {
            checks.require("free", quoted, false, "a field of the goal", None);
            continue;
        };
        let is_given = given[component.index()].is_some();
        checks.require("free", &quoted, !is_given, "without a field that is given too", None);
        checks.require("free", &quoted, !free.contains(&component), "named once", None);
        free.push(component);
    }
    free
}

#[cfg(test)]
mod tests {
    use super::*;

    fn goal_of(wire: &GoalWire, start: &State) -> (Goal, Vec<String>) {
        let mut checks = Checks::new();
        let goal = checks.within("goal", |checks| goal_from_wire(wire, start, checks));
        let messages = match checks.into_result(()) {
            Ok(()) => Vec::new(),
            Err(violations) => violations.list().iter().map(|violation| violation.message.clone()).collect(),
        };
        (goal, messages)
    }

    fn free(names: &[&str]) -> GoalWire {
        GoalWire { free: names.iter().map(|name| (*name).to_owned()).collect(), ..GoalWire::default() }
    }

    #[test]
    fn absent_pose_is_the_start_and_absent_velocities_are_rest() {
        let mut start = State::default();
        start.configuration.x = 3.0;
        start.velocity.y = 1.0;
        let (goal, messages) = goal_of(&GoalWire { y_m: Some(5.0), ..GoalWire::default() }, &start);
        assert_eq!((goal, messages), (Goal::at_rest(3.0, 5.0, 0.0), Vec::new()));
    }

    #[test]
    fn freed_field_is_unconstrained() {
        let (goal, messages) = goal_of(&free(&["heading_rad", "wheel_angle_left_rad"]), &State::default());
        assert_eq!((goal.value(StateComponent::Heading), messages.len()), (None, 0));
    }

    #[test]
    fn completed_goal_means_the_same() {
        let wire = GoalWire { wheel_angle_left_rad: Some(1.0), ..free(&["x_m", "yaw_rate_rad_s"]) };
        let (goal, _) = goal_of(&wire, &State::default());
        let completed = goal_to_wire(&goal);
        assert_eq!(completed.free, ["x_m", "wheel_angle_right_rad", "yaw_rate_rad_s"]);
        assert_eq!(goal_of(&completed, &State::default()), (goal, Vec::new()));
    }

    #[test]
    fn contradictions_in_free_are_named() {
        let cases = [
            (GoalWire { x_m: Some(1.0), ..free(&["x_m"]) }, "`goal.free` is \"x_m\", must be without a field"),
            (free(&["speed"]), "`goal.free` is \"speed\", must be a field of the goal"),
            (free(&["x_m", "x_m"]), "`goal.free` is \"x_m\", must be named once"),
            (free(&["x_m"; 11]), "`goal.free` is 11 names long, must be at most 10"),
        ];
        for (wire, expected) in cases {
            let (_, messages) = goal_of(&wire, &State::default());
            assert_eq!(messages.len(), 1, "{messages:?}");
            assert!(messages[0].starts_with(expected), "{messages:?}");
        }
    }
}
