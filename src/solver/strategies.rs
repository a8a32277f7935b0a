//! Strategies from a start to a local optimum, and from one local optimum to a better one nearby.

use nalgebra::DVector;

use super::candidate::{CRITICALITY_TOLERANCE, Candidate, LARGEST_LAG, LEAST_PROMISE, is_distinct, keep_better};
use super::hops::PATIENCE;
use super::local_search::{LARGEST_PENALTY, LocalSearch, SMALLEST_PREDICTION, STRICT_PENALTY};
use super::run_control::{Phase, RunningPhase};
use super::segments::with_intervals;
use super::settings::Method;
use super::starts::{Start, Strategy};
use crate::optimizer::{FIRST_RADIUS, Interruption, PENALTY_GROWTH, SequentialLinearSettings, minimise_sequentially};
use crate::shooting::decision_from_schedule;

/// Slip smoothings between a start and the exact law, as shares of the maneuver's speed: they remove the kinks where contacts
/// change their modes. Under the exact law alone the search stops at such kinks, with final times up to 20 % longer.
const SMOOTHING: [f64; 3] = [0.24, 0.08, 0.024];
/// Most linear programs of a start under the first smoothing, before starts are compared, and under each smoothing afterwards.
const ROUGH_ITERATION_LIMIT: usize = 10;
const SMOOTHED_ITERATION_LIMIT: usize = 2 * ROUGH_ITERATION_LIMIT;
/// First trust radius from a start, whose torques are farther from the optimum than those of a plan. Much larger ones leave the family
/// of plans that the start belongs to, where small changes go far: backwards, a front-heavy robot is unstable.
const START_RADIUS: f64 = 2.0 * FIRST_RADIUS;
/// Kinks are crossed from plans of similar maneuvers where that may gain this share of the final time: others are near enough to what a new
/// search finds.
const WORTH_CROSSING: f64 = 5e-3;
/// Fewest control intervals of the grids on which held wheels begin.
const FEWEST_INTERVALS: usize = 10;

