//! Trust-region sequential linear programming on an exact l1 penalty.
//!
//! ```text
//! merit(x) = cost' x + penalty_parameter (|residual(x)|_1 + |inequality(x)+|_1)
//! ```
//!
//! Source: the penalty successive linear programming of Zhang, Kim & Lasdon (1985), which is Fletcher's `Sl1QP` ("Practical
//! Methods of Optimization", 1987) with a linear model.
//!
//! Each iteration minimises the merit's linear model in a box about x (an elastic program) and tries the step. Variables that go to
//! and fro get a share of the box (move limits). Where the merit falls by much less than predicted, a second-order correction
//! (Fletcher 1982), here the least change that removes the residuals' curvature, is tried too, and the better point is kept.
//! Acceptance depends on the merit alone: at a contact's slip reversal the derivative can be wrong. Time-optimal torques are
//! bang-bang, so most variables end at a bound and the linear model is as good as a quadratic one.

mod criticality;
mod move_limits;

pub use criticality::{CriticalityMeasure, criticality_measure};
use nalgebra::{DMatrix, DVector};

use self::move_limits::MoveLimits;
use super::elastic_program::{ElasticProgram, violation_sum};
use super::evaluation::{Budget, Constraints, Interruption, Linearisation, Problem};
use super::independent_rows::weights_of_independent;
use super::linear_program::ElasticSolver;

/// Parameters of the iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequentialLinearSettings {
    /// First penalty parameter of the merit; the penalty is exact when it exceeds every multiplier of the problem.
    pub penalty_parameter: f64,
    /// The penalty parameter grows while it is smaller than this.
    pub largest_penalty_parameter: f64,
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
    /// Most iterations of a descent; after a restoration, under a larger penalty parameter, they are counted afresh.
    pub iteration_limit: usize,
    /// Whether the final point is an answer, whose violations are driven to zero, and no intermediate one.
    pub restores: bool,
}

/// First trust radius at a plan, of descents and of the criticality measure: variables may change by a tenth of their scale, enough to
/// leave a kink.
pub const FIRST_RADIUS: f64 = 0.1;
const LARGEST_RADIUS: f64 = 1.0;
const SMALLEST_RADIUS: f64 = 1e-6;
/// Steps are judged by their share of the decrease that the linear model predicts. The trust region shrinks below this one.
const SHRINK_RATIO: f64 = 0.1;
/// Along curves, those of limits or of friction that slips, a step r gains about r (1 - k r): below a half it went beyond the best length,
/// and is corrected for curvature.
const CORRECT_RATIO: f64 = 0.5;
/// From here on a step of twice the length keeps a half, and the trust region grows.
const GROW_RATIO: f64 = 0.75;
/// The factor by which the trust radius grows, and shrinks.
const RADIUS_FACTOR: f64 = 2.0;
/// Corrections above this share of their step are not tried: of 8,000 in two searches, larger ones helped one time in
/// fifteen, smaller ones two times in three.
const LARGEST_CORRECTION: f64 = 0.2;
/// The penalty parameter grows by this factor where the optimum of the merit violates constraints.
pub const PENALTY_GROWTH: f64 = 10.0;
/// So often a change is halved in a restoration.
const HALVINGS: i32 = 3;
/// A merit that would not be beaten by this multiple of the prediction is given up: of 400 hops that gained in a search, those
/// that this rule ends had a sixteenth of the gain, and it saves two thirds of the rollouts.
const HOPE: f64 = 2.0;

/// The best point found.
#[derive(Debug, Clone, PartialEq)]
pub struct SequentialLinearResult {
    /// The point.
    pub x: DVector<f64>,
    /// Its constraint values.
    pub constraints: Constraints,
    /// What of the budget ended it, if anything did.
    pub ending: Result<(), Interruption>,
}

/// Takes a point and its constraint values.
type OnImprovement<'a> = dyn FnMut(&DVector<f64>, &Constraints) + 'a;

