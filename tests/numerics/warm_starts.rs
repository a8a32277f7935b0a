//! Solves that begin from the plan of a similar maneuver.

use std::f64::consts::PI;

use slipdrive::motion::simulate;
use slipdrive::robot::PerWheel;
use slipdrive::shooting::{Goal, StateComponent};
use slipdrive::simulation::TorqueSchedule;
use slipdrive::solver::{Method, RunControl, Solution, SolveInput, SolveParameters, SolverSettings, Status, solve};
use slipdrive::stop::Stop;

/// Half a turn on the spot by a robot whose mass is on the centreline: both ways round are equally fast.
fn half_turn() -> SolveParameters {
    let mut parameters = SolveParameters::forward_drive();
    parameters.robot.center_of_mass_right = 0.0;
    parameters.maneuver.goal = Goal::at_rest(0.0, 0.0, PI);
    parameters
}

fn converged(parameters: SolveParameters) -> Solution {
    let solution = solve(&SolveInput::new(parameters).unwrap(), &RunControl::unattended()).unwrap();
    assert_eq!(solution.status, Status::Converged, "{:?}", solution.reason);
    solution
}

fn turned(solution: &Solution) -> f64 {
    solution.trajectory.end_state.configuration.heading
}

#[test]
fn a_guess_that_turns_the_other_way_round_is_followed() {
    let plan = converged(half_turn());
    let mut mirrored = plan.schedule.clone();
    std::mem::swap(&mut mirrored.left, &mut mirrored.right);
    for (guess, heading) in [(plan.schedule.clone(), turned(&plan)), (mirrored, -turned(&plan))] {
        let next = converged(SolveParameters { initial_guess: Some(guess), ..half_turn() });
        assert!((turned(&next) - heading).abs() < 1e-5, "{} rad, not {heading}", turned(&next));
        let gain = 1.0 - next.schedule.final_time / plan.schedule.final_time;
        // A plan is near a local optimum.
        assert!(gain.abs() < 1e-3, "{gain:e}");
        assert!(next.report.rollouts < plan.report.rollouts);
    }
}

#[test]
fn a_guess_that_meets_the_goal_is_kept_by_the_papers_method() {
    let mut parameters = half_turn();
    parameters.settings = SolverSettings { start_count: 1, ..parameters.settings };
    let plan = converged(parameters.clone());
    // Also one that turns the other way round, whose goal heading is another winding.
    let mut mirrored = plan.schedule.clone();
    std::mem::swap(&mut mirrored.left, &mut mirrored.right);
    parameters.settings = SolverSettings { method: Method::NelderMead, rollout_limit: 1000, ..parameters.settings };
    for guess in [plan.schedule.clone(), mirrored] {
        let input = SolveInput::new(SolveParameters { initial_guess: Some(guess), ..parameters.clone() }).unwrap();
        let next = solve(&input, &RunControl::unattended()).unwrap();
        assert!(matches!(next.status, Status::Converged | Status::Feasible), "{:?}", next.reason);
        assert!(next.schedule.final_time <= plan.schedule.final_time);
    }
}

#[test]
fn a_guess_with_torques_far_beyond_the_grip_is_kept() {
    let mut parameters = SolveParameters::forward_drive();
    // Wheels that race against each other turn the robot a little.
    let guess = TorqueSchedule { final_time: 0.01, left: vec![25.0], right: vec![-25.0] };
    let settings = SolverSettings { step_count: 3, control_count: 1, ..parameters.settings };
    let input = SolveInput::new(SolveParameters { settings, ..parameters.clone() }).unwrap();
    let end = simulate(&input.motion_of(guess.clone(), 3), Stop::never()).unwrap().trajectory.end_state;
    for component in StateComponent::ALL {
        parameters.maneuver.goal.set(component, Some(end.to_vector()[component.index()]));
    }
    parameters.maneuver.torque_limit = PerWheel::new(25.0, 25.0);
    let plan = converged(SolveParameters { settings, initial_guess: Some(guess), ..parameters });
    assert!(plan.schedule.final_time <= 0.01, "{} s", plan.schedule.final_time);
}
