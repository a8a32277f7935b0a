//! Where the simplex begins: at a vertex of its own, or at that of the last program.

use super::{Basis, ElasticSolver, RowPlace};
use crate::optimizer::elastic_program::ElasticProgram;

impl ElasticSolver {
    /// All rows violated or slack as at x = 0.
    pub(super) fn begin_cold(&mut self, program: &ElasticProgram) {
        self.basis = Basis::default();
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
        let is_free = |column: &usize| *column < program.cost.len() && program.width(*column) > 0.0;
        self.basis.adopt(program, candidates, basic.into_iter().filter(is_free).collect());
        for (row, column) in self.basis.tight.iter().zip(&self.basis.basic) {
            self.place[*row] = RowPlace::Tight;
            self.is_basic[*column] = true;
        }
    }
}
