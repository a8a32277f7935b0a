//! Descents of the search; all descents of one part share a rollout budget.

use std::sync::Arc;

use nalgebra::DVector;

use super::candidate::{CRITICALITY_TOLERANCE, Candidate, Stationarity, improves, keep_best};
use super::run_control::{RunControl, SolveProgress};
use super::settings::SolverSettings;
use crate::optimizer::{
    Budget, Constraints, ElasticSolver, FIRST_RADIUS, Interruption, PENALTY_GROWTH, Problem, SequentialLinearSettings,
    criticality_measure, minimise_by_nelder_mead, minimise_sequentially,
};
use crate::shooting::{ShootingProblem, wrapped_angle};
use crate::stop::Stop;

/// First penalty parameter: standing still costs this many times the unit of time, more than any multiplier of most
/// maneuvers. Larger ones follow curved constraints in smaller steps.
const PENALTY: f64 = 30.0;
/// First penalty parameter of the criticality measure.
pub(super) const STRICT_PENALTY: f64 = PENALTY_GROWTH * PENALTY;
/// The largest penalty parameter.
pub(super) const LARGEST_PENALTY: f64 = PENALTY_GROWTH * PENALTY_GROWTH * STRICT_PENALTY;
/// Descents end where less than this share of the unit of time is predicted: to gain the rest would take a third of the rollouts, and
/// more with limits, where steps along curved constraints stay short. `converged` allows ten times as much.
pub(super) const SMALLEST_PREDICTION: f64 = 1e-5;
/// Most linear programs of a descent. Of 10,000 one takes more than 600; a descent may crawl along a kink for ever.
const ITERATION_LIMIT: usize = 1_000;
/// The tolerance of the restoration, as a share of the goal tolerance.
const FEASIBILITY_MARGIN: f64 = 1e-2;

/// The searches of one part of a solve share problem, budget and the best candidate so far.
pub(super) struct LocalSearch<'a> {
    pub(super) problem: ShootingProblem<'a>,
    pub(super) settings: &'a SolverSettings,
    pub(super) control: RunControl<'a>,
    pub(super) budget: Budget<'a>,
    pub(super) programs: ElasticSolver,
    /// Steps of the grid on which starts are compared.
    pub(super) coarse_step_count: usize,
    /// (running start, number of starts).
    pub(super) start: (usize, usize),
    pub(super) best: Option<Candidate>,
}

impl<'a> LocalSearch<'a> {
    pub(super) fn new(
        problem: ShootingProblem<'a>,
        settings: &'a SolverSettings,
        control: &RunControl<'a>,
        rollout_limit: u64,
    ) -> Self {
        Self {
            problem,
            settings,
            control: *control,
            budget: Budget::new(control.stop(), rollout_limit),
            programs: ElasticSolver::default(),
            coarse_step_count: usize::MAX,
            start: (0, 0),
            best: None,
        }
    }

    /// Has so many torques per wheel from now on; the last vertex of a linear program says nothing of the next one.
    pub(super) fn set_control_count(&mut self, control_count: usize) {
        self.problem.set_control_count(control_count);
        self.programs = ElasticSolver::default();
    }

    /// Descends under the exact law and restores the goal.
    pub(super) fn descend(&mut self, guess: &DVector<f64>, radius: f64) -> Result<Candidate, Interruption> {
        self.descend_until(guess, (radius, None), (SMALLEST_PREDICTION, f64::INFINITY))
    }

