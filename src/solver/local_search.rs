//! From one start to a local optimum.

use std::cell::Cell;
use std::cmp::Ordering;

use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::Method;
use super::progress::is_nearer;
use super::run_control::{Phase, RunControl, SolveProgress};
use super::settings::SolverSettings;
use super::starts::{Start, Way};
use crate::optimizer::{
    Budget, Constraints, Ending, Interruption, NelderMeadSettings, Problem, Restoration, SequentialLinearResult,
    SequentialLinearSettings, confirmed_decrease, minimise_by_nelder_mead, minimise_sequentially,
};
use crate::shooting::{GoalScales, LOAD_TOLERANCE, Penalty, ShootingProblem, decision_from_schedule};

/// Slip smoothing on the way from a start to the exact law, m/s: it carries the search over the kinks where contacts
/// change their modes, by which the exact law alone would stop it up to 20 % too slow.
const SMOOTHING: [f64; 3] = [0.1, 0.03, 0.01];
/// Shorter ways back to the exact law from a local optimum, to get off the kink on which it sits.
const POLISH_SMOOTHING: [f64; 2] = [0.03, 0.01];
/// Linear programs under one smoothing: the next smoothing moves the optimum anyway.
const SMOOTHED_ITERATION_LIMIT: usize = 40;
/// First trust radii under the exact law: kinks decide which one gets furthest.
const FIRST_RADII: [f64; 2] = [0.5, 0.3];
/// Trust radius of a start, of which its torques may be far from the optimum.
const START_RADIUS: f64 = 0.3;
/// Trust radius of a plan of a similar maneuver: small enough to stay near it.
const WARM_RADIUS: f64 = 0.05;
/// Trust radius of all later descents: large enough to jump off a kink.
const RADIUS: f64 = 0.1;
/// A shaken copy moves each torque by up to this share of its limit and takes this much longer.
const SHAKEN_SHARE: f64 = 0.03;
const SHAKEN_FINAL_TIME: f64 = 1.003;
/// Share of the final time that a step from a finished plan may promise.
const FINISHED_SHARE: f64 = 3e-5;
const FINISH_LIMIT: usize = 5;
const DIRECT_SHAKES: usize = 3;
const POLISH_SHAKES: usize = 4;
const POLISH_LIMIT: usize = 4;
/// A round of polishing that gains less than this share of the final time is the last one.
const POLISH_GAIN: f64 = 3e-6;
/// A plan that loses more than this share of its final time on another grid has left its local optimum.
const ADAPTION_LOSS: f64 = 5e-3;
/// Least prices of the goal errors, s/m: the first one exceeds the multipliers of most maneuvers, the second is for the
/// rest.
const LEAST_PRICES: [f64; 2] = [5.0, 50.0];
/// Standing still must cost more than the maneuver, or the search gives it up: this many times as much.
const STANDING_COST: f64 = 2.0;
const DEARER: f64 = 10.0;
/// Rows of a higher price would drown the final time in rounding.
const LARGEST_PRICE: f64 = 1e3;
/// A scaled residual above this before the restoration means that violating the goal paid.
const VIOLATION_PAID: f64 = 1e-4;
/// The restoration aims this far below the goal tolerance.
const FEASIBILITY_MARGIN: f64 = 1e-2;

/// First edge of the simplex, as a fraction of each variable's reach.
const NELDER_MEAD_EDGE: f64 = 0.2;
/// Enough for the restarts to stop by themselves.
const NELDER_MEAD_RESTART_LIMIT: usize = 1000;
const NELDER_MEAD_VALUE_TOLERANCE: f64 = 1e-6;
const NELDER_MEAD_SMALLEST_GAIN: f64 = 1e-5;

/// A decision with what the search needs to rank it.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub(super) decision: DVector<f64>,
    /// Largest magnitude of its goal errors.
    pub(super) goal_error: f64,
    /// Whether some contact would have to pull.
    pub(super) lifts_off: bool,
    /// The winding of the goal heading that it meets.
    pub(super) goal_heading: Option<f64>,
}

