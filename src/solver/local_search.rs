//! Descents of the search; all descents of one part share a rollout budget.

use std::cell::Cell;
use std::sync::Arc;

use nalgebra::DVector;

use super::candidate::{Candidate, Stationarity, improves, keep_better};
use super::run_control::{RunControl, SolveProgress};
use super::settings::SolverSettings;
use crate::optimizer::{
    Budget, Constraints, Ending, Interruption, NelderMeadSettings, Problem, SequentialLinearResult,
    SequentialLinearSettings, minimise_by_nelder_mead, minimise_sequentially,
};
use crate::shooting::{GoalScales, NORMAL_LOAD_TOLERANCE, Penalty, ShootingProblem};
use crate::stop::Stop;

/// Least penalty parameters of the goal errors, s/m: the first one exceeds the multipliers of most maneuvers, the second is
/// for the rest.
const LEAST_PENALTY_PARAMETERS: [f64; 2] = [5.0, 50.0];
/// The penalty of standing still, in units of the final time: if it is cheaper than the maneuver, the search collapses to
/// final time zero.
const STANDING_COST: f64 = 2.0;
const PENALTY_GROWTH: f64 = 10.0;
/// With a larger penalty parameter the rounding of the rows would exceed the resolution of the final time.
const LARGEST_PENALTY_PARAMETER: f64 = 1e3;
/// A scaled residual above this before the restoration means that the penalty parameter was below a multiplier.
const PENALTY_TOO_SMALL: f64 = 1e-4;
/// A descent that violates the goal and ends below this share of its guess's final time has collapsed.
const COLLAPSED_SHARE: f64 = 0.7;
/// The tolerance of the restoration, as a share of the goal tolerance.
const FEASIBILITY_MARGIN: f64 = 1e-2;

/// First edge of the simplex, as a fraction of each variable's scale.
const NELDER_MEAD_EDGE: f64 = 0.2;
/// Large enough that idle restarts end the search first.
const NELDER_MEAD_RESTART_LIMIT: usize = 1000;
const NELDER_MEAD_VALUE_TOLERANCE: f64 = 1e-6;
const NELDER_MEAD_SMALLEST_GAIN: f64 = 1e-5;

