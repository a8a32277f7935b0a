//! The search: starts, their local optima, and the best of them.

use super::local_search::{Candidate, LocalSearch};
use super::run_control::RunControl;
use super::settings::SolveInput;
use super::solution::{DistinctOptimum, RefinementOutcome, Replay, StopReason};
use super::starts::{Start, Way, starts};
use crate::optimizer::Interruption;
use crate::shooting::ShootingProblem;

/// Local optima whose final times differ by less than this share count as one.
const DISTINCT_FINAL_TIME: f64 = 1e-3;

/// Local optima that are polished, fastest first.
const POLISHED_OPTIMA: usize = 2;

/// What the search found, and what it spent.
#[derive(Debug)]
pub(super) struct SearchResult {
    /// The best decision; none when the search was stopped before its first rollout.
    pub(super) best: Option<Candidate>,
    pub(super) stop_reason: StopReason,
    /// Steps of the grid that the best decision was made for.
    pub(super) step_count: usize,
    pub(super) iterations: u64,
    pub(super) rollouts: u64,
    pub(super) starts_tried: usize,
    /// Local optima that meet the goal, fastest first.
    pub(super) distinct_optima: Vec<DistinctOptimum>,
    /// The local optima themselves, fastest first.
    pub(super) optima: Vec<Candidate>,
    pub(super) refinement: RefinementOutcome,
    /// The best decision's replay, where the refinement has made it.
    pub(super) replay: Option<Replay>,
}

/// Searches from every start, then polishes the best local optima.
pub(super) fn search(input: &SolveInput, problem: &mut ShootingProblem, control: &RunControl) -> SearchResult {
    let starts = starts(input);
    let mut local_search = LocalSearch::new(problem, &input.settings, control, input.settings.rollout_limit);
    let mut outcome = Outcome::default();
    let stop_reason = match explore(input, &starts, &mut local_search, &mut outcome) {
        Ok(()) => StopReason::Finished,
        Err(interruption) => interruption.into(),
    };
    let (best, iterations, rollouts) = local_search.into_parts();
    SearchResult {
        best,
        stop_reason,
        step_count: input.settings.step_count,
        iterations,
        rollouts,
        starts_tried: outcome.starts_tried,
        distinct_optima: grouped(outcome.optima.iter().map(Candidate::final_time).collect()),
        optima: outcome.fastest_first(),
        refinement: RefinementOutcome::Fixed,
        replay: None,
    }
}

/// What the starts led to so far.
#[derive(Default)]
struct Outcome {
    starts_tried: usize,
    /// Local optima that meet the goal.
    optima: Vec<Candidate>,
}

impl Outcome {
    fn fastest_first(mut self) -> Vec<Candidate> {
        self.optima.sort_by(|a, b| a.final_time().total_cmp(&b.final_time()));
        self.optima
    }
}

fn explore(
    input: &SolveInput,
    starts: &[Start],
    local_search: &mut LocalSearch,
    outcome: &mut Outcome,
) -> Result<(), Interruption> {
    let tolerance = input.settings.goal_tolerance;
    for start in starts {
        outcome.starts_tried += 1;
        let local = local_search.run_from(start, (outcome.starts_tried, starts.len()))?;
        if local.is_feasible(tolerance) {
            outcome.optima.push(local);
        }
    }
    if starts.iter().all(|start| start.way != Way::Smoothed) {
        return Ok(());
    }
    outcome.optima.sort_by(|a, b| a.final_time().total_cmp(&b.final_time()));
    for local in outcome.optima.iter_mut().take(POLISHED_OPTIMA) {
        *local = local_search.polish(local.clone())?;
    }
    Ok(())
}

impl From<Interruption> for StopReason {
    fn from(interruption: Interruption) -> Self {
        match interruption {
            Interruption::Stopped => Self::Stopped,
            Interruption::RolloutLimit => Self::RolloutLimit,
        }
    }
}

fn grouped(mut final_times: Vec<f64>) -> Vec<DistinctOptimum> {
    final_times.sort_by(f64::total_cmp);
    let mut optima: Vec<DistinctOptimum> = Vec::new();
    for final_time in final_times {
        match optima.last_mut() {
            Some(last) if final_time - last.final_time <= DISTINCT_FINAL_TIME * last.final_time => last.count += 1,
            _ => optima.push(DistinctOptimum { final_time, count: 1 }),
        }
    }
    optima
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_final_times_count_as_one_optimum() {
        let optima = grouped(vec![2.931, 2.836, 2.930]);
        assert_eq!(
            optima,
            [DistinctOptimum { final_time: 2.836, count: 1 }, DistinctOptimum { final_time: 2.930, count: 2 }]
        );
    }
}
