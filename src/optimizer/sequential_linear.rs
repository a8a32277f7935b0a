//! Trust-region sequential linear programming on an exact l1 penalty.
//!
//! ```text
//! merit(x) = cost' x + penalty_parameter (|residual(x)|_1 + |inequality(x)+|_1)
//! ```
//!
//! Source: the penalty successive linear programming of Zhang, Kim & Lasdon (1985), which is Fletcher's `Sl1QP` ("Practical
//! Methods of Optimization", 1987) with a linear model.
//!
//! Each iteration minimises the merit's linear model in a box about x (an elastic program) and tries the step. Where the
//! merit falls by much less than predicted, a second-order correction (Fletcher 1982), here the least change that removes
//! the residuals' curvature, is tried too, and the better point is kept. Acceptance depends on the merit alone: at a
//! contact's slip reversal the derivative can be wrong. Time-optimal torques are bang-bang, so most variables end at a
//! bound and the linear model is as good as a quadratic one.

mod criticality;

pub use criticality::{CriticalityMeasure, CriticalitySettings, criticality_measure};
use nalgebra::DVector;

use super::elastic_program::{ElasticProgram, violation_sum};
use super::evaluation::{Budget, Constraints, Interruption, Linearisation, Problem};
use super::linear_program::ElasticSolver;
use super::pseudo_solve::pseudo_solve;

/// Parameters of the iteration; the defaults were chosen by measurements on the paper's forward drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequentialLinearSettings {
    /// Penalty parameter of the merit; the penalty is exact when it exceeds every multiplier of the problem.
    pub penalty_parameter: f64,
    /// First trust radius, as a fraction of each variable's scale.
    pub first_radius: f64,
    /// Residuals of at most this magnitude are met.
    pub feasibility_tolerance: f64,
    /// Inequalities violated by at most this much are met.
    pub inequality_tolerance: f64,
    /// The iteration ends where the model predicts at most this much decrease of the merit.
    pub smallest_prediction: f64,
    /// The merit to beat: the iteration ends where the model no longer promises to.
    pub merit_to_beat: f64,
    /// Most iterations.
    pub iteration_limit: usize,
    /// Whether the final point's violations are driven to zero.
    pub restoration: Restoration,
}

/// Whether the final point's violations are driven to zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restoration {
    /// Yes: the point is an answer.
    Restore,
    /// No: the point is an intermediate one.
    Skip,
}

impl Default for SequentialLinearSettings {
    fn default() -> Self {
        Self {
            penalty_parameter: 5.0,
            first_radius: 0.3,
            feasibility_tolerance: 1e-9,
            inequality_tolerance: 0.0,
            smallest_prediction: SMALLEST_PREDICTION,
            merit_to_beat: f64::INFINITY,
            iteration_limit: 400,
            restoration: Restoration::Restore,
        }
    }
}

const LARGEST_RADIUS: f64 = 1.0;
const SMALLEST_RADIUS: f64 = 1e-6;
/// Predicted decreases up to this are rounding of the merit.
const SMALLEST_PREDICTION: f64 = 1e-7;
/// Gains below this, several times in a row near feasibility, end the iteration.
const SMALL_GAIN: f64 = 1e-5;
const SMALL_GAIN_LIMIT: usize = 6;
const GROW_RATIO: f64 = 0.5;
const GROW_FACTOR: f64 = 2.0;
const SHRINK_RATIO: f64 = 0.1;
const SHRINK_FACTOR: f64 = 0.4;
/// A trial that gains less than this share of the prediction is corrected.
const CORRECTION_RATIO: f64 = 0.1;
/// Corrections above this share of their step are not tried: of 8,000 in two searches, larger ones helped one time in
/// fifteen, smaller ones two times in three.
const LARGEST_CORRECTION: f64 = 0.2;
/// Residual norm at which small gains start to count as convergence.
const NEAR_FEASIBLE: f64 = 1e-4;
const RESTORATION_LIMIT: usize = 20;
const SHORTENING_LIMIT: usize = 4;

/// A merit that would not be beaten by this multiple of the prediction is given up: of 400 hops that gained in a search, those
/// that this rule ends had a sixteenth of the gain, and it saves two thirds of the rollouts.
const HOPE: f64 = 2.0;

/// Why the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The linear model predicts no further decrease.
    Stationary,
    /// Several steps in a row gained very little.
    SmallGains,
    /// The trust region shrank to its smallest radius: a kink of the merit.
    SmallRadius,
    /// The merit to beat is out of reach.
    Hopeless,
    /// The iteration limit.
    IterationLimit,
    /// The budget ended it.
    Interrupted(Interruption),
}

/// The best point found.
#[derive(Debug, Clone, PartialEq)]
pub struct SequentialLinearResult {
    /// The point.
    pub x: DVector<f64>,
    /// Its constraint values.
    pub constraints: Constraints,
    /// Largest violation before the restoration: not small when the penalty parameter is below the multipliers of the
    /// problem, so that a violation lowers the merit.
    pub unrestored: f64,
    /// Linear programs solved.
    pub iterations: u64,
    /// Why it ended.
    pub ending: Ending,
}

