//! A bounded queue that feeds a fixed number of blocking worker threads. It knows no domain.
//!
//! - Admission is counted: at most `workers + queue_length` jobs are in flight, running and waiting together. A
//!   [`Permit`] is reserved first, used to submit a job later, and released when it is dropped. The total expected
//!   run time of the jobs in flight is bounded too.
//! - Jobs of one caller start in the order in which they were submitted, and callers take turns: whoever has more jobs
//!   waiting gives way to who has fewer. A panic of a job is caught, and the outcome of each job is
//!   returned through its [`Ticket`].
//! - A running job may borrow [`IdleWorkers`]; they are given back as soon as another job waits.
//! - A job stops for the first [`StopCause`] that reaches its [`StopHandle`]: its time limit, its deadline, a caller
//!   who no longer waits (the ticket is dropped), or a shutdown. A job that is stopped while it waits is removed from
//!   the queue and never started. One that runs may complete its answer until it is cut off: at the limit or the deadline
//!   itself, and at once where nobody waits.
//!
//! Waiting jobs are kept in a deque under a mutex rather than in a channel, because the permit of a caller who left must
//! be released at once, and only the receiver can take entries out of a channel.

mod bounded_queue;
mod caller;
mod clocks;
mod expected_start;
mod job;
mod lending;
mod lock;
#[cfg(test)]
#[cfg(shuttle)]
mod model;
mod permit;
mod stop;
mod sync;
#[cfg(test)]
#[cfg(not(shuttle))]
mod tests;
mod ticket;
mod watchdog;
mod worker_slots;
mod workers;

use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use bounded_queue::BoundedQueue;
pub use bounded_queue::{Backlog, Capacity, Load, Refusal};
pub use caller::CallerId;
pub use clocks::{ANSWER_MARGIN, Clocks, Finishing};
pub use lending::IdleWorkers;
pub use permit::{Permit, words_of_panic};
pub use stop::{StopCause, StopHandle};
pub use ticket::{JobOutcome, Ticket};
use watchdog::Watchdog;
use workers::Workers;

/// The queue with its worker threads and the watchdog that enforces time limits and deadlines.
///
/// Dropping it closes the queue and stops all jobs, without waiting for them.
#[derive(Debug)]
pub struct Queue {
    jobs: Arc<BoundedQueue>,
    workers: Workers,
    watchdog: Arc<Watchdog>,
}

impl Queue {
    /// Starts the watchdog and `workers` worker threads; `capacity` bounds what may be in flight.
    ///
    /// # Errors
    /// When the operating system refuses a thread.
    pub fn start(workers: NonZeroUsize, capacity: Capacity) -> io::Result<Self> {
        let jobs = Arc::new(BoundedQueue::new(workers.get(), capacity));
        let watchdog = Arc::new(Watchdog::start()?);
        let workers = Workers::start(workers, &jobs).inspect_err(|_| jobs.close())?;
        Ok(Self { jobs, workers, watchdog })
    }

    /// Reserves a permit for one job.
    ///
    /// # Errors
    /// When the capacity is used up, or the queue is closed.
    pub fn reserve(&self) -> Result<Permit, Refusal> {
        self.jobs.reserve().map(|id| self.permit(id))
    }

    /// Reserves a permit whatever the jobs in flight are expected to take.
    ///
    /// # Errors
    /// When all permits are issued, or the queue is closed.
    pub fn reserve_for_any_work(&self) -> Result<Permit, Refusal> {
        self.jobs.reserve_for_any_work().map(|id| self.permit(id))
    }

    /// Waits until less is in flight than `capacity`, then reserves a permit.
    ///
    /// # Errors
    /// Only when the queue is closed.
    pub async fn wait_for_permit(&self, capacity: Capacity) -> Result<Permit, Refusal> {
        self.jobs.wait_for_permit(capacity).await.map(|id| self.permit(id))
    }

    fn permit(&self, id: u64) -> Permit {
        Permit::new(id, &self.jobs, &self.watchdog)
    }

    /// Whether permits are still issued.
    pub fn is_open(&self) -> bool {
        self.jobs.is_open()
    }

    /// The jobs that wait or run, and how long they are expected to take.
    pub fn backlog(&self) -> Backlog {
        self.jobs.backlog()
    }

    /// Workers whose job was signalled to stop longer than `timeout` ago and still runs.
    pub fn stuck_workers(&self, timeout: Duration) -> usize {
        self.jobs.stuck(timeout)
    }

    /// Jobs that wait, and jobs that run.
    pub fn load(&self) -> Load {
        self.jobs.load()
    }

    /// Jobs in flight: reserved, waiting and running.
    pub fn in_flight(&self) -> usize {
        self.jobs.in_flight()
    }

    /// Workers that are lent to jobs of other workers at present.
    pub fn helping_workers(&self) -> usize {
        self.jobs.lent()
    }

    /// Issues no more permits; jobs in flight continue.
    pub fn close(&self) {
        self.jobs.close();
    }

    /// Closes the queue and cuts off every job in flight, waiting or running.
    pub fn cancel_all(&self, cause: StopCause) {
        self.jobs.cancel_all(cause);
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
