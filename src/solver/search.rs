//! The search: starts, their local optima, and the best of them.

use super::candidate::Candidate;
use super::local_search::LocalSearch;
use super::parts::{PartOutcome, Parts, RunPart, Total};
use super::progress::BestProgress;
use super::run_control::RunControl;
use super::settings::SolveInput;
use super::solution::{DistinctOptimum, RefinementOutcome, Replay, StopReason};
use super::starts::{Strategy, starts};
use super::strategies::HopBudget;
use crate::optimizer::Interruption;
use crate::shooting::ShootingProblem;

/// Local optima whose final times differ by less than this share count as one.
const DISTINCT_FINAL_TIME: f64 = 1e-3;

/// Where fewer than half of the starts lead to a plan, more are tried: up to this multiple of the requested number.
const MORE_STARTS: usize = 2;

/// Rounds of polishing: how many distinct local optima, fastest first, and how thoroughly each.
const POLISH_ROUNDS: [(usize, HopBudget); 2] = [(8, HopBudget::SHORT), (3, HopBudget::LONG)];

/// The result of the search, and its cost.
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

impl SearchResult {
    /// Adds the search of a finer grid, where this one found no plan; the better of both misses is kept.
    pub(super) fn follow(&mut self, finer: Self, goal_tolerance: f64) {
        let has_better = match (&finer.best, &self.best) {
            (Some(new), Some(known)) => new.is_better_than(known, goal_tolerance),
            (new, known) => known.is_none() && new.is_some(),
        };
        let (iterations, rollouts) = (self.iterations + finer.iterations, self.rollouts + finer.rollouts);
        let starts_tried = self.starts_tried + finer.starts_tried;
        if has_better {
            *self = finer;
        } else {
            self.stop_reason = finer.stop_reason;
        }
        (self.iterations, self.rollouts, self.starts_tried) = (iterations, rollouts, starts_tried);
    }
}

/// Searches on a grid from every start, then polishes the best local optima; the result does not depend on the helpers.
pub(super) fn search(
    input: &SolveInput,
    problem: &ShootingProblem,
    (step_count, rollout_limit): (usize, u64),
    control: &RunControl,
) -> SearchResult {
    let (settings, starts) = (&input.settings, starts(input, MORE_STARTS * input.settings.start_count));
    let progress = BestProgress::new(control, settings.goal_tolerance);
    let parts_of = |rollout_limit: u64, count: usize, run: &RunPart| {
        Parts::new((control, &progress), settings.goal_tolerance, rollout_limit, (count, run)).total()
    };

    let mut found = Total::default();
    let mut optima: Vec<Candidate> = Vec::new();
    for block in starts.chunks(settings.start_count) {
        let tried = found.tried;
        let left = rollout_limit - found.rollouts;
        let more = parts_of(left, block.len(), &|index, control, rollout_limit| {
            let number = (tried + index + 1, tried + block.len());
            part(input, problem, (control, rollout_limit), |search| search.run_from(&block[index], number))
        });
        let locals = more.locals.iter().map(|(_, local)| local);
        optima.extend(locals.filter(|local| local.is_feasible(settings.goal_tolerance)).cloned());
        found.tried += more.tried;
        found.follow(more, settings.goal_tolerance);
        if found.interruption.is_some() || 2 * optima.len() >= found.tried {
            break;
        }
    }

    optima = fastest_first(optima);
    let is_polished = starts[..found.tried].iter().any(|start| start.strategy == Strategy::Smoothed);
    for (count, hop_budget) in POLISH_ROUNDS.into_iter().filter(|_| is_polished) {
        if found.interruption.is_some() {
            break;
        }
        let mut chosen = distinct(&optima);
        chosen.truncate(count);
        let left = rollout_limit - found.rollouts;
        let polished = parts_of(left, chosen.len(), &|index, control, rollout_limit| {
            let optimum = optima[chosen[index]].clone();
            part(input, problem, (control, rollout_limit), |search| search.polish(optimum, hop_budget))
        });
        for (index, local) in &polished.locals {
            optima[chosen[*index]] = local.clone();
        }
        found.follow(polished, settings.goal_tolerance);
        optima = fastest_first(optima);
    }
    SearchResult {
        best: found.best,
        stop_reason: found.interruption.map_or(StopReason::Finished, StopReason::from),
        step_count,
        iterations: found.iterations,
        rollouts: found.rollouts,
        starts_tried: found.tried,
        distinct_optima: grouped(optima.iter().map(Candidate::final_time).collect()),
        optima,
        refinement: RefinementOutcome::Fixed,
        replay: None,
    }
}

/// One part of the search, with a problem and a budget of its own.
fn part(
    input: &SolveInput,
    problem: &ShootingProblem,
    (control, rollout_limit): (&RunControl, u64),
    run: impl FnOnce(&mut LocalSearch) -> Result<Candidate, Interruption>,
) -> PartOutcome {
    let mut problem = problem.clone();
    let mut local_search = LocalSearch::new(&mut problem, &input.settings, control, rollout_limit);
    let local = run(&mut local_search);
    let (best, iterations, rollouts) = local_search.into_parts();
    PartOutcome { local, best, iterations, rollouts }
}

pub(super) fn fastest_first(mut optima: Vec<Candidate>) -> Vec<Candidate> {
    optima.sort_by(|a, b| a.final_time().total_cmp(&b.final_time()));
    optima
}

/// The first of each group of sorted optima whose final times are nearly equal.
fn distinct(optima: &[Candidate]) -> Vec<usize> {
    let mut firsts: Vec<usize> = Vec::new();
    for (index, optimum) in optima.iter().enumerate() {
        let follows = |first: &usize| is_distinct(optima[*first].final_time(), optimum.final_time());
        if firsts.last().is_none_or(follows) {
            firsts.push(index);
        }
    }
    firsts
}

/// Whether two final times belong to different optima.
pub(super) fn is_distinct(faster: f64, slower: f64) -> bool {
    slower - faster > DISTINCT_FINAL_TIME * faster
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
            Some(last) if !is_distinct(last.final_time, final_time) => last.count += 1,
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
