//! The race of a search: from starts through ever fewer and ever more thorough heats to the best local optimum.

use std::ops::Range;

use super::candidate::{CRITICALITY_TOLERANCE, Candidate, LARGEST_LAG, distinct, is_distinct};
use super::hops::PATIENCE;
use super::local_search::LocalSearch;
use super::parts::{PartOutcome, RunPart};
use super::progress::BestProgress;
use super::run_control::RunControl;
use super::search::SearchResult;
use super::settings::{Method, SolveInput};
use super::starts::{ONE_IN, Start, Strategy, spun, starts};
use super::strategies::laws_of;
use crate::optimizer::{FIRST_RADIUS, Interruption};
use crate::shooting::{ShootingProblem, schedule_from_decision};

/// Rounds of spins end as soon as so many of them in a row lead to no better plan.
const MOST_IN_VAIN: usize = 8;
/// Or one, where one start or spin for so many of the requested starts led to the best merit: what is found less often may not be the best
/// there is.
const STARTS_A_FIND: usize = 8;
/// Spins that the first law leaves behind the best merit of earlier heats by more than this share go no further. They are a third of
/// all, and one in 2,000 of them would become the best.
const LARGEST_SPIN_LAG: f64 = 0.3;
/// Longest step of the grid on which starts are compared, as a share of the robot's natural time.
const LONGEST_STEP: f64 = 0.25;

/// A search in rounds, each of which is over before the next one begins: so the answer does not depend on who runs which part.
pub(super) struct Race<'a> {
    input: &'a SolveInput,
    problem: ShootingProblem<'a>,
    coarse_step_count: usize,
    /// Most rollouts of all that is found, those before this race included.
    rollout_limit: u64,
    progress: BestProgress<'a>,
    /// What is known so far, and what it took.
    pub(super) found: SearchResult,
    /// Where starts and spins led under smoothed laws, best first.
    smoothed: Vec<Smoothed>,
    /// Local optima under the exact law.
    pub(super) optima: Vec<Candidate>,
}

impl<'a> Race<'a> {
    pub(super) fn new(
        input: &'a SolveInput,
        problem: &ShootingProblem<'a>,
        (found, rollout_limit): (SearchResult, u64),
        control: &'a RunControl<'a>,
    ) -> Self {
        let coarse_step_count = coarse_step_count(input, problem.time_unit());
        let progress = BestProgress::new(control, input.settings.goal_tolerance);
        let (problem, smoothed, optima) = (problem.clone(), Vec::new(), Vec::new());
        Self { input, problem, coarse_step_count, rollout_limit, progress, found, smoothed, optima }
    }

    /// From starts to local optima, from as many more where none is a plan, and from spins of the best. Where any start goes through
    /// smoothed laws the optima are polished; at the end the best plan is, where it has not settled.
    pub(super) fn run(&mut self) {
        self.block();
        let has_plan = self.optima.iter().any(Candidate::is_feasible);
        if !has_plan && !self.found.is_interrupted() {
            self.block();
        }
        self.spins();
        self.descend();
        if !self.smoothed.is_empty() {
            self.finals();
        }
        self.settle_best();
    }

    /// From so many starts as are requested to local optima. Some maneuvers have fewer.
    pub(super) fn block(&mut self) {
        let tried = self.found.starts_tried;
        let starts = starts(self.input, tried + self.input.settings.start_count);
        let count = starts.len();
        let numbered = (1..).zip(starts).skip(tried).map(|(number, start)| (start, (number, count)));
        self.found.starts_tried += self.heats(&numbered.collect::<Vec<_>>(), f64::INFINITY);
        self.descend();
    }

    /// From spins of the best smoothed plan so far to what they lead to, in rounds, until one leads to no better plan and the best has been
    /// found more than by chance, or until several in a row lead to no better one.
    fn spins(&mut self) {
        let start_count = self.input.settings.start_count;
        let count = start_count / ONE_IN;
        let (mut stream, mut in_vain) = (self.found.starts_tried, 0);
        while count > 0 && in_vain < MOST_IN_VAIN {
            let (false, Some(best)) = (self.found.is_interrupted(), self.smoothed.first()) else { return };
            let schedule = schedule_from_decision(&best.local.decision);
            let plan = Start { schedule, goal_heading: best.local.goal_heading, strategy: Strategy::Smoothed };
            let (merit, number) = (best.local.merit, best.number);
            let spins = spun(self.input, &plan, (count, stream as u64)).into_iter().map(|spin| (spin, number));
            stream += count;
            self.heats(&spins.collect::<Vec<_>>(), (1.0 + LARGEST_SPIN_LAG) * merit);
            in_vain = if is_distinct(self.smoothed[0].local.merit, merit) { 0 } else { in_vain + 1 };
            if in_vain > 0 && times_found(&self.smoothed) * STARTS_A_FIND >= start_count {
                return;
            }
        }
    }

