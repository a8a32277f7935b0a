//! The grid on which a robot keeps its course.

use super::settings::SolverSettings;
use crate::robot::RobotParameters;
use crate::shooting::Maneuver;

/// Fewest steps on which a robot that drives straight from its start to its goal, from rest to rest, turns back to its course without
/// swinging over; 0 where the goal leaves the place free.
///
/// With the centre of mass at d ahead of the axle a step of a rolling robot changes the yaw rate by the factor 1 - m d v dt / I
/// (`docs/model.md`, *The course*), and a drive over L on n steps has v dt of at most 2 L / n: so the factor is never negative on
/// n = 2 L m d / I of them.
pub(super) fn steps_on_course(robot: &RobotParameters, maneuver: &Maneuver) -> usize {
    let miss = maneuver.goal_error(&maneuver.start);
    let distance = miss[0].hypot(miss[1]);
    let lever = robot.chassis_mass * robot.center_of_mass_forward;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, and no support lifts at rest")]
    let steps = (2.0 * distance * lever / robot.rolling_yaw_inertia()).ceil() as usize;
    steps
}

/// The steps to begin with: fixed ones as they are, automatic ones at least as many as the robot needs to keep its course, all control
/// intervals equally long.
pub(super) fn first_steps(settings: &SolverSettings, robot: &RobotParameters, maneuver: &Maneuver) -> usize {
    let finest = settings.finest_step_count();
    let steps = settings.step_count.max(steps_on_course(robot, maneuver)).min(finest);
    steps.checked_next_multiple_of(settings.control_count).map_or(finest, |steps| steps.min(finest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shooting::{Goal, StateComponent};
    use crate::solver::settings::{Refinement, SolveInput, SolveParameters};

    fn steps(goal: &Goal) -> usize {
        steps_on_course(&RobotParameters::default(), &Maneuver { goal: *goal, ..Maneuver::forward_drive() })
    }

    #[test]
    fn the_reference_robot_needs_less_than_five_steps_per_metre() {
        assert_eq!(steps(&Goal::at_rest(0.0, 100.0, 0.0)), 452);
        assert_eq!(steps(&Goal::at_rest(-60.0, 80.0, 1.0)), 452);
        let mut somewhere = Goal::at_rest(0.0, 100.0, 0.0);
        somewhere.set(StateComponent::Y, None);
        assert_eq!(steps(&somewhere), 0);
    }

    #[test]
    fn automatic_steps_begin_on_the_course() {
        let first = |distance: f64, refinement: Refinement| {
            let mut parameters = SolveParameters::default();
            (parameters.settings.refinement, parameters.settings.control_count) = (refinement, 37);
            parameters.maneuver.goal.set(StateComponent::Y, Some(distance));
            SolveInput::new(parameters).unwrap().settings.step_count
        };
        let automatic = |step_limit: usize| Refinement::UntilConfirmed { step_limit };
        assert_eq!(first(100.0, Refinement::Fixed), 200);
        // Whole multiples of the intervals, up to the last one within the limit.
        assert_eq!([1.0, 100.0, 1e4].map(|distance| first(distance, automatic(10_000))), [222, 481, 9_990]);
        assert_eq!(first(100.0, automatic(300)), 296);
        assert_eq!(first(100.0, automatic(36)), 36);
    }
}
