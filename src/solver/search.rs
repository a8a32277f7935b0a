//! The search: starts, their local optima, and the best of them.

use super::candidate::{Candidate, improves};
use super::certificate::Replayed;
use super::local_search::LocalSearch;
use super::parts::{PartOutcome, Parts, RunPart, Total};
use super::progress::BestProgress;
use super::run_control::RunControl;
use super::sensitivity::friction_shift;
use super::settings::{Choice, SolveInput};
use super::solution::{DistinctOptimum, RefinementOutcome, StopReason};
use super::starts::{Start, Strategy, starts};
use super::strategies::Heat;
use crate::optimizer::Interruption;
use crate::shooting::{ShootingProblem, schedule_from_decision};
use crate::stop::{Stop, Stopped};

/// Local optima whose final times differ by less than this share count as one.
const DISTINCT_FINAL_TIME: f64 = 1e-3;

/// Where too few starts lead to the best merit, more are tried: up to this multiple of the requested number.
const MORE_STARTS: usize = 3;
/// One in so many of the requested starts must lead to the best merit: what is found only once, of 24, is seldom the best there is.
const STARTS_A_FIND: usize = 12;
/// So many starts of so many, those with the better merits, go thoroughly through smoothed laws.
const THOROUGH: (usize, usize) = (2, 3);
/// One optimum for so many requested starts goes on under the exact law, and half of these are polished.
const STARTS_AN_OPTIMUM: usize = 4;
/// Fewest steps per control interval of the grid on which starts are compared.
const COARSE_STEPS: usize = 2;
/// Its longest step, as a share of the robot's natural time.
const LONGEST_STEP: f64 = 0.25;
/// A best plan that misses the goal by more than so many tolerances is not near it.
const FAR: f64 = 1e3;
/// Hops of each local optimum in the first final; each further one has half as many optima, with twice as many hops.
pub(super) const FIRST_HOPS: usize = 12;

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
    /// The best decision and the first of each other group of local optima, in the order in which they are wanted.
    pub(super) plans: Vec<Candidate>,
    pub(super) refinement: RefinementOutcome,
    /// The best decision's replay, where the refinement has made it.
    pub(super) replayed: Option<Replayed>,
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

    /// How far less friction shifts the ends of the local optima; the steadiest comes first where it is asked for.
    fn weigh(&mut self, input: &SolveInput, optima: &[Candidate], stop: Stop) -> Result<(), Stopped> {
        let shift = |candidate: &Candidate| {
            friction_shift(input, (&schedule_from_decision(&candidate.decision), self.step_count), stop)
        };
        let shifts: Vec<_> = distinct(optima, Candidate::final_time)
            .into_iter()
            .map(|first| shift(&optima[first]))
            .collect::<Result<_, _>>()?;
        if input.settings.choice == Choice::Steadiest {
            let fastest = self.plans.first().map_or(0.0, Candidate::final_time);
            let latest = (1.0 + input.settings.choose_within) * fastest;
            let mut ranked = Vec::with_capacity(self.plans.len());
            for plan in &self.plans {
                let shift = if plan.final_time() <= latest { shift(plan)? } else { None };
                ranked.push((shift.map_or(f64::INFINITY, |shift| shift.relative(&input.settings)), plan));
            }
            // Those that are too slow, or leave the model, stay sorted by their final times.
            ranked.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            let plans: Vec<Candidate> = ranked.into_iter().map(|(_, plan)| plan.clone()).collect();
            self.best = plans.first().cloned().or(self.best.take());
            self.plans = plans;
        }
        for (optimum, shift) in self.distinct_optima.iter_mut().zip(shifts) {
            optimum.friction_shift = shift;
        }
        Ok(())
    }
}