    /// From starts to what they lead to, ever fewer of them and ever more thoroughly, through other laws than the first where their merit
    /// is at most the slowest. Returns how many starts were tried.
    fn heats(&mut self, starts: &[(Start, StartNumber)], slowest: f64) -> usize {
        let locals = self.round(starts, |(start, number), search| search.run_from(start, *number));
        let tried = locals.len();
        // Merits under different laws do not compare closely.
        let (mut rough, mut sharper) = (Vec::new(), Vec::new());
        for ((Start { strategy, .. }, number), local) in locals {
            match strategy {
                Strategy::Warm | Strategy::Direct => self.optima.push(local),
                Strategy::Smoothed => rough.push(Smoothed::new(*number, *strategy, local)),
                Strategy::Sharper => sharper.push(Smoothed::new(*number, *strategy, local)),
            }
        }
        let mut arrived: Vec<_> = [rough, sharper].into_iter().flat_map(|rough| self.first_law(rough)).collect();
        arrived.retain(|arrived| arrived.local.merit <= slowest);
        let is_first = self.smoothed.is_empty();
        // A smooth motion has one law.
        if !self.problem.is_smooth() {
            arrived = self.heat(&arrived, |search, from, laws| search.through(from, &laws[1..]));
        }
        self.smoothed.extend(arrived);
        best_first(&mut self.smoothed, |smoothed| &smoothed.local);
        if let Some(best) = self.smoothed.first().filter(|_| is_first) {
            // The first guess of a small maneuver may be twenty times as slow: laws and tolerances would be too fine.
            self.problem.set_time_unit(best.local.merit.min(self.problem.time_unit()));
        }
        tried
    }

    /// Where the first law of their strategy leads the better ones, each optimum once.
    fn first_law(&mut self, mut rough: Vec<Smoothed>) -> Vec<Smoothed> {
        best_first(&mut rough, |rough| &rough.local);
        rough.truncate(rough.len() - rough.len() / ONE_IN);
        let mut arrived = self.heat(&rough, |search, from, laws| search.through(from, &laws[..1]));
        arrived.dedup_by(|next, kept| kept.takes_in(next));
        arrived
    }

    /// Where a further heat leads these, from where the last one led, by the smoothed laws of their starts; best first, and none of them
    /// once the search is interrupted.
    fn heat(
        &mut self,
        entrants: &[Smoothed],
        go_on: impl Fn(&mut LocalSearch, &Candidate, &[f64]) -> Result<Candidate, Interruption> + Sync,
    ) -> Vec<Smoothed> {
        if self.found.is_interrupted() {
            return Vec::new();
        }
        let locals = self.round(entrants, |Smoothed { number, strategy, local, .. }, search| {
            let _phase = search.begin(*number, local.goal_heading);
            Ok(Candidate { times_found: local.times_found, ..go_on(search, local, laws_of(*strategy))? })
        });
        let mut arrived: Vec<_> = locals.into_iter().map(|(from, local)| Smoothed { local, ..from.clone() }).collect();
        best_first(&mut arrived, |arrived| &arrived.local);
        arrived
    }

    /// The best distinct optima of smoothed laws under the exact law, where they join the others. After each block of starts, so that
    /// a search which is stopped has a plan.
    fn descend(&mut self) {
        let mut groups = distinct(&self.smoothed, |smoothed| smoothed.local.merit);
        groups.truncate(self.input.settings.start_count.div_ceil(ONE_IN));
        groups.retain(|group| !std::mem::replace(&mut self.smoothed[group.start].has_gone_on, true));
        let chosen: Vec<_> = groups.into_iter().map(|group| representative(&mut self.smoothed[group])).collect();
        let arrived = self.heat(&chosen, |search, from, _| search.descend(&from.decision, FIRST_RADIUS));
        self.optima.extend(arrived.into_iter().map(|arrived| arrived.local));
        self.secure_best();
    }

    /// Moves the fastest plan to where it is certain to keep all limits of the maneuver, so that a search which is stopped has one.
    fn secure_best(&mut self) {
        let plans = self.optima.iter().filter(|optimum| optimum.is_feasible());
        let fastest = plans.min_by(|a, b| a.final_time().total_cmp(&b.final_time()));
        if let Some(fastest) = fastest.filter(|_| self.problem.is_stand_in() && !self.found.is_interrupted()).cloned() {
            self.round(&[fastest], |fastest, search| search.secure(fastest));
        }
    }

