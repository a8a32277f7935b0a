//! Elastic linear programs with few rows and many boxed variables, by the bounded-variable primal simplex method (Dantzig
//! 1955).
//!
//! ```text
//! minimise    cost' x + penalty_parameter (violations of equations and inequalities)
//! subject to  lower <= x <= upper,  lower <= 0 <= upper
//! ```
//!
//! Each row gets two slacks, `matrix x - above + below = target`, so the simplex starts at x = 0 without a first phase,
//! and variables without a gain stay at 0. With m rows (8 for a maneuver) an iteration costs m n for pricing and m^2
//! for the basis, of which the inverse is kept explicitly; a variable that goes from bound to bound costs no pivot. On this
//! shape it is much faster than a general solver (`benches/linear_program.rs`).
//!
//! The entering column has the largest reduced cost (Dantzig), or after many steps of length zero the lowest index (Bland
//! 1977); the leaving one is chosen by Harris's (1973) ratio test in two passes.

use nalgebra::{DMatrix, DVector};

use super::elastic_program::{ElasticProgram, ElasticSolution, violation_sum};
use crate::stop::{Stop, Stopped};

/// Reduced costs closer to zero are rounding of the multipliers.
const REDUCED_COST_TOLERANCE: f64 = 1e-11;
/// How far a basic variable may pass its bound within one ratio test.
const BOUND_TOLERANCE: f64 = 1e-9;
/// Iterations without progress after which the entering column is chosen by Bland's rule, the lowest index, against
/// cycling.
const STALL_LIMIT: usize = 50;
/// Iterations per variable and row after which the simplex gives up.
const ITERATION_FACTOR: usize = 50;

/// Safeguards against rounding. Rows are dependent when a plan ends sticking, and about one program in twenty thousand then
/// needs the strict ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Safeguards {
    #[default]
    Usual,
    Strict,
}

impl Safeguards {
    /// Pivots smaller than this share of the largest entry of their column would amplify rounding too much.
    const fn pivot_tolerance(self) -> f64 {
        match self {
            Self::Usual => 1e-7,
            Self::Strict => 1e-5,
        }
    }

    /// Pivots after which the basis is inverted afresh.
    const fn inversion_period(self) -> usize {
        match self {
            Self::Usual => 20,
            Self::Strict => 1,
        }
    }
}

/// Memory of the simplex, reusable between programs of one shape.
#[derive(Debug, Clone, Default)]
pub struct ElasticSolver {
    /// Status per column (n structural, m above, m below).
    status: Vec<VariableStatus>,
    /// Column of each basic position.
    basis: Vec<usize>,
    basis_value: Vec<f64>,
    inverse: DMatrix<f64>,
    multiplier: DVector<f64>,
    direction: DVector<f64>,
    pivots_since_inversion: usize,
    /// (descent, column)
    candidates: Vec<(f64, usize)>,
    safeguards: Safeguards,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum VariableStatus {
    /// Nonbasic at 0, where it started: between its bounds, free to move either way.
    Zero,
    Lower,
    Upper,
    Basic,
}

/// A column that improves the objective, and the direction in which it moves.
struct Entering {
    column: usize,
    sign: f64,
}

enum Blocking {
    /// The entering column reaches its other bound first.
    OtherBound,
    /// A basic position reaches a bound.
    Position { index: usize, at: VariableStatus },
}

impl ElasticSolver {
    /// A solver without memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Solves a program; at least as good as x = 0.
    ///
    /// # Errors
    /// When it was stopped: programs of thousands of variables take many milliseconds.
    pub fn solve(&mut self, program: &ElasticProgram, stop: Stop) -> Result<ElasticSolution, Stopped> {
        let staying = program.penalty_parameter * violation_sum(&-program.target, program.equation_count);
        let mut iterations = 0;
        for safeguards in [Safeguards::Usual, Safeguards::Strict] {
            let mut solution = self.solve_with(program, safeguards, stop)?;
            iterations += solution.iterations;
            solution.iterations = iterations;
            if solution.objective <= staying {
                return Ok(solution);
            }
        }
        // Singular to rounding, or not finite.
        let (rows, columns) = program.matrix.shape();
        let (x, multiplier) = (DVector::zeros(columns), DVector::zeros(rows));
        Ok(ElasticSolution { x, multiplier, objective: staying, iterations })
    }

    fn solve_with(
        &mut self,
        program: &ElasticProgram,
        safeguards: Safeguards,
        stop: Stop,
    ) -> Result<ElasticSolution, Stopped> {
        self.safeguards = safeguards;
        self.start(program);
        self.update_multipliers(program);
        let (rows, columns) = program.matrix.shape();
        let mut stalled = 0;
        let mut iterations = 0;
        while iterations < ITERATION_FACTOR * (rows + columns) {
            self.list_candidates(program);
            if stalled >= STALL_LIMIT {
                // Bland's rule for the entering column.
                self.candidates.sort_unstable_by_key(|(_, column)| *column);
                self.candidates.truncate(1);
            }
            stop.check()?;
            if self.candidates.is_empty() {
                break;
            }
            for candidate in 0..self.candidates.len() {
                let column = self.candidates[candidate].1;
                if let Some((entering, _)) = self.entering(program, column) {
                    iterations += 1;
                    // A basis of many rows takes milliseconds to invert.
                    stop.check()?;
                    let step = self.advance(program, &entering);
                    stalled = if step > 0.0 { 0 } else { stalled + 1 };
                }
            }
        }
        Ok(self.solution(program, iterations))
    }

