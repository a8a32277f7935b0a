//! Elastic linear programs with boxed variables, by a dual simplex with long steps that begins where the last program ended.
//!
//! ```text
//! minimise    cost' x + penalty_parameter (violations of equations and inequalities)
//! subject to  lower <= x <= upper,  lower <= 0 <= upper
//! ```
//!
//! Its dual maximises a concave piecewise linear function of one multiplier per row,
//!
//! ```text
//! D(multiplier) = -multiplier' target + sum_j min over the box of gradient_j x_j,    gradient = cost + matrix' multiplier
//! ```
//!
//! in a box too: an equation's multiplier lies within the penalty parameter, an inequality's between 0 and it. A vertex of
//! the dual has k *tight* rows, whose multipliers are inside their box, and k *basic* variables, whose gradient is zero; all
//! other variables rest at the bound that their gradient's sign chooses. So every choice of rows and variables with a regular
//! k x k matrix is a vertex, and the last program's choice is a good start for the next one, whatever has changed (a warm start). One
//! iteration takes a basic variable or a row that contradicts its place, that with the steepest edge (Forrest & Goldfarb, "Steepest-edge
//! simplex algorithms for linear programming", 1992), and moves the multipliers along the edge that frees it, past the kinks of D as long
//! as D rises: the bound flipping ratio test of Maros ("Computational Techniques of the Simplex Method", 2003). Rows that stay slack cost
//! no more than a scalar product, and those that nothing within the bounds violates are left out. Multipliers, gradients and point move
//! along the edge, and are computed afresh where the simplex would end.

mod basis;
mod beginning;
mod perturbation;
mod pricing;
mod ratio_test;

use basis::Basis;
use nalgebra::{DMatrix, DVector};
use perturbation::PERTURBATION;
use pricing::{Edge, Leaving};
use ratio_test::{Kink, KinkAt};

use super::elastic_program::{ElasticProgram, ElasticSolution, violation_sum};
use crate::stop::{Stop, Stopped};

/// Gradients within so many times the largest of a basic variable, which should be zero, are rounding, where correction leaves one: on
/// motions that amplify errors beyond all digits.
const GRADIENT_MARGIN: f64 = 10.0;
/// The rounding of sums, as a share of what they are sums of: of slopes and pivots, of the objective, and of what an inverse should make
/// zero. Where rows are nearly dependent these sums are far larger: with the tolerance of other comparisons the kinks that were passed over
/// let D fall, and the simplex came back.
const SUM_ROUNDING: f64 = 1e-12;
/// Smaller shares are rounding: of the largest cost, in gradients (costs are as small as the trust region of a program: an absolute
/// tolerance passed the perturbation in small ones, and the simplex came back to the same vertices); of a variable's or row's range that
/// is violated, of the penalty parameter by which a multiplier passes its box, of a pivot, between steps, of a variable's scale by which
/// it is off its bound.
pub(super) const TOLERANCE: f64 = 1e-9;
/// Iterations after which the simplex gives up, for each row, each place of the largest basis, and the last look. Nearly all programs take
/// less than half of these; those of motions that amplify errors beyond all digits take any number.
const ITERATION_FACTOR: usize = 20;

/// Memory of the simplex: the vertex of the last program, from which the next one begins; at first there is none.
#[derive(Debug, Clone, Default)]
pub struct ElasticSolver {
    /// Names and places of the last program's rows, names ascending.
    known: Vec<(usize, RowPlace)>,
    place: Vec<RowPlace>,
    basis: Basis,
    is_basic: Vec<bool>,
    /// Where each variable that is not basic rests.
    rest: Vec<Rest>,
    /// Per row: multiplier, its change along the edge, the row's value, its range.
    multiplier: DVector<f64>,
    direction: DVector<f64>,
    value: DVector<f64>,
    range: DVector<f64>,
    /// What the objective may miss.
    rounding: f64,
    /// A gradient that is closer to zero than this should be zero.
    small_gradient: f64,
    /// The transposed matrix: a contiguous column per row of the program.
    by_row: DMatrix<f64>,
    /// Per variable: gradient, its change along the edge, the variable's value.
    gradient: DVector<f64>,
    slope: DVector<f64>,
    x: DVector<f64>,
    /// The largest gradient of a basic variable, when they were last computed afresh.
    gradient_error: f64,
    kinks: Vec<Kink>,
    /// The unit of the perturbation, a cost; 0 where there is none.
    perturbation: f64,
}

/// Where the multiplier of a row is: at its lower bound, inside its box, or at its upper bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RowPlace {
    Low,
    Tight,
    High,
}

