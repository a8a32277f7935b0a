//! The race of a search: from starts through ever fewer and ever more thorough heats to the best local optimum.

use super::candidate::{CRITICALITY_TOLERANCE, Candidate, LARGEST_LAG, distinct, is_distinct};
use super::hops::PATIENCE;
use super::local_search::LocalSearch;
use super::parts::{PartOutcome, Parts, RunPart, Total};
use super::progress::BestProgress;
use super::settings::SolveInput;
use super::starts::{ONE_IN, Start, Strategy, spun, starts};
use super::strategies::Heat;
use crate::optimizer::Interruption;
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
    rollout_limit: u64,
    progress: &'a BestProgress<'a>,
    pub(super) found: Total,
    /// Starts tried.
    pub(super) tried: usize,
    /// Spins of the best plan tried.
    spun: usize,
}

impl<'a> Race<'a> {
    pub(super) fn new(
        input: &'a SolveInput,
        problem: &ShootingProblem<'a>,
        rollout_limit: u64,
        progress: &'a BestProgress<'a>,
    ) -> Self {
        let coarse_step_count = coarse_step_count(input, problem.time_unit());
        let problem = problem.clone();
        Self { input, problem, coarse_step_count, rollout_limit, progress, found: Total::default(), tried: 0, spun: 0 }
    }

    /// From starts to local optima, from as many more where none is a plan, and from spins of the best. Whether any start goes through
    /// smoothed laws.
    pub(super) fn starts(&mut self, optima: &mut Vec<Candidate>) -> bool {
        let mut smoothed = Vec::new();
        self.block(&mut smoothed, optima);
        let has_plan = optima.iter().any(|optimum| optimum.is_feasible(self.input.settings.goal_tolerance));
        if !has_plan && self.found.interruption.is_none() {
            self.block(&mut smoothed, optima);
        }
        self.spins(&mut smoothed, optima);
        self.descend(&mut smoothed, optima);
        !smoothed.is_empty()
    }

    /// From so many starts as are requested to local optima. Some maneuvers have fewer.
    pub(super) fn block(&mut self, smoothed: &mut Vec<Smoothed>, optima: &mut Vec<Candidate>) {
        let first = self.tried;
        let starts = starts(self.input, first + self.input.settings.start_count);
        let starts = starts.get(first..).unwrap_or_default();
        let count = starts.len();
        let numbers: Vec<_> = (1..=count).map(|number| (first + number, first + count)).collect();
        self.tried += self.heats((starts, &numbers), f64::INFINITY, smoothed, optima);
        self.descend(smoothed, optima);
    }

    /// From spins of the best smoothed plan so far to what they lead to, in rounds, until one leads to no better plan and the best has been
    /// found more than by chance, or until several in a row lead to no better one.
    fn spins(&mut self, smoothed: &mut Vec<Smoothed>, optima: &mut Vec<Candidate>) {
        let start_count = self.input.settings.start_count;
        let count = start_count / ONE_IN;
        let mut in_vain = 0;
        while count > 0 && in_vain < MOST_IN_VAIN {
            let (None, Some(best)) = (self.found.interruption, smoothed.first()) else { return };
            let plan = Start {
                schedule: schedule_from_decision(&best.local.decision),
                goal_heading: best.local.goal_heading,
                strategy: Strategy::Smoothed,
            };
            let (merit, numbers) = (best.local.merit, vec![best.number; count]);
            let spins = spun(self.input, &plan, (count, (self.tried + self.spun) as u64));
            self.spun += count;
            self.heats((&spins, &numbers), (1.0 + LARGEST_SPIN_LAG) * merit, smoothed, optima);
            in_vain = if is_distinct(smoothed[0].local.merit, merit) { 0 } else { in_vain + 1 };
            if in_vain > 0 && times_found(smoothed) * STARTS_A_FIND >= start_count {
                return;
            }
        }
    }

