//! Tight rows, basic variables and the inverse of their matrix.
//!
//! The inverse is updated by the row or column that changes (product form), at the cost of one of its squares in place of its cube, and
//! made afresh where a pivot is small or an answer shows that it has lost its digits.

use nalgebra::{DMatrix, DVector};

use crate::optimizer::elastic_program::ElasticProgram;
use crate::optimizer::evaluation::largest_magnitude;
use crate::optimizer::independent_rows::DEPENDENT;

/// The choice of rows and variables that is a vertex of the dual.
#[derive(Debug, Clone, Default)]
pub(super) struct Basis {
    /// Tight rows and basic variables, as many of each.
    pub(super) tight: Vec<usize>,
    pub(super) basic: Vec<usize>,
    /// Inverse of the basic columns of the tight rows: a row per basic variable, a column per tight row.
    pub(super) inverse: DMatrix<f64>,
    /// Whether the inverse is there and need not be made; wherever a row or a variable leaves its place it is there.
    pub(super) is_inverted: bool,
    /// Whether the inverse was updated since it was made.
    pub(super) is_updated: bool,
}

impl Basis {
    /// Adds a pair; the matrix is not inverted.
    pub(super) fn push(&mut self, row: usize, column: usize) {
        self.tight.push(row);
        self.basic.push(column);
        self.is_inverted = false;
    }

    /// Takes these rows and columns in place of none, if their matrix is regular by far; else, pair by pair with complete pivoting, those
    /// of them that are independent.
    pub(super) fn adopt(&mut self, program: &ElasticProgram, mut rows: Vec<usize>, mut columns: Vec<usize>) {
        if rows.len() == columns.len() {
            (self.tight, self.basic) = (rows.clone(), columns.clone());
            let largest = |matrix: &DMatrix<f64>| largest_magnitude(matrix.as_slice().iter().copied());
            if self.invert(program) && largest(&self.inverse) * largest(program.matrix) < 1.0 / DEPENDENT {
                return;
            }
            *self = Self::default();
        }
        let mut rest = program.matrix.select_rows(&rows).select_columns(&columns);
        let smallest = DEPENDENT * rest.amax();
        while !rest.is_empty() {
            let (row, column) = rest.iamax_full();
            let pivot = rest[(row, column)];
            if pivot.abs() <= smallest {
                break;
            }
            let (of_row, of_column) = (rest.row(row).remove_column(column), rest.column(column).remove_row(row));
            rest = rest.remove_row(row).remove_column(column) - of_column * of_row / pivot;
            self.push(rows.remove(row), columns.remove(column));
        }
    }

    /// Inverts the matrix, unless its inverse is known; false when it is singular or not finite.
    pub(super) fn invert(&mut self, program: &ElasticProgram) -> bool {
        if self.is_inverted {
            return true;
        }
        let size = self.tight.len();
        let matrix = DMatrix::from_fn(size, size, |row, column| program.matrix[(self.tight[row], self.basic[column])]);
        let Some(inverse) = matrix.try_inverse() else { return false };
        self.inverse = inverse;
        (self.is_inverted, self.is_updated) = (true, false);
        self.inverse.iter().all(|value| value.is_finite())
    }

    /// Whether the inverse was updated, and is therefore to be made afresh.
    pub(super) fn forget_updates(&mut self) -> bool {
        self.is_inverted &= !self.is_updated;
        self.is_updated
    }

    /// Another variable becomes basic in place of one.
    pub(super) fn replace_column(&mut self, program: &ElasticProgram, position: usize, column: usize) {
        self.basic[position] = column;
        let change = &self.inverse * program.matrix.column(column).select_rows(&self.tight);
        if self.may_update(change[position], change.amax()) {
            let row = self.inverse.row(position) / change[position];
            self.inverse.ger(-1.0, &change, &row.transpose(), 1.0);
            self.inverse.row_mut(position).copy_from(&row);
        }
    }

    /// Another row becomes tight in place of one; with what its basic part is in terms of the tight rows.
    pub(super) fn replace_row(&mut self, old: usize, (new, change): (usize, DVector<f64>)) {
        let position = self.position(old);
        self.tight[position] = new;
        if self.may_update(change[position], change.amax()) {
            let column = self.inverse.column(position) / change[position];
            self.inverse.ger(-1.0, &column, &change, 1.0);
            self.inverse.column_mut(position).copy_from(&column);
        }
    }

    /// A row becomes tight and a variable basic; the row with what its basic part is in terms of the tight rows.
    pub(super) fn add(&mut self, program: &ElasticProgram, (row, by_row): (usize, DVector<f64>), column: usize) {
        let size = self.tight.len();
        let of_column = program.matrix.column(column).select_rows(&self.tight);
        let of_row = self.basic_part(program, row);
        let by_column = &self.inverse * &of_column;
        let corner = program.matrix[(row, column)];
        let pivot = corner - of_row.dot(&by_column);
        self.push(row, column);
        if self.may_update(pivot, corner.abs().max(of_row.amax())) {
            self.inverse.ger(1.0 / pivot, &by_column, &by_row, 1.0);
            self.inverse.resize_mut(size + 1, size + 1, 1.0 / pivot);
            self.inverse.view_mut((0, size), (size, 1)).copy_from(&(by_column / -pivot));
            self.inverse.view_mut((size, 0), (1, size)).copy_from(&(by_row / -pivot).transpose());
        }
    }

    /// A tight row and the basic variable at a position go.
    pub(super) fn remove(&mut self, row: usize, basic: usize) {
        let tight = self.position(row);
        self.tight.remove(tight);
        self.basic.remove(basic);
        let pivot = self.inverse[(basic, tight)];
        if self.may_update(pivot, self.inverse.column(tight).amax()) {
            let column = self.inverse.column(tight).into_owned();
            let row = self.inverse.row(basic).transpose();
            self.inverse.ger(-1.0 / pivot, &column, &row, 1.0);
            self.inverse = std::mem::take(&mut self.inverse).remove_row(basic).remove_column(tight);
        }
    }

    /// Whether the inverse can be updated by this pivot; else it is to be made afresh.
    fn may_update(&mut self, pivot: f64, largest: f64) -> bool {
        self.is_updated = true;
        self.is_inverted = pivot.abs() > DEPENDENT * largest;
        self.is_inverted
    }

    /// The position of a tight row.
    pub(super) fn position(&self, row: usize) -> usize {
        self.tight.iter().position(|tight| *tight == row).expect("the row is tight")
    }

    /// The entries of a row in the basic columns.
    pub(super) fn basic_part(&self, program: &ElasticProgram, row: usize) -> DVector<f64> {
        DVector::from_iterator(self.basic.len(), self.basic.iter().map(|column| program.matrix[(row, *column)]))
    }
}