    /// Improves the fastest distinct optima that come near the best, ever fewer of them and ever more thoroughly (successive halving:
    /// Jamieson & Talwalkar 2016). Patience begins with a half of what one without rivals has.
    fn finals(&mut self) {
        let (mut count, mut patience) = (self.input.settings.start_count.div_ceil(ONE_IN), PATIENCE / 2);
        for round in 0.. {
            if self.found.is_interrupted() {
                return;
            }
            let (groups, slowest) = self.rank_optima();
            let places = groups.into_iter().map(|group| group.start);
            let may_win = places.filter(|place| self.optima[*place].merit <= slowest).take(count);
            let chosen: Vec<_> = may_win.map(|place| (place, self.optima[place].clone())).collect();
            for ((place, _), local) in self.round(&chosen, |(_, plan), search| search.polish(plan, patience, round)) {
                self.optima[*place] = local;
            }
            // None where no merit is a number.
            if chosen.len() <= 1 && patience >= PATIENCE {
                return;
            }
            (count, patience) = (count.div_ceil(2), 2 * patience);
        }
    }

    /// Polishes the best plan where it is not shown to be a local optimum: a descent only passed it, or torques near the grip are not
    /// all.
    fn settle_best(&mut self) {
        self.release_torques();
        let Some(best) = self.found.best.clone().filter(|_| !self.found.is_interrupted()) else { return };
        if best.stationarity.is_some() || !best.is_feasible() {
            return;
        }
        if let Some((best, local)) = self.round(&[best], |best, search| search.polish(best, PATIENCE, 0)).pop() {
            let same = self.optima.extract_if(.., |optimum| optimum.decision == best.decision);
            let times_found = same.map(|optimum| optimum.times_found).sum::<usize>().max(local.times_found);
            self.optima.push(Candidate { times_found, ..local });
        }
    }

    /// Allows all torques; where motors were judged at the ends of steps alone, each optimum moves to where it keeps their whole curves.
    pub(super) fn release_torques(&mut self) {
        if !self.problem.has_torque_beyond_grip() {
            return;
        }
        // What was measured is that of torques near the grip.
        self.optima.iter_mut().chain(&mut self.found.best).for_each(|plan| plan.stationarity = None);
        let judged_motors_at_ends = self.problem.is_stand_in();
        self.problem.release_torques();
        // Nelder-Mead has had all torques from the start.
        if !judged_motors_at_ends || self.input.settings.method == Method::NelderMead {
            return;
        }
        if self.found.is_interrupted() {
            // Of the others it is not known whether they keep the whole curves.
            self.optima = self.found.best.iter().cloned().collect();
        } else {
            self.move_optima();
        }
    }

    /// Sorts the optima by merit; the distinct ones, and the largest merit of those that may become the best.
    fn rank_optima(&mut self) -> (Vec<Range<usize>>, f64) {
        best_first(&mut self.optima, |optimum| optimum);
        let slowest = (1.0 + LARGEST_LAG) * self.optima.first().map_or(0.0, |best| best.merit);
        (distinct(&self.optima, |optimum| optimum.merit), slowest)
    }

    /// Moves each optimum, once where several are one, to where it keeps limits that are others than before; the best is left to be
    /// polished.
    fn move_optima(&mut self) {
        let (groups, slowest) = self.rank_optima();
        let once = |group: Range<usize>| {
            let times_found = self.optima[group.clone()].iter().map(|optimum| optimum.times_found).sum();
            Candidate { times_found, ..self.optima[group.start].clone() }
        };
        let chosen: Vec<_> = groups.into_iter().map(once).collect();
        let moved = self.round(&chosen, |optimum, search| {
            search.problem.aim(optimum.goal_heading);
            // Those that may become the best in every way there is.
            let moved = if optimum.merit <= slowest { search.adapt(optimum) } else { search.back_off(optimum) }?;
            Ok(Candidate { times_found: optimum.times_found, ..moved })
        });
        self.optima = moved.into_iter().map(|(_, moved)| moved).collect();
        self.found.best.iter_mut().for_each(|best| best.stationarity = None);
    }

    /// Runs a round, one part for each entrant; the local optima to which they led, each with its entrant.
    fn round<'b, T: Sync>(
        &mut self,
        entrants: &'b [T],
        run: impl Fn(&T, &mut LocalSearch) -> Result<Candidate, Interruption> + Sync,
    ) -> Vec<(&'b T, Candidate)> {
        let run_part: &RunPart = &|index, control, rollout_limit| {
            let mut search = LocalSearch::new(self.problem.clone(), &self.input.settings, control, rollout_limit);
            search.coarse_step_count = self.coarse_step_count;
            let local = run(&entrants[index], &mut search);
            let LocalSearch { best, budget, .. } = search;
            PartOutcome { local, best, iterations: budget.iterations, rollouts: budget.spent() }
        };
        let left = self.rollout_limit - self.found.rollouts;
        let locals = self.found.add_parts((entrants.len(), left), &self.progress, run_part);
        locals.into_iter().map(|(index, local)| (&entrants[index], local)).collect()
    }
}