/// Minimises `cost' x` subject to `residual = 0`, `inequality <= 0` and the bounds, from `start`.
///
/// Residuals of `accepted` count as none. The first linear program begins where the last one of `programs` ended.
/// `on_improvement` is called with the start, each accepted point and its constraint values.
pub fn minimise_sequentially(
    problem: &mut dyn Problem,
    (start, programs): (&DVector<f64>, &mut ElasticSolver),
    (settings, accepted): (&SequentialLinearSettings, Option<&DVector<f64>>),
    budget: &mut Budget,
    on_improvement: &mut OnImprovement,
) -> SequentialLinearResult {
    let mut search = Search::new(problem, (start, programs), settings);
    if let Some(residual) = accepted {
        search.offset.residual.copy_from(residual);
    }
    let ending = search.run(budget, on_improvement);
    let constraints = search.constraints();
    SequentialLinearResult { x: search.x, constraints, ending }
}

struct Search<'a> {
    problem: &'a mut dyn Problem,
    settings: &'a SequentialLinearSettings,
    programs: &'a mut ElasticSolver,
    x: DVector<f64>,
    /// Its constraint values are those of x; so are its derivatives, when it is current.
    model: Linearisation,
    model_is_current: bool,
    radius: f64,
    moves: MoveLimits,
    penalty_parameter: f64,
    /// Constraint values that count as none.
    offset: Constraints,
}

/// A point with its constraint values and merit.
struct Trial {
    x: DVector<f64>,
    constraints: Constraints,
    merit: f64,
}

