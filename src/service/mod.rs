//! Jobs behind the bounded queue: what every transport and the command line share. It knows no kind of job.
//!
//! The life of a job: [`Service::reserve`] gives a [`Permit`] or refuses at once; the transport then parses and validates
//! its request; [`Permit::submit`] queues it and gives the [`Running`] job, a future of its outcome or a stream of its
//! events.

mod error;
mod job;
mod observation;
mod pace;
mod permit;
mod running;
mod share;

use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

pub use error::ServiceError;
pub(crate) use error::seconds;
pub use job::{Class, Done, Job, JobControl, Stopped};
use pace::Pace;
pub use pace::{Cost, WorkDone};
pub use permit::Permit;
pub use running::{Event, Running};
pub use share::Share;
use share::{ShareSize, Taken};
use tokio::sync::watch;

use crate::metrics::{Metrics, QueueLevels};
use crate::queue::{self, Capacity, Queue, Refusal};
pub use crate::queue::{Finishing, StopCause, words_of_panic};

/// How much expected work per worker may be in flight unless configured: the longest time limit. Who would wait longer
/// had better come back.
pub const DEFAULT_QUEUE_WORK: Duration = Duration::from_secs(60);
/// How long after its stop flag a worker counts as stuck: a job may complete its answer until it is cut off, but keeps no
/// more than a share of its time limit for that.
const STUCK_AFTER: Duration = Duration::from_secs(30);
/// Light jobs that may wait for their thread.
pub const LIGHT_QUEUE_LENGTH: usize = 16;

/// Size of the service.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServiceSettings {
    /// Worker threads, each running one job at a time.
    pub workers: NonZeroUsize,
    /// Jobs that may wait for a worker.
    pub queue_length: usize,
    /// What the jobs in flight may be expected to take, per worker, before more are refused.
    pub queue_work: Duration,
    /// How long after its stop flag a worker counts as stuck.
    pub stuck_after: Duration,
}

impl Default for ServiceSettings {
    fn default() -> Self {
        Self { workers: NonZeroUsize::MIN, queue_length: 64, queue_work: DEFAULT_QUEUE_WORK, stuck_after: STUCK_AFTER }
    }
}

impl ServiceSettings {
    /// The same for the jobs of a class.
    fn of(&self, class: Class) -> Self {
        match class {
            Class::Heavy => *self,
            Class::Light => Self { workers: NonZeroUsize::MIN, queue_length: LIGHT_QUEUE_LENGTH, ..*self },
        }
    }

    /// What may run and wait at once.
    fn capacity(&self) -> Capacity {
        let (workers, queue_length) = (self.workers.get(), self.queue_length);
        let work = self.queue_work.saturating_mul(u32::try_from(workers).unwrap_or(u32::MAX));
        Capacity { permits: workers.saturating_add(queue_length), work }
    }

    /// The capacity for batches: the last quarter of the queue is left to single callers.
    fn capacity_for_batches(&self) -> Capacity {
        let Capacity { permits, work } = self.capacity();
        Capacity { permits: permits - self.queue_length.div_ceil(4), work: work.mul_f64(0.75) }
    }

    /// What one of several callers may have in flight: all workers and half of the queue.
    fn share(&self) -> ShareSize {
        let Capacity { permits, work } = self.capacity();
        let capacity = Capacity { permits: permits - self.queue_length.div_ceil(2), work: work / 2 };
        ShareSize { capacity, workers: self.workers.get() }
    }

    /// What its batches may have of that: the last quarter of its part of the queue is left to its other requests.
    fn share_for_batches(&self) -> ShareSize {
        let ShareSize { capacity: Capacity { permits, work }, workers } = self.share();
        let capacity = Capacity { permits: permits - (self.queue_length / 2).div_ceil(4), work: work.mul_f64(0.75) };
        ShareSize { capacity, workers }
    }
}

/// The service with its queue and worker threads.
pub struct Service {
    queue: Queue,
    /// Light jobs, on a thread of their own.
    light: Queue,
    settings: ServiceSettings,
    pace: Arc<Pace>,
    metrics: Arc<Metrics>,
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
    pub fn start(settings: ServiceSettings) -> io::Result<Self> {
        let start = |settings: ServiceSettings| Queue::start(settings.workers, settings.capacity());
        let (queue, light) = (start(settings)?, start(settings.of(Class::Light))?);
        let (pace, metrics) = (Arc::default(), Arc::default());
        let (draining, closed) = (AtomicBool::new(false), watch::Sender::new(false));
        Ok(Self { queue, light, settings, pace, metrics, draining, closed })
    }

    /// The size of the service.
    pub fn settings(&self) -> &ServiceSettings {
        &self.settings
    }

    /// What this service counts about itself.
    pub fn metrics(&self) -> &Arc<Metrics> {
        &self.metrics
    }

    /// The counts and levels of this moment, in the text format of Prometheus.
    pub fn metrics_text(&self) -> Vec<u8> {
        let (load, workers) = (self.queue.load(), self.settings.workers.get());
        let stuck_workers = self.queue.stuck_workers(self.settings.stuck_after).min(workers);
        let busy_workers = load.running.min(workers).saturating_sub(stuck_workers);
        // Taken a moment later: a worker may have changed its state in between.
        let helping_workers = self.queue.helping_workers().min(workers - busy_workers - stuck_workers);
        self.metrics.render(&QueueLevels {
            waiting: load.waiting,
            capacity: self.settings.queue_length,
            cost_s: self.queue.backlog().work.as_secs_f64(),
            busy_workers,
            stuck_workers,
            helping_workers,
            idle_workers: workers - busy_workers - stuck_workers - helping_workers,
            light_jobs: self.light.in_flight(),
        })
    }

