//! A bounded queue that feeds a fixed number of blocking worker threads. It knows no domain.
//!
//! - Admission is counted: at most `workers + queue_length` jobs are in flight, running and waiting together. A
//!   [`Place`] is reserved first, filled with a job later, and given back when it is dropped.
//! - Jobs start in the order in which they came. Each runs behind a panic border and answers through its [`Ticket`].
//! - A running job may borrow [`IdleWorkers`]; they are given back as soon as another job waits.
//! - A job stops for the first [`StopCause`] that reaches its [`StopHandle`]: its time limit, its deadline, its
//!   caller's departure (the ticket is dropped), or a shutdown. A job that is stopped while it waits is taken out of
//!   the line and never started.
//!
//! The waiting line is a deque under a mutex rather than a channel, because the place of a caller who left must be free
//! at once, and a channel gives entries only to its receivers.
//!
//! Mutex poisoning is ignored throughout: no foreign code runs while one of these locks is held, and each critical
//! section leaves the state sound after every statement.

mod bounded_queue;
mod job;
mod lending;
mod stop;
#[cfg(test)]
mod tests;
mod watchdog;
mod workers;

use std::io;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bounded_queue::BoundedQueue;
pub use bounded_queue::{Place, Refusal};
pub use job::{ANSWER_MARGIN, Clocks, JobOutcome, Ticket};
pub use lending::IdleWorkers;
pub use stop::{StopCause, StopHandle};
use watchdog::Watchdog;
use workers::Workers;

/// The queue with its worker threads and the watchdog of time limits.
///
/// Dropping it closes the admission and stops all jobs, without waiting for them.
#[derive(Debug)]
pub struct Queue {
    waiting_line: Arc<BoundedQueue>,
    workers: Workers,
    watchdog: Arc<Watchdog>,
}

impl Queue {
    /// Starts the threads: `workers` of them may run a job each while `queue_length` more jobs wait.
    ///
    /// # Errors
    /// When the operating system refuses a thread.
    pub fn start(workers: NonZeroUsize, queue_length: usize) -> io::Result<Self> {
        let capacity = workers.get().saturating_add(queue_length);
        let waiting_line = Arc::new(BoundedQueue::new(workers.get(), capacity));
        let watchdog = Arc::new(Watchdog::start()?);
        let workers = Workers::start(workers, &waiting_line, &watchdog).inspect_err(|_| waiting_line.close())?;
        Ok(Self { waiting_line, workers, watchdog })
    }

    /// Reserves the place of one job.
    ///
    /// # Errors
    /// When all places are taken, or the queue was closed.
    pub fn reserve(&self) -> Result<Place, Refusal> {
        self.waiting_line.reserve(&self.watchdog)
    }

    /// Waits until fewer than `bound` places are taken, then reserves one.
    ///
    /// # Errors
    /// Only when the queue is closed.
    pub async fn wait_for_place(&self, bound: usize) -> Result<Place, Refusal> {
        self.waiting_line.wait_for_place(bound, &self.watchdog).await
    }

    /// Whether places are still given out.
    pub fn is_open(&self) -> bool {
        self.waiting_line.is_open()
    }

    /// Jobs that wait or run.
    pub fn queued(&self) -> usize {
        self.waiting_line.queued()
    }

    /// Jobs in flight: reserved, waiting and running.
    pub fn in_flight(&self) -> usize {
        self.waiting_line.in_flight()
    }

    /// Workers that help another's job at present.
    pub fn helping_workers(&self) -> usize {
        self.waiting_line.lent()
    }

    /// Gives out no more places; jobs in flight go on.
    pub fn close(&self) {
        self.waiting_line.close();
    }

    /// Closes the queue and stops every job in flight, waiting or running.
    pub fn cancel_all(&self, cause: StopCause) {
        self.waiting_line.cancel_all(cause);
    }

    /// Closes the queue, waits until all jobs in flight have ended, and joins the threads. Blocks.
    pub fn join(&self) {
        self.close();
        self.workers.join();
        self.watchdog.join();
    }
}

impl Drop for Queue {
    fn drop(&mut self) {
        self.cancel_all(StopCause::Shutdown);
    }
}

/// Locks under the policy on poisoning that the module states.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
