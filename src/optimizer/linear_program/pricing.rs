//! Pricing: what leaves its place in the next iteration.

use nalgebra::DVector;

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

/// An edge of the dual from a vertex on.
#[derive(Debug)]
pub(super) struct Edge {
    pub(super) leaving: Leaving,
    /// The slope of D along it, at first.
    pub(super) rise: f64,
    /// How the multipliers of the tight rows change along it.
    pub(super) changes: DVector<f64>,
}

impl ElasticSolver {
    /// The steepest edge of a variable or row that contradicts its place: along which D rises most for the length that the multipliers, each
    /// times its row's range, move. None at the optimum.
    pub(super) fn steepest_edge(&self, program: &ElasticProgram) -> Option<Edge> {
        let ranges = self.range.select_rows(&self.basis.tight);
        let (mut steepest, mut of_basic) = (0.0, None);
        for (position, &column) in self.basis.basic.iter().enumerate() {
            let (below, above) = (program.lower[column] - self.x[column], self.x[column] - program.upper[column]);
            let rise = below.max(above);
            if rise <= TOLERANCE * program.width(column) {
                continue;
            }
            let steepness = rise / length(self.basis.inverse.row(position).iter(), &ranges);
            if steepness > steepest {
                let sign = if below > above { 1.0 } else { -1.0 };
                (steepest, of_basic) = (steepness, Some((position, sign, rise)));
            }
        }
        let mut edge = of_basic.map(|(position, sign, rise)| {
            let changes = self.basis.inverse.row(position).transpose() * sign;
            Edge { leaving: Leaving::Basic { position, sign }, rise, changes }
        });
        for (row, place) in self.place.iter().enumerate() {
            let sign = match place {
                RowPlace::Low => 1.0,
                RowPlace::Tight => continue,
                RowPlace::High => -1.0,
            };
            // The edge is no shorter than the change of the row's own multiplier: few lengths are needed.
            let rise = sign * self.value[row];
            if rise <= TOLERANCE.max(steepest) * self.range[row] || self.range[row] <= 0.0 {
                continue;
            }
            let changes = self.basis.inverse.tr_mul(&(self.basis.basic_part(program, row) * -sign));
            let steepness = rise / length(changes.iter(), &ranges).hypot(self.range[row]);
            if steepness > steepest {
                (steepest, edge) = (steepness, Some(Edge { leaving: Leaving::Row { row, sign }, rise, changes }));
            }
        }
        edge
    }
}

/// How far the multipliers of the tight rows move, each times its range.
fn length<'a>(changes: impl Iterator<Item = &'a f64>, ranges: &DVector<f64>) -> f64 {
    changes.zip(ranges.as_slice()).map(|(change, range)| (change * range).powi(2)).sum::<f64>().sqrt()
}
