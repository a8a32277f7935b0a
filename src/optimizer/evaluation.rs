//! The interface between an optimiser and its problem, and the rollout budget.

use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::{DMatrix, DVector};

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
    fn evaluate(&mut self, x: &DVector<f64>, constraints: &mut Constraints);
    /// The constraint values at x, the working set and its derivatives; counts as one rollout.
    fn linearise(&mut self, x: &DVector<f64>, linearisation: &mut Linearisation);
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
    /// The largest violation.
    pub fn violation(&self) -> f64 {
        self.residual.amax().max(self.largest_inequality_violation())
    }

    /// Sum of all violations.
    pub fn violation_sum(&self) -> f64 {
        let violated: f64 = self.inequality.iter().map(|value| value.max(0.0)).sum();
        self.residual.lp_norm(1) + violated
    }

    /// The largest violation of an inequality, at least 0.
    pub fn largest_inequality_violation(&self) -> f64 {
        self.inequality.iter().copied().fold(0.0, f64::max)
    }
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
    /// A stop flag is set.
    Stopped,
    /// The rollouts are used up.
    RolloutLimit,
}

/// Rollouts that may still be spent, and the stop flags, which are checked before each rollout.
#[derive(Debug)]
pub struct Budget<'a> {
    stop: &'a AtomicBool,
    /// Further stop flags.
    interrupts: &'a [&'a AtomicBool],
    limit: u64,
    spent: u64,
}

impl<'a> Budget<'a> {
    /// At most `limit` rollouts, fewer when `stop` is set.
    pub fn new(stop: &'a AtomicBool, limit: u64) -> Self {
        Self { stop, interrupts: &[], limit, spent: 0 }
    }

    /// Also stopped by any of these flags.
    #[must_use]
    pub fn interrupted_by(self, interrupts: &'a [&'a AtomicBool]) -> Self {
        Self { interrupts, ..self }
    }

    /// Whether one of the flags is set.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.interrupts.iter().any(|flag| flag.load(Ordering::Relaxed))
    }

    /// Rollouts spent.
    pub fn spent(&self) -> u64 {
        self.spent
    }

    /// Takes one rollout.
    ///
    /// # Errors
    /// When a flag is set or none is left.
    pub fn spend(&mut self) -> Result<(), Interruption> {
        if self.is_stopped() {
            return Err(Interruption::Stopped);
        }
        if self.spent >= self.limit {
            return Err(Interruption::RolloutLimit);
        }
        self.spent += 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budget_ends_with_the_limit() {
        let stop = AtomicBool::new(false);
        let mut budget = Budget::new(&stop, 2);
        assert_eq!((budget.spend(), budget.spend()), (Ok(()), Ok(())));
        assert_eq!(budget.spend(), Err(Interruption::RolloutLimit));
    }

    #[test]
    fn budget_ends_with_the_flag() {
        let stop = AtomicBool::new(false);
        let mut budget = Budget::new(&stop, 10);
        stop.store(true, Ordering::Relaxed);
        assert_eq!(budget.spend(), Err(Interruption::Stopped));
        assert_eq!(budget.spent(), 0);
    }

    #[test]
    fn any_flag_ends_the_budget() {
        let [stop, first, second] = [const { AtomicBool::new(false) }; 3];
        let flags = [&first, &second];
        let mut budget = Budget::new(&stop, 10).interrupted_by(&flags);
        assert_eq!(budget.spend(), Ok(()));
        second.store(true, Ordering::Relaxed);
        assert_eq!(budget.spend(), Err(Interruption::Stopped));
    }
}