/// Searches on a grid from every start, then polishes the best local optima; the result does not depend on the helpers.
pub(super) fn search(
    input: &SolveInput,
    problem: &ShootingProblem<'_>,
    (step_count, rollout_limit): (usize, u64),
    control: &RunControl,
) -> SearchResult {
    let (settings, starts) = (&input.settings, starts(input, MORE_STARTS * input.settings.start_count));
    let progress = BestProgress::new(control, settings.goal_tolerance);
    let mut race = Race::new(input, problem, rollout_limit, (control, &progress));
    let mut optima = Vec::new();
    race.starts(&starts, &mut optima);
    let is_smoothed = starts[..race.found.tried].iter().any(|start| start.strategy == Strategy::Smoothed);
    if is_smoothed && !race.is_too_coarse() {
        race.finals(&mut optima);
    }
    race.release_torques(&mut optima);
    let found = race.found;
    let optima = feasible(optima, settings.goal_tolerance);
    let mut result = SearchResult {
        plans: plans(found.best.iter().chain(&optima), settings.goal_tolerance),
        best: found.best,
        stop_reason: found.interruption.map_or(StopReason::Finished, StopReason::from),
        step_count,
        iterations: found.iterations,
        rollouts: found.rollouts,
        starts_tried: found.tried,
        distinct_optima: grouped(&optima),
        refinement: RefinementOutcome::Fixed,
        replayed: None,
    };
    if result.stop_reason != StopReason::Stopped && result.weigh(input, &optima, control.stop()).is_err() {
        result.stop_reason = StopReason::Stopped;
    }
    result
}

/// The feasible ones of sorted candidates, one of each group whose final times are nearly equal.
fn plans<'a>(candidates: impl Iterator<Item = &'a Candidate>, tolerance: f64) -> Vec<Candidate> {
    let mut plans: Vec<Candidate> = Vec::new();
    for candidate in candidates {
        let is_new = plans.last().is_none_or(|last| is_distinct(last.final_time(), candidate.final_time()));
        if candidate.is_feasible(tolerance) && is_new {
            plans.push(candidate.clone());
        }
    }
    plans
}

/// Local optima of as many further starts, fastest first.
pub(super) fn further_optima(
    input: &SolveInput,
    problem: &ShootingProblem,
    result: &mut SearchResult,
    control: &RunControl,
) -> Vec<Candidate> {
    let settings = &input.settings;
    let starts = starts(input, result.starts_tried + settings.start_count);
    let progress = BestProgress::new(control, settings.goal_tolerance);
    let mut race = Race::new(input, problem, settings.rollout_limit - result.rollouts, (control, &progress));
    race.found.tried = result.starts_tried;
    let (mut smoothed, mut optima) = (Vec::new(), Vec::new());
    // Searches of several grids count their starts each time, and some maneuvers have few.
    race.heats(starts.get(result.starts_tried..).unwrap_or_default(), &mut smoothed, &mut optima);
    race.descend(&mut smoothed, &mut optima);
    result.iterations += race.found.iterations;
    result.rollouts += race.found.rollouts;
    if let Some(interruption) = race.found.interruption {
        result.stop_reason = interruption.into();
    }
    feasible(optima, settings.goal_tolerance)
}

/// A search in rounds, each of which is over before the next one begins: so the answer does not depend on who runs which part.
struct Race<'a> {
    input: &'a SolveInput,
    problem: ShootingProblem<'a>,
    coarse_step_count: usize,
    rollout_limit: u64,
    control: &'a RunControl<'a>,
    progress: &'a BestProgress<'a>,
    found: Total,
}

impl<'a> Race<'a> {
    fn new(
        input: &'a SolveInput,
        problem: &ShootingProblem<'a>,
        rollout_limit: u64,
        (control, progress): (&'a RunControl<'a>, &'a BestProgress<'a>),
    ) -> Self {
        let coarse_step_count = coarse_step_count(input, problem.time_unit());
        let problem = problem.clone();
        Self { input, problem, coarse_step_count, rollout_limit, control, progress, found: Total::default() }
    }

    /// From starts to local optima, in blocks of the requested number, until the best one has been found more than by chance, and
    /// one is a plan, or until a finer grid should come first.
    fn starts(&mut self, starts: &[Start], optima: &mut Vec<Candidate>) {
        let settings = &self.input.settings;
        let mut smoothed = Vec::new();
        for block in starts.chunks(settings.start_count) {
            self.heats(block, &mut smoothed, optima);
            self.descend(&mut smoothed, optima);
            let is_found_again = smoothed.is_empty() || times_found(&smoothed) * STARTS_A_FIND >= settings.start_count;
            let has_plan = optima.iter().any(|optimum| optimum.is_feasible(settings.goal_tolerance));
            if is_found_again && has_plan || self.is_too_coarse() || self.found.interruption.is_some() {
                return;
            }
        }
    }

    /// Whether finer grids may follow, and no start came near the goal: on a long maneuver the steps are then too long for the robot
    /// to keep its course.
    fn is_too_coarse(&self) -> bool {
        let settings = &self.input.settings;
        let misses = |best: &Candidate| best.goal_error > FAR * settings.goal_tolerance;
        self.problem.step_count() < settings.finest_step_count() && self.found.best.as_ref().is_none_or(misses)
    }

