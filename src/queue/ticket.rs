//! The caller's end of a job.

use std::sync::Weak;
use std::time::Duration;

use tokio::sync::oneshot;

use super::bounded_queue::BoundedQueue;
use super::stop::{StopCause, StopHandle};
use super::watchdog::Watch;

/// How a job ended.
#[derive(Debug, Clone, PartialEq)]
pub enum JobOutcome<T> {
    /// The work returned, by itself or because it was signalled to stop.
    Finished {
        /// What it returned.
        value: T,
        /// How long it ran, waiting excluded.
        duration: Duration,
    },
    /// The work panicked.
    Panicked {
        /// The panic message, for the log only.
        message: String,
    },
    /// The job was signalled to stop before its work started.
    NeverStarted {
        /// What stopped it.
        cause: StopCause,
    },
}

/// The caller's end of a job. Dropping it stops the job, because nobody waits for its outcome any more.
#[derive(Debug)]
pub struct Ticket<T> {
    answer: oneshot::Receiver<JobOutcome<T>>,
    cancel_on_drop: CancelOnDrop,
    /// The watch of the deadline, if there is one; dropped when the job has ended.
    deadline: Option<Watch>,
}

impl<T> Ticket<T> {
    /// The caller's end of the job that sends `answer`; `deadline` is the watch of its deadline.
    pub(super) fn new(
        answer: oneshot::Receiver<JobOutcome<T>>,
        cancel_on_drop: CancelOnDrop,
        deadline: Option<Watch>,
    ) -> Self {
        Self { answer, cancel_on_drop, deadline }
    }

    /// Waits for the end of the job.
    pub async fn outcome(self) -> JobOutcome<T> {
        let Self { answer, cancel_on_drop, deadline: _watch } = self;
        answer.await.unwrap_or_else(|_| cancel_on_drop.never_started())
    }

    /// Waits for the end of the job on a thread that may block.
    ///
    /// # Panics
    /// When called on a thread of an async runtime.
    pub fn blocking_outcome(self) -> JobOutcome<T> {
        let Self { answer, cancel_on_drop, deadline: _watch } = self;
        answer.blocking_recv().unwrap_or_else(|_| cancel_on_drop.never_started())
    }
}

/// Stops the job when its ticket is dropped, and removes it from the queue if it still waits.
#[derive(Debug)]
pub(super) struct CancelOnDrop {
    stop: StopHandle,
    queue: Weak<BoundedQueue>,
    id: u64,
}

impl CancelOnDrop {
    pub(super) fn new(stop: StopHandle, queue: Weak<BoundedQueue>, id: u64) -> Self {
        Self { stop, queue, id }
    }

    /// The outcome of a job that was dropped without an answer.
    fn never_started<T>(&self) -> JobOutcome<T> {
        JobOutcome::NeverStarted { cause: self.stop.cause().unwrap_or(StopCause::Shutdown) }
    }
}

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.stop.cut_off(StopCause::CallerGone);
        if let Some(queue) = self.queue.upgrade() {
            queue.remove(self.id);
        }
    }
}
