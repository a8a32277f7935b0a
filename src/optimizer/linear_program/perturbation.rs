//! A perturbation of costs and multiplier bounds, against cycles.
//!
//! Only the final time costs anything, so most gradients are zero at first, and most vertices of the dual degenerate: the simplex may
//! come back to one. With a perturbation each variable and row has a cost and a bound of its own, and none comes back (Wolfe 1963).

use std::f64::consts::SQRT_2;

use super::ElasticSolver;
use crate::optimizer::elastic_program::ElasticProgram;

/// The unit of the perturbation, as a share of the largest cost: far below what a search reads from a solution, far above rounding.
pub(super) const PERTURBATION: f64 = 1e-6;

/// What the cost of a variable grows by, or the multiplier bound of a row times its range: one to two units.
fn perturbed_by(unit: f64, index: usize) -> f64 {
    // Nearly always none, and asked for every row and variable in each iteration. Multiples of a square root, less whole
    // numbers, spread evenly.
    if unit == 0.0 { 0.0 } else { unit * (1.0 + ((index + 1) as f64 * SQRT_2).fract()) }
}

impl ElasticSolver {
    /// The program's cost of a variable, with its perturbation.
    pub(super) fn cost(&self, program: &ElasticProgram, column: usize) -> f64 {
        program.cost[column] + perturbed_by(self.perturbation, column)
    }

    /// The program's bounds of a row's multiplier, moved outwards by the perturbation.
    pub(super) fn multiplier_bounds(&self, program: &ElasticProgram, row: usize) -> (f64, f64) {
        let (low, high) = program.multiplier_bounds(row);
        if self.perturbation == 0.0 || self.range[row] <= 0.0 {
            return (low, high);
        }
        let change = perturbed_by(self.perturbation, row) / self.range[row];
        (low - change, high + change)
    }
}