/// Where a variable rests: its gradient's sign decides, and without a gradient it stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rest {
    Lower,
    Zero,
    Upper,
}

impl ElasticSolver {
    /// Solves a program; at least as good as x = 0.
    ///
    /// # Errors
    /// When it was stopped: programs of hundreds of rows take many milliseconds.
    pub fn solve(&mut self, program: &ElasticProgram, stop: Stop) -> Result<ElasticSolution, Stopped> {
        let rows = program.rows_within_reach();
        if rows.len() == program.target.len() {
            return self.solve_rows(program, stop);
        }
        let within_reach = ElasticProgram {
            matrix: &program.matrix.select_rows(&rows),
            target: &program.target.select_rows(&rows),
            row_name: &rows.iter().map(|row| program.row_name[*row]).collect::<Vec<_>>(),
            ..*program
        };
        let solution = self.solve_rows(&within_reach, stop)?;
        let mut multiplier = DVector::zeros(program.target.len());
        for (row, value) in rows.iter().zip(solution.multiplier.iter()) {
            multiplier[*row] = *value;
        }
        Ok(ElasticSolution { multiplier, ..solution })
    }

    /// Solves a program, all rows of it.
    fn solve_rows(&mut self, program: &ElasticProgram, stop: Stop) -> Result<ElasticSolution, Stopped> {
        let (rows, columns) = program.matrix.shape();
        let staying = program.penalty_parameter * violation_sum(&-program.target, program.equation_count);
        let (x, multiplier) = (DVector::zeros(columns), DVector::zeros(rows));
        let mut best = ElasticSolution { x, multiplier, objective: staying, gap: 0.0, iterations: 0 };
        for begin in [Self::begin_warm, Self::begin_cold] {
            self.prepare(program);
            begin(self, program);
            let is_optimal = self.climb(program, &mut best.iterations, stop)?;
            self.x = self.x.zip_zip_map(program.lower, program.upper, |x, lower, upper| x.max(lower).min(upper));
            let objective = program.objective(&self.x);
            if objective <= best.objective + self.rounding {
                (best.x, best.objective) = (self.x.clone(), objective);
                if is_optimal {
                    self.known = program.row_name.iter().copied().zip(self.place.iter().copied()).collect();
                    return Ok(ElasticSolution { multiplier: -&self.multiplier, ..best });
                }
            }
        }
        // Singular to rounding, or not finite.
        self.known.clear();
        let gap = best.objective - program.lower_bound(&self.multiplier);
        Ok(ElasticSolution { gap, ..best })
    }

    /// Sizes the memory, and computes the rows at x = 0 and their ranges.
    fn prepare(&mut self, program: &ElasticProgram) {
        let (rows, columns) = program.matrix.shape();
        [self.multiplier, self.direction] = [rows; 2].map(DVector::zeros);
        [self.gradient, self.slope, self.x] = [columns; 3].map(DVector::zeros);
        self.value = -program.target;
        self.by_row = program.matrix.transpose();
        let width = program.upper - program.lower;
        let ranges = self.by_row.column_iter().map(|coefficients| range(coefficients.as_slice(), width.as_slice()));
        self.range = DVector::from_iterator(rows, ranges);
        self.rounding = SUM_ROUNDING * program.penalty_parameter * self.range.amax();
        self.small_gradient = TOLERANCE * program.cost.amax();
        self.is_basic = vec![false; columns];
        self.rest = vec![Rest::Zero; columns];
    }

    /// Climbs to the maximum of D; false when the basis became singular or the iterations ran out.
    fn climb(&mut self, program: &ElasticProgram, iterations: &mut usize, stop: Stop) -> Result<bool, Stopped> {
        let (rows, columns) = program.matrix.shape();
        self.perturbation = 0.0;
        let (mut stalled, mut was_perturbed, mut is_afresh) = (0, false, true);
        for _ in 0..ITERATION_FACTOR * (1 + rows + rows.min(columns)) {
            stop.check()?;
            *iterations += 1;
            if !is_afresh {
                self.update_point(program, false);
            } else if !self.basis.invert(program) {
                return Ok(false);
            } else if !self.compute_afresh(program) {
                continue;
            }
            let Some(edge) = self.steepest_edge(program) else {
                if !is_afresh || self.has_drifted(program) && self.basis.forget_updates() {
                    is_afresh = true;
                    continue;
                }
                if self.perturbation != 0.0 && !was_perturbed {
                    // From here it is near; where the program stalls again, the perturbed one has to do.
                    (self.perturbation, stalled, was_perturbed) = (0.0, 0, true);
                    continue;
                }
                return Ok(true);
            };
            self.update_direction(&edge);
            self.list_kinks(program, edge.leaving);
            let Some(kink) = self.first_kink_without_rise(edge.rise) else {
                if is_afresh && !self.basis.forget_updates() {
                    return Ok(false);
                }
                is_afresh = true;
                continue;
            };
            stalled = if kink.step * edge.rise > self.rounding { 0 } else { stalled + 1 };
            add_multiple(&mut self.multiplier, kink.step, self.direction.as_slice());
            add_multiple(&mut self.gradient, kink.step, self.slope.as_slice());
            self.exchange(program, &edge, kink.at);
            is_afresh = !self.basis.is_inverted;
            // As many iterations as there are variables without progress are no accident.
            if stalled > columns {
                self.perturbation = PERTURBATION * program.cost.amax();
                is_afresh = true;
            }
        }
        Ok(false)
    }

