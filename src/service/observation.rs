//! What is counted and traced of a job, from the line to its end.
//!
//! Spans: `queue_wait` and `solve` (or `simulate`) under the span of the request that queued the job; under `solve` one
//! span per phase of the search.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use tokio::sync::watch;
use tracing::Span;
use tracing::span::EnteredSpan;

use super::finishing::SearchEnd;
use super::{ServiceError, Solved};
use crate::metrics::{CancelCause, Metrics, SolveRecord};
use crate::solver::{Phase, ProgressObserver, SolveProgress};

/// What a job does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Solve,
    Simulate,
}

/// A job in the line.
pub(super) struct Queued {
    metrics: Arc<Metrics>,
    job_id: u64,
    since: Instant,
    /// The span of the request.
    request: Span,
    /// Ends with the wait, also when the job is taken out of the line.
    waiting: Span,
}

impl Queued {
    pub(super) fn new(metrics: &Arc<Metrics>, job_id: u64) -> Self {
        let request = Span::current();
        let waiting = tracing::info_span!(parent: &request, "queue_wait", job.id = job_id);
        Self { metrics: Arc::clone(metrics), job_id, since: Instant::now(), request, waiting }
    }

    /// The job starts on the calling thread.
    pub(super) fn started(self, kind: Kind) -> Running {
        let Self { metrics, job_id, since, request, waiting } = self;
        let queue_wait = since.elapsed();
        metrics.waited(queue_wait);
        drop(waiting);
        let span = match kind {
            Kind::Solve => tracing::info_span!(parent: &request, "solve", job.id = job_id),
            Kind::Simulate => tracing::info_span!(parent: &request, "simulate", job.id = job_id),
        };
        Running { metrics, queue_wait, span: span.entered() }
    }
}

/// A job on its worker.
pub(super) struct Running {
    metrics: Arc<Metrics>,
    queue_wait: Duration,
    /// Lines of the log bear the request of the job while this lives.
    span: EnteredSpan,
}

impl Running {
    /// How long the job waited.
    pub(super) fn queue_wait(&self) -> Duration {
        self.queue_wait
    }

    /// Counts the answer.
    pub(super) fn solved(&self, solved: &Solved) {
        let report = &solved.solution.report;
        self.metrics.solved(&SolveRecord {
            method: report.method.as_str(),
            status: solved.solution.status.as_str(),
            stop_reason: solved.stop_reason.as_str(),
            duration: solved.solve_time,
            rollouts: report.rollouts,
        });
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if thread::panicking() {
            self.metrics.panicked();
        }
    }
}

/// A job that its caller waits for; dropped before its end, the caller has left.
pub(super) struct Awaited {
    metrics: Arc<Metrics>,
    is_answered: bool,
}

impl Awaited {
    pub(super) fn new(metrics: Arc<Metrics>) -> Self {
        Self { metrics, is_answered: false }
    }

    /// Passes the end on, and counts it when it is no answer because the job was stopped.
    pub(super) fn answered<T>(mut self, outcome: Result<T, ServiceError>) -> Result<T, ServiceError> {
        self.is_answered = true;
        let cause = match outcome {
            Err(ServiceError::DeadlineExceeded) => Some(CancelCause::Deadline),
            Err(ServiceError::Unavailable { .. }) => Some(CancelCause::Shutdown),
            Err(ServiceError::Cancelled) => Some(CancelCause::CallerGone),
            Err(
                ServiceError::QueueFull { .. } | ServiceError::DeadlineUnreachable { .. } | ServiceError::SolverPanic,
            )
            | Ok(_) => None,
        };
        if let Some(cause) = cause {
            self.metrics.cancelled(cause);
        }
        outcome
    }
}

impl Drop for Awaited {
    fn drop(&mut self) {
        if !self.is_answered {
            self.metrics.cancelled(CancelCause::CallerGone);
        }
    }
}

/// Keeps the latest progress for whoever asks, when the search ended, and a span per running phase.
pub(super) struct SolveObserver {
    /// Nothing waits and nothing fails when nobody asks.
    tell: watch::Sender<Option<SolveProgress>>,
    pub(super) search_end: SearchEnd,
    solve: Span,
    phases: Mutex<Vec<(Phase, Span)>>,
}

impl SolveObserver {
    pub(super) fn new(tell: watch::Sender<Option<SolveProgress>>, running: &Running) -> Self {
        Self { tell, search_end: SearchEnd::default(), solve: Span::clone(&running.span), phases: Mutex::default() }
    }

    fn span_of(&self, phase: Phase) -> Span {
        match phase {
            Phase::Start { number } => tracing::info_span!(parent: &self.solve, "start", start.number = number),
            Phase::Polish => tracing::info_span!(parent: &self.solve, "polish"),
            Phase::Refinement => tracing::info_span!(parent: &self.solve, "refinement"),
            Phase::Certificate => tracing::info_span!(parent: &self.solve, "certificate"),
        }
    }
}

impl ProgressObserver for SolveObserver {
    fn progress(&self, progress: &SolveProgress) {
        self.tell.send_replace(Some(*progress));
    }

    fn begins(&self, phase: Phase) {
        if phase == Phase::Certificate {
            self.search_end.mark();
        }
        let span = self.span_of(phase);
        self.phases.lock().unwrap_or_else(PoisonError::into_inner).push((phase, span));
    }

    fn ends(&self, phase: Phase) {
        let mut phases = self.phases.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(position) = phases.iter().position(|(running, _)| *running == phase) {
            phases.swap_remove(position);
        }
    }
}
