//! From one start to a local optimum.

use std::cell::Cell;

use nalgebra::DVector;

use super::Method;
use super::run_control::{RunControl, SolveProgress};
use super::settings::SolverSettings;
use super::starts::{Start, Way};
use crate::optimizer::{
    Budget, Ending, Interruption, NelderMeadSettings, Problem, Restoration, SequentialLinearResult,
    SequentialLinearSettings, minimise_by_nelder_mead, minimise_sequentially,
};
use crate::shooting::{GoalScales, Penalty, ShootingProblem, decision_from_schedule};

/// Slip smoothing on the way from a start to the exact law, m/s: it carries the search over the kinks where contacts
/// change their modes, by which the exact law alone would stop it up to 20 % too slow.
const SMOOTHING: [f64; 3] = [0.1, 0.03, 0.01];
/// Shorter ways back to the exact law from a local optimum, to get off the kink on which it sits.
const POLISH_SMOOTHING: [f64; 2] = [0.03, 0.01];
/// Linear programs under one smoothing: the next smoothing moves the optimum anyway.
const SMOOTHED_ITERATION_LIMIT: usize = 40;
/// First trust radii under the exact law: kinks decide which one gets furthest.
const FIRST_RADII: [f64; 3] = [0.5, 0.3, 0.2];
/// Trust radius of a start, of which its torques may be far from the optimum.
const START_RADIUS: f64 = 0.3;
/// Trust radius of all later descents: large enough to jump off a kink.
const RADIUS: f64 = 0.1;
const POLISH_LIMIT: usize = 4;
/// A round of polishing that gains less than this share of the final time is the last one.
const POLISH_GAIN: f64 = 3e-6;
/// A plan that loses more than this share of its final time on another grid has left its local optimum.
const ADAPTION_LOSS: f64 = 5e-3;
/// Prices of the goal errors, s/m: the first one exceeds the multipliers of most maneuvers, the second is for the rest.
pub(super) const WEIGHTS: [f64; 2] = [5.0, 50.0];
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
    /// The winding of the goal heading that it meets.
    pub(super) goal_heading: Option<f64>,
}

impl Candidate {
    pub(super) fn final_time(&self) -> f64 {
        self.decision[self.decision.len() - 1]
    }

    /// Faster among those that meet the goal, else nearer to the goal. A NaN is never better.
    pub(super) fn is_better_than(&self, other: &Self, goal_tolerance: f64) -> bool {
        match (self.goal_error <= goal_tolerance, other.goal_error <= goal_tolerance) {
            (true, true) => self.final_time() < other.final_time(),
            (true, false) => true,
            (false, true) => false,
            (false, false) => self.goal_error < other.goal_error,
        }
    }
}