/// Steps of the grid on which starts are compared: under smoothed laws these do.
fn coarse_step_count(input: &SolveInput, final_time: f64) -> usize {
    let control_count = input.settings.control_count;
    let interval = final_time / control_count as f64;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive and whole")]
    let needed = (interval / (LONGEST_STEP * input.robot.parameters().natural_time())).ceil() as usize;
    needed.saturating_mul(control_count)
}

/// The number of a start, and how many there are.
type StartNumber = (usize, usize);

/// Where a start led under smoothed laws.
#[derive(Clone)]
struct Smoothed {
    /// That of the start, or of the one whose spin it was.
    number: StartNumber,
    strategy: Strategy,
    local: Candidate,
    /// Under the exact law.
    has_gone_on: bool,
    /// Whether another one of its group has gone on for it.
    is_represented: bool,
}

impl Smoothed {
    fn new(number: StartNumber, strategy: Strategy, local: Candidate) -> Self {
        Self { number, strategy, local, has_gone_on: false, is_represented: false }
    }

    /// Whether the next one by merit is where this one is, as closely as descents end: side by side they would find the same. What
    /// lies farther apart may be distinct under sharper laws.
    fn takes_in(&mut self, next: &Self) -> bool {
        let is_same = next.local.merit <= (1.0 + CRITICALITY_TOLERANCE) * self.local.merit;
        self.local.times_found += if is_same { next.local.times_found } else { 0 };
        is_same
    }
}

/// The first of a group, with the starts that led to it and to those for which none has gone on yet.
fn representative(group: &mut [Smoothed]) -> Smoothed {
    let mut first = group[0].clone();
    for member in &mut group[1..] {
        if !member.has_gone_on && !std::mem::replace(&mut member.is_represented, true) {
            first.local.times_found += member.local.times_found;
        }
    }
    first
}

/// How often the best one of sorted optima was found.
fn times_found(smoothed: &[Smoothed]) -> usize {
    let are_best = smoothed.iter().take_while(|other| !is_distinct(smoothed[0].local.merit, other.local.merit));
    are_best.map(|smoothed| smoothed.local.times_found).sum()
}

/// Sorts by merits: a plan that misses its goal by little may become the best one.
fn best_first<T>(optima: &mut [T], of: impl Fn(&T) -> &Candidate) {
    optima.sort_by(|a, b| of(a).merit.total_cmp(&of(b).merit));
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::simulation::Simulator;
    use crate::solver::grid_problem::problem_on;

    #[test]
    fn finals_end_where_no_merit_is_a_number() {
        let (input, control) = (SolveInput::forward_drive(), RunControl::unattended());
        let simulator = Simulator::new(&input.robot);
        let (problem, _) = problem_on(&input, &simulator, input.settings.step_count);
        let mut race = Race::new(&input, &problem, (SearchResult::default(), 10), &control);
        let diverged = Candidate::new(DVector::from_element(1, 1.0), None);
        race.optima.push(Candidate { goal_error: f64::NAN, merit: f64::NAN, ..diverged });
        race.finals();
        assert_eq!(race.found.rollouts, 0);
    }

    #[test]
    fn an_optimum_is_found_again_by_its_merit() {
        let smoothed = |merit: f64| {
            let local = Candidate::new(DVector::from_element(1, 1.0), None).judged((0.0, 0.0), true);
            let local = Candidate { merit, ..local };
            Smoothed::new((1, 1), Strategy::Smoothed, local)
        };
        assert_eq!(times_found(&[]), 0);
        assert_eq!(times_found(&[2.000, 2.001, 2.01].map(smoothed)), 2);
        let mut arrived = [2.0000, 2.0001, 2.001, 2.0011, 2.01].map(smoothed).to_vec();
        arrived.dedup_by(|next, kept| kept.takes_in(next));
        assert_eq!(arrived.iter().map(|smoothed| smoothed.local.times_found).collect::<Vec<_>>(), [2, 2, 1]);
        assert_eq!(times_found(&arrived), 4);
        assert_eq!(representative(&mut arrived[..2]).local.times_found, 4);
        assert_eq!(times_found(&arrived), 4, "what was found stays found");
        // One that comes later and is better goes on for itself.
        arrived[0].has_gone_on = true;
        arrived.insert(0, smoothed(1.9999));
        assert_eq!(representative(&mut arrived[..3]).local.times_found, 1);
    }
}