    /// Columns that improve the objective at the current multipliers, the largest reduced cost first (Dantzig's rule).
    ///
    /// A variable that goes from bound to bound changes no multiplier, so one list serves many moves; after a pivot the
    /// reduced cost of each remaining column is computed again before it enters.
    fn list_candidates(&mut self, program: &ElasticProgram) {
        let mut candidates = std::mem::take(&mut self.candidates);
        candidates.clear();
        let improving = |column| self.entering(program, column).map(|(_, descent)| (descent, column));
        candidates.extend((0..self.status.len()).filter_map(improving));
        candidates.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        self.candidates = candidates;
    }

    /// Sets every variable to 0; the basis consists of one slack per row.
    fn start(&mut self, program: &ElasticProgram) {
        let (rows, columns) = program.matrix.shape();
        self.status.clear();
        self.status.resize(columns + 2 * rows, VariableStatus::Zero);
        self.basis.resize(rows, 0);
        self.basis_value.resize(rows, 0.0);
        self.inverse = DMatrix::zeros(rows, rows);
        for row in 0..rows {
            let above = columns + row;
            let below = columns + rows + row;
            let value = -program.target[row];
            let (basic, resting) = if value >= 0.0 { (above, below) } else { (below, above) };
            self.basis[row] = basic;
            self.status[basic] = VariableStatus::Basic;
            self.status[resting] = VariableStatus::Lower;
            self.basis_value[row] = value.abs();
            self.inverse[(row, row)] = program.slack_sign(basic);
        }
        self.pivots_since_inversion = 0;
    }

    fn resting_value(&self, program: &ElasticProgram, column: usize) -> f64 {
        match self.status[column] {
            VariableStatus::Zero | VariableStatus::Basic => 0.0,
            VariableStatus::Lower => program.bounds(column).0,
            VariableStatus::Upper => program.bounds(column).1,
        }
    }

    /// multiplier' = (cost of the basis)' inverse.
    fn update_multipliers(&mut self, program: &ElasticProgram) {
        let rows = self.basis.len();
        self.multiplier.resize_vertically_mut(rows, 0.0);
        self.multiplier.fill(0.0);
        for (position, &column) in self.basis.iter().enumerate() {
            let cost = program.column_cost(column);
            if cost != 0.0 {
                for row in 0..rows {
                    self.multiplier[row] += cost * self.inverse[(position, row)];
                }
            }
        }
    }

    /// The direction in which a column improves the objective, with its rate; none if it does not.
    #[inline]
    fn entering(&self, program: &ElasticProgram, column: usize) -> Option<(Entering, f64)> {
        let status = self.status[column];
        if status == VariableStatus::Basic {
            return None;
        }
        let reduced_cost = self.reduced_cost(program, column);
        let sign = match status {
            VariableStatus::Lower | VariableStatus::Basic => 1.0,
            VariableStatus::Upper => -1.0,
            VariableStatus::Zero => -reduced_cost.signum(),
        };
        let descent = -sign * reduced_cost;
        let entering = Entering { column, sign };
        (descent > REDUCED_COST_TOLERANCE && self.room(program, &entering) > 0.0).then_some((entering, descent))
    }

    #[inline]
    fn reduced_cost(&self, program: &ElasticProgram, column: usize) -> f64 {
        let columns = program.cost.len();
        let cost = program.column_cost(column);
        if column < columns {
            cost - program.matrix.column(column).dot(&self.multiplier)
        } else {
            cost - program.slack_sign(column) * self.multiplier[program.slack_row(column)]
        }
    }

    /// Moves the entering column as far as the bounds allow; returns how far.
    fn advance(&mut self, program: &ElasticProgram, entering: &Entering) -> f64 {
        self.compute_direction(program, entering.column);
        let (step, blocking) = self.ratio_test(program, entering);
        for (value, change) in self.basis_value.iter_mut().zip(self.direction.iter()) {
            *value -= entering.sign * step * change;
        }
        match blocking {
            Blocking::OtherBound => {
                self.status[entering.column] =
                    if entering.sign > 0.0 { VariableStatus::Upper } else { VariableStatus::Lower };
            }
            Blocking::Position { index, at } => {
                let entering_value = self.resting_value(program, entering.column) + entering.sign * step;
                self.status[self.basis[index]] = at;
                self.status[entering.column] = VariableStatus::Basic;
                self.basis[index] = entering.column;
                self.basis_value[index] = entering_value;
                self.pivot(program, index);
                self.update_multipliers(program);
            }
        }
        step
    }