    /// As [`Self::descend`], as long as the linear model promises more than a smallest prediction, as a share of the unit of
    /// time, and a final time below the one to beat, s. Residuals that are accepted count as none.
    pub(super) fn descend_until(
        &mut self,
        guess: &DVector<f64>,
        (radius, accepted): (f64, Option<&DVector<f64>>),
        (smallest_prediction, time_to_beat): (f64, f64),
    ) -> Result<Candidate, Interruption> {
        let merit_to_beat = time_to_beat / self.problem.time_unit();
        let settings = SequentialLinearSettings { merit_to_beat, ..self.descent(radius, smallest_prediction) };
        let (tolerance, inequality_tolerance) = (self.settings.goal_tolerance, self.problem.inequality_tolerance());
        let (scales, goal_heading) = (self.problem.goal_scales(), self.problem.goal_heading());
        let is_stand_in = self.problem.is_stand_in();
        // The latest feasible point is the fastest one since the penalty parameter last grew: the merit only falls.
        let mut passed = None;
        let mut report_each = |x: &DVector<f64>, constraints: &Constraints| {
            let goal_error = scales.largest_goal_error(&constraints.residual);
            let breaks_limits = constraints.largest_inequality_violation() > inequality_tolerance;
            let reached = Candidate::new(x.clone(), goal_heading).judged((goal_error, tolerance), breaks_limits);
            let is_feasible = reached.is_feasible();
            if !(is_stand_in && is_feasible) {
                report(&self.control, self.start, &reached);
            }
            if is_feasible {
                passed = Some(reached);
            }
        };
        let from = (guess, &mut self.programs);
        let result =
            minimise_sequentially(&mut self.problem, from, (&settings, accepted), &mut self.budget, &mut report_each);
        let candidate = self.candidate(result.x, &result.constraints);
        self.note(&candidate);
        // When a descent ends infeasible, its last feasible iterate is kept.
        if let Some(passed) = passed.filter(|_| !candidate.is_feasible()) {
            self.note(&passed);
        }
        result.ending.map(|()| candidate)
    }

    /// The settings of a descent to the goal.
    pub(super) fn descent(&self, first_radius: f64, smallest_prediction: f64) -> SequentialLinearSettings {
        let smallest_scale = self.problem.goal_scales().smallest();
        SequentialLinearSettings {
            penalty_parameter: PENALTY,
            largest_penalty_parameter: LARGEST_PENALTY,
            first_radius,
            feasibility_tolerance: FEASIBILITY_MARGIN * self.settings.goal_tolerance * smallest_scale,
            inequality_tolerance: self.problem.inequality_tolerance(),
            smallest_prediction,
            merit_to_beat: f64::INFINITY,
            iteration_limit: ITERATION_LIMIT,
            restores: true,
        }
    }

    /// The final time and what violations cost, s.
    pub(super) fn merit(&self, decision: &DVector<f64>, constraints: &Constraints) -> f64 {
        let violation = PENALTY * constraints.violation_sum();
        decision[decision.len() - 1] + self.problem.time_unit() * violation
    }

    pub(super) fn nelder_mead(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        // A final time below the bound is in the dead zone of the penalty.
        let guess = guess.zip_zip_map(self.problem.lower(), self.problem.upper(), f64::clamp);
        let scale = self.problem.variable_scale(&guess);
        let (scales, tolerance) = (self.problem.goal_scales(), self.settings.goal_tolerance);
        let goal_heading = self.problem.goal_heading();
        let mut best = Candidate { goal_error: f64::NAN, ..Candidate::new(guess.clone(), goal_heading) };
        let mut best_value = f64::INFINITY;
        let mut passed = None;
        let mut value = |x: &DVector<f64>, stop: Stop| {
            let (value, decision, constraints) = self.problem.penalised(x, stop)?;
            let goal_error = scales.largest_goal_error(&constraints.residual);
            let breaks_limits = self.problem.breaks_limits(&constraints);
            let reached = Candidate::new(decision, goal_heading).judged((goal_error, tolerance), breaks_limits);
            keep_best(&mut passed, Some(reached.clone()).filter(Candidate::is_feasible));
            if value < best_value {
                (best, best_value) = (reached, value);
                report(&self.control, self.start, &best);
            }
            Ok(value)
        };
        let result = minimise_by_nelder_mead(&mut value, &guess, &scale, &mut self.budget);
        self.note(&best);
        // The penalty trades the goal for time: its best point may miss what another one, such as the guess, meets.
        if let Some(passed) = passed {
            self.note(&passed);
        }
        result.ending.map(|()| best)
    }