/// The searches of one solve share problem, budget and the best candidate so far.
pub(super) struct LocalSearch<'a, 'b, 'c> {
    problem: &'a mut ShootingProblem<'b>,
    scales: GoalScales,
    settings: &'a SolverSettings,
    control: &'a RunControl<'c>,
    budget: Budget<'c>,
    /// (running start, number of starts).
    start: (usize, usize),
    goal_heading: Option<f64>,
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
        let budget = Budget::new(control.stop_flag(), rollout_limit);
        let scales = problem.goal_scales();
        Self {
            problem,
            scales,
            settings,
            control,
            budget,
            start: (0, 0),
            goal_heading: None,
            best: None,
            iterations: 0,
        }
    }

    /// Searches from one start of several; the local optimum is also kept when it is the best so far.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn run_from(&mut self, start: &Start, number: (usize, usize)) -> Result<Candidate, Interruption> {
        self.start = number;
        self.aim(start.goal_heading);
        let guess = decision_from_schedule(&start.schedule);
        match self.settings.method {
            Method::SequentialLinear => match start.way {
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
        self.aim(candidate.goal_heading);
        let tolerance = self.settings.goal_tolerance;
        let slowest = (1.0 + ADAPTION_LOSS) * candidate.final_time();
        let arrived = |best: &Candidate| best.goal_error <= tolerance && best.final_time() <= slowest;
        let mut best = self.descend(&candidate.decision, WEIGHTS[0], RADIUS)?;
        if !arrived(&best) {
            let next = self.descend(&candidate.decision, WEIGHTS[1], START_RADIUS)?;
            keep_better(&mut best, next, tolerance);
        }
        if !arrived(&best) {
            let smoothed = self.through_smoothing(&candidate.decision, &POLISH_SMOOTHING, RADIUS)?;
            let next = self.descend(&smoothed, WEIGHTS[0], RADIUS)?;
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
        self.aim(candidate.goal_heading);
        let tolerance = self.settings.goal_tolerance;
        let mut best = candidate;
        for _ in 0..POLISH_LIMIT {
            let before = best.final_time();
            for radius in [START_RADIUS, RADIUS] {
                let next = self.descend(&best.decision, WEIGHTS[0], radius)?;
                keep_better(&mut best, next, tolerance);
            }
            let smoothed = self.through_smoothing(&best.decision, &POLISH_SMOOTHING, RADIUS)?;
            let next = self.descend(&smoothed, WEIGHTS[0], RADIUS)?;
            keep_better(&mut best, next, tolerance);
            if before - best.final_time() < POLISH_GAIN * before {
                break;
            }
        }
        Ok(best)
    }

    /// Under the exact law from several trust radii, then again from the best point until that gains nothing.
    fn directly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let tolerance = self.settings.goal_tolerance;
        let mut best = self.descend(guess, WEIGHTS[0], FIRST_RADII[0])?;
        for radius in &FIRST_RADII[1..] {
            let next = self.descend(guess, WEIGHTS[0], *radius)?;
            keep_better(&mut best, next, tolerance);
        }
        for _ in 0..POLISH_LIMIT {
            let before = best.final_time();
            let weight = if best.goal_error <= tolerance { WEIGHTS[0] } else { WEIGHTS[1] };
            let next = self.descend(&best.decision, weight, RADIUS)?;
            keep_better(&mut best, next, tolerance);
            if before - best.final_time() < POLISH_GAIN * before {
                break;
            }
        }
        Ok(best)
    }

    /// Through ever less smoothing to the exact law.
    fn smoothly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let smoothed = self.through_smoothing(guess, &SMOOTHING, START_RADIUS)?;
        let tolerance = self.settings.goal_tolerance;
        let mut best = self.descend(&smoothed, WEIGHTS[0], RADIUS)?;
        if best.goal_error > tolerance {
            let next = self.descend(&smoothed, WEIGHTS[1], START_RADIUS)?;
            keep_better(&mut best, next, tolerance);
        }
        Ok(best)
    }

    fn through_smoothing(
        &mut self,
        guess: &DVector<f64>,
        smoothings: &[f64],
        first_radius: f64,
    ) -> Result<DVector<f64>, Interruption> {
        let mut decision = guess.clone();
        let mut radius = first_radius;
        for &smoothing in smoothings {
            let settings = SequentialLinearSettings {
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
        if result.unrestored <= VIOLATION_PAID || weight >= WEIGHTS[1] {
            return Ok(self.candidate(&result));
        }
        let dearer = self.descend_at_price(&result.x, WEIGHTS[1], radius)?;
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
            ..SequentialLinearSettings::default()
        };
        let (control, start, scales) = (self.control, self.start, &self.scales);
        let mut tell = |x: &DVector<f64>, residual: &DVector<f64>| {
            report(control, start, x, scales.largest_goal_error(residual));
        };
        let result = minimise_sequentially(self.problem, guess, &settings, &mut self.budget, &mut tell);
        self.iterations += result.iterations;
        let candidate = self.candidate(&result);
        self.note(&candidate);
        match result.ending {
            Ending::Interrupted(interruption) => Err(interruption),
            Ending::Stationary | Ending::SmallGains | Ending::SmallRadius | Ending::IterationLimit => Ok(result),
        }
    }

    fn candidate(&self, result: &SequentialLinearResult) -> Candidate {
        Candidate {
            goal_error: self.scales.largest_goal_error(&result.residual),
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
        let (control, start, scales) = (self.control, self.start, &self.scales);
        let goal_error = Cell::new(f64::NAN);
        let mut penalty = Penalty::new(self.problem);
        let mut value = |x: &DVector<f64>| {
            let value = penalty.value(x);
            goal_error.set(scales.largest_goal_error(penalty.residual()));
            value
        };
        let mut best_goal_error = f64::NAN;
        let mut tell = |x: &DVector<f64>| {
            best_goal_error = goal_error.get();
            report(control, start, x, best_goal_error);
        };
        let result = minimise_by_nelder_mead(&mut value, guess, &settings, &mut self.budget, &mut tell);
        self.iterations += result.iterations;
        let decision = result.x.zip_zip_map(self.problem.lower(), self.problem.upper(), f64::clamp);
        let candidate = Candidate { decision, goal_error: best_goal_error, goal_heading: self.goal_heading };
        self.note(&candidate);
        result.interruption.map_or(Ok(candidate), Err)
    }

    fn aim(&mut self, goal_heading: Option<f64>) {
        self.goal_heading = goal_heading;
        if let Some(heading) = goal_heading {
            self.problem.aim_at_heading(heading);
        }
    }

    fn note(&mut self, candidate: &Candidate) {
        let tolerance = self.settings.goal_tolerance;
        if self.best.as_ref().is_none_or(|best| candidate.is_better_than(best, tolerance)) {
            self.best = Some(candidate.clone());
        }
    }
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