    /// inverse * (entering column).
    fn compute_direction(&mut self, program: &ElasticProgram, column: usize) {
        let (rows, columns) = program.matrix.shape();
        self.direction.resize_vertically_mut(rows, 0.0);
        if column < columns {
            self.inverse.mul_to(&program.matrix.column(column), &mut self.direction);
        } else {
            self.direction.copy_from(&self.inverse.column(program.slack_row(column)));
            self.direction *= program.slack_sign(column);
        }
    }

    /// How far a column can move before its own bound.
    fn room(&self, program: &ElasticProgram, entering: &Entering) -> f64 {
        let (lower, upper) = program.bounds(entering.column);
        let value = self.resting_value(program, entering.column);
        if entering.sign > 0.0 { upper - value } else { value - lower }
    }

    /// How far the entering column can move, and what stops it.
    ///
    /// In two passes (Harris 1973): the first finds the step with bounds relaxed by a tolerance; of the positions that
    /// block within that step the second takes the one with the largest pivot. Rows are dependent when a plan ends
    /// sticking; smaller pivots would make the basis singular to rounding.
    fn ratio_test(&self, program: &ElasticProgram, entering: &Entering) -> (f64, Blocking) {
        let own_room = self.room(program, entering);
        let smallest_pivot = self.safeguards.pivot_tolerance() * self.direction.amax();
        let mut relaxed = own_room;
        for index in 0..self.basis.len() {
            if let Some((room, rate, _)) = self.blocking_at(program, entering, index, smallest_pivot) {
                relaxed = relaxed.min((room + BOUND_TOLERANCE) / rate);
            }
        }
        let mut step = own_room;
        let mut blocking = Blocking::OtherBound;
        let mut pivot = 0.0;
        for index in 0..self.basis.len() {
            if let Some((room, rate, at)) = self.blocking_at(program, entering, index, smallest_pivot)
                && room / rate <= relaxed
                && rate > pivot
                && room / rate < own_room
            {
                (step, pivot) = (room / rate, rate);
                blocking = Blocking::Position { index, at };
            }
        }
        (step, blocking)
    }

    /// (room to the bound, speed towards it, the bound) of a basic position that moves.
    ///
    /// The room may be slightly negative: the step is then negative, so that the variable leaves the basis exactly at its
    /// bound.
    fn blocking_at(
        &self,
        program: &ElasticProgram,
        entering: &Entering,
        index: usize,
        smallest_pivot: f64,
    ) -> Option<(f64, f64, VariableStatus)> {
        let rate = entering.sign * self.direction[index];
        if rate.abs() <= smallest_pivot {
            return None;
        }
        let (lower, upper) = program.bounds(self.basis[index]);
        let value = self.basis_value[index];
        let (room, at) =
            if rate > 0.0 { (value - lower, VariableStatus::Lower) } else { (upper - value, VariableStatus::Upper) };
        Some((room, rate.abs(), at))
    }

    /// Updates the inverse after the basis has changed at `index`.
    fn pivot(&mut self, program: &ElasticProgram, index: usize) {
        self.pivots_since_inversion += 1;
        if self.pivots_since_inversion >= self.safeguards.inversion_period() && self.invert_basis(program) {
            return;
        }
        let rows = self.basis.len();
        let pivot = self.direction[index];
        for column in 0..rows {
            let scaled = self.inverse[(index, column)] / pivot;
            for row in 0..rows {
                if row != index {
                    self.inverse[(row, column)] -= self.direction[row] * scaled;
                }
            }
            self.inverse[(index, column)] = scaled;
        }
    }

    /// Inverts the basis and recomputes its values; false when it is singular to rounding.
    fn invert_basis(&mut self, program: &ElasticProgram) -> bool {
        let (rows, columns) = program.matrix.shape();
        let mut matrix = DMatrix::zeros(rows, rows);
        for (position, &column) in self.basis.iter().enumerate() {
            if column < columns {
                matrix.set_column(position, &program.matrix.column(column));
            } else {
                matrix[(program.slack_row(column), position)] = program.slack_sign(column);
            }
        }
        let Some(inverse) = matrix.try_inverse() else { return false };
        self.inverse = inverse;
        self.pivots_since_inversion = 0;
        let mut remaining = program.target.clone();
        for column in 0..columns {
            if self.status[column] != VariableStatus::Basic {
                remaining.axpy(-self.resting_value(program, column), &program.matrix.column(column), 1.0);
            }
        }
        let values = &self.inverse * remaining;
        self.basis_value.copy_from_slice(values.as_slice());
        true
    }

    fn solution(&mut self, program: &ElasticProgram, iterations: usize) -> ElasticSolution {
        let columns = program.cost.len();
        let mut x = DVector::from_fn(columns, |column, _| self.resting_value(program, column));
        for (position, &column) in self.basis.iter().enumerate() {
            if column < columns {
                x[column] = self.basis_value[position].clamp(program.lower[column], program.upper[column]);
            }
        }
        ElasticSolution { objective: program.objective(&x), x, multiplier: self.multiplier.clone(), iterations }
    }
}

#[cfg(test)]
mod tests;