impl<'a> Search<'a> {
    fn new(
        problem: &'a mut dyn Problem,
        (start, programs): (&DVector<f64>, &'a mut ElasticSolver),
        settings: &'a SequentialLinearSettings,
    ) -> Self {
        let x = clamped(start, problem.lower(), problem.upper());
        let offset = problem.constraints();
        let mut model = Linearisation::new(offset.clone(), start.len());
        // Not known before the first rollout, which the budget may not allow.
        model.constraints.residual.fill(f64::NAN);
        Self {
            problem,
            settings,
            programs,
            x,
            model,
            model_is_current: false,
            radius: settings.first_radius,
            moves: MoveLimits::new(start.len()),
            penalty_parameter: settings.penalty_parameter,
            offset,
        }
    }

    /// Descends and restores; again with a larger penalty parameter where a kink keeps the restoration from meeting the constraints.
    fn run(&mut self, budget: &mut Budget, on_improvement: &mut OnImprovement) -> Result<(), Interruption> {
        // A start that meets the constraints is a plan, even where the descent loses them.
        self.linearise(budget)?;
        on_improvement(&self.x, &self.constraints());
        loop {
            if !self.descend(budget, on_improvement)? || !self.settings.restores {
                return Ok(());
            }
            self.restore(budget)?;
            if self.is_met() || !self.tightens() {
                return Ok(());
            }
            self.radius = self.settings.first_radius;
            // Rows that no step within the last radius violates are left out of the model.
            self.model_is_current = false;
        }
    }

    /// Descends until the linear model predicts no further decrease, or none that the merit confirms in the smallest trust region, a
    /// kink; false where the merit to beat is out of reach.
    fn descend(&mut self, budget: &mut Budget, on_improvement: &mut OnImprovement) -> Result<bool, Interruption> {
        for _ in 0..self.settings.iteration_limit {
            self.linearise(budget)?;
            let merit = self.merit(&self.x, &self.model.constraints);
            let (step, _) = self.linear_step(budget)?;
            budget.iterations += 1;
            let prediction = merit - self.modelled_merit(&step);
            if prediction <= self.settings.smallest_prediction {
                // At an optimum of the merit that violates constraints the penalty parameter is too small.
                let violation_cost = self.violation_cost(&self.model.constraints);
                if violation_cost > self.settings.smallest_prediction && self.tightens() {
                    continue;
                }
                return Ok(true);
            }
            if merit - HOPE * prediction > self.settings.merit_to_beat {
                return Ok(false);
            }
            let good_merit = merit - CORRECT_RATIO * prediction;
            let trial = self.try_step(&step, good_merit, budget)?;
            let gain = merit - trial.merit;
            self.adapt_radius(gain / prediction);
            if gain > 0.0 {
                self.moves.adapt(&trial.x - &self.x);
                self.accept(trial);
                on_improvement(&self.x, &self.constraints());
            }
            if self.radius < SMALLEST_RADIUS {
                return Ok(true);
            }
        }
        Ok(true)
    }

    /// Makes the penalty parameter larger, if it may be and may be too small: at a kink far from the constraints, where what is violated
    /// costs more than any point within the bounds saves, it is not. Where nothing is left to save, too large a cost keeps it there.
    fn tightens(&mut self) -> bool {
        let saving = self.largest_saving();
        let may_be_too_small = saving == 0.0 || self.violation_cost(&self.model.constraints) <= saving;
        let may_grow = may_be_too_small && self.penalty_parameter < self.settings.largest_penalty_parameter;
        if may_grow {
            self.penalty_parameter *= PENALTY_GROWTH;
        }
        may_grow
    }

    /// All that the cost can fall by within the bounds.
    fn largest_saving(&self) -> f64 {
        let [above_lower, above_upper] = [self.problem.lower(), self.problem.upper()].map(|bound| &self.x - bound);
        let saving = |cost: f64, above: f64, below: f64| (cost * above).max(cost * below);
        self.problem.cost().zip_zip_map(&above_lower, &above_upper, saving).sum()
    }

    /// Whether the constraints are met within their tolerances.
    fn is_met(&self) -> bool {
        let constraints = &self.model.constraints;
        let is_kept = constraints.largest_inequality_violation() <= self.settings.inequality_tolerance;
        constraints.largest_residual() <= self.settings.feasibility_tolerance && is_kept
    }

    fn linearise(&mut self, budget: &mut Budget) -> Result<(), Interruption> {
        if !self.model_is_current {
            let stop = budget.spend()?;
            self.problem.linearise((&self.x, self.radius), &mut self.model, stop)?;
            self.model.constraints.subtract(&self.offset);
            self.model_is_current = true;
        }
        Ok(())
    }

    /// The minimiser of the linear model in the trust region, and by how much its minimum may lie lower; the program's variables are
    /// steps in units of its half widths.
    fn linear_step(&mut self, budget: &Budget) -> Result<(DVector<f64>, f64), Interruption> {
        let half_width = self.problem.variable_scale(&self.x).component_mul(&self.moves.shares) * self.radius;
        let share = |room: f64, half_width: f64| if half_width > 0.0 { room / half_width } else { 0.0 };
        let lower = (self.problem.lower() - &self.x).zip_map(&half_width, |room, width| share(room, width).max(-1.0));
        let upper = (self.problem.upper() - &self.x).zip_map(&half_width, |room, width| share(room, width).min(1.0));
        let program = ElasticProgram {
            matrix: &with_scaled_columns(self.model.jacobian.clone(), &half_width),
            target: &-self.model.rows_of(&self.model.constraints),
            row_name: &self.model.row_names(),
            equation_count: self.equation_count(),
            cost: &self.problem.cost().component_mul(&half_width),
            lower: &lower,
            upper: &upper,
            penalty_parameter: self.penalty_parameter,
        };
        let solution = self.programs.solve(&program, budget.stop())?;
        Ok((solution.x.component_mul(&half_width), solution.gap))
    }

    /// The constraint values at x, the offset included.
    fn constraints(&self) -> Constraints {
        let Constraints { residual, inequality } = &self.model.constraints;
        Constraints { residual: residual + &self.offset.residual, inequality: inequality + &self.offset.inequality }
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
        self.problem.cost().dot(&(&self.x + step)) + self.penalty_parameter * violation
    }

    /// The point after the step; if its merit exceeds `good_merit`, its correction is tried too, and the better one is
    /// kept.
    fn try_step(&mut self, step: &DVector<f64>, good_merit: f64, budget: &mut Budget) -> Result<Trial, Interruption> {
        let trial = self.evaluate(&(&self.x + step), budget)?;
        if trial.merit <= good_merit {
            return Ok(trial);
        }
        let values = self.model.rows_of(&trial.constraints);
        let missed = &values - self.modelled_rows(step);
        let Some(correction) = self.least_change(&trial.x, &values, &missed) else { return Ok(trial) };
        if correction.norm() > LARGEST_CORRECTION * step.norm() {
            return Ok(trial);
        }
        let corrected = self.evaluate(&(&trial.x - correction), budget)?;
        Ok(if corrected.merit < trial.merit { corrected } else { trial })
    }

    fn evaluate(&mut self, x: &DVector<f64>, budget: &mut Budget) -> Result<Trial, Interruption> {
        let stop = budget.spend()?;
        let x = clamped(x, self.problem.lower(), self.problem.upper());
        let mut constraints = self.problem.evaluate(&x, stop)?;
        constraints.subtract(&self.offset);
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
            self.radius = (RADIUS_FACTOR * self.radius).min(LARGEST_RADIUS);
        } else if ratio < SHRINK_RATIO || ratio.is_nan() {
            self.radius /= RADIUS_FACTOR;
        }
    }