impl<'a> LocalSearch<'a> {
    /// Searches from one start of several: to a local optimum, which is also kept when it is the best so far, or only through the
    /// smoothed laws, to a merit by which such starts are compared.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn run_from(&mut self, start: &Start, number: (usize, usize)) -> Result<Candidate, Interruption> {
        let _phase = self.begin(number, start.goal_heading);
        let guess = decision_from_schedule(&start.schedule);
        // Guesses of callers may need more, and no descent follows on Nelder-Mead.
        let needs_all = start.strategy == Strategy::Warm || self.settings.method == Method::NelderMead;
        if needs_all && self.problem.exceeds_grip(&guess) {
            self.problem.release_torques();
        }
        if let (Strategy::Warm, Some(heading)) = (start.strategy, start.goal_heading) {
            self.aim_where_it_leads(&guess, heading)?;
        }
        match (self.settings.method, start.strategy) {
            (Method::NelderMead, _) => self.nelder_mead(&guess),
            (Method::SequentialLinear, Strategy::Warm) => {
                let mut best = self.warmly(&guess, start.goal_heading)?;
                self.cross_kink(&mut best, WORTH_CROSSING)?;
                Ok(best)
            }
            (Method::SequentialLinear, Strategy::Direct) => {
                let best = self.directly(&guess)?;
                self.secure(&best)
            }
            (Method::SequentialLinear, Strategy::Smoothed | Strategy::Sharper) => {
                let law = &laws_of(start.strategy)[..1];
                self.coarsely(|search| search.smoothed(&guess, law, (START_RADIUS, ROUGH_ITERATION_LIMIT)))
            }
        }
    }

    /// Moves a local optimum of another grid to this one.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn adapt(&mut self, plan: &Candidate) -> Result<Candidate, Interruption> {
        let adapted = self.warmly(&plan.decision, plan.goal_heading)?;
        // A grid moves an optimum by little: one that is slower lies on a kink.
        let lies_on_a_kink = is_distinct(plan.final_time(), adapted.final_time());
        if lies_on_a_kink { self.polish(&adapted, PATIENCE, 0) } else { Ok(adapted) }
    }

    /// Moves a local optimum to where its limits are tighter, and plans slower.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn back_off(&mut self, candidate: &Candidate) -> Result<Candidate, Interruption> {
        let mut best = self.near(&candidate.decision)?;
        if best.is_feasible() {
            self.settle(&mut best)?;
        }
        Ok(best)
    }

    /// Keeps a plan, which it gives back, where that is certain to keep all limits of the maneuver, so that a search which is stopped has one.
    pub(super) fn secure(&mut self, plan: &Candidate) -> Result<Candidate, Interruption> {
        if self.problem.is_stand_in() && plan.is_feasible() {
            let near_grip = self.problem.clone();
            self.problem.aim(plan.goal_heading);
            self.problem.release_torques();
            let secured = self.back_off(plan);
            self.problem = near_grip;
            secured?;
        }
        Ok(plan.clone())
    }

    /// A part of the search from one start of several.
    pub(super) fn begin(&mut self, number: (usize, usize), goal_heading: Option<f64>) -> RunningPhase<'a> {
        self.start = number;
        self.problem.aim(goal_heading);
        self.control.enter(Phase::Start { number: number.0 })
    }

    /// On through smoothed laws, thoroughly.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn through(&mut self, from: &Candidate, laws: &[f64]) -> Result<Candidate, Interruption> {
        self.coarsely(|search| search.smoothed(&from.decision, laws, (FIRST_RADIUS, SMOOTHED_ITERATION_LIMIT)))
    }

    /// Improves a local optimum, unless it has no promise, by hops, others in each round. Before them kinks are crossed in the first round,
    /// and steep ones followed, and the third one begins with a way back through smoothed laws.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn polish(&mut self, plan: &Candidate, patience: usize, round: u64) -> Result<Candidate, Interruption> {
        let mut best = plan.clone();
        if self.settings.method == Method::NelderMead {
            return Ok(best);
        }
        let _phase = self.control.enter(Phase::Polish);
        self.problem.aim(plan.goal_heading);
        if !self.settles_without_promise(&mut best)? {
            match round {
                0 => {
                    while self.cross_kink(&mut best, LEAST_PROMISE)? {}
                    self.hold_wheels(&mut best)?;
                }
                2 => self.leave_kinks(&mut best)?,
                _ => (),
            }
            self.hop(&mut best, patience, round)?;
            self.settle(&mut best)?;
        }
        Ok(Candidate { times_found: plan.times_found, ..best })
    }

    /// Back through smoothed laws, as long as that leads to another local optimum.
    fn leave_kinks(&mut self, best: &mut Candidate) -> Result<(), Interruption> {
        loop {
            let before = best.final_time();
            let next = self.around(&best.decision, &SMOOTHING[1..], FIRST_RADIUS)?;
            keep_better(best, next);
            if !is_distinct(best.final_time(), before) {
                return Ok(());
            }
        }
    }

    /// Through smoothed laws, which leave the kink of a local optimum, and down to another one.
    fn around(&mut self, guess: &DVector<f64>, smoothings: &[f64], radius: f64) -> Result<Candidate, Interruption> {
        let smoothed = self.smoothed(guess, smoothings, (radius, SMOOTHED_ITERATION_LIMIT))?;
        self.descend(&smoothed.decision, FIRST_RADIUS)
    }

    /// Under held wheels where kinks are steep, else under the exact law, across kinks, then from perturbed copies of the best point, unless
    /// that has no promise. A smooth motion has no kinks to leave; its descents begin on coarser control grids.
    pub(super) fn directly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let held = self.holding_wheels(f64::INFINITY, |held| held.directly(guess))?;
        let mut best = held.map_or_else(|| self.descend_directly(guess), Ok)?;
        if !self.problem.is_smooth() && !self.settles_without_promise(&mut best)? {
            while self.cross_kink(&mut best, LEAST_PROMISE)? {}
            if !best.has_no_promise() {
                self.hop(&mut best, PATIENCE, 0)?;
            }
        }
        self.settle(&mut best)?;
        Ok(best)
    }

    /// Under the exact law at once; through smoothing where that does not lead to the goal.
    fn descend_directly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let (from, radius) = self.on_coarser_controls(guess)?;
        let mut best = self.descend(&from, radius)?;
        if !best.is_feasible() {
            let next = self.around(guess, &SMOOTHING, START_RADIUS)?;
            keep_better(&mut best, next);
        }
        Ok(best)
    }

    /// Where a descent from this guess is to begin, and its first trust radius. With a smooth motion that is where grids of half as many
    /// control intervals lead, one after another (grid sequencing): on a coarse one linear programs are small, and a plan goes far.
    fn on_coarser_controls(&mut self, guess: &DVector<f64>) -> Result<(DVector<f64>, f64), Interruption> {
        let (control_count, coarser_count) = (self.problem.control_count(), self.problem.control_count() / 2);
        if !self.problem.is_smooth() || coarser_count < FEWEST_INTERVALS {
            return Ok((guess.clone(), START_RADIUS));
        }
        self.set_control_count(coarser_count);
        let coarser = self.on_coarser_controls(&with_intervals(guess, coarser_count)).and_then(|(from, radius)| {
            self.coarsely(|search| search.smoothed(&from, &SMOOTHING, (radius, SMOOTHED_ITERATION_LIMIT)))
        });
        self.set_control_count(control_count);
        Ok((with_intervals(&coarser?.decision, control_count), FIRST_RADIUS))
    }

    /// From a plan of a similar maneuver or of another grid: one descent near it, and other ways where that loses the goal or
    /// much time. The other goal heading is for a guess whose motion is unstable: it may end turned round.
    pub(super) fn warmly(
        &mut self,
        guess: &DVector<f64>,
        other_heading: Option<f64>,
    ) -> Result<Candidate, Interruption> {
        let slowest = (1.0 + LARGEST_LAG) * guess[guess.len() - 1];
        let arrived = |best: &Candidate| best.is_feasible() && best.final_time() <= slowest;
        let mut best = self.near(guess)?;
        if !arrived(&best) && self.problem.goal_heading() != other_heading {
            self.problem.aim(other_heading);
            keep_better(&mut best, self.near(guess)?);
            self.problem.aim(best.goal_heading);
        }
        if !arrived(&best) {
            let held = self.holding_wheels(best.time_to_beat(), |held| held.warmly(guess, other_heading))?;
            if let Some(held) = held {
                keep_better(&mut best, held);
            }
            self.problem.aim(best.goal_heading);
        }
        if !arrived(&best) {
            keep_better(&mut best, self.around(guess, &SMOOTHING[1..], FIRST_RADIUS)?);
        }
        if best.is_feasible() {
            self.settle(&mut best)?;
            return Ok(best);
        }
        self.directly(guess)
    }

    /// From a plan that has settled on a kink to a faster one behind it, where the linear model promises a worthwhile share of the final
    /// time: its torques lead across, and the final time stays. Whether that gains anything.
    fn cross_kink(&mut self, best: &mut Candidate, worthwhile: f64) -> Result<bool, Interruption> {
        let is_worthwhile = best.promised_decrease().is_some_and(|share| share >= worthwhile);
        let known = best.stationarity.as_ref().filter(|_| is_worthwhile && best.is_feasible());
        let Some(known) = known else { return Ok(false) };
        let (mut across, final_time) = (known.measure.promised_point.clone(), best.final_time());
        across[best.decision.len() - 1] = final_time;
        let time_to_beat = (1.0 - worthwhile) * final_time;
        let next = self.descend_until(&across, (START_RADIUS, None), (SMALLEST_PREDICTION, time_to_beat))?;
        let gains = next.gains_on(best, CRITICALITY_TOLERANCE);
        if gains {
            *best = next;
            self.settle(best)?;
        }
        Ok(gains)
    }

    /// One descent near a plan of a similar problem.
    pub(super) fn near(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        self.descend_until(guess, (FIRST_RADIUS, None), (CRITICALITY_TOLERANCE, f64::INFINITY))
    }

    /// Whether a plan settles on a local optimum without promise, from which hops gain little. What misses the goal is left where it is: a
    /// penalty that grows leads it to where hops do not meet the goal either.
    fn settles_without_promise(&mut self, best: &mut Candidate) -> Result<bool, Interruption> {
        if best.is_feasible() {
            self.settle(best)?;
        }
        Ok(best.has_no_promise())
    }

    /// Continues from the point that the criticality measure found, while it finds a better one: the certificate would find it
    /// too. Where that leads to no better plan, the merit trades the goal for time, and its penalty parameter is too small. One that
    /// is measured has settled.
    pub(super) fn settle(&mut self, best: &mut Candidate) -> Result<(), Interruption> {
        if best.stationarity.is_some() {
            return Ok(());
        }
        let mut penalty_parameter = STRICT_PENALTY;
        loop {
            let known = self.measured(best, penalty_parameter)?;
            let Some(better) = known.measure.better.clone()? else {
                best.stationarity = Some(known);
                // It may be the best one of all.
                self.note(best);
                return Ok(());
            };
            // On a short way the goal tolerance gains much time, and from a plan that uses it a descent to the goal itself is slower.
            let near = (known.measure.radius, Some(&known.measure.accepted));
            let next = self.descend_until(&better, near, (SMALLEST_PREDICTION, f64::INFINITY))?;
            // Less than what descents end with is no gain.
            let gains = next.gains_on(best, SMALLEST_PREDICTION);
            keep_better(best, next);
            if !gains {
                if penalty_parameter >= LARGEST_PENALTY {
                    return Ok(());
                }
                penalty_parameter *= PENALTY_GROWTH;
            }
        }
    }

    /// On the coarse grid, where that does to tell starts apart.
    fn coarsely<T>(&mut self, run: impl FnOnce(&mut Self) -> T) -> T {
        let step_count = self.problem.step_count();
        self.problem.set_step_count(self.coarse_step_count.min(step_count));
        let found = run(self);
        self.problem.set_step_count(step_count);
        found
    }

    /// Through smoothed laws, with the merit under the last one.
    fn smoothed(
        &mut self,
        guess: &DVector<f64>,
        smoothings: &[f64],
        (mut first_radius, iteration_limit): (f64, usize),
    ) -> Result<Candidate, Interruption> {
        let (mut decision, mut merit) = (guess.clone(), f64::INFINITY);
        // A smooth motion has one law.
        let smoothings = if self.problem.is_smooth() { &smoothings[..1] } else { smoothings };
        for &smoothing in smoothings {
            let descent = self.descent(first_radius, SMALLEST_PREDICTION);
            let settings = SequentialLinearSettings { iteration_limit, restores: false, ..descent };
            self.problem.set_slip_smoothing(smoothing);
            let from = (&decision, &mut self.programs);
            let result =
                minimise_sequentially(&mut self.problem, from, (&settings, None), &mut self.budget, &mut |_, _| {});
            self.problem.set_slip_smoothing(0.0);
            result.ending?;
            merit = self.merit(&result.x, &result.constraints);
            decision = result.x;
            first_radius = FIRST_RADIUS;
        }
        Ok(Candidate { merit, ..Candidate::new(decision, self.problem.goal_heading()) })
    }
}

