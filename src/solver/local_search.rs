//! From one start to a local optimum.

use std::cell::Cell;

use nalgebra::DVector;

use super::Method;
use super::run_control::{RunControl, SolveProgress};
use super::settings::SolverSettings;
use crate::optimizer::{
    Budget, Ending, Interruption, NelderMeadSettings, Problem, SequentialLinearSettings, minimise_by_nelder_mead,
    minimise_sequentially,
};
use crate::shooting::{GoalScales, Penalty, ShootingProblem};

/// First trust radii that are tried from each start: kinks between contact modes decide which one gets furthest.
const FIRST_RADII: [f64; 3] = [0.5, 0.3, 0.2];
/// Trust radius of the repeats from the best point: large enough to jump off a kink.
const REPEAT_RADIUS: f64 = 0.1;
const REPEAT_LIMIT: usize = 5;
/// A repeat that gains less than this share of the final time is the last one.
const REPEAT_GAIN: f64 = 3e-6;
/// Prices of the goal errors, s/m: the first one exceeds the multipliers of most maneuvers, the second is for the rest.
pub(super) const WEIGHTS: [f64; 2] = [5.0, 50.0];
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
    best: Option<Candidate>,
    iterations: u64,
}

impl<'a, 'b, 'c> LocalSearch<'a, 'b, 'c> {
    pub(super) fn new(
        problem: &'a mut ShootingProblem<'b>,
        settings: &'a SolverSettings,
        control: &'a RunControl<'c>,
    ) -> Self {
        let budget = Budget::new(control.stop_flag(), settings.rollout_limit);
        let scales = problem.goal_scales();
        Self { problem, scales, settings, control, budget, start: (0, 0), best: None, iterations: 0 }
    }

    /// Searches from one start of several; the local optimum is also kept when it is the best so far.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn run_from(&mut self, guess: &DVector<f64>, start: (usize, usize)) -> Result<Candidate, Interruption> {
        self.start = start;
        match self.settings.method {
            Method::SequentialLinear => self.sequential_linear(guess),
            Method::NelderMead => self.nelder_mead(guess),
        }
    }

    pub(super) fn into_parts(self) -> (Option<Candidate>, u64, u64) {
        (self.best, self.iterations, self.budget.spent())
    }

    fn sequential_linear(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let mut local: Option<Candidate> = None;
        for weight in WEIGHTS {
            for radius in FIRST_RADII {
                let candidate = self.descend(guess, weight, radius)?;
                self.keep_better(&mut local, candidate);
            }
            if let Some(found) = local.clone().filter(|found| found.goal_error <= self.settings.goal_tolerance) {
                return self.repeat_from(found, weight);
            }
        }
        Ok(local.expect("at least one radius was tried"))
    }

    /// Opens the trust region again at the best point, until that gains nothing more.
    fn repeat_from(&mut self, mut best: Candidate, weight: f64) -> Result<Candidate, Interruption> {
        for _ in 0..REPEAT_LIMIT {
            let candidate = self.descend(&best.decision, weight, REPEAT_RADIUS)?;
            let gain = best.final_time() - candidate.final_time();
            let is_better = candidate.is_better_than(&best, self.settings.goal_tolerance);
            if is_better {
                best = candidate;
            }
            if !is_better || gain < REPEAT_GAIN * best.final_time() {
                break;
            }
        }
        Ok(best)
    }

    fn descend(&mut self, guess: &DVector<f64>, weight: f64, radius: f64) -> Result<Candidate, Interruption> {
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
        let candidate = Candidate { goal_error: self.scales.largest_goal_error(&result.residual), decision: result.x };
        self.note(&candidate);
        match result.ending {
            Ending::Interrupted(interruption) => Err(interruption),
            Ending::Stationary | Ending::SmallGains | Ending::SmallRadius | Ending::IterationLimit => Ok(candidate),
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
        let candidate = Candidate { decision, goal_error: best_goal_error };
        self.note(&candidate);
        result.interruption.map_or(Ok(candidate), Err)
    }

    fn keep_better(&self, local: &mut Option<Candidate>, candidate: Candidate) {
        if local.as_ref().is_none_or(|best| candidate.is_better_than(best, self.settings.goal_tolerance)) {
            *local = Some(candidate);
        }
    }

    fn note(&mut self, candidate: &Candidate) {
        let tolerance = self.settings.goal_tolerance;
        if self.best.as_ref().is_none_or(|best| candidate.is_better_than(best, tolerance)) {
            self.best = Some(candidate.clone());
        }
    }
}

fn report(control: &RunControl, (start, start_count): (usize, usize), x: &DVector<f64>, goal_error: f64) {
    let best_final_time = x[x.len() - 1];
    control.report(&SolveProgress { best_final_time, best_goal_error: goal_error, start, start_count });
}