    /// Drives the violations of the final point to zero by least changes of the variables that are off their bounds, as long as
    /// they fall.
    fn restore(&mut self, budget: &mut Budget) -> Result<(), Interruption> {
        while !self.is_met() {
            self.linearise(budget)?;
            let missed = self.model.rows_of(&self.model.constraints);
            let Some(change) = self.least_change(&self.x, &missed, &missed) else { break };
            if !self.shorten_until_better(&change, budget)? {
                break;
            }
        }
        Ok(())
    }

    /// Takes the change, or a half, a quarter, ... of it: at a kink only a part may reduce the violation. False when none
    /// does.
    fn shorten_until_better(&mut self, change: &DVector<f64>, budget: &mut Budget) -> Result<bool, Interruption> {
        let violation = self.model.constraints.violation();
        for halving in 0..=HALVINGS {
            let trial = self.evaluate(&(&self.x - change * 0.5_f64.powi(halving)), budget)?;
            if trial.constraints.violation() < violation {
                self.accept(trial);
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The smallest change (in units of the variable scales) of the variables off their bounds whose linear effect is `missed` on all
    /// residuals, and on inequalities that are violated where the rows have these values.
    fn least_change(&self, x: &DVector<f64>, values: &DVector<f64>, missed: &DVector<f64>) -> Option<DVector<f64>> {
        let counts = |row: &usize| *row < self.equation_count() || values[*row] > 0.0;
        let rows: Vec<usize> = (0..values.len()).filter(counts).collect();
        let off_bounds = |x: f64, lower: f64, upper: f64| if x <= lower || x >= upper { 0.0 } else { 1.0 };
        let free = x.zip_zip_map(self.problem.lower(), self.problem.upper(), off_bounds);
        let scale = self.problem.variable_scale(x).component_mul(&free);
        let scaled = with_scaled_columns(self.model.jacobian.select_rows(&rows), &scale);
        let weights = weights_of_independent(&(&scaled * scaled.transpose()), &missed.select_rows(&rows))?;
        Some((scaled.transpose() * weights).component_mul(&scale))
    }

    fn merit(&self, x: &DVector<f64>, constraints: &Constraints) -> f64 {
        self.problem.cost().dot(x) + self.violation_cost(constraints)
    }

    fn violation_cost(&self, constraints: &Constraints) -> f64 {
        self.penalty_parameter * constraints.violation_sum()
    }
}

/// As slices: nalgebra's iterators look for the end of a column at every element.
fn with_scaled_columns(mut matrix: DMatrix<f64>, scale: &DVector<f64>) -> DMatrix<f64> {
    for (mut column, scale) in matrix.column_iter_mut().zip(scale.as_slice()) {
        for value in column.as_mut_slice() {
            *value *= scale;
        }
    }
    matrix
}

fn clamped(x: &DVector<f64>, lower: &DVector<f64>, upper: &DVector<f64>) -> DVector<f64> {
    x.zip_zip_map(lower, upper, f64::clamp)
}

#[cfg(test)]
mod tests;
