//! The right to submit a job, and the job that is made of the submitted work: its clocks, its panic border, its outcome.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::oneshot;

use super::bounded_queue::BoundedQueue;
use super::caller::CallerId;
use super::clocks::Clocks;
use super::job::Job;
use super::lending::IdleWorkers;
use super::stop::{StopCause, StopHandle};
use super::ticket::{CancelOnDrop, JobOutcome, Ticket};
use super::watchdog::Watchdog;

/// The right to submit one job to the queue; released on drop.
#[derive(Debug)]
pub struct Permit {
    queue: Arc<BoundedQueue>,
    watchdog: Arc<Watchdog>,
    id: u64,
    caller: CallerId,
}

impl Permit {
    /// The permit that the queue has issued under this number.
    pub(super) fn new(id: u64, queue: &Arc<BoundedQueue>, watchdog: &Arc<Watchdog>) -> Self {
        let caller = CallerId::default();
        Self { queue: Arc::clone(queue), watchdog: Arc::clone(watchdog), id, caller }
    }

    /// The same for a job of this caller; without it, all jobs are those of one.
    #[must_use]
    pub fn of_caller(mut self, caller: CallerId) -> Self {
        self.caller = caller;
        self
    }

    /// The number of the job, unique in this queue, for logs.
    pub fn job_id(&self) -> u64 {
        self.id
    }

    /// The place in the queue of a job that is submitted at this moment: 0 where a worker is idle, 1 where it is the next
    /// to start.
    pub fn position(&self) -> usize {
        self.queue.position(self.caller)
    }

    /// How long a job that is submitted at this moment will probably wait for a worker.
    pub fn expected_wait(&self) -> Duration {
        self.queue.expected_wait(self.caller)
    }

    /// The workers that the job of this permit may borrow while it runs.
    pub fn idle_workers(&self) -> IdleWorkers {
        IdleWorkers::new(Arc::clone(&self.queue))
    }

    /// Queues `work`; when one of its clocks runs out, the stop handle signals it.
    pub fn submit<T: Send + 'static>(
        self,
        clocks: Clocks,
        work: impl FnOnce(&StopHandle) -> T + Send + 'static,
    ) -> Ticket<T> {
        let (queue, watchdog) = (Arc::clone(&self.queue), Arc::clone(&self.watchdog));
        let (id, caller, stop) = (self.id, self.caller, StopHandle::new());
        let cancel_on_drop = CancelOnDrop::new(stop.clone(), Arc::downgrade(&queue), id);
        let (sender, answer) = oneshot::channel();
        queue.push(self.into_job(stop.clone(), clocks, work, sender), stop.clone(), clocks, caller);
        // After the push, so that a deadline that has passed already finds the job in the queue and removes it.
        let deadline = clocks.last_start().map(|time| {
            let queued = (Arc::downgrade(&queue), id);
            watchdog.watch_queued(&stop, (time, StopCause::Deadline), queued)
        });
        Ticket::new(answer, cancel_on_drop, deadline)
    }

    /// The worker's end of a job.
    fn into_job<T: Send + 'static>(
        self,
        stop: StopHandle,
        clocks: Clocks,
        work: impl FnOnce(&StopHandle) -> T + Send + 'static,
        sender: oneshot::Sender<JobOutcome<T>>,
    ) -> Job {
        Job::new(self.id, move || {
            // The watchdog may be a moment late, and the job must not start after its deadline.
            if clocks.last_start().is_some_and(|time| time <= Instant::now()) {
                stop.stop(StopCause::Deadline);
            }
            let outcome = match stop.cause() {
                Some(cause) => JobOutcome::NeverStarted { cause },
                None => run_timed(&stop, &clocks, work, &self.watchdog),
            };
            // Before the outcome is sent, so that a caller who has it can reserve this permit again.
            drop(self);
            // Sending fails when the caller has left, who needs no outcome.
            let _ = sender.send(outcome);
        })
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        self.queue.release(self.id);
    }
}

fn run_timed<T>(
    stop: &StopHandle,
    clocks: &Clocks,
    work: impl FnOnce(&StopHandle) -> T,
    watchdog: &Watchdog,
) -> JobOutcome<T> {
    let start = Instant::now();
    let watches = clocks.signals(start).map(|signal| signal.map(|signal| watchdog.watch(stop, signal)));
    // The work owns all it touches, so nothing half-changed outlives a panic.
    let result = catch_unwind(AssertUnwindSafe(|| work(stop)));
    let duration = start.elapsed();
    drop(watches);
    match result {
        Ok(value) => JobOutcome::Finished { value, duration },
        Err(payload) => {
            let message = words_of_panic(payload.as_ref()).unwrap_or("a panic without a message").to_owned();
            JobOutcome::Panicked { message }
        }
    }
}

/// The words of a panic, where it has any.
pub fn words_of_panic(payload: &(dyn Any + Send)) -> Option<&str> {
    payload.downcast_ref::<&str>().copied().or_else(|| payload.downcast_ref::<String>().map(String::as_str))
}