/// The searches of one part of a solve share problem, budget and the best candidate so far.
pub(super) struct LocalSearch<'a, 'b, 'c> {
    pub(super) problem: &'a mut ShootingProblem<'b>,
    scales: GoalScales,
    pub(super) settings: &'a SolverSettings,
    pub(super) control: &'a RunControl<'c>,
    pub(super) budget: Budget<'c>,
    /// (running start, number of starts).
    pub(super) start: (usize, usize),
    goal_heading: Option<f64>,
    pub(super) penalty_parameters: [f64; 2],
    best: Option<Candidate>,
    pub(super) iterations: u64,
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
            penalty_parameters: LEAST_PENALTY_PARAMETERS,
            best: None,
            iterations: 0,
        }
    }

    pub(super) fn into_parts(self) -> (Option<Candidate>, u64, u64) {
        (self.best, self.iterations, self.budget.spent())
    }

    /// Descends under the exact law and restores the goal; again with the larger penalty parameter where the smaller one
    /// left the goal violated.
    pub(super) fn descend(
        &mut self,
        guess: &DVector<f64>,
        penalty_parameter: f64,
        radius: f64,
    ) -> Result<Candidate, Interruption> {
        let smallest_prediction = SequentialLinearSettings::default().smallest_prediction;
        self.descend_until(guess, (penalty_parameter, radius), (smallest_prediction, f64::INFINITY))
    }

    /// As [`Self::descend`], as long as the linear model promises more than a smallest prediction, s, and a final time below
    /// the one to beat.
    pub(super) fn descend_until(
        &mut self,
        guess: &DVector<f64>,
        (penalty_parameter, radius): (f64, f64),
        (smallest_prediction, time_to_beat): (f64, f64),
    ) -> Result<Candidate, Interruption> {
        let until = (smallest_prediction, time_to_beat);
        let result = self.descend_with_penalty(guess, (penalty_parameter, radius), until)?;
        let is_last = penalty_parameter >= self.penalty_parameters[1] || result.ending == Ending::Hopeless;
        if result.unrestored <= PENALTY_TOO_SMALL || is_last {
            return Ok(self.candidate(&result));
        }
        let from = if has_collapsed(&result.x, guess) {
            // Start again from the guess; later descents with the smaller penalty parameter would collapse too.
            self.penalty_parameters[0] = self.penalty_parameters[1];
            guess
        } else {
            &result.x
        };
        let stricter = self.descend_with_penalty(from, (self.penalty_parameters[1], radius), until)?;
        let (mut best, next) = (self.candidate(&result), self.candidate(&stricter));
        keep_better(&mut best, next, self.settings.goal_tolerance);
        Ok(best)
    }

    fn descend_with_penalty(
        &mut self,
        guess: &DVector<f64>,
        (penalty_parameter, radius): (f64, f64),
        (smallest_prediction, merit_to_beat): (f64, f64),
    ) -> Result<SequentialLinearResult, Interruption> {
        let settings = SequentialLinearSettings {
            penalty_parameter,
            first_radius: radius,
            feasibility_tolerance: FEASIBILITY_MARGIN * self.settings.goal_tolerance * self.scales.smallest(),
            inequality_tolerance: NORMAL_LOAD_TOLERANCE,
            smallest_prediction,
            merit_to_beat,
            ..SequentialLinearSettings::default()
        };
        let (control, start, scales, goal_heading) = (self.control, self.start, &self.scales, self.goal_heading);
        let tolerance = self.settings.goal_tolerance;
        // The latest feasible point is the fastest one, because the merit decreases monotonically.
        let mut passed = None;
        let mut report_improvement = |x: &DVector<f64>, constraints: &Constraints| {
            let goal_error = scales.largest_goal_error(&constraints.residual);
            let breaks_limits = constraints.largest_inequality_violation() > NORMAL_LOAD_TOLERANCE;
            if goal_error > tolerance || !breaks_limits {
                report(control, start, x, goal_error);
            }
            if goal_error <= tolerance && !breaks_limits {
                passed = Some(Candidate::new(x.clone(), goal_error, breaks_limits, goal_heading));
            }
        };
        let result = minimise_sequentially(self.problem, guess, &settings, &mut self.budget, &mut report_improvement);
        self.iterations += result.iterations;
        let candidate = self.candidate(&result);
        self.note(&candidate);
        // When a descent ends infeasible, its last feasible iterate is kept.
        if let Some(passed) = passed.filter(|_| !candidate.is_feasible(tolerance)) {
            self.note(&passed);
        }
        match result.ending {
            Ending::Interrupted(interruption) => Err(interruption),
            Ending::Stationary
            | Ending::SmallGains
            | Ending::SmallRadius
            | Ending::Hopeless
            | Ending::IterationLimit => Ok(result),
        }
    }

    fn candidate(&self, result: &SequentialLinearResult) -> Candidate {
        let goal_error = self.scales.largest_goal_error(&result.constraints.residual);
        let breaks_limits = self.problem.breaks_limits(&result.constraints);
        Candidate::new(result.x.clone(), goal_error, breaks_limits, self.goal_heading)
    }

    pub(super) fn nelder_mead(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let settings = NelderMeadSettings {
            edge: self.problem.variable_scale(guess) * NELDER_MEAD_EDGE,
            restart_limit: NELDER_MEAD_RESTART_LIMIT,
            value_tolerance: NELDER_MEAD_VALUE_TOLERANCE,
            smallest_gain: NELDER_MEAD_SMALLEST_GAIN,
        };
        let (control, start, scales, tolerance) =
            (self.control, self.start, &self.scales, self.settings.goal_tolerance);
        let last = Cell::new((f64::NAN, true));
        let mut penalty = Penalty::new(self.problem);
        let mut value = |x: &DVector<f64>, stop: Stop| {
            let value = penalty.value(x, stop)?;
            last.set((scales.largest_goal_error(&penalty.constraints().residual), penalty.breaks_limits()));
            Ok(value)
        };
        let mut best = last.get();
        let mut report_improvement = |x: &DVector<f64>| {
            best = last.get();
            if best.0 > tolerance || !best.1 {
                report(control, start, x, best.0);
            }
        };
        let result = minimise_by_nelder_mead(&mut value, guess, &settings, &mut self.budget, &mut report_improvement);
        self.iterations += result.iterations;
        let decision = result.x.zip_zip_map(self.problem.lower(), self.problem.upper(), f64::clamp);
        let (goal_error, breaks_limits) = best;
        let candidate = Candidate::new(decision, goal_error, breaks_limits, self.goal_heading);
        self.note(&candidate);
        result.interruption.map_or(Ok(candidate), Err)
    }

    pub(super) fn aim(&mut self, goal_heading: Option<f64>, final_time: f64) {
        self.goal_heading = goal_heading;
        if let Some(heading) = goal_heading {
            self.problem.aim_at_heading(heading);
        }
        self.penalty_parameters = penalty_parameters(self.problem, final_time);
    }

    /// Stores the criticality measure of a candidate, also with the best one if they are the same.
    pub(super) fn note_stationarity(&mut self, candidate: &mut Candidate, stationarity: Stationarity) {
        candidate.stationarity = Some(Arc::new(stationarity));
        if let Some(best) = self.best.as_mut().filter(|best| best.decision == candidate.decision) {
            best.stationarity.clone_from(&candidate.stationarity);
        }
    }

    fn note(&mut self, candidate: &Candidate) {
        let tolerance = self.settings.goal_tolerance;
        if improves(self.best.as_ref(), candidate, tolerance) {
            self.best = Some(candidate.clone());
            // A decision that meets the goal beyond the limits is not reported.
            if candidate.goal_error > tolerance || candidate.is_feasible(tolerance) {
                report(self.control, self.start, &candidate.decision, candidate.goal_error);
            }
        }
    }
}

/// Whether a descent gave up the goal for a shorter final time.
fn has_collapsed(x: &DVector<f64>, guess: &DVector<f64>) -> bool {
    let last = guess.len() - 1;
    x[last] < COLLAPSED_SHARE * guess[last]
}

/// Penalty parameters of the goal errors for a maneuver of about this final time, s/m: the usual and the larger one.
pub(super) fn penalty_parameters(problem: &ShootingProblem, final_time: f64) -> [f64; 2] {
    let standing = STANDING_COST * final_time / problem.violation_at_start();
    let [usual, large] = LEAST_PENALTY_PARAMETERS;
    let usual = standing.clamp(usual, LARGEST_PENALTY_PARAMETER);
    [usual, large.max(PENALTY_GROWTH * usual).min(LARGEST_PENALTY_PARAMETER)]
}

fn report(control: &RunControl, (start, start_count): (usize, usize), x: &DVector<f64>, goal_error: f64) {
    let best_final_time = x[x.len() - 1];
    control.report(&SolveProgress { best_final_time, best_goal_error: goal_error, start, start_count });
}