    /// Multipliers, gradients and point of the vertex; false when a row had to be dropped, which makes it another
    /// vertex.
    fn compute_afresh(&mut self, program: &ElasticProgram) -> bool {
        self.update_multipliers(program);
        self.update_gradient(program);
        if self.gradient_error > self.small_gradient {
            // Where rows are nearly dependent, as those of rolling wheels are, the inverse has few digits.
            self.take_from_basic(&self.gradient.select_rows(&self.basis.basic));
            self.update_gradient(program);
        }
        if self.drop_row_beyond_box(program) {
            return false;
        }
        for column in &self.basis.basic {
            self.gradient[*column] = 0.0;
        }
        self.update_point(program, true);
        if self.basis.is_updated {
            // Corrects what the updates have lost.
            self.value.copy_from(program.target);
            self.value.gemv(1.0, program.matrix, &self.x, -1.0);
            self.update_point(program, false);
        }
        true
    }

    /// Multipliers at their bounds, and those of the tight rows that make the gradients of the basic variables zero.
    fn update_multipliers(&mut self, program: &ElasticProgram) {
        for (row, place) in self.place.iter().enumerate() {
            let (low, high) = self.multiplier_bounds(program, row);
            self.multiplier[row] = match place {
                RowPlace::Low => low,
                RowPlace::Tight => 0.0,
                RowPlace::High => high,
            };
        }
        let gradient =
            |column: &usize| self.cost(program, *column) + program.matrix.column(*column).dot(&self.multiplier);
        let gradients = DVector::from_iterator(self.basis.basic.len(), self.basis.basic.iter().map(gradient));
        self.take_from_basic(&gradients);
    }

    /// Changes the multipliers of the tight rows such that the gradients of the basic variables fall by these.
    fn take_from_basic(&mut self, gradients: &DVector<f64>) {
        let changes = self.basis.inverse.tr_mul(gradients);
        for (row, change) in self.basis.tight.iter().zip(changes.iter()) {
            self.multiplier[*row] -= change;
        }
    }

    /// Puts the tight row whose multiplier is furthest beyond its box at that bound, after a warm start; false when there is
    /// none.
    fn drop_row_beyond_box(&mut self, program: &ElasticProgram) -> bool {
        let slack = TOLERANCE * program.penalty_parameter;
        let beyond = |row: &usize| {
            let (low, high) = self.multiplier_bounds(program, *row);
            (low - self.multiplier[*row]).max(self.multiplier[*row] - high)
        };
        let worst = self.basis.tight.iter().copied().max_by(|a, b| beyond(a).total_cmp(&beyond(b)));
        let Some(row) = worst.filter(|row| beyond(row) > slack) else { return false };
        let partner = self.basis.inverse.column(self.basis.position(row)).iamax();
        self.is_basic[self.basis.basic[partner]] = false;
        self.basis.remove(row, partner);
        // Zero is in every box.
        self.place[row] = if self.multiplier[row] < 0.0 { RowPlace::Low } else { RowPlace::High };
        true
    }

    fn update_gradient(&mut self, program: &ElasticProgram) {
        self.gradient = DVector::from_fn(program.cost.len(), |column, _| self.cost(program, column));
        add_rows(&mut self.gradient, &self.multiplier, &self.by_row);
        let of_basic = self.basis.basic.iter().map(|column| self.gradient[*column].abs());
        self.gradient_error = of_basic.fold(0.0, f64::max);
    }

    /// Whether an inverse that was updated has lost its digits: what it should make zero is not.
    fn has_drifted(&self, program: &ElasticProgram) -> bool {
        let is_missed = |row: &usize| self.value[*row].abs() > SUM_ROUNDING * self.range[*row];
        self.gradient_error > SUM_ROUNDING * program.cost.amax() || self.basis.tight.iter().any(is_missed)
    }

