//! A problem with shifted constraints: small violations of a given point count as none.

use nalgebra::DVector;

use super::evaluation::{Constraints, Linearisation, Problem};
use crate::stop::{Stop, Stopped};

/// The same problem with a constant offset of its constraint values.
pub(super) struct ShiftedConstraints<'a> {
    problem: &'a mut dyn Problem,
    offset: Constraints,
}

impl<'a> ShiftedConstraints<'a> {
    /// Shifts the constraints by the violations of a point with these constraint values, as far as they are within the
    /// tolerances of residuals and inequalities.
    pub(super) fn at(
        problem: &'a mut dyn Problem,
        constraints: &Constraints,
        (residual_tolerance, inequality_tolerance): (f64, f64),
    ) -> Self {
        let within = |value: f64, tolerance: f64| if value.abs() <= tolerance { value } else { 0.0 };
        let residual = constraints.residual.map(|value| within(value, residual_tolerance));
        let inequality = constraints.inequality.map(|value| within(value.max(0.0), inequality_tolerance));
        Self { problem, offset: Constraints { residual, inequality } }
    }

    /// Turns constraint values of the problem into those of the shifted one.
    pub(super) fn shift(&self, constraints: &mut Constraints) {
        constraints.residual -= &self.offset.residual;
        constraints.inequality -= &self.offset.inequality;
    }
}

impl Problem for ShiftedConstraints<'_> {
    fn cost(&self) -> &DVector<f64> {
        self.problem.cost()
    }

    fn lower(&self) -> &DVector<f64> {
        self.problem.lower()
    }

    fn upper(&self) -> &DVector<f64> {
        self.problem.upper()
    }

    fn variable_scale(&self, x: &DVector<f64>) -> DVector<f64> {
        self.problem.variable_scale(x)
    }

    fn constraints(&self) -> Constraints {
        self.problem.constraints()
    }

    fn evaluate(&mut self, x: &DVector<f64>, constraints: &mut Constraints, stop: Stop) -> Result<(), Stopped> {
        self.problem.evaluate(x, constraints, stop)?;
        self.shift(constraints);
        Ok(())
    }

    fn linearise(
        &mut self,
        at: (&DVector<f64>, f64),
        linearisation: &mut Linearisation,
        stop: Stop,
    ) -> Result<(), Stopped> {
        self.problem.linearise(at, linearisation, stop)?;
        self.shift(&mut linearisation.constraints);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use nalgebra::DMatrix;

    use super::*;
    use crate::optimizer::linear_problem::LinearProblem;
    use crate::optimizer::{Budget, CriticalitySettings, ElasticSolver, criticality_measure};

    /// Minimise the only variable, which should be 1, or at least 1.
    fn to_one(at_least: bool) -> LinearProblem {
        let [cost, lower, upper, target] = [1.0, 0.0, 10.0, -1.0].map(|value| DVector::repeat(1, value));
        let matrix = DMatrix::repeat(1, 1, -1.0);
        LinearProblem { cost, lower, upper, matrix, target, residual_count: usize::from(!at_least) }
    }

    fn decrease_at(mut problem: LinearProblem, x: f64, tolerance: f64) -> f64 {
        let settings = CriticalitySettings {
            penalty_parameter: 50.0,
            negligible_decrease: 1e-9,
            residual_tolerance: tolerance,
            inequality_tolerance: tolerance,
        };
        let stop = AtomicBool::new(false);
        let mut budget = Budget::new(&stop, 100);
        criticality_measure(&mut problem, (&DVector::repeat(1, x), &mut ElasticSolver::new()), &settings, &mut budget)
            .unwrap()
            .prediction
    }

    #[test]
    fn accepted_violations_need_not_be_taken_back() {
        for at_least in [true, false] {
            assert!(decrease_at(to_one(at_least), 0.999, 1e-2) < 1e-12);
            assert!(decrease_at(to_one(at_least), 0.999, 1e-4) > 0.04);
        }
    }

    #[test]
    fn slack_of_an_inequality_still_counts() {
        assert!((decrease_at(to_one(true), 1.001, 1e-2) - 0.001).abs() < 1e-12);
    }
}
