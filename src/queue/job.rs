//! What the queue knows of a job: its number, and how to run it.

use std::fmt;

/// A queued job; its value type is erased, so that one queue holds jobs of all kinds.
pub(super) struct Job {
    id: u64,
    run: Box<dyn FnOnce() + Send>,
}

impl Job {
    /// `run` does the work, releases the permit, and sends the outcome.
    pub(super) fn new(id: u64, run: impl FnOnce() + Send + 'static) -> Self {
        Self { id, run: Box::new(run) }
    }

    pub(super) fn id(&self) -> u64 {
        self.id
    }

    /// Runs the work, releases the permit, then sends the outcome.
    pub(super) fn run(self) {
        (self.run)();
    }
}

impl fmt::Debug for Job {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Job").field("id", &self.id).finish_non_exhaustive()
    }
}
