//! One job: the work under its clocks and behind a panic border, and the ticket that its caller waits with.

use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Weak;
use std::time::{Duration, Instant};

use tokio::sync::oneshot;

use super::bounded_queue::{BoundedQueue, Permit};
use super::stop::{StopCause, StopHandle};
use super::watchdog::{Watch, Watchdog};

/// How long before a deadline a job is signalled to stop: time to write the answer and send it.
pub const ANSWER_MARGIN: Duration = Duration::from_millis(20);

/// The two clocks of a job, and how long it is expected to run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Clocks {
    /// How long the job may run, counted from its start on the worker.
    pub time_limit: Option<Duration>,
    /// When its caller needs the answer, waiting included; the job is signalled to stop [`ANSWER_MARGIN`] earlier, and
    /// is never started after that.
    pub deadline: Option<Instant>,
    /// How long it is expected to run: the part of the queue's capacity for work that it takes.
    pub estimate: Duration,
}

impl Clocks {
    /// When a job under this deadline is signalled to stop.
    pub(super) fn stop_time(&self) -> Option<Instant> {
        // A time that the clock cannot represent lies in the past: stop at once.
        self.deadline.map(|deadline| deadline.checked_sub(ANSWER_MARGIN).unwrap_or_else(Instant::now))
    }
}

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
    /// Attaches the watch of the deadline.
    pub(super) fn watched_by(self, deadline: Option<Watch>) -> Self {
        Self { deadline, ..self }
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
        self.stop.stop(StopCause::CallerGone);
        if let Some(queue) = self.queue.upgrade() {
            queue.remove(self.id);
        }
    }
}

/// A queued job; its value type is erased, so that one queue holds jobs of all kinds.
pub(super) struct Job {
    id: u64,
    run: Box<dyn FnOnce(&Watchdog) + Send>,
}

impl Job {
    pub(super) fn id(&self) -> u64 {
        self.id
    }

    /// Runs the work, releases the permit, then sends the outcome.
    pub(super) fn run(self, watchdog: &Watchdog) {
        (self.run)(watchdog);
    }
}

impl fmt::Debug for Job {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Job").field("id", &self.id).finish_non_exhaustive()
    }
}

/// The two ends of a job: the worker's and the caller's.
pub(super) fn pair<T: Send + 'static>(
    permit: Permit,
    id: u64,
    (stop, cancel_on_drop): (StopHandle, CancelOnDrop),
    clocks: Clocks,
    work: impl FnOnce(&StopHandle) -> T + Send + 'static,
) -> (Job, Ticket<T>) {
    let (sender, answer) = oneshot::channel();
    let run = move |watchdog: &Watchdog| {
        // The watchdog may be a moment late, and the job must not start after its deadline.
        if clocks.stop_time().is_some_and(|time| time <= Instant::now()) {
            stop.stop(StopCause::Deadline);
        }
        let outcome = match stop.cause() {
            Some(cause) => JobOutcome::NeverStarted { cause },
            None => run_timed(&stop, clocks.time_limit, work, watchdog),
        };
        // Before the outcome is sent, so that a caller who has it can reserve this permit again.
        drop(permit);
        // Sending fails when the caller has left, who needs no outcome.
        let _ = sender.send(outcome);
    };
    (Job { id, run: Box::new(run) }, Ticket { answer, cancel_on_drop, deadline: None })
}

fn run_timed<T>(
    stop: &StopHandle,
    time_limit: Option<Duration>,
    work: impl FnOnce(&StopHandle) -> T,
    watchdog: &Watchdog,
) -> JobOutcome<T> {
    let start = Instant::now();
    // A limit beyond the range of the clock never passes: no watch.
    let end = time_limit.and_then(|limit| start.checked_add(limit));
    let watch = end.map(|end| watchdog.watch(stop, end, StopCause::TimeLimit));
    // The work owns all it touches, so nothing half-changed outlives a panic.
    let result = catch_unwind(AssertUnwindSafe(|| work(stop)));
    let duration = start.elapsed();
    drop(watch);
    match result {
        Ok(value) => JobOutcome::Finished { value, duration },
        Err(payload) => JobOutcome::Panicked { message: panic_message(payload.as_ref()) },
    }
}

fn panic_message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().copied().or_else(|| payload.downcast_ref::<String>().map(String::as_str));
    text.unwrap_or("a panic without a message").to_owned()
}