    /// From starts to what they lead to, ever fewer of them and ever more thoroughly, through other laws than the first where their merit
    /// is at most the slowest. Smoothed ones join the others, best first. Returns how many starts were tried.
    fn heats(
        &mut self,
        (starts, numbers): (&[Start], &[StartNumber]),
        slowest: f64,
        smoothed: &mut Vec<Smoothed>,
        optima: &mut Vec<Candidate>,
    ) -> usize {
        let locals = self.round(starts.len(), &|index, search| search.run_from(&starts[index], numbers[index]));
        let tried = locals.len();
        let mut rough = Vec::new();
        for (index, local) in locals {
            let strategy = starts[index].strategy;
            if strategy.is_smoothed() {
                rough.push(Smoothed::new(numbers[index], strategy, local));
            } else {
                optima.push(local);
            }
        }
        // Merits under different laws do not compare closely.
        let (rough, sharper): (Vec<_>, Vec<_>) =
            rough.into_iter().partition(|rough| rough.strategy == Strategy::Smoothed);
        let mut arrived: Vec<_> = [rough, sharper].into_iter().flat_map(|rough| self.first_law(rough)).collect();
        arrived.retain(|arrived| arrived.local.merit <= slowest);
        let is_first = smoothed.is_empty();
        smoothed.extend(self.heat(&arrived, Heat::OtherLaws));
        best_first(smoothed, |smoothed| &smoothed.local);
        if let Some(best) = smoothed.first().filter(|_| is_first) {
            // The first guess of a small maneuver may be twenty times as slow: laws and tolerances would be too fine.
            self.problem.set_time_unit(best.local.merit.min(self.problem.time_unit()));
        }
        tried
    }

    /// Where the first law of their strategy leads the better ones, each optimum once.
    fn first_law(&mut self, mut rough: Vec<Smoothed>) -> Vec<Smoothed> {
        best_first(&mut rough, |rough| &rough.local);
        rough.truncate(rough.len() - rough.len() / ONE_IN);
        let mut arrived = self.heat(&rough, Heat::FirstLaw);
        arrived.dedup_by(|next, kept| kept.takes_in(next));
        arrived
    }

    /// Where a heat leads these, best first; none of them once the search is interrupted.
    fn heat(&mut self, entrants: &[Smoothed], heat: Heat) -> Vec<Smoothed> {
        if self.found.interruption.is_some() {
            return Vec::new();
        }
        let go_on = |index: usize, search: &mut LocalSearch| {
            let Smoothed { number, strategy, local, .. } = &entrants[index];
            search.go_on(local, (heat, *strategy), *number)
        };
        let locals = self.round(entrants.len(), &go_on).into_iter();
        let mut arrived: Vec<_> = locals.map(|(index, local)| Smoothed { local, ..entrants[index].clone() }).collect();
        best_first(&mut arrived, |arrived| &arrived.local);
        arrived
    }

    /// The best distinct optima of smoothed laws under the exact law, where they join the others. After each block of starts, so that
    /// a search which is stopped has a plan.
    fn descend(&mut self, smoothed: &mut [Smoothed], optima: &mut Vec<Candidate>) {
        let mut groups = distinct(smoothed, |smoothed| smoothed.local.merit);
        groups.truncate(self.input.settings.start_count.div_ceil(ONE_IN));
        groups.retain(|group| !std::mem::replace(&mut smoothed[group.start].has_gone_on, true));
        let chosen: Vec<_> = groups.into_iter().map(|group| representative(&mut smoothed[group])).collect();
        optima.extend(self.heat(&chosen, Heat::Descend).into_iter().map(|arrived| arrived.local));
    }

