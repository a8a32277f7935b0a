//! Solve and simulate behind the bounded queue: what every transport and the command line share.
//!
//! The life of a request: [`Service::reserve`] gives a [`Place`] or refuses at once; the transport then parses and
//! validates its request into a domain input; [`Place::solve`] queues it and answers when a worker has run it, while
//! [`Place::start_solve`] tells of its progress too. The solver sits behind [`ManeuverSolver`], so that tests and
//! benches can put another one there.

pub mod domain;
mod error;
mod finishing;
pub mod limits;
mod pace;
mod place;
mod solver;

use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

pub use error::ServiceError;
use finishing::FinishingPace;
pub use limits::{DEFAULT_TIME_LIMIT_S, Limits};
use pace::Pace;
pub use place::{Place, RunningSolve, Simulated, SolveClocks, SolveEvent, Solved, StopReason};
pub use solver::{InProcessSolver, ManeuverSolver};
use tokio::sync::watch;

use crate::queue::{self, Queue, Refusal, StopCause};

/// Size of the service.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServiceSettings {
    /// Worker threads, each running one job at a time.
    pub workers: NonZeroUsize,
    /// Jobs that may wait for a worker.
    pub queue_length: usize,
    /// What is accepted at most.
    pub limits: Limits,
}

/// The service with its queue and worker threads.
pub struct Service {
    queue: Queue,
    solver: Arc<dyn ManeuverSolver>,
    settings: ServiceSettings,
    pace: Arc<Pace>,
    finishing: Arc<FinishingPace>,
    /// Whether the end was announced: probes turn away, work is still taken.
    draining: AtomicBool,
    /// Whether the queue was closed, for those who wait for it.
    closed: watch::Sender<bool>,
}

impl Service {
    /// Starts the worker threads.
    ///
    /// # Errors
    /// When the operating system refuses a thread.
    pub fn start(settings: ServiceSettings, solver: Arc<dyn ManeuverSolver>) -> io::Result<Self> {
        let queue = Queue::start(settings.workers, settings.queue_length)?;
        let (draining, closed) = (AtomicBool::new(false), watch::Sender::new(false));
        let (pace, finishing) = (Arc::default(), Arc::default());
        Ok(Self { queue, solver, settings, pace, finishing, draining, closed })
    }

    /// What is accepted at most.
    pub fn limits(&self) -> &Limits {
        &self.settings.limits
    }

    /// The size of the service.
    pub fn settings(&self) -> &ServiceSettings {
        &self.settings
    }

    /// Whether new callers are welcome; a full queue is ready too.
    pub fn is_ready(&self) -> bool {
        self.queue.is_open() && !self.draining.load(Ordering::Relaxed)
    }

    /// Jobs in flight: reserved, waiting and running.
    pub fn jobs_in_flight(&self) -> usize {
        self.queue.in_flight()
    }

    /// Refuses when the service takes no work.
    ///
    /// # Errors
    /// [`ServiceError::Unavailable`] once the service is closed.
    pub fn check_open(&self) -> Result<(), ServiceError> {
        if self.queue.is_open() { Ok(()) } else { Err(self.unavailable()) }
    }

    /// Refuses when new callers are not welcome.
    ///
    /// # Errors
    /// [`ServiceError::Unavailable`] once the end is announced or the service is closed.
    pub fn check_ready(&self) -> Result<(), ServiceError> {
        if self.is_ready() { Ok(()) } else { Err(self.unavailable()) }
    }

    /// Reserves a place in the queue, to be given before the request is parsed.
    ///
    /// # Errors
    /// When the queue is full or closed.
    pub fn reserve(&self) -> Result<Place, ServiceError> {
        self.queue.reserve().map(|place| self.place(place)).map_err(|refusal| self.refused(refusal))
    }

    /// Waits for a place as one item of a batch does: the last quarter of the queue is left to single callers.
    ///
    /// # Errors
    /// Only when the queue is closed.
    pub async fn reserve_for_batch(&self) -> Result<Place, ServiceError> {
        let left_to_others = self.settings.queue_length.div_ceil(4);
        let place = self.queue.wait_for_place(self.capacity() - left_to_others).await;
        place.map(|place| self.place(place)).map_err(|refusal| self.refused(refusal))
    }

    /// Announces the end: the service is not ready any more, but still takes work from those who have not heard.
    pub fn announce_end(&self) {
        self.draining.store(true, Ordering::Relaxed);
    }

    /// Takes no more work; jobs in flight go on.
    pub fn close(&self) {
        self.queue.close();
        self.closed.send_replace(true);
    }

    /// Waits until no more work is taken.
    pub async fn closed(&self) {
        // The sender lives as long as the service.
        let _ = self.closed.subscribe().wait_for(|closed| *closed).await;
    }

    /// Takes no more work and stops all jobs in flight; their callers get [`ServiceError::Unavailable`].
    pub fn cancel_all(&self) {
        self.queue.cancel_all(StopCause::Shutdown);
        self.closed.send_replace(true);
    }

    /// Closes the service, waits for the jobs in flight and ends the worker threads. Blocks.
    pub fn join(&self) {
        self.closed.send_replace(true);
        self.queue.join();
    }

    /// Jobs that may run and wait at once.
    fn capacity(&self) -> usize {
        self.settings.workers.get().saturating_add(self.settings.queue_length)
    }

    fn place(&self, reserved: queue::Place) -> Place {
        let (solver, pace) = (Arc::clone(&self.solver), Arc::clone(&self.pace));
        Place { reserved, solver, pace, finishing: Arc::clone(&self.finishing), workers: self.settings.workers.get() }
    }

    fn refused(&self, refusal: Refusal) -> ServiceError {
        match refusal {
            Refusal::Full => {
                ServiceError::QueueFull { retry_after: self.pace.retry_after(), capacity: self.capacity() }
            }
            Refusal::Closed => self.unavailable(),
        }
    }

    fn unavailable(&self) -> ServiceError {
        ServiceError::Unavailable { retry_after: self.pace.retry_after() }
    }
}
