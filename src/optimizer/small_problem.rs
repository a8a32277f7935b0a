//! Problems of a few variables, written down as functions, for tests.

use std::sync::atomic::AtomicBool;

use nalgebra::{DMatrix, DVector};

use super::{
    Budget, Constraints, ElasticSolver, Linearisation, Problem, SequentialLinearResult, SequentialLinearSettings,
    minimise_sequentially,
};
use crate::stop::{Stop, Stopped};

/// Value and gradient of a row; at a kink the gradient is that of one side.
pub(super) type Row = fn(&[f64]) -> (f64, Vec<f64>);

/// Minimises the last variable, t: an objective f is the row `f(x) - t <= 0` or `f(x) - t = 0`.
pub(super) struct SmallProblem {
    cost: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    equations: &'static [Row],
    limits: &'static [Row],
    /// A limit that is met by more than this has no row in the linear model.
    margin: f64,
    /// Linear programs that the last run solved.
    pub(super) iterations: u64,
}

/// Bounds of t, which no answer here touches.
const OBJECTIVE_BOUND: f64 = 1e3;
/// More rollouts than any run here takes.
pub(super) const PLENTY: u64 = 100_000;

impl SmallProblem {
    /// With bounds of all variables but t.
    pub(super) fn new(bounds: &[(f64, f64)], equations: &'static [Row], limits: &'static [Row]) -> Self {
        let all = || bounds.iter().copied().chain([(-OBJECTIVE_BOUND, OBJECTIVE_BOUND)]);
        let count = bounds.len() + 1;
        let mut cost = DVector::zeros(count);
        cost[count - 1] = 1.0;
        Self {
            cost,
            lower: DVector::from_iterator(count, all().map(|(lower, _)| lower)),
            upper: DVector::from_iterator(count, all().map(|(_, upper)| upper)),
            equations,
            limits,
            margin: f64::INFINITY,
            iterations: 0,
        }
    }

    /// With rows in the linear model for those limits alone that are met by less than `margin`.
    pub(super) fn with_margin(self, margin: f64) -> Self {
        Self { margin, ..self }
    }

    pub(super) fn constraints_at(&mut self, x: &DVector<f64>) -> Constraints {
        self.evaluate(x, Stop::never()).unwrap()
    }

    /// The answer from `start`, checked for what holds of every run: points inside the bounds, a merit that falls, and
    /// constraint values that are those of the point.
    pub(super) fn solve_with(
        &mut self,
        start: &[f64],
        settings: &SequentialLinearSettings,
        rollouts: u64,
    ) -> SequentialLinearResult {
        let (stop, start) = (AtomicBool::new(false), DVector::from_row_slice(start));
        let mut budget = Budget::new(&stop, rollouts);
        let mut merits = Vec::new();
        let result = minimise_sequentially(
            self,
            (&start, &mut ElasticSolver::default()),
            (settings, None),
            &mut budget,
            &mut |x, constraints| {
                merits.push(x[x.len() - 1] + settings.penalty_parameter * constraints.violation_sum());
            },
        );
        assert!(merits.is_sorted_by(|before, after| after < before), "{merits:?}");
        assert!(result.x >= self.lower && result.x <= self.upper, "{}", result.x);
        assert_eq!(result.constraints, self.constraints_at(&result.x));
        assert!(budget.spent() <= rollouts);
        self.iterations = budget.iterations;
        result
    }

    pub(super) fn solve(&mut self, start: &[f64]) -> SequentialLinearResult {
        self.solve_with(start, &settings(), PLENTY)
    }
}

/// A descent to an answer with a penalty parameter that stays.
pub(super) fn settings() -> SequentialLinearSettings {
    SequentialLinearSettings {
        penalty_parameter: 5.0,
        largest_penalty_parameter: 0.0,
        first_radius: 0.3,
        feasibility_tolerance: 1e-9,
        inequality_tolerance: 0.0,
        smallest_prediction: 1e-8,
        merit_to_beat: f64::INFINITY,
        iteration_limit: 400,
        restores: true,
    }
}

impl Problem for SmallProblem {
    fn cost(&self) -> &DVector<f64> {
        &self.cost
    }

    fn lower(&self) -> &DVector<f64> {
        &self.lower
    }

    fn upper(&self) -> &DVector<f64> {
        &self.upper
    }

    fn variable_scale(&self, x: &DVector<f64>) -> DVector<f64> {
        DVector::repeat(x.len(), 1.0)
    }

    fn constraints(&self) -> Constraints {
        let [residual, inequality] = [self.equations, self.limits].map(|rows| DVector::zeros(rows.len()));
        Constraints { residual, inequality }
    }

    fn evaluate(&mut self, x: &DVector<f64>, stop: Stop) -> Result<Constraints, Stopped> {
        stop.check()?;
        let values = |rows: &[Row]| DVector::from_iterator(rows.len(), rows.iter().map(|row| row(x.as_slice()).0));
        Ok(Constraints { residual: values(self.equations), inequality: values(self.limits) })
    }

    fn linearise(
        &mut self,
        (x, _): (&DVector<f64>, f64),
        model: &mut Linearisation,
        stop: Stop,
    ) -> Result<(), Stopped> {
        model.constraints = self.evaluate(x, stop)?;
        let near = model.constraints.inequality.iter().enumerate().filter(|(_, value)| **value > -self.margin);
        model.working_set = near.map(|(index, _)| index).collect();
        let limits = model.working_set.iter().map(|&index| &self.limits[index]);
        let gradients: Vec<f64> = self.equations.iter().chain(limits).flat_map(|row| row(x.as_slice()).1).collect();
        let row_count = self.equations.len() + model.working_set.len();
        model.jacobian = DMatrix::from_row_slice(row_count, x.len(), &gradients);
        Ok(())
    }
}