    /// Improves the fastest distinct optima that come near the best, ever fewer of them and ever more thoroughly (successive halving:
    /// Jamieson & Talwalkar 2016). Patience begins with a half of what one without rivals has.
    pub(super) fn finals(&mut self, optima: &mut [Candidate]) {
        let (mut count, mut patience) = (self.input.settings.start_count.div_ceil(ONE_IN), PATIENCE / 2);
        for round in 0.. {
            if self.found.interruption.is_some() {
                return;
            }
            best_first(optima, |optimum| optimum);
            let slowest = (1.0 + LARGEST_LAG) * optima.first().map_or(0.0, |best| best.merit);
            let groups = distinct(optima, |optimum| optimum.merit).into_iter();
            let mut chosen: Vec<_> = groups.map(|group| group.start).collect();
            chosen.retain(|index| optima[*index].merit <= slowest);
            chosen.truncate(count);
            let polish =
                |index: usize, search: &mut LocalSearch| search.polish(optima[chosen[index]].clone(), patience, round);
            for (index, local) in self.round(chosen.len(), &polish) {
                optima[chosen[index]] = local;
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
    pub(super) fn settle_best(&mut self, optima: &mut Vec<Candidate>) {
        if self.problem.has_torque_beyond_grip() {
            // What was measured is that of torques near the grip.
            optima.iter_mut().chain(&mut self.found.best).for_each(|plan| plan.stationarity = None);
            self.problem.release_torques();
        }
        let Some(best) = self.found.best.clone().filter(|_| self.found.interruption.is_none()) else { return };
        if best.stationarity.is_some() || !best.is_feasible(self.input.settings.goal_tolerance) {
            return;
        }
        if let Some((_, local)) = self.round(1, &|_, search| search.polish(best.clone(), PATIENCE, 0)).pop() {
            optima.retain(|optimum| optimum.decision != best.decision);
            optima.push(local);
        }
    }

    /// Runs the parts of one round; the local optima with the numbers of their parts.
    fn round(
        &mut self,
        count: usize,
        run: &(dyn Fn(usize, &mut LocalSearch) -> Result<Candidate, Interruption> + Sync),
    ) -> Vec<(usize, Candidate)> {
        let run_part: &RunPart = &|index, control, rollout_limit| {
            let mut problem = self.problem.clone();
            let mut local_search = LocalSearch::new(&mut problem, &self.input.settings, control, rollout_limit);
            local_search.coarse_step_count = self.coarse_step_count;
            let local = run(index, &mut local_search);
            let (best, iterations, rollouts) = local_search.into_parts();
            PartOutcome { local, best, iterations, rollouts }
        };
        let left = self.rollout_limit - self.found.rollouts;
        Parts::new(self.progress, left, (count, run_part)).run_into(&mut self.found)
    }
}

/// Steps of the grid on which starts are compared: under smoothed laws these do.
fn coarse_step_count(input: &SolveInput, final_time: f64) -> usize {
    let control_count = input.settings.control_count;
    let interval = final_time / control_count as f64;
    let needed = (interval / (LONGEST_STEP * input.robot.parameters().natural_time())).ceil();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive and whole")]
    let needed = needed as usize;
    needed.saturating_mul(control_count)
}

/// The number of a start, and how many there are.
type StartNumber = (usize, usize);

/// Where a start led under smoothed laws.
#[derive(Clone)]
pub(super) struct Smoothed {
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
    use crate::solver::run_control::RunControl;

    #[test]
    fn finals_end_where_no_merit_is_a_number() {
        let (input, control) = (SolveInput::forward_drive(), RunControl::unattended());
        let simulator = Simulator::new(&input.robot);
        let (problem, _) = problem_on(&input, &simulator, input.settings.step_count);
        let progress = BestProgress::new(&control, input.settings.goal_tolerance);
        let mut race = Race::new(&input, &problem, 10, &progress);
        let diverged = Candidate::new(DVector::from_element(1, 1.0), f64::NAN, true, None);
        race.finals(&mut [Candidate { merit: f64::NAN, ..diverged }]);
        assert_eq!(race.found.rollouts, 0);
    }

    #[test]
    fn an_optimum_is_found_again_by_its_merit() {
        let smoothed = |merit: f64| {
            let local = Candidate { merit, ..Candidate::new(DVector::from_element(1, 1.0), 0.0, true, None) };
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
