//! Where the simplex begins: at a vertex of its own, or at that of the last program.

use super::basis::Basis;
use super::{DEPENDENT, ElasticSolver, RowPlace};
use crate::optimizer::elastic_program::ElasticProgram;

impl ElasticSolver {
    /// All rows violated or slack as at x = 0.
    pub(super) fn begin_cold(&mut self, program: &ElasticProgram) {
        self.basis.clear();
        self.place.clear();
        self.place
            .extend(program.target.iter().map(|target| if *target < 0.0 { RowPlace::High } else { RowPlace::Low }));
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
        let is_whole = candidates.len() == columns.len() && candidates.len() > Basis::SMALL;
        if is_whole && self.basis.adopt(program, &candidates, &columns) {
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
        let mut rest = program.matrix.select_rows(&rows).select_columns(&columns);
        let largest = rest.amax();
        while !rows.is_empty() && !columns.is_empty() {
            let (row, column) = rest.iamax_full();
            let pivot = rest[(row, column)];
            if pivot.abs() <= DEPENDENT * largest {
                break;
            }
            let eliminated = rest.column(column) * rest.row(row) / pivot;
            rest -= eliminated;
            rest = rest.remove_row(row).remove_column(column);
            let (row, column) = (rows.remove(row), columns.remove(column));
            self.place[row] = RowPlace::Tight;
            self.is_basic[column] = true;
            self.basis.push(row, column);
        }
    }

    pub(super) fn remember(&mut self, program: &ElasticProgram) {
        self.known.clear();
        self.known.extend(program.row_name.iter().copied().zip(self.place.iter().copied()));
    }
}
