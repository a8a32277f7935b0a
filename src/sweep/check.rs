//! All requests of a sweep are judged before any of them runs.

use std::num::NonZeroUsize;
use std::panic::resume_unwind;
use std::thread;

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
    /// Judges the requests of all rows of a shard on so many threads; none of them runs.
    ///
    /// # Errors
    /// All rows that would be refused.
    pub fn check(&self, shard: Shard, threads: NonZeroUsize) -> Result<(), RowFaults> {
        let count = threads.get() as u64;
        let of_thread = |thread: u64| Shard {
            index: shard.index.saturating_add(shard.of.saturating_mul(thread)),
            of: shard.of.saturating_mul(count),
        };
        let found: Vec<_> = thread::scope(|scope| {
            let judge = |thread| scope.spawn(move || self.faults(of_thread(thread)));
            let threads: Vec<_> = (0..count).map(judge).collect();
            threads.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
        });
        let mut faults = found.into_iter().fold(RowFaults::default(), |mut all, faults: RowFaults| {
            all.first.extend(faults.first);
            RowFaults { count: all.count + faults.count, ..all }
        });
        faults.first.sort_by_key(|(row, _)| *row);
        faults.first.truncate(MOST_FAULTS);
        if faults.count == 0 { Ok(()) } else { Err(faults) }
    }

    fn faults(&self, shard: Shard) -> RowFaults {
        let mut faults = RowFaults::default();
        for row in shard.chunks(self.chunk_count()).flat_map(|chunk| self.chunk(chunk)) {
            if let Err(problem) = self.row(row).and_then(|row| self.job().check(&row.request)) {
                faults.count += 1;
                if faults.first.len() < MOST_FAULTS {
                    faults.first.push((row, problem));
                }
            }
        }
        faults
    }
}