/// Minimises `cost' x` subject to `residual = 0`, `inequality <= 0` and the bounds, from `start`.
///
/// `on_improvement` is called with each accepted point and its constraint values.
pub fn minimise_sequentially(
    problem: &mut dyn Problem,
    start: &DVector<f64>,
    settings: &SequentialLinearSettings,
    budget: &mut Budget,
    on_improvement: &mut dyn FnMut(&DVector<f64>, &Constraints),
) -> SequentialLinearResult {
    let mut search = Search::new(problem, start, settings);
    let descent = search.descend(budget, on_improvement);
    let unrestored = search.model.constraints.violation();
    let ending = match descent {
        Ok(ending) if ending == Ending::Hopeless || settings.restoration == Restoration::Skip => ending,
        Ok(ending) => search.restore(budget).map_or_else(Ending::Interrupted, |()| ending),
        Err(interruption) => Ending::Interrupted(interruption),
    };
    let Search { x, model, iterations, .. } = search;
    SequentialLinearResult { x, constraints: model.constraints, unrestored, iterations, ending }
}

struct Search<'a> {
    problem: &'a mut dyn Problem,
    settings: &'a SequentialLinearSettings,
    programs: ElasticSolver,
    x: DVector<f64>,
    /// Its constraint values are those of x; so are its derivatives, when it is current.
    model: Linearisation,
    model_is_current: bool,
    radius: f64,
    iterations: u64,
}

/// A point with its constraint values and merit.
struct Trial {
    x: DVector<f64>,
    constraints: Constraints,
    merit: f64,
}

impl<'a> Search<'a> {
    fn new(problem: &'a mut dyn Problem, start: &DVector<f64>, settings: &'a SequentialLinearSettings) -> Self {
        let x = clamped(start, problem.lower(), problem.upper());
        let mut model = Linearisation::new(problem.constraints(), start.len());
        // Not known before the first rollout, which the budget may not allow.
        model.constraints.residual.fill(f64::NAN);
        Self {
            problem,
            settings,
            programs: ElasticSolver::new(),
            x,
            model,
            model_is_current: false,
            radius: settings.first_radius,
            iterations: 0,
        }
    }

    fn descend(
        &mut self,
        budget: &mut Budget,
        on_improvement: &mut dyn FnMut(&DVector<f64>, &Constraints),
    ) -> Result<Ending, Interruption> {
        let mut small_gains = 0;
        for _ in 0..self.settings.iteration_limit {
            self.linearise(budget)?;
            let merit = self.merit(&self.x, &self.model.constraints);
            let step = self.linear_step(budget)?;
            self.iterations += 1;
            let prediction = merit - self.modelled_merit(&step);
            if prediction <= self.settings.smallest_prediction {
                return Ok(Ending::Stationary);
            }
            if merit - HOPE * prediction > self.settings.merit_to_beat {
                return Ok(Ending::Hopeless);
            }
            let trial = self.try_step(&step, merit - CORRECTION_RATIO * prediction, budget)?;
            let gain = merit - trial.merit;
            self.adapt_radius(gain / prediction);
            if gain > 0.0 {
                self.accept(trial);
                on_improvement(&self.x, &self.model.constraints);
                let is_small = gain < SMALL_GAIN && self.model.constraints.violation() < NEAR_FEASIBLE;
                small_gains = if is_small { small_gains + 1 } else { 0 };
                if small_gains >= SMALL_GAIN_LIMIT {
                    return Ok(Ending::SmallGains);
                }
            }
            if self.radius < SMALLEST_RADIUS {
                return Ok(Ending::SmallRadius);
            }
        }
        Ok(Ending::IterationLimit)
    }

    fn linearise(&mut self, budget: &mut Budget) -> Result<(), Interruption> {
        if !self.model_is_current {
            let stop = budget.spend()?;
            self.problem.linearise(&self.x, &mut self.model, stop)?;
            self.model_is_current = true;
        }
        Ok(())
    }

    /// The minimiser of the linear model in the trust region.
    fn linear_step(&mut self, budget: &Budget) -> Result<DVector<f64>, Interruption> {
        let half_width = self.problem.variable_scale(&self.x) * self.radius;
        let lower = (self.problem.lower() - &self.x).zip_map(&half_width, |bound, half_width| bound.max(-half_width));
        let upper = (self.problem.upper() - &self.x).zip_map(&half_width, f64::min);
        let program = ElasticProgram {
            matrix: &self.model.jacobian,
            target: &-self.model.rows_of(&self.model.constraints),
            row_name: &self.model.row_names(),
            equation_count: self.equation_count(),
            cost: self.problem.cost(),
            lower: &lower,
            upper: &upper,
            penalty_parameter: self.settings.penalty_parameter,
        };
        Ok(self.programs.solve(&program, budget.stop())?.x)
    }

    fn equation_count(&self) -> usize {
        self.model.constraints.residual.len()
    }

    /// The linear model's rows after a step.
    fn modelled_rows(&self, step: &DVector<f64>) -> DVector<f64> {
        self.model.rows_of(&self.model.constraints) + &self.model.jacobian * step
    }