    /// Variables at the bounds that their gradients choose; the basic ones meet the tight rows, from where they are or afresh.
    fn update_point(&mut self, program: &ElasticProgram, is_afresh: bool) {
        let gradient_tolerance = self.gradient_tolerance();
        let bounds = program.lower.as_slice().iter().zip(program.upper.as_slice());
        let places = self.rest.iter_mut().zip(&self.is_basic).zip(self.gradient.as_slice());
        let variables = self.x.as_mut_slice().iter_mut().zip(places).zip(bounds);
        for (column, ((x, ((rest, &is_basic), &gradient)), (&lower, &upper))) in variables.enumerate() {
            if gradient.abs() > gradient_tolerance {
                *rest = Rest::by(gradient);
            }
            let new = match rest {
                _ if is_basic && is_afresh => 0.0,
                _ if is_basic => continue,
                Rest::Lower => lower,
                Rest::Zero => 0.0,
                Rest::Upper => upper,
            };
            let change = new - *x;
            if change != 0.0 {
                add_multiple(&mut self.value, change, program.matrix.column(column).as_slice());
                *x = new;
            }
        }
        let basic = &self.basis.inverse * self.value.select_rows(&self.basis.tight);
        for (column, x) in self.basis.basic.iter().zip(basic.iter()) {
            self.x[*column] -= x;
            add_multiple(&mut self.value, -x, program.matrix.column(*column).as_slice());
        }
    }

    /// The change of the multipliers along the edge, and that of the gradients.
    fn update_direction(&mut self, edge: &Edge) {
        self.direction.as_mut_slice().fill(0.0);
        if let Leaving::Row { row, sign } = edge.leaving {
            self.direction[row] = sign;
        }
        for (row, change) in self.basis.tight.iter().zip(edge.changes.iter()) {
            self.direction[*row] = *change;
        }
        self.slope.as_mut_slice().fill(0.0);
        add_rows(&mut self.slope, &self.direction, &self.by_row);
    }

    /// Lets one leave its place and the other take it.
    fn exchange(&mut self, program: &ElasticProgram, edge: &Edge, entering: KinkAt) {
        match edge.leaving {
            Leaving::Basic { position, sign } => {
                let column = self.basis.basic[position];
                (self.is_basic[column], self.rest[column]) = (false, Rest::by(sign));
            }
            Leaving::Row { row, .. } => self.place[row] = RowPlace::Tight,
        }
        match entering {
            KinkAt::Variable(column) => self.is_basic[column] = true,
            KinkAt::Row(row) if self.direction[row] > 0.0 => self.place[row] = RowPlace::High,
            KinkAt::Row(row) => self.place[row] = RowPlace::Low,
        }
        match (edge.leaving, entering) {
            (Leaving::Basic { position, .. }, KinkAt::Variable(column)) => {
                self.basis.replace_column(program, position, column);
            }
            (Leaving::Basic { position, .. }, KinkAt::Row(row)) => self.basis.remove(row, position),
            (Leaving::Row { row, sign }, KinkAt::Variable(column)) => {
                self.basis.add(program, (row, &edge.changes * -sign), column);
            }
            // From one bound to the other.
            (Leaving::Row { row, .. }, KinkAt::Row(other)) if row == other => {}
            (Leaving::Row { row, sign }, KinkAt::Row(other)) => {
                self.basis.replace_row(other, (row, &edge.changes * -sign));
            }
        }
    }
}

/// Slices take half the time of nalgebra's `axpy`, which also scales the sum; its iterators look for the end of a column at every
/// element.
fn add_multiple(sum: &mut DVector<f64>, factor: f64, addend: &[f64]) {
    for (sum, addend) in sum.as_mut_slice().iter_mut().zip(addend) {
        *sum += factor * addend;
    }
}

/// Adds all rows, each times its factor.
fn add_rows(sum: &mut DVector<f64>, factors: &DVector<f64>, by_row: &DMatrix<f64>) {
    for (factor, coefficients) in factors.as_slice().iter().zip(by_row.column_iter()) {
        if *factor != 0.0 {
            add_multiple(sum, *factor, coefficients.as_slice());
        }
    }
}

/// How far a sum can move whose terms have these coefficients and ranges.
fn range(coefficients: &[f64], ranges: &[f64]) -> f64 {
    coefficients.iter().zip(ranges).map(|(coefficient, range)| coefficient.abs() * range).sum()
}

impl Rest {
    /// The bound that a gradient of this sign chooses.
    fn by(gradient: f64) -> Self {
        if gradient > 0.0 { Self::Lower } else { Self::Upper }
    }
}

#[cfg(test)]
mod tests;