impl Candidate {
    pub(super) fn final_time(&self) -> f64 {
        self.decision[self.decision.len() - 1]
    }

    /// Whether it meets the goal, with every contact on the floor.
    pub(super) fn is_feasible(&self, goal_tolerance: f64) -> bool {
        self.goal_error <= goal_tolerance && !self.lifts_off
    }

    /// A feasible one before any other, one that meets the goal before one that misses it; then the faster one or the
    /// one nearer to the goal. A NaN is the worst.
    pub(super) fn is_better_than(&self, other: &Self, goal_tolerance: f64) -> bool {
        let rank = |candidate: &Self| match (candidate.goal_error <= goal_tolerance, candidate.lifts_off) {
            (true, false) => 2,
            (true, true) => 1,
            (false, _) => 0,
        };
        match rank(self).cmp(&rank(other)) {
            Ordering::Greater => true,
            Ordering::Less => false,
            Ordering::Equal if rank(self) > 0 => self.final_time() < other.final_time(),
            Ordering::Equal => is_nearer(self.goal_error, other.goal_error),
        }
    }
}

/// The searches of one part of a solve share problem, budget and the best candidate so far.
pub(super) struct LocalSearch<'a, 'b, 'c> {
    problem: &'a mut ShootingProblem<'b>,
    scales: GoalScales,
    settings: &'a SolverSettings,
    control: &'a RunControl<'c>,
    budget: Budget<'c>,
    /// (running start, number of starts).
    start: (usize, usize),
    goal_heading: Option<f64>,
    prices: [f64; 2],
    best: Option<Candidate>,
    iterations: u64,
}

impl<'a, 'b, 'c> LocalSearch<'a, 'b, 'c> {
    pub(super) fn new(
        problem: &'a mut ShootingProblem<'b>,
        settings: &'a SolverSettings,
        control: &'a RunControl<'c>,
        rollout_limit: u64,
    ) -> Self {
        let budget = control.budget(rollout_limit);
        let scales = problem.goal_scales();
        Self {
            problem,
            scales,
            settings,
            control,
            budget,
            start: (0, 0),
            goal_heading: None,
            prices: LEAST_PRICES,
            best: None,
            iterations: 0,
        }
    }

