//! What is counted and traced of a job, from the queue to its end.
//!
//! Spans: `queue_wait` and one named after the kind of job under the span of the request that queued it; a kind may add
//! spans of its phases.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use tracing::Span;
use tracing::span::EnteredSpan;

use super::{Class, ServiceError};
use crate::metrics::{JobEnd, Metrics};

/// A job in the queue.
pub(super) struct Queued {
    metrics: Arc<Metrics>,
    job_id: u64,
    class: Class,
    since: Instant,
    /// The span of the request.
    request: Span,
    /// Ends with the wait, also when the job is taken out of the queue.
    waiting: Span,
}

impl Queued {
    pub(super) fn new(metrics: &Arc<Metrics>, job_id: u64, class: Class) -> Self {
        let request = Span::current();
        let waiting = tracing::info_span!(parent: &request, "queue_wait", job.id = job_id);
        Self { metrics: Arc::clone(metrics), job_id, class, since: Instant::now(), request, waiting }
    }

    /// The job starts on the calling thread.
    pub(super) fn started(self, kind: &'static str) -> Started {
        let Self { metrics, job_id, class, since, request, waiting } = self;
        let queue_wait = since.elapsed();
        match class {
            Class::Heavy => metrics.waited(queue_wait),
            // No worker is what they wait for: among the others, they would hide how long these wait.
            Class::Light => {}
        }
        drop(waiting);
        // The name of a span is fixed when it is compiled; exporters take that of `otel.name`.
        let span = tracing::info_span!(parent: &request, "job", otel.name = kind, job.kind = kind, job.id = job_id);
        Started { metrics, queue_wait, span: span.entered() }
    }
}

/// A job on its worker.
pub(super) struct Started {
    metrics: Arc<Metrics>,
    queue_wait: Duration,
    /// Lines of the log bear the request of the job while this lives.
    span: EnteredSpan,
}

impl Started {
    /// How long the job waited.
    pub(super) fn queue_wait(&self) -> Duration {
        self.queue_wait
    }

    /// The span of the job.
    pub(super) fn span(&self) -> &Span {
        &self.span
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        if thread::panicking() {
            self.metrics.panicked();
        }
    }
}

/// A job that its caller waits for; counts its end once. Dropped before its end, the caller has left.
pub(super) struct Awaited {
    metrics: Arc<Metrics>,
    kind: &'static str,
    end: JobEnd,
}

impl Awaited {
    pub(super) fn new(metrics: Arc<Metrics>, kind: &'static str) -> Self {
        Self { metrics, kind, end: JobEnd::CallerGone }
    }

    /// Passes the outcome on.
    pub(super) fn ended<T>(mut self, outcome: Result<T, ServiceError>) -> Result<T, ServiceError> {
        self.end = match outcome {
            Ok(_) | Err(ServiceError::Contradicted { .. }) => JobEnd::Finished,
            Err(ServiceError::DeadlineExceeded) => JobEnd::Deadline,
            Err(ServiceError::TimeLimitExceeded) => JobEnd::TimeLimit,
            Err(ServiceError::Unavailable { .. }) => JobEnd::Shutdown,
            Err(ServiceError::SolverPanic) => JobEnd::Panicked,
            // The others refuse a job before it is queued.
            Err(
                ServiceError::Cancelled
                | ServiceError::QueueFull { .. }
                | ServiceError::ShareUsedUp { .. }
                | ServiceError::DeadlineUnreachable { .. },
            ) => JobEnd::CallerGone,
        };
        outcome
    }
}

impl Drop for Awaited {
    fn drop(&mut self) {
        self.metrics.job_ended(self.kind, self.end);
    }
}
