//! The search: starts, their local optima, and the best of them.

use nalgebra::DVector;

use super::initial_guess::{resampled, straight_bang_bang};
use super::local_search::{Candidate, LocalSearch};
use super::run_control::RunControl;
use super::settings::SolveInput;
use super::solution::{DistinctOptimum, StopReason};
use crate::optimizer::Interruption;
use crate::shooting::{ShootingProblem, decision_from_schedule};

/// Local optima whose final times differ by less than this share count as one.
const DISTINCT_FINAL_TIME: f64 = 1e-3;

/// What the search found, and what it spent.
#[derive(Debug)]
pub(super) struct SearchResult {
    /// The best decision; none when the search was stopped before its first rollout.
    pub(super) best: Option<Candidate>,
    pub(super) stop_reason: StopReason,
    pub(super) iterations: u64,
    pub(super) rollouts: u64,
    pub(super) starts_tried: usize,
    /// Local optima that meet the goal, fastest first.
    pub(super) distinct_optima: Vec<DistinctOptimum>,
}

/// Searches from the caller's guess (if any) and the straight bang-bang.
pub(super) fn search(input: &SolveInput, problem: &mut ShootingProblem, control: &RunControl) -> SearchResult {
    let starts = starts(input);
    let mut local_search = LocalSearch::new(problem, &input.settings, control);
    let mut final_times = Vec::new();
    let mut starts_tried = 0;
    let mut stop_reason = StopReason::Finished;
    for start in &starts {
        starts_tried += 1;
        match local_search.run_from(start, (starts_tried, starts.len())) {
            Ok(local) if local.goal_error <= input.settings.goal_tolerance => final_times.push(local.final_time()),
            Ok(_) => {}
            Err(interruption) => {
                stop_reason = interruption.into();
                break;
            }
        }
    }
    let (best, iterations, rollouts) = local_search.into_parts();
    SearchResult { best, stop_reason, iterations, rollouts, starts_tried, distinct_optima: grouped(final_times) }
}

impl From<Interruption> for StopReason {
    fn from(interruption: Interruption) -> Self {
        match interruption {
            Interruption::Stopped => Self::Stopped,
            Interruption::RolloutLimit => Self::RolloutLimit,
        }
    }
}

/// The caller's guess first; it counts as one of the starts asked for.
fn starts(input: &SolveInput) -> Vec<DVector<f64>> {
    let control_count = input.settings.control_count;
    let guess = input.initial_guess.as_ref().map(|guess| resampled(guess, control_count));
    let straight = straight_bang_bang(&input.maneuver, input.robot.parameters(), control_count);
    let starts = guess.into_iter().chain([straight]).take(input.settings.start_count);
    starts.map(|schedule| decision_from_schedule(&schedule)).collect()
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
