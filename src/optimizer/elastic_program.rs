//! The data of an elastic linear program and its solution.

use nalgebra::{DMatrix, DVector};

/// The data of one program.
#[derive(Debug, Clone, Copy)]
pub struct ElasticProgram<'a> {
    /// m x n.
    pub matrix: &'a DMatrix<f64>,
    /// m.
    pub target: &'a DVector<f64>,
    /// Names of the rows, ascending, by which a solver knows them again in its next program.
    pub row_name: &'a [usize],
    /// The first rows are equations, `matrix x = target`; the others are inequalities, `matrix x <= target`.
    pub equation_count: usize,
    /// n.
    pub cost: &'a DVector<f64>,
    /// n.
    pub lower: &'a DVector<f64>,
    /// n.
    pub upper: &'a DVector<f64>,
    /// Penalty per unit of any row's violation, > 0.
    pub penalty_parameter: f64,
}

/// The minimiser; where rounding lets none be found, the best point that was met.
#[derive(Debug, Clone, PartialEq)]
pub struct ElasticSolution {
    /// n.
    pub x: DVector<f64>,
    /// Lagrange multiplier of each row: change of the minimum per unit of its target. Its magnitude is at most the penalty
    /// parameter, and it is at most 0 for an inequality.
    pub multiplier: DVector<f64>,
    /// `cost' x + penalty_parameter (violations of all rows)`.
    pub objective: f64,
    /// By how much the minimum may lie below the objective, but for rounding: 0 where it is the minimum.
    pub gap: f64,
    /// Simplex iterations.
    pub iterations: usize,
}

impl ElasticProgram<'_> {
    /// `cost' x + penalty_parameter (violations of all rows)`.
    pub(super) fn objective(&self, x: &DVector<f64>) -> f64 {
        self.cost.dot(x) + self.penalty_parameter * violation_sum(&(self.matrix * x - self.target), self.equation_count)
    }

    /// What no point within the bounds is below: D at these multipliers, moved into their box (weak duality).
    pub(super) fn lower_bound(&self, multiplier: &DVector<f64>) -> f64 {
        let multiplier = DVector::from_fn(multiplier.len(), |row, _| {
            let (low, high) = self.multiplier_bounds(row);
            multiplier[row].max(low).min(high)
        });
        let gradient = self.cost + self.matrix.tr_mul(&multiplier);
        let least = |column: usize| (gradient[column] * self.lower[column]).min(gradient[column] * self.upper[column]);
        (0..gradient.len()).map(least).sum::<f64>() - multiplier.dot(self.target)
    }

    /// The rows that a solution needs: where there are more than variables, only equations and those inequalities that a point within
    /// the bounds can violate.
    pub(super) fn rows_within_reach(&self) -> Vec<usize> {
        let (rows, columns) = self.matrix.shape();
        if rows <= columns {
            return (0..rows).collect();
        }
        let mut largest = DVector::<f64>::zeros(rows);
        for (coefficients, (lower, upper)) in self.matrix.column_iter().zip(self.lower.iter().zip(self.upper.iter())) {
            for (largest, coefficient) in largest.as_mut_slice().iter_mut().zip(coefficients.as_slice()) {
                *largest += (coefficient * lower).max(coefficient * upper);
            }
        }
        (0..rows).filter(|&row| row < self.equation_count || largest[row] > self.target[row]).collect()
    }

    /// Bounds of a row's multiplier: the slopes of its penalty on either side.
    pub(super) fn multiplier_bounds(&self, row: usize) -> (f64, f64) {
        let low = if row < self.equation_count { -self.penalty_parameter } else { 0.0 };
        (low, self.penalty_parameter)
    }

    /// How far a variable can move.
    pub(super) fn width(&self, column: usize) -> f64 {
        self.upper[column] - self.lower[column]
    }
}

/// Sum of the violations of rows of which the first are equations, `value = 0`, and the others inequalities, `value <= 0`.
pub(super) fn violation_sum(rows: &DVector<f64>, equation_count: usize) -> f64 {
    let (equations, inequalities) = rows.as_slice().split_at(equation_count);
    let of_equations: f64 = equations.iter().map(|value| value.abs()).sum();
    let of_inequalities: f64 = inequalities.iter().map(|value| value.max(0.0)).sum();
    of_equations + of_inequalities
}
