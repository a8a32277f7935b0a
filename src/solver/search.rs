//! The search: starts, their local optima, and the best of them.

use super::candidate::{Candidate, improves};
use super::local_search::LocalSearch;
use super::parts::{PartOutcome, Parts, RunPart, Total};
use super::progress::BestProgress;
use super::run_control::RunControl;
use super::settings::SolveInput;
use super::solution::{DistinctOptimum, RefinementOutcome, Replay, StopReason};
use super::starts::{Start, Strategy, starts};
use super::strategies::{Heat, SMOOTHING};
use crate::optimizer::Interruption;
use crate::shooting::ShootingProblem;

/// Local optima whose final times differ by less than this share count as one.
const DISTINCT_FINAL_TIME: f64 = 1e-3;

/// Where fewer than half of the starts lead to a plan, more are tried: up to this multiple of the requested number.
const MORE_STARTS: usize = 2;

/// A start whose smoothed merit is this multiple of the best one has lost its goal: its penalty exceeds its final time.
const LOST_MERIT: f64 = 2.0;

/// The race: in each round the fastest of the last one go on, this share of the starts. The merits under smoothing tell early
/// which starts lead to the fastest plans: in all of 15 searches the best one was among the better half before the exact law.
const HEATS: [Round<Heat>; 3] = [
    Round { divisor: 1, effort: Heat::Smooth(&[SMOOTHING[0], SMOOTHING[1]]) },
    Round { divisor: 1, effort: Heat::Smooth(&[SMOOTHING[2]]) },
    Round { divisor: 2, effort: Heat::Descend },
];
/// The rounds between local optima, with the most hops of each: half as many, twice as thoroughly.
const FINALS: [Round<usize>; 4] = [
    Round { divisor: 3, effort: 0 },
    Round { divisor: 6, effort: 24 },
    Round { divisor: 12, effort: 48 },
    Round { divisor: 24, effort: 96 },
];

/// One round of the race.
#[derive(Debug, Clone, Copy)]
struct Round<E> {
    /// The starts over this number is how many take part.
    divisor: usize,
    effort: E,
}

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
        let has_better = finer.best.as_ref().is_some_and(|next| improves(self.best.as_ref(), next, goal_tolerance));
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
    let mut race = Race { input, problem, rollout_limit, control, progress: &progress, found: Total::default() };
    let mut optima: Vec<Candidate> = Vec::new();
    for block in starts.chunks(settings.start_count) {
        let arrived = race.heats(block, &mut optima);
        if race.found.interruption.is_some() || 2 * arrived >= block.len() && !optima.is_empty() {
            break;
        }
    }
    if starts[..race.found.tried].iter().any(|start| start.strategy == Strategy::Smoothed) {
        race.finals(&mut optima);
    }
    let found = race.found;
    let optima = fastest_first(optima);
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

/// A search in rounds, each of which is over before the next one begins: so the answer does not depend on who runs which part.
struct Race<'a> {
    input: &'a SolveInput,
    problem: &'a ShootingProblem<'a>,
    rollout_limit: u64,
    control: &'a RunControl<'a>,
    progress: &'a BestProgress<'a>,
    found: Total,
}

impl Race<'_> {
    /// From starts to local optima, which join the others; returns how many starts seem to lead to a plan.
    fn heats(&mut self, starts: &[Start], optima: &mut Vec<Candidate>) -> usize {
        let first = self.found.tried;
        let number = |index: usize| (first + index + 1, first + starts.len());
        let (mut arrived, mut smooth) = (0, Vec::new());
        let locals = self.round(starts.len(), &|index, search| match starts[index].strategy {
            Strategy::Smoothed => search.begin(&starts[index], HEATS[0].effort, number(index)),
            Strategy::Warm | Strategy::Direct => search.run_from(&starts[index], number(index)),
        });
        self.found.tried = first + locals.len();
        for (index, local) in locals {
            if local.smoothed_merit.is_some() {
                smooth.push((index, local));
            } else {
                let plan = Some(local).filter(|local| local.is_feasible(self.input.settings.goal_tolerance));
                arrived += usize::from(plan.is_some());
                optima.extend(plan);
            }
        }
        for round in &HEATS[1..] {
            if self.found.interruption.is_some() {
                return arrived;
            }
            smooth.sort_by(|(_, a), (_, b)| merit(a).total_cmp(&merit(b)));
            if let (Heat::Descend, Some((_, best))) = (round.effort, smooth.first()) {
                let lost = LOST_MERIT * merit(best);
                arrived += smooth.iter().filter(|(_, local)| merit(local) < lost).count();
            }
            smooth.truncate(starts.len().div_ceil(round.divisor));
            let locals = self.round(smooth.len(), &|index, search| {
                let (start, local) = &smooth[index];
                search.go_on(&starts[*start], local, round.effort, number(*start))
            });
            smooth = locals.into_iter().map(|(index, local)| (smooth[index].0, local)).collect();
        }
        let feasible = |local: &Candidate| local.is_feasible(self.input.settings.goal_tolerance);
        optima.extend(smooth.into_iter().map(|(_, local)| local).filter(feasible));
        arrived
    }

    /// Improves the fastest distinct optima, ever fewer of them.
    fn finals(&mut self, optima: &mut Vec<Candidate>) {
        for (number, round) in (0..).zip(FINALS) {
            if self.found.interruption.is_some() {
                return;
            }
            *optima = fastest_first(std::mem::take(optima));
            let mut chosen = distinct(optima);
            chosen.truncate(self.input.settings.start_count.div_ceil(round.divisor));
            let locals = self.round(chosen.len(), &|index, search| {
                search.polish(optima[chosen[index]].clone(), round.effort, number)
            });
            for (index, local) in locals {
                optima[chosen[index]] = local;
            }
        }
    }

    /// Runs the parts of one round; the local optima with the numbers of their parts.
    fn round(
        &mut self,
        count: usize,
        run: &(dyn Fn(usize, &mut LocalSearch) -> RoundResult + Sync),
    ) -> Vec<(usize, Candidate)> {
        let run_part: &RunPart = &|index, control, rollout_limit| {
            let mut problem = self.problem.clone();
            let mut local_search = LocalSearch::new(&mut problem, &self.input.settings, control, rollout_limit);
            let local = run(index, &mut local_search);
            let (best, iterations, rollouts) = local_search.into_parts();
            PartOutcome { local, best, iterations, rollouts }
        };
        let tolerance = self.input.settings.goal_tolerance;
        let left = self.rollout_limit - self.found.rollouts;
        let mut total = Parts::new((self.control, self.progress), tolerance, left, (count, run_part)).total();
        let locals = std::mem::take(&mut total.locals);
        self.found.follow(total, tolerance);
        locals
    }
}

type RoundResult = Result<Candidate, Interruption>;

/// The merit under a smoothed law.
fn merit(candidate: &Candidate) -> f64 {
    candidate.smoothed_merit.unwrap_or(f64::INFINITY)
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