    /// From starts to what they lead to, thoroughly for those with the better merits after a first look. Smoothed ones join the
    /// others, best first.
    fn heats(&mut self, starts: &[Start], smoothed: &mut Vec<Smoothed>, optima: &mut Vec<Candidate>) {
        let first = self.found.tried;
        let number = |index: usize| (first + index + 1, first + starts.len());
        let locals = self.round(starts.len(), &|index, search| search.run_from(&starts[index], number(index)));
        self.found.tried = first + locals.len();
        let (mut rough, exact): (Vec<_>, Vec<_>) =
            locals.into_iter().partition(|(index, _)| starts[*index].strategy == Strategy::Smoothed);
        optima.extend(exact.into_iter().map(|(_, local)| local));
        if self.found.interruption.is_some() {
            return;
        }
        best_first(&mut rough, |(_, local)| local);
        rough.truncate((THOROUGH.0 * starts.len()).div_ceil(THOROUGH.1));
        let locals = self.round(rough.len(), &|index, search| {
            let (start, local) = &rough[index];
            search.go_on(local, Heat::Smooth, number(*start))
        });
        let is_first = smoothed.is_empty();
        let arrived =
            |(index, local): (usize, Candidate)| Smoothed { number: number(rough[index].0), local, has_gone_on: false };
        smoothed.extend(locals.into_iter().map(arrived));
        best_first(smoothed, |smoothed| &smoothed.local);
        if let Some(best) = smoothed.first().filter(|_| is_first) {
            // The first guess of a small maneuver may be twenty times as slow: laws and tolerances would be too fine.
            self.problem.set_time_unit(best.local.merit.min(self.problem.time_unit()));
        }
    }

    /// The best distinct optima of smoothed laws under the exact law, where they join the others. After each block of starts, so that
    /// a search which is stopped has a plan.
    fn descend(&mut self, smoothed: &mut [Smoothed], optima: &mut Vec<Candidate>) {
        if self.found.interruption.is_some() {
            return;
        }
        let mut chosen = distinct(smoothed, |smoothed| smoothed.local.merit);
        chosen.truncate(self.input.settings.start_count.div_ceil(STARTS_AN_OPTIMUM));
        chosen.retain(|index| !std::mem::replace(&mut smoothed[*index].has_gone_on, true));
        let smoothed = &*smoothed;
        let locals = self.round(chosen.len(), &|index, search| {
            let Smoothed { number, local, .. } = &smoothed[chosen[index]];
            search.go_on(local, Heat::Descend, *number)
        });
        optima.extend(locals.into_iter().map(|(_, local)| local));
    }

    /// Improves the fastest distinct optima, ever fewer of them and ever more thoroughly (successive halving: Jamieson &
    /// Talwalkar 2016).
    fn finals(&mut self, optima: &mut [Candidate]) {
        let (mut count, mut hops) = (self.input.settings.start_count.div_ceil(2 * STARTS_AN_OPTIMUM), FIRST_HOPS);
        for stream in 0.. {
            self.polish(optima, count, (hops, stream));
            if count == 1 || self.found.interruption.is_some() {
                break;
            }
            (count, hops) = (count.div_ceil(2), 2 * hops);
        }
    }

    /// The best plan with all torques, where those near the grip are not all.
    fn release_torques(&mut self, optima: &mut Vec<Candidate>) {
        let Some(best) = self.found.best.clone() else { return };
        if self.problem.has_torque_beyond_grip() && self.found.interruption.is_none() {
            self.problem.release_torques();
            let locals = self.round(1, &|_, search| search.polish(best.clone(), 0, 0));
            optima.extend(locals.into_iter().map(|(_, local)| local));
        }
    }

