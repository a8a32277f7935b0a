//! Where the simplex begins: at a vertex of its own, or at that of the last program.

use nalgebra::DMatrix;

use super::{ElasticSolver, RowPlace};
use crate::optimizer::elastic_program::ElasticProgram;
use crate::optimizer::independent_rows::DEPENDENT;

impl ElasticSolver {
    /// All rows violated or slack as at x = 0.
    pub(super) fn begin_cold(&mut self, program: &ElasticProgram) {
        self.basis.clear();
        let place = |target: &f64| if *target < 0.0 { RowPlace::High } else { RowPlace::Low };
        self.place = program.target.iter().map(place).collect();
    }

    /// The rows and variables of the last program, as far as they are there and independent.
    pub(super) fn begin_warm(&mut self, program: &ElasticProgram) {
        let basic = std::mem::take(&mut self.basis.basic);
        self.begin_cold(program);
        let mut candidates = Vec::new();
        for (row, name) in program.row_name.iter().enumerate() {
            let Ok(known) = self.known.binary_search_by_key(name, |(name, _)| *name) else { continue };
            match self.known[known].1 {
                RowPlace::Tight => candidates.push(row),
                place @ (RowPlace::Low | RowPlace::High) => self.place[row] = place,
            }
        }
        let columns = program.cost.len();
        let is_free = |column: &usize| *column < columns && program.width(*column) > 0.0;
        let columns: Vec<usize> = basic.into_iter().filter(is_free).collect();
        if candidates.len() == columns.len() && self.basis.adopt(program, &candidates, &columns) {
            for (row, column) in candidates.into_iter().zip(columns) {
                self.place[row] = RowPlace::Tight;
                self.is_basic[column] = true;
            }
        } else {
            self.pair(program, candidates, columns);
        }
    }

    /// Makes rows tight and variables basic, pair by pair with complete pivoting, while they are independent.
    fn pair(&mut self, program: &ElasticProgram, mut rows: Vec<usize>, mut columns: Vec<usize>) {
        // What is left of the matrix after each elimination is that of the first rows and columns, in their order.
        let mut rest = program.matrix.select_rows(&rows).select_columns(&columns);
        let largest = rest.amax();
        while !rows.is_empty() && !columns.is_empty() {
            let (row, column) = rest.view((0, 0), (rows.len(), columns.len())).iamax_full();
            let pivot = rest[(row, column)];
            if pivot.abs() <= DEPENDENT * largest {
                break;
            }
            eliminate(&mut rest, (rows.len(), columns.len()), (row, column));
            let (row, column) = (rows.remove(row), columns.remove(column));
            self.place[row] = RowPlace::Tight;
            self.is_basic[column] = true;
            self.basis.push(row, column);
        }
    }

    pub(super) fn remember(&mut self, program: &ElasticProgram) {
        self.known = program.row_name.iter().copied().zip(self.place.iter().copied()).collect();
    }
}

/// Eliminates a row and a column, and closes the gaps that they leave.
fn eliminate(matrix: &mut DMatrix<f64>, (rows, columns): (usize, usize), (row, column): (usize, usize)) {
    let pivot_column = matrix.column(column).into_owned();
    let pivot = pivot_column[row];
    for from in (0..columns).filter(|from| *from != column) {
        let of_row = matrix[(row, from)];
        let to = from - usize::from(from > column);
        for from_row in 0..row {
            matrix[(from_row, to)] = matrix[(from_row, from)] - pivot_column[from_row] * of_row / pivot;
        }
        for from_row in row + 1..rows {
            matrix[(from_row - 1, to)] = matrix[(from_row, from)] - pivot_column[from_row] * of_row / pivot;
        }
    }
}
