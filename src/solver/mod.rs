//! The solver: from a validated maneuver to a plan with its certificate.

mod bounds;
mod candidate;
mod certificate;
mod control_grid;
mod course;
mod goal_miss;
mod grid_problem;
mod held_wheels;
mod helpers;
mod hops;
mod local_search;
mod parts;
mod progress;
mod race;
mod refinement;
mod run_control;
mod search;
mod segments;
mod settings;
mod solution;
mod starts;
mod strategies;

pub use helpers::{Alone, Helpers, SharedWork};
pub use run_control::{NoProgress, Phase, ProgressObserver, RunControl, SolveProgress};
pub use settings::{Choice, Method, Refinement, SolveInput, SolveParameters, SolverSettings};
pub use solution::{
    DistinctOptimum, LowerBoundAssumption, Reason, RefinementOutcome, Replay, Report, Solution, Status, StopReason,
};

pub(crate) use certificate::{REPLAY_EXCESS, REPLAY_REFINEMENT};
pub(crate) use helpers::in_parts;

use std::iter;

use candidate::Candidate;
use certificate::Motion;
use grid_problem::problem_on;
use nalgebra::DVector;
use search::SearchResult;

use crate::motion::ROUNDING;
use crate::shooting::{decision_from_schedule, schedule_from_decision};
use crate::simulation::Simulator;
use crate::stop::{Stop, Stopped};

/// Solves a maneuver; the result, whatever it is, is a status of the answer, never an error.
///
/// The answer depends on the input alone, unless `control` stops the search.
///
/// # Errors
/// When `control` cuts it off before there is a plan to answer.
pub fn solve(input: &SolveInput, control: &RunControl) -> Result<Solution, Stopped> {
    if let Some(reason) = bounds::impossibility(input) {
        return Ok(certificate::certified_impossible(input, reason));
    }
    if input.starts_at_goal() {
        return Ok(certificate::certified_standstill(input));
    }
    let simulator = Simulator::new(&input.robot);
    let settings = &input.settings;
    let (mut problem, mut bound) = problem_on(input, &simulator, settings.step_count);
    let mut result = control_grid::search(input, (&simulator, &problem), settings.rollout_limit, control);
    if let Refinement::UntilConfirmed { .. } = settings.refinement {
        refinement::refine(input, &simulator, control, &mut result);
        (problem, bound) = problem_on(input, &simulator, result.step_count);
    }
    let _phase = control.enter(Phase::Certificate);
    problem.release_torques();
    let answered = answered(input, &simulator, &mut result, control.cut())?;
    Ok(certificate::certified(input, &simulator, (&mut problem, bound), answered, (result, control.cut())))
}

/// The decision to answer, with its motion: the best one, or the first start of a solve that was stopped before its first rollout, where
/// that diverges no torque. The motion alone decides: rollouts of the search follow others, and may stay finite where it does not.
///
/// That of a plan that was found is not cut off: it takes milliseconds, and the plan would be lost.
fn answered(
    input: &SolveInput,
    simulator: &Simulator,
    result: &mut SearchResult,
    stop: Stop,
) -> Result<(Candidate, Motion), Stopped> {
    let step_count = result.step_count;
    let moving = |candidate: Candidate, stop: Stop| {
        let schedule = schedule_from_decision(&candidate.decision);
        Motion::of_plan(input, simulator, (schedule, step_count), stop).map(|motion| (candidate, motion))
    };
    let found = result.best.take().map(|best| (best, Stop::never()));
    for (candidate, stop) in found.into_iter().chain(iter::once_with(|| (first_start(input), stop))) {
        let (candidate, motion) = moving(candidate, stop)?;
        if motion.is_finite() {
            return Ok((candidate, motion));
        }
        // It is that of the best one.
        result.replayed = None;
    }
    moving(standing_still(input), stop)
}

fn first_start(input: &SolveInput) -> Candidate {
    let start = &starts::starts(input, 1)[0];
    Candidate::new(decision_from_schedule(&start.schedule), start.goal_heading)
}

/// The answer where every motion that was tried diverged: no torque, for so short a time that none does.
fn standing_still(input: &SolveInput) -> Candidate {
    let decision = DVector::zeros(2 * input.settings.control_count).push(ROUNDING);
    Candidate::new(decision, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_replay_is_that_of_the_answer() {
        let input = SolveInput::forward_drive();
        let (simulator, step_count) = (Simulator::new(&input.robot), 200);
        let start = first_start(&input);
        let schedule = schedule_from_decision(&start.decision);
        let replayed = certificate::replay(&input, &simulator, (&schedule, step_count), Stop::never()).unwrap();
        let answered_with = |decision: DVector<f64>| {
            let best = Some(Candidate { decision, ..start.clone() });
            let replayed = Some(replayed.clone());
            let mut result = SearchResult { best, step_count, replayed, ..SearchResult::default() };
            let (candidate, motion) = answered(&input, &simulator, &mut result, Stop::never()).unwrap();
            (candidate.decision, motion.is_finite(), result.replayed.is_some())
        };
        assert_eq!(answered_with(start.decision.clone()), (start.decision.clone(), true, true));
        assert_eq!(answered_with(1e300 * &start.decision), (start.decision.clone(), true, false));
    }
}