    /// Polishes the fastest distinct optima, so many of them.
    fn polish(&mut self, optima: &mut [Candidate], count: usize, (hops, stream): (usize, u64)) {
        if self.found.interruption.is_some() {
            return;
        }
        best_first(optima, |optimum| optimum);
        let mut chosen = distinct(optima, |optimum| optimum.merit);
        chosen.truncate(count);
        let locals =
            self.round(chosen.len(), &|index, search| search.polish(optima[chosen[index]].clone(), hops, stream));
        for (index, local) in locals {
            optima[chosen[index]] = local;
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
            local_search.coarse_step_count = self.coarse_step_count;
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

/// Steps of the grid on which starts are compared: under smoothed laws these do.
fn coarse_step_count(input: &SolveInput, final_time: f64) -> usize {
    let control_count = input.settings.control_count;
    let interval = final_time / control_count as f64;
    let needed = (interval / (LONGEST_STEP * input.robot.parameters().natural_time())).ceil();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive and whole")]
    let needed = needed as usize;
    needed.max(COARSE_STEPS).saturating_mul(control_count)
}

type RoundResult = Result<Candidate, Interruption>;

/// Where a start led under smoothed laws.
struct Smoothed {
    /// The start's, and how many there are.
    number: (usize, usize),
    local: Candidate,
    /// Under the exact law.
    has_gone_on: bool,
}

/// How many of sorted optima are the best one.
fn times_found(smoothed: &[Smoothed]) -> usize {
    let Some(best) = smoothed.first() else { return 0 };
    smoothed.iter().take_while(|other| !is_distinct(best.local.merit, other.local.merit)).count()
}

/// Sorts by merits: a plan that misses its goal by little may become the best one.
fn best_first<T>(optima: &mut [T], of: impl Fn(&T) -> &Candidate) {
    optima.sort_by(|a, b| of(a).merit.total_cmp(&of(b).merit));
}

/// Those that meet the goal, fastest first.
fn feasible(mut optima: Vec<Candidate>, goal_tolerance: f64) -> Vec<Candidate> {
    optima.retain(|optimum| optimum.is_feasible(goal_tolerance));
    optima.sort_by(|a, b| a.final_time().total_cmp(&b.final_time()));
    optima
}

/// The first of each group of sorted optima whose times are nearly equal.
fn distinct<T>(optima: &[T], time: impl Fn(&T) -> f64) -> Vec<usize> {
    let mut firsts: Vec<usize> = Vec::new();
    for (index, optimum) in optima.iter().enumerate() {
        if firsts.last().is_none_or(|first| is_distinct(time(&optima[*first]), time(optimum))) {
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

/// The groups of sorted optima.
fn grouped(optima: &[Candidate]) -> Vec<DistinctOptimum> {
    let firsts = distinct(optima, Candidate::final_time);
    let ends = firsts.iter().skip(1).copied().chain([optima.len()]);
    let of = |(&first, end): (&usize, usize)| DistinctOptimum {
        final_time: optima[first].final_time(),
        count: end - first,
        friction_shift: None,
    };
    firsts.iter().zip(ends).map(of).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::simulation::Simulator;
    use crate::solver::grid_problem::problem_on;
    use crate::solver::settings::{Method, SolveParameters, SolverSettings};

    #[test]
    fn without_further_starts_there_are_no_further_optima() {
        let parameters = SolveParameters {
            settings: SolverSettings { method: Method::NelderMead, rollout_limit: 10, ..SolverSettings::default() },
            ..SolveParameters::default()
        };
        let input = SolveInput::new(parameters).unwrap();
        let (simulator, control) = (Simulator::new(&input.robot), RunControl::unattended());
        let (problem, _) = problem_on(&input, &simulator, input.settings.step_count);
        let mut result = search(&input, &problem, (input.settings.step_count, 10), &control);
        // As after the searches of several grids; the method has one start.
        result.starts_tried = 3;
        assert!(further_optima(&input, &problem, &mut result, &control).is_empty());
    }

    #[test]
    fn near_final_times_count_as_one_optimum() {
        let optimum = |final_time: f64| Candidate::new(DVector::from_element(1, final_time), 0.0, false, None);
        let optima = grouped(&feasible([2.931, 2.836, 2.930].map(optimum).to_vec(), 0.0));
        let groups: Vec<_> = optima.iter().map(|group| (group.final_time, group.count)).collect();
        assert_eq!(groups, [(2.836, 1), (2.930, 2)]);
    }

    #[test]
    fn an_optimum_is_found_again_by_its_merit() {
        let smoothed = |merit: f64| {
            let local = Candidate { merit, ..Candidate::new(DVector::from_element(1, 1.0), 0.0, true, None) };
            Smoothed { number: (1, 1), local, has_gone_on: false }
        };
        assert_eq!(times_found(&[]), 0);
        assert_eq!(times_found(&[2.000, 2.001, 2.01].map(smoothed)), 2);
    }
}
