//! The interface between an optimiser and its problem, and the rollout budget.

use nalgebra::{DMatrix, DVector};

use crate::stop::{Stop, Stopped};

/// A problem with a linear cost, box bounds, equality constraints (residuals) and inequality constraints.
pub trait Problem {
    /// Cost of each variable; the objective is `cost' x`.
    fn cost(&self) -> &DVector<f64>;
    /// Lower bounds.
    fn lower(&self) -> &DVector<f64>;
    /// Upper bounds.
    fn upper(&self) -> &DVector<f64>;
    /// The scale of each variable at x: how far it may move in a trust region of radius 1.
    fn variable_scale(&self, x: &DVector<f64>) -> DVector<f64>;
    /// Constraint values of the right lengths, all zero.
    fn constraints(&self) -> Constraints;
    /// The constraint values at x; one rollout.
    ///
    /// # Errors
    /// When it was stopped.
    fn evaluate(&mut self, x: &DVector<f64>, stop: Stop) -> Result<Constraints, Stopped>;
    /// The constraint values at x, the working set and its derivatives; counts as one rollout. The working set is to hold what a step
    /// within a trust region of this radius may violate.
    ///
    /// # Errors
    /// When it was stopped; the values are then as they were or those at x, and the derivatives are not valid.
    fn linearise(
        &mut self,
        at: (&DVector<f64>, f64),
        linearisation: &mut Linearisation,
        stop: Stop,
    ) -> Result<(), Stopped>;
}

/// The constraint values at a point.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Constraints {
    /// Scaled residuals of the equality constraints `residual = 0`.
    pub residual: DVector<f64>,
    /// Scaled values of the inequality constraints `inequality <= 0`.
    pub inequality: DVector<f64>,
}

impl Constraints {
    /// The largest violation; NaN if a value is NaN.
    pub fn violation(&self) -> f64 {
        larger(self.largest_inequality_violation(), self.largest_residual())
    }

    pub(super) fn subtract(&mut self, offset: &Self) {
        self.residual -= &offset.residual;
        self.inequality -= &offset.inequality;
    }

    /// Sum of all violations; NaN if a value is NaN.
    pub fn violation_sum(&self) -> f64 {
        let violated: f64 = self.inequality.as_slice().iter().map(|value| larger(0.0, *value)).sum();
        self.residual.lp_norm(1) + violated
    }

    /// The largest magnitude of a residual; NaN if one is NaN.
    pub(super) fn largest_residual(&self) -> f64 {
        largest_magnitude(self.residual.iter().copied())
    }

    /// The largest violation of an inequality, at least 0; NaN if one is NaN.
    pub fn largest_inequality_violation(&self) -> f64 {
        self.inequality.iter().copied().fold(0.0, larger)
    }
}

/// The larger of two, or NaN: a point without values meets nothing.
pub fn larger(worst: f64, value: f64) -> f64 {
    if value > worst || value.is_nan() { value } else { worst }
}

/// The largest magnitude, at least 0; NaN if a value is NaN, which `max` would drop.
pub fn largest_magnitude(values: impl Iterator<Item = f64>) -> f64 {
    values.map(f64::abs).fold(0.0, larger)
}

/// A linear model of the constraints.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearisation {
    /// The values at the point.
    pub constraints: Constraints,
    /// The working set: inequalities that are violated or nearly active, which have a row.
    pub working_set: Vec<usize>,
    /// Derivatives: a row per residual, then one per inequality of the working set.
    pub jacobian: DMatrix<f64>,
}

impl Linearisation {
    /// A model with an empty working set, all zero.
    pub fn new(constraints: Constraints, variable_count: usize) -> Self {
        let jacobian = DMatrix::zeros(constraints.residual.len(), variable_count);
        Self { constraints, working_set: Vec::new(), jacobian }
    }

    /// A name of each row that stays when the working set changes.
    pub fn row_names(&self) -> Vec<usize> {
        let residuals = self.constraints.residual.len();
        (0..residuals).chain(self.working_set.iter().map(|index| residuals + index)).collect()
    }

    /// The values of the rows at any point.
    pub fn rows_of(&self, constraints: &Constraints) -> DVector<f64> {
        let inequalities = self.working_set.iter().map(|&index| constraints.inequality[index]);
        let rows = constraints.residual.iter().copied().chain(inequalities);
        DVector::from_iterator(self.jacobian.nrows(), rows)
    }
}

/// Why an optimiser must stop before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interruption {
    /// It was asked to stop.
    Stopped,
    /// The rollouts are used up.
    RolloutLimit,
}

impl From<Stopped> for Interruption {
    fn from(_: Stopped) -> Self {
        Self::Stopped
    }
}

/// Rollouts that may still be spent, and what ends them early; it counts iterations, too.
#[derive(Clone, Copy)]
pub struct Budget<'a> {
    stop: Stop<'a>,
    limit: u64,
    spent: u64,
    /// Linear programs that descents solved, and moves of simplices.
    pub iterations: u64,
}

impl<'a> Budget<'a> {
    /// At most `limit` rollouts, fewer when `stop` is set.
    pub fn new(stop: impl Into<Stop<'a>>, limit: u64) -> Self {
        Self { stop: stop.into(), limit, spent: 0, iterations: 0 }
    }

    /// What ends the work under this budget early.
    pub fn stop(&self) -> Stop<'a> {
        self.stop
    }

    /// Rollouts spent.
    pub fn spent(&self) -> u64 {
        self.spent
    }

    /// Takes one rollout, and gives what ends it early.
    ///
    /// # Errors
    /// When the work is stopped or no rollout is left.
    pub fn spend(&mut self) -> Result<Stop<'a>, Interruption> {
        self.stop.check()?;
        if self.spent >= self.limit {
            return Err(Interruption::RolloutLimit);
        }
        self.spent += 1;
        Ok(self.stop)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn values_that_are_not_numbers_are_no_answer() {
        let met = Constraints { residual: DVector::zeros(2), inequality: DVector::repeat(2, -1.0) };
        for index in 0..2 {
            let mut constraints = [met.clone(), met.clone()];
            constraints[0].residual[index] = f64::NAN;
            constraints[1].inequality[index] = f64::NAN;
            assert!(constraints.iter().all(|values| values.violation().is_nan() && values.violation_sum().is_nan()));
        }
        assert_eq!((met.violation(), met.violation_sum()), (0.0, 0.0));
    }

    #[test]
    fn budget_ends_with_the_limit() {
        let stop = AtomicBool::new(false);
        let mut budget = Budget::new(&stop, 2);
        assert!(budget.spend().is_ok() && budget.spend().is_ok());
        assert_eq!(budget.spend().err(), Some(Interruption::RolloutLimit));
    }

    #[test]
    fn budget_ends_with_the_flag() {
        let stop = AtomicBool::new(false);
        let mut budget = Budget::new(&stop, 10);
        stop.store(true, Ordering::Relaxed);
        assert_eq!(budget.spend().err(), Some(Interruption::Stopped));
        assert_eq!(budget.spent(), 0);
    }
}
