//! Which workers run jobs, which are lent, and which are idle.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The slots of the workers: each holds a running job or a loan, or is idle.
#[derive(Debug)]
pub(super) struct WorkerSlots {
    workers: usize,
    /// The jobs that a worker has taken and that have not released their permit.
    running: BTreeSet<u64>,
    /// The recall flags of all loans, the latest last.
    lent: BTreeMap<u64, Arc<AtomicBool>>,
    next_loan: u64,
}

impl WorkerSlots {
    pub(super) fn new(workers: usize) -> Self {
        Self { workers, running: BTreeSet::new(), lent: BTreeMap::new(), next_loan: 0 }
    }

    pub(super) fn has_idle(&self) -> bool {
        self.running.len() + self.lent.len() < self.workers
    }

    pub(super) fn lent(&self) -> usize {
        self.lent.len()
    }

    pub(super) fn begin_job(&mut self, id: u64) {
        self.running.insert(id);
    }

    /// Does nothing for a job that was never begun.
    pub(super) fn end_job(&mut self, id: u64) {
        self.running.remove(&id);
    }

    pub(super) fn lend(&mut self) -> (u64, Arc<AtomicBool>) {
        let (loan, is_recalled) = (self.next_loan, Arc::new(AtomicBool::new(false)));
        self.next_loan += 1;
        self.lent.insert(loan, Arc::clone(&is_recalled));
        (loan, is_recalled)
    }

    pub(super) fn give_back(&mut self, loan: u64) {
        self.lent.remove(&loan);
    }

    /// Recalls as many loans as the waiting jobs need, the latest first: their helpers have done least.
    pub(super) fn recall_for(&self, waiting: usize) {
        let idle = self.workers - self.running.len() - self.lent.len();
        for is_recalled in self.lent.values().rev().take(waiting.saturating_sub(idle)) {
            is_recalled.store(true, Ordering::Relaxed);
        }
    }
}
