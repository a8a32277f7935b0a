//! A problem with constant derivatives, for tests.

use nalgebra::{DMatrix, DVector};

use super::evaluation::{Constraints, Linearisation, Problem};
use crate::stop::{Stop, Stopped};

/// Rows `matrix x - target`: first the residuals, then the inequalities.
pub(super) struct LinearProblem {
    pub(super) cost: DVector<f64>,
    pub(super) lower: DVector<f64>,
    pub(super) upper: DVector<f64>,
    pub(super) matrix: DMatrix<f64>,
    pub(super) target: DVector<f64>,
    pub(super) residual_count: usize,
}

impl Problem for LinearProblem {
    fn cost(&self) -> &DVector<f64> {
        &self.cost
    }

    fn lower(&self) -> &DVector<f64> {
        &self.lower
    }

    fn upper(&self) -> &DVector<f64> {
        &self.upper
    }

    fn variable_scale(&self, _x: &DVector<f64>) -> DVector<f64> {
        self.upper.clone()
    }

    fn constraints(&self) -> Constraints {
        let inequality_count = self.target.len() - self.residual_count;
        Constraints { residual: DVector::zeros(self.residual_count), inequality: DVector::zeros(inequality_count) }
    }

    fn evaluate(&mut self, x: &DVector<f64>, constraints: &mut Constraints, _stop: Stop) -> Result<(), Stopped> {
        let rows = &self.matrix * x - &self.target;
        let (residual, inequality) = rows.as_slice().split_at(self.residual_count);
        constraints.residual.copy_from_slice(residual);
        constraints.inequality.copy_from_slice(inequality);
        Ok(())
    }

    fn linearise(
        &mut self,
        (x, _): (&DVector<f64>, f64),
        model: &mut Linearisation,
        stop: Stop,
    ) -> Result<(), Stopped> {
        self.evaluate(x, &mut model.constraints, stop)?;
        model.working_set = (0..model.constraints.inequality.len()).collect();
        model.jacobian.clone_from(&self.matrix);
        Ok(())
    }
}
