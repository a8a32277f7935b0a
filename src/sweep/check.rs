//! All requests of a sweep are judged before any of them runs.

use super::{Shard, Sweep};
use crate::contract::Problem;

/// Most rows whose faults are kept: the others are counted.
pub const MOST_FAULTS: usize = 20;

/// Rows that would be refused.
#[derive(Debug, Default)]
pub struct RowFaults {
    /// The first of them with their numbers, in order.
    pub first: Vec<(u64, Problem)>,
    /// How many there are.
    pub count: u64,
}

impl Sweep {
    /// Judges the requests of all rows of a shard; none of them runs.
    ///
    /// # Errors
    /// All rows that would be refused.
    pub fn check(&self, shard: Shard) -> Result<(), RowFaults> {
        let mut faults = RowFaults::default();
        for row in shard.chunks(self.chunk_count()).flat_map(|chunk| self.chunk(chunk)) {
            if let Err(problem) = self.row(row).and_then(|row| self.job().check(&row.request)) {
                faults.count += 1;
                if faults.first.len() < MOST_FAULTS {
                    faults.first.push((row, problem));
                }
            }
        }
        if faults.count == 0 { Ok(()) } else { Err(faults) }
    }
}
