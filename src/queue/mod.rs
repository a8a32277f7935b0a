//! A bounded queue that feeds a fixed number of blocking worker threads. It knows no domain.
//!
//! - Admission is counted: at most `workers + queue_length` jobs are in flight, running and waiting together. A
//!   [`Place`] is reserved first, filled with a job later, and given back when it is dropped. What the jobs in flight
//!   are expected to take is bounded too.
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
use std::time::Duration;

use bounded_queue::BoundedQueue;
pub use bounded_queue::{Ahead, Place, Refusal, Room};
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
    /// Starts the threads: `workers` of them run a job each while others wait within the room.
    ///
    /// # Errors
    /// When the operating system refuses a thread.
    pub fn start(workers: NonZeroUsize, room: Room) -> io::Result<Self> {
        let waiting_line = Arc::new(BoundedQueue::new(workers.get(), room));
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

    /// Waits until less is in flight than `room`, then reserves a place.
    ///
    /// # Errors
    /// Only when the queue is closed.
    pub async fn wait_for_place(&self, room: Room) -> Result<Place, Refusal> {
        self.waiting_line.wait_for_place(room, &self.watchdog).await
    }

    /// Whether places are still given out.
    pub fn is_open(&self) -> bool {
        self.waiting_line.is_open()
    }

    /// What waits or runs.
    pub fn ahead(&self) -> Ahead {
        self.waiting_line.ahead()
    }

    /// Workers whose job was told to stop longer than `patience` ago and still runs.
    pub fn stuck_workers(&self, patience: Duration) -> usize {
        self.waiting_line.stuck(patience)
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