    /// Searches from one start of several; the local optimum is also kept when it is the best so far.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn run_from(&mut self, start: &Start, number: (usize, usize)) -> Result<Candidate, Interruption> {
        let _phase = self.control.enter(Phase::Start { number: number.0 });
        self.start = number;
        self.aim(start.goal_heading, start.schedule.final_time);
        let guess = decision_from_schedule(&start.schedule);
        match self.settings.method {
            Method::SequentialLinear => match start.way {
                Way::Warm => self.warmly(&guess),
                Way::Direct => self.directly(&guess),
                Way::Smoothed => self.smoothly(&guess),
            },
            Method::NelderMead => self.nelder_mead(&guess),
        }
    }

    pub(super) fn into_parts(self) -> (Option<Candidate>, u64, u64) {
        (self.best, self.iterations, self.budget.spent())
    }

    /// Moves a local optimum of another grid to this one; by longer ways where the near one loses the goal or much time.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn adapt(&mut self, candidate: &Candidate) -> Result<Candidate, Interruption> {
        let _phase = self.control.enter(Phase::Refinement);
        self.aim(candidate.goal_heading, candidate.final_time());
        let tolerance = self.settings.goal_tolerance;
        let slowest = (1.0 + ADAPTION_LOSS) * candidate.final_time();
        let arrived = |best: &Candidate| best.is_feasible(tolerance) && best.final_time() <= slowest;
        let mut best = self.descend(&candidate.decision, self.prices[0], RADIUS)?;
        if !arrived(&best) {
            let next = self.descend(&candidate.decision, self.prices[1], START_RADIUS)?;
            keep_better(&mut best, next, tolerance);
        }
        if !arrived(&best) {
            let smoothed = self.through_smoothing(&candidate.decision, &POLISH_SMOOTHING, self.prices[0], RADIUS)?;
            let next = self.descend(&smoothed, self.prices[0], RADIUS)?;
            keep_better(&mut best, next, tolerance);
        }
        Ok(best)
    }

    /// Improves a local optimum until a whole round of descents gains nothing more.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn polish(&mut self, candidate: Candidate) -> Result<Candidate, Interruption> {
        if self.settings.method == Method::NelderMead {
            return Ok(candidate);
        }
        let _phase = self.control.enter(Phase::Polish);
        self.aim(candidate.goal_heading, candidate.final_time());
        let tolerance = self.settings.goal_tolerance;
        let mut best = candidate;
        for _ in 0..POLISH_LIMIT {
            let before = best.final_time();
            for (weight, radius) in [(self.prices[0], START_RADIUS), (self.prices[1], RADIUS)] {
                let next = self.descend(&best.decision, weight, radius)?;
                keep_better(&mut best, next, tolerance);
            }
            let smoothed = self.through_smoothing(&best.decision, &POLISH_SMOOTHING, self.prices[0], RADIUS)?;
            let next = self.descend(&smoothed, self.prices[0], RADIUS)?;
            keep_better(&mut best, next, tolerance);
            if before - best.final_time() < POLISH_GAIN * before {
                break;
            }
        }
        self.shake(&mut best, POLISH_SHAKES)?;
        self.finish(&mut best)?;
        Ok(best)
    }

    /// Under the exact law from several trust radii, then from shaken copies of the best point; through smoothing where
    /// the exact law leads nowhere.
    fn directly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let tolerance = self.settings.goal_tolerance;
        let mut best = self.descend(guess, self.prices[0], FIRST_RADII[0])?;
        for radius in &FIRST_RADII[1..] {
            let next = self.descend(guess, self.prices[0], *radius)?;
            keep_better(&mut best, next, tolerance);
        }
        if !best.is_feasible(tolerance) {
            keep_better(&mut best, self.smoothly(guess)?, tolerance);
        }
        self.shake(&mut best, DIRECT_SHAKES)?;
        self.finish(&mut best)?;
        Ok(best)
    }

    /// From a plan of a similar maneuver: one descent, or the direct way where that misses the goal.
    fn warmly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let warm = self.descend(guess, self.prices[0], WARM_RADIUS)?;
        if !warm.is_feasible(self.settings.goal_tolerance) {
            return self.directly(guess);
        }
        let mut best = warm;
        self.finish(&mut best)?;
        Ok(best)
    }

    /// Descends again from slightly slower, slightly disturbed copies of a local optimum: it sits on a kink, and another
    /// one nearby is often better.
    fn shake(&mut self, best: &mut Candidate, count: usize) -> Result<(), Interruption> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.settings.seed);
        let last = best.decision.len() - 1;
        for _ in 0..count {
            let mut shaken = best.decision.clone();
            let reach = self.problem.reach(&shaken) * SHAKEN_SHARE;
            for (torque, reach) in shaken.iter_mut().zip(reach.iter()).take(last) {
                *torque += reach * rng.random_range(-1.0..1.0);
            }
            shaken[last] *= SHAKEN_FINAL_TIME;
            let weight = if best.is_feasible(self.settings.goal_tolerance) { self.prices[0] } else { self.prices[1] };
            let next = self.descend(&shaken, weight, RADIUS)?;
            keep_better(best, next, self.settings.goal_tolerance);
        }
        Ok(())
    }

    /// Goes on from the very step that would refute the certificate of the plan, while there is one.
    fn finish(&mut self, best: &mut Candidate) -> Result<(), Interruption> {
        for _ in 0..FINISH_LIMIT {
            let price = self.prices[1];
            let confirmed = confirmed_decrease(self.problem, &best.decision, price, &mut self.budget)?;
            let is_stationary = confirmed.prediction <= FINISHED_SHARE * best.final_time();
            let Some(better) = confirmed.better.filter(|_| !is_stationary) else { return Ok(()) };
            let next = self.descend(&better, price, RADIUS)?;
            keep_better(best, next, self.settings.goal_tolerance);
        }
        Ok(())
    }

    /// Through ever less smoothing to the exact law; at a higher price where that leads past the goal.
    fn smoothly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let mut best = self.smoothly_at_price(guess, self.prices[0])?;
        if !best.is_feasible(self.settings.goal_tolerance) {
            let next = self.smoothly_at_price(guess, self.prices[1])?;
            keep_better(&mut best, next, self.settings.goal_tolerance);
        }
        Ok(best)
    }

    fn smoothly_at_price(&mut self, guess: &DVector<f64>, price: f64) -> Result<Candidate, Interruption> {
        let smoothed = self.through_smoothing(guess, &SMOOTHING, price, START_RADIUS)?;
        self.descend(&smoothed, price, RADIUS)
    }

    fn through_smoothing(
        &mut self,
        guess: &DVector<f64>,
        smoothings: &[f64],
        price: f64,
        first_radius: f64,
    ) -> Result<DVector<f64>, Interruption> {
        let mut decision = guess.clone();
        let mut radius = first_radius;
        for &smoothing in smoothings {
            let settings = SequentialLinearSettings {
                weight: price,
                first_radius: radius,
                iteration_limit: SMOOTHED_ITERATION_LIMIT,
                restoration: Restoration::Skip,
                ..SequentialLinearSettings::default()
            };
            self.problem.set_slip_smoothing(smoothing);
            let result = minimise_sequentially(self.problem, &decision, &settings, &mut self.budget, &mut |_, _| {});
            self.problem.set_slip_smoothing(0.0);
            self.iterations += result.iterations;
            if let Ending::Interrupted(interruption) = result.ending {
                return Err(interruption);
            }
            decision = result.x;
            radius = RADIUS;
        }
        Ok(decision)
    }

    /// Descends under the exact law and restores the goal; again with a higher price where violating the goal paid.
    fn descend(&mut self, guess: &DVector<f64>, weight: f64, radius: f64) -> Result<Candidate, Interruption> {
        let result = self.descend_at_price(guess, weight, radius)?;
        if result.unrestored <= VIOLATION_PAID || weight >= self.prices[1] {
            return Ok(self.candidate(&result));
        }
        let dearer = self.descend_at_price(&result.x, self.prices[1], radius)?;
        let (mut best, next) = (self.candidate(&result), self.candidate(&dearer));
        keep_better(&mut best, next, self.settings.goal_tolerance);
        Ok(best)
    }

    fn descend_at_price(
        &mut self,
        guess: &DVector<f64>,
        weight: f64,
        radius: f64,
    ) -> Result<SequentialLinearResult, Interruption> {
        let settings = SequentialLinearSettings {
            weight,
            first_radius: radius,
            feasibility_tolerance: FEASIBILITY_MARGIN * self.settings.goal_tolerance * self.scales.smallest(),
            excess_tolerance: LOAD_TOLERANCE,
            ..SequentialLinearSettings::default()
        };
        let (control, start, scales, goal_heading) = (self.control, self.start, &self.scales, self.goal_heading);
        let tolerance = self.settings.goal_tolerance;
        // The latest feasible point is the fastest one: the merit only falls.
        let mut passed = None;
        let mut tell = |x: &DVector<f64>, constraints: &Constraints| {
            let goal_error = scales.largest_goal_error(&constraints.residual);
            // Within the margin some contact might pull.
            let lifts_off = constraints.largest_excess() > 0.0;
            if goal_error > tolerance || !lifts_off {
                report(control, start, x, goal_error);
            }
            if goal_error <= tolerance && !lifts_off {
                passed = Some(Candidate { decision: x.clone(), goal_error, lifts_off, goal_heading });
            }
        };
        let result = minimise_sequentially(self.problem, guess, &settings, &mut self.budget, &mut tell);
        self.iterations += result.iterations;
        let candidate = self.candidate(&result);
        self.note(&candidate);
        // A descent that ends infeasible, because it was cut or by itself, is worth what it passed.
        if let Some(passed) = passed.filter(|_| !candidate.is_feasible(tolerance)) {
            self.note(&passed);
        }
        match result.ending {
            Ending::Interrupted(interruption) => Err(interruption),
            Ending::Stationary | Ending::SmallGains | Ending::SmallRadius | Ending::IterationLimit => Ok(result),
        }
    }

    fn candidate(&self, result: &SequentialLinearResult) -> Candidate {
        Candidate {
            goal_error: self.scales.largest_goal_error(&result.constraints.residual),
            lifts_off: self.problem.lifts_off(&result.constraints),
            decision: result.x.clone(),
            goal_heading: self.goal_heading,
        }
    }

    fn nelder_mead(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let settings = NelderMeadSettings {
            edge: self.problem.reach(guess) * NELDER_MEAD_EDGE,
            restart_limit: NELDER_MEAD_RESTART_LIMIT,
            value_tolerance: NELDER_MEAD_VALUE_TOLERANCE,
            smallest_gain: NELDER_MEAD_SMALLEST_GAIN,
        };
        let (control, start, scales, tolerance) =
            (self.control, self.start, &self.scales, self.settings.goal_tolerance);
        let last = Cell::new((f64::NAN, true));
        let mut penalty = Penalty::new(self.problem);
        let mut value = |x: &DVector<f64>| {
            let value = penalty.value(x);
            last.set((scales.largest_goal_error(&penalty.constraints().residual), penalty.lifts_off()));
            value
        };
        let mut best = last.get();
        let mut tell = |x: &DVector<f64>| {
            best = last.get();
            if best.0 > tolerance || !best.1 {
                report(control, start, x, best.0);
            }
        };
        let result = minimise_by_nelder_mead(&mut value, guess, &settings, &mut self.budget, &mut tell);
        self.iterations += result.iterations;
        let decision = result.x.zip_zip_map(self.problem.lower(), self.problem.upper(), f64::clamp);
        let (goal_error, lifts_off) = best;
        let candidate = Candidate { decision, goal_error, lifts_off, goal_heading: self.goal_heading };
        self.note(&candidate);
        result.interruption.map_or(Ok(candidate), Err)
    }

    fn aim(&mut self, goal_heading: Option<f64>, final_time: f64) {
        self.goal_heading = goal_heading;
        if let Some(heading) = goal_heading {
            self.problem.aim_at_heading(heading);
        }
        self.prices = prices(self.problem, final_time);
    }

    fn note(&mut self, candidate: &Candidate) {
        let tolerance = self.settings.goal_tolerance;
        if self.best.as_ref().is_none_or(|best| candidate.is_better_than(best, tolerance)) {
            self.best = Some(candidate.clone());
            // What meets the goal and lifts off is no plan to be told of.
            if candidate.goal_error > tolerance || candidate.is_feasible(tolerance) {
                report(self.control, self.start, &candidate.decision, candidate.goal_error);
            }
        }
    }
}

/// Prices of the goal errors for a maneuver of about this final time, s/m: usual and dear.
pub(super) fn prices(problem: &ShootingProblem, final_time: f64) -> [f64; 2] {
    let standing = STANDING_COST * final_time / problem.violation_at_start();
    let [usual, dear] = LEAST_PRICES;
    let usual = standing.clamp(usual, LARGEST_PRICE);
    [usual, dear.max(DEARER * usual).min(LARGEST_PRICE)]
}

fn keep_better(best: &mut Candidate, next: Candidate, goal_tolerance: f64) {
    if next.is_better_than(best, goal_tolerance) {
        *best = next;
    }
}

fn report(control: &RunControl, (start, start_count): (usize, usize), x: &DVector<f64>, goal_error: f64) {
    let best_final_time = x[x.len() - 1];
    control.report(&SolveProgress { best_final_time, best_goal_error: goal_error, start, start_count });
}