    /// Aims at this goal heading in the winding nearest to where a guess leads: it may turn the other way round, or once more.
    pub(super) fn aim_where_it_leads(&mut self, guess: &DVector<f64>, heading: f64) -> Result<(), Interruption> {
        let stop = self.budget.spend()?;
        let turn = self.problem.end_heading(guess, stop)? - heading;
        // A motion that diverges leads nowhere.
        let whole_turns = if turn.is_finite() { turn - wrapped_angle(turn) } else { 0.0 };
        self.problem.aim(Some(heading + whole_turns));
        Ok(())
    }

    /// The criticality measure of a plan: until half of what counts is predicted.
    pub(super) fn measured(
        &mut self,
        plan: &Candidate,
        penalty_parameter: f64,
    ) -> Result<Arc<Stationarity>, Interruption> {
        let time_unit = self.problem.time_unit();
        let settings = SequentialLinearSettings {
            penalty_parameter,
            feasibility_tolerance: self.settings.goal_tolerance * self.problem.goal_scales().largest(),
            ..self.descent(FIRST_RADIUS, 0.5 * CRITICALITY_TOLERANCE * plan.final_time() / time_unit)
        };
        let from = (&plan.decision, &mut self.programs);
        let measure = criticality_measure(&mut self.problem, from, &settings, &mut self.budget)?;
        Ok(Arc::new(Stationarity { penalty_parameter, time_unit, measure }))
    }

    /// A point with its constraint values, as a candidate.
    pub(super) fn candidate(&self, decision: DVector<f64>, constraints: &Constraints) -> Candidate {
        let goal_error = self.problem.goal_scales().largest_goal_error(&constraints.residual);
        let breaks_limits = self.problem.breaks_limits(constraints);
        let merit = self.merit(&decision, constraints);
        let candidate = Candidate { merit, ..Candidate::new(decision, self.problem.goal_heading()) };
        candidate.judged((goal_error, self.settings.goal_tolerance), breaks_limits)
    }

    /// Keeps a candidate where it is the best one so far that is certain to keep the limits of the maneuver.
    pub(super) fn note(&mut self, candidate: &Candidate) {
        let candidate = if self.problem.is_stand_in() { candidate.clone().not_judged() } else { candidate.clone() };
        if improves(self.best.as_ref(), &candidate) {
            report(&self.control, self.start, &candidate);
        }
        keep_best(&mut self.best, Some(candidate));
    }
}

/// Reports a decision, but for one that meets the goal beyond the limits.
fn report(control: &RunControl, (start, start_count): (usize, usize), reached: &Candidate) {
    if reached.goal_error > reached.goal_tolerance || !reached.breaks_limits {
        let (best_final_time, best_goal_error) = (reached.final_time(), reached.goal_error);
        control.report(&SolveProgress { best_final_time, best_goal_error, start, start_count });
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::shooting::{Goal, Maneuver, PathLimits};
    use crate::simulation::Simulator;
    use crate::solver::settings::SolveInput;

    #[test]
    fn the_goal_heading_is_that_of_the_nearest_whole_turn() {
        let simulator = Simulator::new(&SolveInput::forward_drive().robot);
        let maneuver = Maneuver { goal: Goal::at_rest(0.0, 0.0, 0.5), ..Maneuver::forward_drive() };
        let (settings, control) = (SolverSettings::default(), RunControl::unattended());
        for torque in [0.0, 0.2, 1.0, -1.0] {
            let mut problem = ShootingProblem::new(&simulator, (&maneuver, &PathLimits::default()), (100, 1), 1.0);
            let guess = DVector::from_vec(vec![-torque, torque, 2.0]);
            let led = problem.end_heading(&guess, Stop::never()).unwrap();
            let mut search = LocalSearch::new(problem, &settings, &control, 1);
            search.aim_where_it_leads(&guess, 0.5).unwrap();
            let aimed = search.problem.goal_heading().unwrap();
            let turns = (aimed - 0.5) / (2.0 * PI);
            assert!((aimed - led).abs() <= PI && (turns - turns.round()).abs() < 1e-12, "{aimed} near {led}");
        }
    }
}