    /// The merit's linear model after a step.
    fn modelled_merit(&self, step: &DVector<f64>) -> f64 {
        let violation = violation_sum(&self.modelled_rows(step), self.equation_count());
        self.problem.cost().dot(&(&self.x + step)) + self.settings.penalty_parameter * violation
    }

    /// The point after the step; if its merit exceeds `good_merit`, its correction is tried too, and the better one is
    /// kept.
    fn try_step(&mut self, step: &DVector<f64>, good_merit: f64, budget: &mut Budget) -> Result<Trial, Interruption> {
        let trial = self.evaluate(&(&self.x + step), budget)?;
        if trial.merit <= good_merit {
            return Ok(trial);
        }
        let missed = self.model.rows_of(&trial.constraints) - self.modelled_rows(step);
        let rows = self.violated_rows(&trial.constraints);
        let Some(correction) = self.least_change(&trial.x, &rows, &missed) else { return Ok(trial) };
        if correction.norm() > LARGEST_CORRECTION * step.norm() {
            return Ok(trial);
        }
        let corrected = self.evaluate(&(&trial.x - correction), budget)?;
        Ok(if corrected.merit < trial.merit { corrected } else { trial })
    }

    fn evaluate(&mut self, x: &DVector<f64>, budget: &mut Budget) -> Result<Trial, Interruption> {
        let stop = budget.spend()?;
        let x = clamped(x, self.problem.lower(), self.problem.upper());
        let mut constraints = self.problem.constraints();
        self.problem.evaluate(&x, &mut constraints, stop)?;
        let merit = self.merit(&x, &constraints);
        Ok(Trial { x, constraints, merit })
    }

    fn accept(&mut self, trial: Trial) {
        self.x = trial.x;
        self.model.constraints = trial.constraints;
        self.model_is_current = false;
    }

    fn adapt_radius(&mut self, ratio: f64) {
        if ratio > GROW_RATIO {
            self.radius = (GROW_FACTOR * self.radius).min(LARGEST_RADIUS);
        } else if ratio < SHRINK_RATIO || ratio.is_nan() {
            self.radius *= SHRINK_FACTOR;
        }
    }

    /// Drives the violations of the final point to zero by least changes of the variables that are off their bounds.
    fn restore(&mut self, budget: &mut Budget) -> Result<(), Interruption> {
        for _ in 0..RESTORATION_LIMIT {
            let constraints = &self.model.constraints;
            let is_kept = constraints.largest_inequality_violation() <= self.settings.inequality_tolerance;
            if constraints.residual.amax() <= self.settings.feasibility_tolerance && is_kept {
                return Ok(());
            }
            self.linearise(budget)?;
            let rows = self.violated_rows(&self.model.constraints);
            let missed = self.model.rows_of(&self.model.constraints);
            let Some(change) = self.least_change(&self.x, &rows, &missed) else { return Ok(()) };
            if !self.shorten_until_better(&change, budget)? {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Takes the change, or a half, a quarter, ... of it: at a kink only a part may reduce the violation. False when none
    /// does.
    fn shorten_until_better(&mut self, change: &DVector<f64>, budget: &mut Budget) -> Result<bool, Interruption> {
        let mut share = 1.0;
        for _ in 0..SHORTENING_LIMIT {
            let trial = self.evaluate(&(&self.x - change * share), budget)?;
            if trial.constraints.violation() < self.model.constraints.violation() {
                self.accept(trial);
                return Ok(true);
            }
            share *= 0.5;
        }
        Ok(false)
    }

    /// All residuals, and the rows of violated inequalities.
    fn violated_rows(&self, constraints: &Constraints) -> Vec<usize> {
        let equations = self.equation_count();
        let working_set = self.model.working_set.iter().enumerate();
        let violated = working_set.filter(|(_, index)| constraints.inequality[**index] > 0.0);
        (0..equations).chain(violated.map(|(row, _)| equations + row)).collect()
    }

    /// The smallest change (in units of the variable scales) of the variables off their bounds whose linear effect on
    /// `rows` is `missed`.
    fn least_change(&self, x: &DVector<f64>, rows: &[usize], missed: &DVector<f64>) -> Option<DVector<f64>> {
        let mut scale = self.problem.variable_scale(x);
        for (index, scale) in scale.iter_mut().enumerate() {
            if x[index] <= self.problem.lower()[index] || x[index] >= self.problem.upper()[index] {
                *scale = 0.0;
            }
        }
        let mut scaled = self.model.jacobian.select_rows(rows);
        for (mut column, scale) in scaled.column_iter_mut().zip(scale.iter()) {
            column *= *scale;
        }
        let weights = pseudo_solve(&(&scaled * scaled.transpose()), &missed.select_rows(rows))?;
        Some((scaled.transpose() * weights).component_mul(&scale))
    }

    fn merit(&self, x: &DVector<f64>, constraints: &Constraints) -> f64 {
        self.problem.cost().dot(x) + self.settings.penalty_parameter * constraints.violation_sum()
    }
}

fn clamped(x: &DVector<f64>, lower: &DVector<f64>, upper: &DVector<f64>) -> DVector<f64> {
    x.zip_zip_map(lower, upper, f64::clamp)
}