/// The smoothings that starts of this strategy go through, if they do.
pub(super) fn laws_of(strategy: Strategy) -> &'static [f64] {
    if strategy == Strategy::Sharper { &SMOOTHING[1..] } else { &SMOOTHING }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shooting::{Goal, Maneuver, PathLimits, ShootingProblem};
    use crate::simulation::{Simulator, TorqueSchedule};
    use crate::solver::run_control::RunControl;
    use crate::solver::settings::{SolveInput, SolverSettings};

    /// Final times of a plan that settled on a kink, and of what it becomes.
    fn crossed(goal: Goal) -> [f64; 2] {
        let simulator = Simulator::new(&SolveInput::forward_drive().robot);
        let maneuver = Maneuver { goal, ..Maneuver::forward_drive() };
        let problem = ShootingProblem::new(&simulator, (&maneuver, &PathLimits::default()), (100, 20), 1.0);
        let (settings, control) = (SolverSettings::default(), RunControl::unattended());
        let mut search = LocalSearch::new(problem, &settings, &control, 10_000);
        let there_and_back = |torque: f64| [[torque; 10], [-torque; 10]].concat();
        let guess = TorqueSchedule { final_time: 2.0, left: there_and_back(0.5), right: there_and_back(0.45) };
        let mut best = search.near(&decision_from_schedule(&guess)).unwrap();
        search.settle(&mut best).unwrap();
        assert!(best.is_feasible() && !best.has_no_promise());
        let settled = best.final_time();
        search.cross_kink(&mut best, WORTH_CROSSING).unwrap();
        assert!(best.is_feasible() && best.stationarity.is_some());
        [settled, best.final_time()]
    }

    #[test]
    fn a_kink_is_crossed_where_that_gains_enough() {
        for goal in [Goal::at_rest(0.0, 1.0, 0.0), Goal::at_rest(0.2, 1.0, 0.0)] {
            let [settled, crossed] = crossed(goal);
            assert!(crossed < (1.0 - WORTH_CROSSING) * settled, "{settled} s, then {crossed} s");
        }
        let [settled, crossed] = crossed(Goal::at_rest(0.5, 1.0, 0.0));
        assert_eq!(settled, crossed);
    }
}