    /// Whether new callers are welcome; a full queue is ready too.
    pub fn is_ready(&self) -> bool {
        self.is_open() && !self.draining.load(Ordering::Relaxed)
    }

    /// Whether any worker is not stuck: none will ever end its job otherwise.
    pub fn is_alive(&self) -> bool {
        self.stuck_workers() < self.settings.workers.get()
    }

    /// Workers that do not obey the stop flag of their job.
    pub fn stuck_workers(&self) -> usize {
        self.queue.stuck_workers(self.settings.stuck_after)
    }

    fn is_open(&self) -> bool {
        self.queue.is_open() && self.is_alive()
    }

    /// Jobs in flight: reserved, waiting and running.
    pub fn jobs_in_flight(&self) -> usize {
        self.queue.in_flight() + self.light.in_flight()
    }

    /// Refuses when the service takes no work.
    ///
    /// # Errors
    /// [`ServiceError::Unavailable`] once the service is closed or has lost its workers.
    pub fn check_open(&self) -> Result<(), ServiceError> {
        if self.is_open() { Ok(()) } else { Err(self.unavailable()) }
    }

    /// Fails when only a restart helps.
    ///
    /// # Errors
    /// [`ServiceError::Unavailable`] while all workers are stuck.
    pub fn check_alive(&self) -> Result<(), ServiceError> {
        if self.is_alive() { Ok(()) } else { Err(self.unavailable()) }
    }

    /// Refuses when new callers are not welcome.
    ///
    /// # Errors
    /// [`ServiceError::Unavailable`] once the end is announced or the service is closed.
    pub fn check_ready(&self) -> Result<(), ServiceError> {
        if self.is_ready() { Ok(()) } else { Err(self.unavailable()) }
    }

    /// Reserves a permit, before the request is parsed.
    ///
    /// # Errors
    /// When the queue of the class is full or closed.
    pub fn reserve(&self, class: Class) -> Result<Permit, ServiceError> {
        self.reserve_in(None, class)
    }

    /// Reserves a permit in the share of a caller, if it has one.
    ///
    /// # Errors
    /// When the queue of the class is full or closed, or the share is used up.
    pub fn reserve_in(&self, share: Option<&Arc<Share>>, class: Class) -> Result<Permit, ServiceError> {
        let Some(share) = share else { return self.issued(self.queue_of(class).reserve(), None, class) };
        let (size, is_untouched) = (self.settings.of(class).share(), share.is_untouched(class));
        let Some(taken) = share.take(class, &size, &self.metrics) else {
            self.metrics.caller_refused(share.label());
            let retry_after = self.pace.retry_after();
            return Err(ServiceError::ShareUsedUp { retry_after, capacity: size.capacity.permits });
        };
        // Whatever the jobs of others are expected to take, a caller without any has a turn.
        let is_next = share.is_bounded() && is_untouched;
        let queue = self.queue_of(class);
        let reserved = if is_next { queue.reserve_for_any_work() } else { queue.reserve() };
        self.issued(reserved.map(|permit| permit.of_caller(share.caller())), Some(taken), class)
    }

    /// Waits for a permit as one item of a batch does: the last quarter of the queue is left to single callers, and that
    /// of the share to the caller's own other requests.
    ///
    /// # Errors
    /// Only when the queue is closed.
    pub async fn reserve_for_batch(&self, share: Option<&Arc<Share>>, class: Class) -> Result<Permit, ServiceError> {
        let settings = self.settings.of(class);
        let (size, metrics) = (settings.share_for_batches(), &self.metrics);
        let taken = match share {
            Some(share) => Some(tokio::select! {
                taken = share.taken(class, &size, metrics) => taken,
                () = self.closed() => return Err(self.unavailable()),
            }),
            None => None,
        };
        let reserved = self.queue_of(class).wait_for_permit(settings.capacity_for_batches()).await;
        let caller = share.map(|share| share.caller()).unwrap_or_default();
        self.issued(reserved.map(|permit| permit.of_caller(caller)), taken, class)
    }

    /// Announces the end: the service is not ready any more, but still takes work from those who have not heard.
    pub fn announce_end(&self) {
        self.draining.store(true, Ordering::Relaxed);
    }

    /// Takes the announcement back: what was lacking is there again.
    pub fn revoke_end(&self) {
        self.draining.store(false, Ordering::Relaxed);
    }

    /// Takes no more work; jobs in flight go on.
    pub fn close(&self) {
        self.queue.close();
        self.light.close();
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
        self.light.cancel_all(StopCause::Shutdown);
        self.closed.send_replace(true);
    }

    /// Closes the service, waits for the jobs in flight and ends the worker threads. Blocks.
    pub fn join(&self) {
        self.closed.send_replace(true);
        self.light.close();
        self.queue.join();
        self.light.join();
    }

    fn queue_of(&self, class: Class) -> &Queue {
        match class {
            Class::Heavy => &self.queue,
            Class::Light => &self.light,
        }
    }

    fn issued(
        &self,
        reserved: Result<queue::Permit, Refusal>,
        taken: Option<Taken>,
        class: Class,
    ) -> Result<Permit, ServiceError> {
        let settings = self.settings.of(class);
        match reserved {
            Ok(reserved) => {
                let (pace, metrics) = (Arc::clone(&self.pace), Arc::clone(&self.metrics));
                Ok(Permit { reserved, class, taken, pace, metrics })
            }
            Err(Refusal::Full) => Err(ServiceError::QueueFull {
                retry_after: self.pace.retry_after(),
                capacity: settings.capacity().permits,
            }),
            Err(Refusal::Closed) => Err(self.unavailable()),
        }
    }

    fn unavailable(&self) -> ServiceError {
        ServiceError::Unavailable { retry_after: self.pace.retry_after() }
    }
}
