//! Lower bounds on the final time that hold for any motion of the model.

use super::solution::LowerBoundAssumption;
use crate::robot::{RobotParameters, State};
use crate::shooting::{Maneuver, StateComponent};

/// The friction bound, s; 0 where it says nothing.
///
/// All horizontal forces on the robot are friction forces, at most `mu N` each, and without separation the normal forces
/// add up to the weight. The whole robot's centre of mass thus accelerates by at most a = max(mu) g. From rest to rest
/// over a displacement D the fastest such motion accelerates half the way and brakes the other half: `2 sqrt(D / a)`.
pub(super) fn friction_bound(maneuver: &Maneuver, robot: &RobotParameters) -> (f64, LowerBoundAssumption) {
    let friction = robot.wheel_friction_coefficient.max(robot.front_friction_coefficient);
    let displacement = rest_to_rest_displacement(maneuver, robot);
    let bound = match displacement {
        Some(displacement) if friction > 0.0 => 2.0 * (displacement / (friction * robot.gravity)).sqrt(),
        Some(_) | None => 0.0,
    };
    (bound, LowerBoundAssumption::Friction)
}

/// How far the whole robot's centre of mass must move, m, when start and goal are poses at rest.
fn rest_to_rest_displacement(maneuver: &Maneuver, robot: &RobotParameters) -> Option<f64> {
    let value = |component| maneuver.goal.value(component);
    let mut goal = State::default();
    goal.configuration.x = value(StateComponent::X)?;
    goal.configuration.y = value(StateComponent::Y)?;
    goal.configuration.heading = value(StateComponent::Heading)?;
    let rates = [StateComponent::VelocityX, StateComponent::VelocityY, StateComponent::YawRate];
    let ends_at_rest = rates.into_iter().all(|component| value(component) == Some(0.0));
    let rates_at_start = maneuver.start.to_vector();
    let starts_at_rest = rates.into_iter().all(|component| rates_at_start[component.index()] == 0.0);
    if !(starts_at_rest && ends_at_rest) {
        return None;
    }
    let offset = robot.whole_center_of_mass() - maneuver.reference_point.offset(robot);
    let (from, to) = (maneuver.start.moved_by(offset).configuration, goal.moved_by(offset).configuration);
    Some((to.x - from.x).hypot(to.y - from.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forward_drive_takes_longer_than_friction_alone_allows() {
        let (bound, _) = friction_bound(&Maneuver::forward_drive(), &RobotParameters::default());
        // The heading does not change, so the whole centre of mass moves 5 m as well.
        assert!((bound - 2.0 * (5.0_f64 / (0.45 * 9.81)).sqrt()).abs() < 1e-14);
    }

    #[test]
    fn turning_about_the_whole_center_of_mass_is_not_bounded() {
        let robot = RobotParameters::default();
        let mut maneuver = Maneuver::forward_drive();
        let center = robot.whole_center_of_mass();
        // A half turn about the whole centre of mass takes the chassis to the other side of it.
        maneuver.goal.set(StateComponent::X, Some(2.0 * center.x));
        maneuver.goal.set(StateComponent::Y, Some(2.0 * center.y));
        maneuver.goal.set(StateComponent::Heading, Some(std::f64::consts::PI));
        let (bound, _) = friction_bound(&maneuver, &robot);
        // sqrt of a displacement of 1e-17 m.
        assert!(bound < 1e-7);
    }

    #[test]
    fn moving_starts_and_free_goals_have_no_friction_bound() {
        let mut maneuver = Maneuver::forward_drive();
        maneuver.goal.set(StateComponent::X, None);
        assert_eq!(friction_bound(&maneuver, &RobotParameters::default()).0, 0.0);
    }
}
