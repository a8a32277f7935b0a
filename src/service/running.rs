//! A job that was queued, until its caller has the outcome.

use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::stream::{Stream, unfold};
use tokio::sync::watch;
use tokio::time::sleep_until;

use super::ServiceError;
use super::job::Stopped;
use super::observation::Awaited;
use super::pace::Pace;
use crate::queue::{JobOutcome, StopCause, Ticket};

/// Shortest time between two reports of progress: enough for eyes and planners, little for networks.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// A job in the queue or on its worker; dropping it, or the future or stream made of it, stops the job.
pub struct Running<T, P> {
    pub(super) position: usize,
    pub(super) progress: watch::Receiver<Option<P>>,
    pub(super) job: QueuedJob<T>,
}

/// What happens to a job.
#[derive(Debug)]
pub enum Event<T, P> {
    /// It was queued, at this position: 0 when a worker was idle, 1 when it is the next to start. Always the first event.
    Queued(usize),
    /// The latest progress.
    Progress(P),
    /// It ended. Always the last event.
    Ended(Result<T, ServiceError>),
}

impl<T: Send + 'static, P: Copy + Send + Sync + 'static> Running<T, P> {
    /// Waits for the end.
    ///
    /// # Errors
    /// When the deadline cannot be kept, the job panics, or the service shuts down before there is an answer.
    pub async fn outcome(self) -> Result<T, ServiceError> {
        self.job.outcome().await
    }

    /// Like [`Running::outcome`], on a thread that may block.
    ///
    /// # Errors
    /// As [`Running::outcome`].
    pub fn blocking_outcome(self) -> Result<T, ServiceError> {
        self.job.blocking_outcome()
    }

    /// All that happens, as it happens; of several reports of progress between two reads only the latest.
    pub fn events(self) -> impl Stream<Item = Event<T, P>> + Send {
        unfold(Stage::Queued(self), |stage| async {
            match stage {
                Stage::Queued(Self { position, progress, job }) => {
                    let watched = Watched { outcome: Box::pin(job.outcome()), progress, next_report: Instant::now() };
                    Some((Event::Queued(position), Stage::Watched(watched)))
                }
                Stage::Watched(mut watched) => match watched.next().await {
                    ended @ Event::Ended(_) => Some((ended, Stage::Over)),
                    other @ (Event::Queued(_) | Event::Progress(_)) => Some((other, Stage::Watched(watched))),
                },
                Stage::Over => None,
            }
        })
    }
}

/// What is to be reported next.
enum Stage<T, P> {
    Queued(Running<T, P>),
    Watched(Watched<T, P>),
    Over,
}

/// A job whose progress is read.
struct Watched<T, P> {
    outcome: Pin<Box<dyn Future<Output = Result<T, ServiceError>> + Send>>,
    progress: watch::Receiver<Option<P>>,
    next_report: Instant,
}

impl<T, P: Copy> Watched<T, P> {
    async fn next(&mut self) -> Event<T, P> {
        let Self { outcome, progress, next_report } = self;
        let report = async {
            sleep_until((*next_report).into()).await;
            match progress.changed().await {
                Ok(()) => *progress.borrow_and_update(),
                // The work is over: only the outcome is left.
                Err(_) => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            ended = outcome => Event::Ended(ended),
            Some(latest) = report => {
                *next_report = Instant::now() + PROGRESS_INTERVAL;
                Event::Progress(latest)
            }
        }
    }
}

/// A job in the queue, and what is needed to turn its end into an answer.
pub(super) struct QueuedJob<T> {
    pub(super) job_id: u64,
    pub(super) ticket: Ticket<Result<T, Stopped>>,
    pub(super) pace: Arc<Pace>,
    pub(super) awaited: Awaited,
}

impl<T> QueuedJob<T> {
    async fn outcome(self) -> Result<T, ServiceError> {
        let Self { job_id, ticket, pace, awaited } = self;
        awaited.ended(answer_of(job_id, ticket.outcome().await, &pace))
    }

    fn blocking_outcome(self) -> Result<T, ServiceError> {
        let Self { job_id, ticket, pace, awaited } = self;
        awaited.ended(answer_of(job_id, ticket.blocking_outcome(), &pace))
    }
}

fn answer_of<T>(job_id: u64, outcome: JobOutcome<Result<T, Stopped>>, pace: &Pace) -> Result<T, ServiceError> {
    match outcome {
        JobOutcome::Finished { value: Ok(answer), duration } => {
            tracing::debug!(job.id = job_id, job.duration_ms = duration.as_secs_f64() * 1e3, "a job finished");
            Ok(answer)
        }
        JobOutcome::Finished { value: Err(Stopped::Unasked), .. } => Err(ServiceError::SolverPanic),
        JobOutcome::Finished { value: Err(Stopped::Contradicted { field, fault }), .. } => {
            Err(ServiceError::Contradicted { field, fault })
        }
        JobOutcome::Finished { value: Err(Stopped::By(cause)), .. } | JobOutcome::NeverStarted { cause } => {
            Err(error_of(cause, pace))
        }
        JobOutcome::Panicked { message } => {
            tracing::error!(job.id = job_id, panic.message = message, "a job panicked");
            Err(ServiceError::SolverPanic)
        }
    }
}

fn error_of(cause: StopCause, pace: &Pace) -> ServiceError {
    match cause {
        StopCause::CallerGone => ServiceError::Cancelled,
        StopCause::Deadline => ServiceError::DeadlineExceeded,
        StopCause::TimeLimit => ServiceError::TimeLimitExceeded,
        StopCause::Shutdown => ServiceError::Unavailable { retry_after: pace.retry_after() },
    }
}
