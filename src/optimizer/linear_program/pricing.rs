//! Pricing: what leaves its place in the next iteration.

use super::{ElasticSolver, RowPlace, TOLERANCE};
use crate::optimizer::elastic_program::ElasticProgram;

/// What leaves its place.
#[derive(Debug, Clone, Copy)]
pub(super) enum Leaving {
    /// The basic variable at this position, and the sign that its gradient takes.
    Basic { position: usize, sign: f64 },
    /// A row at a bound of its multiplier, and the sign in which that moves.
    Row { row: usize, sign: f64 },
}

impl ElasticSolver {
    /// The variable or row that contradicts its place most, as a share of its range; none at the optimum.
    pub(super) fn leaving(&self, program: &ElasticProgram) -> Option<Leaving> {
        let mut worst = TOLERANCE;
        let mut leaving = None;
        for (position, &column) in self.basis.basic.iter().enumerate() {
            let below = (program.lower[column] - self.x[column]) / program.width(column);
            let above = (self.x[column] - program.upper[column]) / program.width(column);
            if below.max(above) > worst {
                worst = below.max(above);
                leaving = Some(Leaving::Basic { position, sign: if below > above { 1.0 } else { -1.0 } });
            }
        }
        for (row, place) in self.place.iter().enumerate() {
            let sign = match place {
                RowPlace::Low => 1.0,
                RowPlace::Tight => continue,
                RowPlace::High => -1.0,
            };
            let violation = sign * self.value[row] / self.range[row];
            if violation > worst && self.range[row] > 0.0 {
                worst = violation;
                leaving = Some(Leaving::Row { row, sign });
            }
        }
        leaving
    }
}
