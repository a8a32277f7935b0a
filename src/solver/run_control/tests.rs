//! How soon a solve ends once it is stopped or cut off, with a robot whose friction is hard to resolve.

use super::*;
use crate::robot::PerWheel;
use crate::robot::unlucky::heavy_wheels;
use crate::shooting::{Goal, Maneuver};
use crate::simulation::TorqueSchedule;
use crate::solver::{
    Method, Refinement, RefinementOutcome, Solution, SolveInput, SolveParameters, SolverSettings, Status, StopReason,
    solve,
};
use crate::stop::probe;

const STEPS: usize = 6;
/// The most questions after the one that stops: each level of the search asks once more on the way out.
const WAY_OUT: u64 = 20;

fn input(settings: SolverSettings) -> SolveInput {
    let robot = heavy_wheels();
    let maneuver = Maneuver {
        goal: Goal::at_rest(1.0, 2.0, 0.7),
        torque_limit: PerWheel::new(2.0, 2.0),
        ..Maneuver::forward_drive()
    };
    let guess = TorqueSchedule { final_time: 9.1, left: vec![1.3, -0.4, 0.9, -1.7], right: vec![-0.6, 1.9, -1.1, 0.2] };
    let settings = SolverSettings { step_count: STEPS, control_count: STEPS, start_count: 1, ..settings };
    let initial_guess = Some(guess);
    SolveInput::new(SolveParameters { robot, maneuver, settings, initial_guess, ..SolveParameters::default() }).unwrap()
}

fn searching(method: Method, rollout_limit: u64) -> SolveInput {
    input(SolverSettings { method, rollout_limit, refinement: Refinement::Fixed, ..SolverSettings::default() })
}

/// The paper's forward drive on a coarse grid, whose replay asks for a finer one.
fn refining() -> SolveInput {
    let mut input = SolveInput::forward_drive();
    let refinement = Refinement::UntilConfirmed { step_limit: 160 };
    input.settings = SolverSettings { step_count: 40, control_count: 10, start_count: 1, refinement, ..input.settings };
    input
}

/// Some questions between two.
fn spread(first: u64, end: u64) -> impl Iterator<Item = u64> {
    (first..end).step_by(usize::try_from((end - first) / 8).unwrap().max(1))
}

fn stopped_at(question: u64, input: &SolveInput) -> (Solution, u64) {
    let (solution, asked) = probe::stopped_at(question, |stop| solve(input, &RunControl::new(stop, &NoProgress)));
    (solution.unwrap(), asked)
}

#[test]
fn search_asks_at_each_step_and_ends_where_it_is_stopped() {
    for input in [searching(Method::SequentialLinear, 25), searching(Method::NelderMead, 25)] {
        let (solution, asked) = stopped_at(0, &input);
        assert_eq!(solution.stop_reason, StopReason::RolloutLimit);
        assert!(asked >= 25 * STEPS as u64, "{asked} questions in 25 rollouts of {STEPS} steps");
        for question in spread(1, asked) {
            let (solution, asked) = stopped_at(question, &input);
            assert_eq!(solution.stop_reason, StopReason::Stopped, "question {question}");
            assert!(asked <= question + WAY_OUT, "{} questions after the one that stops", asked - question);
            assert!(solution.report.rollouts <= question, "counted rollouts were begun");
        }
    }
}

#[test]
fn refinement_ends_where_it_is_stopped() {
    let input = refining();
    let (solution, asked) = stopped_at(0, &input);
    assert_eq!(solution.stop_reason, StopReason::Finished);
    assert!(solution.report.step_count > 40, "the grid is refined");
    // The last of them are those of the refinement.
    for question in spread(asked - 5000, asked) {
        let (solution, asked) = stopped_at(question, &input);
        assert_eq!(solution.stop_reason, StopReason::Stopped, "question {question}");
        assert!(asked <= question + WAY_OUT, "{} questions after the one that stops", asked - question);
        assert_eq!(solution.report.refinement, RefinementOutcome::Interrupted);
        assert!(solution.report.replay.is_some(), "the certificate was not cut off");
    }
}

#[test]
fn certificate_asks_at_each_step_and_ends_where_it_is_cut_off() {
    // The forward drive's plan meets the goal; the other robot's does not.
    let mut coarse = refining();
    coarse.settings.refinement = Refinement::Fixed;
    for (input, kept) in [(searching(Method::SequentialLinear, 20), Status::NotConverged), (coarse, Status::Feasible)] {
        let steps = input.settings.step_count as u64;
        let cut_at = |question: u64| {
            let certify = |cut: Stop| solve(&input, &RunControl::unattended().cut_off_by(cut));
            probe::stopped_at(question, certify)
        };
        let (whole, asked) = cut_at(0);
        let whole = whole.unwrap();
        assert!(asked >= 16 * steps, "{asked} questions for the replay of {steps} steps");
        for question in spread(1, asked) {
            let (solution, asked) = cut_at(question);
            assert!(asked <= question + WAY_OUT, "{} questions after the one that cuts off", asked - question);
            // Not even the first question loses the plan.
            let Solution { status, replay_confirmed, report, trajectory, .. } = solution.unwrap();
            assert_eq!((status, replay_confirmed), (kept, false), "question {question}");
            assert_eq!((report.replay, report.lower_bound, report.lower_bound_assumption), (None, None, None));
            assert_eq!(report.sensitivity, []);
            assert_eq!(trajectory, whole.trajectory);
        }
        assert!(whole.report.replay.is_some() && whole.report.lower_bound.is_some());
        assert_eq!(whole.report.sensitivity.len(), 14);
    }
}
