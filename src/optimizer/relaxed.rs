//! A problem whose limits are let out to where a point has them.

use nalgebra::DVector;

use super::evaluation::{Constraints, Linearisation, Problem};

/// The same problem, except that each limit may be exceeded by its allowance.
pub(super) struct Relaxed<'a> {
    problem: &'a mut dyn Problem,
    /// >= 0, per limit.
    allowance: DVector<f64>,
}

impl<'a> Relaxed<'a> {
    /// Allows what a point with these constraint values exceeds by no more than `tolerance`.
    pub(super) fn at(problem: &'a mut dyn Problem, constraints: &Constraints, tolerance: f64) -> Self {
        let allowed = |excess: f64| if excess <= tolerance { excess.max(0.0) } else { 0.0 };
        Self { problem, allowance: constraints.excess.map(allowed) }
    }

    /// Constraint values of the problem become those of the relaxed one.
    pub(super) fn relax(&self, constraints: &mut Constraints) {
        constraints.excess -= &self.allowance;
    }
}

impl Problem for Relaxed<'_> {
    fn cost(&self) -> &DVector<f64> {
        self.problem.cost()
    }

    fn lower(&self) -> &DVector<f64> {
        self.problem.lower()
    }

    fn upper(&self) -> &DVector<f64> {
        self.problem.upper()
    }

    fn reach(&self, x: &DVector<f64>) -> DVector<f64> {
        self.problem.reach(x)
    }

    fn constraints(&self) -> Constraints {
        self.problem.constraints()
    }

    fn evaluate(&mut self, x: &DVector<f64>, constraints: &mut Constraints) {
        self.problem.evaluate(x, constraints);
        self.relax(constraints);
    }

    fn linearise(&mut self, x: &DVector<f64>, linearisation: &mut Linearisation) {
        self.problem.linearise(x, linearisation);
        self.relax(&mut linearisation.constraints);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::optimizer::{Budget, FirstOrderSettings, confirmed_decrease};

    /// Minimise the only variable, which should be at least 1.
    struct AtLeastOne {
        cost: DVector<f64>,
        lower: DVector<f64>,
        upper: DVector<f64>,
    }

    impl Problem for AtLeastOne {
        fn cost(&self) -> &DVector<f64> {
            &self.cost
        }

        fn lower(&self) -> &DVector<f64> {
            &self.lower
        }

        fn upper(&self) -> &DVector<f64> {
            &self.upper
        }

        fn reach(&self, _x: &DVector<f64>) -> DVector<f64> {
            self.upper.clone()
        }

        fn constraints(&self) -> Constraints {
            Constraints { residual: DVector::zeros(0), excess: DVector::zeros(1) }
        }

        fn evaluate(&mut self, x: &DVector<f64>, constraints: &mut Constraints) {
            constraints.excess[0] = 1.0 - x[0];
        }

        fn linearise(&mut self, x: &DVector<f64>, model: &mut Linearisation) {
            self.evaluate(x, &mut model.constraints);
            model.near_limits = vec![0];
            model.jacobian.resize_vertically_mut(1, 0.0);
            model.jacobian[(0, 0)] = -1.0;
        }
    }

    fn decrease_at(x: f64, excess_tolerance: f64) -> f64 {
        let [cost, lower, upper] = [1.0, 0.0, 10.0].map(|value| DVector::repeat(1, value));
        let mut problem = AtLeastOne { cost, lower, upper };
        let stop = AtomicBool::new(false);
        let settings = FirstOrderSettings { weight: 50.0, enough: 1e-9, excess_tolerance };
        let mut budget = Budget::new(&stop, 100);
        confirmed_decrease(&mut problem, &DVector::repeat(1, x), &settings, &mut budget).unwrap().prediction
    }

    #[test]
    fn an_accepted_excess_need_not_be_taken_back() {
        assert!(decrease_at(0.999, 1e-2) < 1e-12);
        assert!(decrease_at(0.999, 1e-4) > 0.04);
    }

    #[test]
    fn room_below_a_limit_still_counts() {
        assert!((decrease_at(1.001, 1e-2) - 0.001).abs() < 1e-12);
    }
}
