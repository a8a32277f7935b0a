//! What an optimiser needs to know of a problem, and how much it may spend.

use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::{DMatrix, DVector};

/// A problem with a linear cost, boxed variables and residuals that should vanish.
pub trait Problem {
    /// Price of each variable; the cost is `cost' x`.
    fn cost(&self) -> &DVector<f64>;
    /// Lower bounds.
    fn lower(&self) -> &DVector<f64>;
    /// Upper bounds.
    fn upper(&self) -> &DVector<f64>;
    /// How far each variable may move at x in a trust region of radius 1.
    fn reach(&self, x: &DVector<f64>) -> DVector<f64>;
    /// Number of residuals.
    fn residual_count(&self) -> usize;
    /// The scaled residuals at x; one rollout.
    fn residual(&mut self, x: &DVector<f64>, residual: &mut DVector<f64>);
    /// The scaled residuals and their Jacobian at x; counts as one rollout.
    fn linearise(&mut self, x: &DVector<f64>, residual: &mut DVector<f64>, jacobian: &mut DMatrix<f64>);
}

/// Why an optimiser must stop before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interruption {
    /// The stop flag is set.
    Stopped,
    /// The rollouts are used up.
    RolloutLimit,
}

/// Rollouts that may still be spent, and the stop flag, asked before each of them.
#[derive(Debug)]
pub struct Budget<'a> {
    stop: &'a AtomicBool,
    limit: u64,
    spent: u64,
}

impl<'a> Budget<'a> {
    /// At most `limit` rollouts, fewer when `stop` is set.
    pub fn new(stop: &'a AtomicBool, limit: u64) -> Self {
        Self { stop, limit, spent: 0 }
    }

    /// Whether the flag is set.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Rollouts spent.
    pub fn spent(&self) -> u64 {
        self.spent
    }

    /// Takes one rollout.
    ///
    /// # Errors
    /// When the flag is set or none is left.
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
}
