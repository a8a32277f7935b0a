//! The solver: from a validated maneuver to a plan with its certificate.

mod candidate;
mod carried;
mod certificate;
mod control_grid;
mod course;
mod disturbed;
mod excluded_ends;
mod goal_miss;
mod grid_problem;
mod helpers;
mod hops;
mod impossibility;
mod largest_normal_force;
mod limit_uses;
mod local_search;
mod lower_bound;
mod parts;
mod progress;
mod race;
mod refinement;
mod run_control;
mod schedule_check;
mod search;
mod segments;
mod sensitivity;
mod settings;
mod simulate;
mod solution;
mod standstill;
mod starts;
mod strategies;

pub use disturbed::{ChangedParameter, Disturbed, Undisturbed};
pub use helpers::{Alone, Helpers, SharedWork};
pub use run_control::{NoProgress, Phase, ProgressObserver, RunControl, SolveProgress};
pub use sensitivity::{EndShift, Sensitivity};
pub use settings::{Choice, Method, Refinement, SolveInput, SolveParameters, SolverSettings};
pub use simulate::{SimulateInput, SimulateParameters, Simulation, simulate};
pub use solution::{
    DistinctOptimum, LimitUse, LowerBoundAssumption, Reason, RefinementOutcome, Replay, Report, Solution, Status,
    StopReason,
};

pub(crate) use certificate::{REPLAY_EXCESS, REPLAY_REFINEMENT};
pub(crate) use helpers::CancelOnPanic;

use candidate::Candidate;
use grid_problem::problem_on;
use nalgebra::DVector;
use settings::ROUNDING;

use crate::optimizer::Problem as _;
use crate::shooting::{ShootingProblem, decision_from_schedule, decision_len};
use crate::simulation::Simulator;
use crate::stop::{Stop, Stopped};

/// Solves a maneuver; the result, whatever it is, is a status of the answer, never an error.
///
/// The answer depends on the input alone, unless `control` stops the search.
///
/// # Errors
/// When `control` cuts off the certificate before the motion of the plan is known: there is nothing to answer.
pub fn solve(input: &SolveInput, control: &RunControl) -> Result<Solution, Stopped> {
    if let Some(reason) = impossibility::impossibility(input) {
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
    let best = result.best.take().filter(|best| best.goal_error.is_finite());
    let best = match best {
        Some(best) => best,
        None => fallback(input, &mut problem, control.cut())?.unwrap_or_else(|| standing_still(input)),
    };
    certificate::certified(input, &simulator, (&mut problem, bound), &best, (result, control.cut()))
}

/// The first start, as the answer of a solve that was stopped before its first rollout; none when its motion diverges.
fn fallback(input: &SolveInput, problem: &mut ShootingProblem, stop: Stop) -> Result<Option<Candidate>, Stopped> {
    let start = &starts::starts(input, 1)[0];
    let decision = decision_from_schedule(&start.schedule);
    let mut constraints = problem.constraints();
    problem.evaluate(&decision, &mut constraints, stop)?;
    let goal_error = problem.goal_scales().largest_goal_error(&constraints.residual);
    let candidate = Candidate::new(decision, goal_error, true, start.goal_heading);
    Ok(goal_error.is_finite().then_some(candidate))
}

/// The answer where every motion that was tried diverged: no torque, for so short a time that none does.
fn standing_still(input: &SolveInput) -> Candidate {
    let mut decision = DVector::zeros(decision_len(input.settings.control_count));
    decision[2 * input.settings.control_count] = ROUNDING;
    Candidate::new(decision, f64::INFINITY, true, None)
}
