//! A permit to queue one job, and the job that uses it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::watch;

use super::job::{Done, Job, JobControl, Stopped};
use super::observation::{Awaited, Queued};
use super::pace::Pace;
use super::running::{QueuedJob, Running};
use super::{ServiceError, ServiceSettings};
use crate::metrics::Metrics;
use crate::queue::{self, ANSWER_MARGIN, Backlog, Clocks, StopHandle};

/// Leave to queue one job; given back on drop.
pub struct Permit {
    pub(super) reserved: queue::Permit,
    pub(super) pace: Arc<Pace>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) settings: ServiceSettings,
}

impl Permit {
    /// Queues a job at once. What its caller gets is made by `answer` on the worker, off the async runtime.
    ///
    /// # Errors
    /// When the wait for a worker would outlast the deadline.
    pub fn submit<J: Job, T: Send + 'static>(
        self,
        job: Arc<J>,
        input: J::Input,
        deadline: Option<Instant>,
        answer: impl FnOnce(&J::Input, &Done<J::Output>) -> T + Send + 'static,
    ) -> Result<Running<T, J::Progress>, ServiceError> {
        let backlog = self.reserved.backlog();
        self.check_reachable(deadline, backlog)?;
        let position = (backlog.jobs + 1).saturating_sub(self.settings.workers.get());
        let (report, progress) = watch::channel(None);
        Ok(Running { position, progress, job: self.queue(job, input, deadline, answer, report) })
    }

    /// Refuses when the jobs in flight would keep the workers busy beyond the deadline. A deadline that has passed already
    /// is no matter of waiting: its job is queued, and never started.
    fn check_reachable(&self, deadline: Option<Instant>, backlog: Backlog) -> Result<(), ServiceError> {
        let Some(deadline) = deadline else { return Ok(()) };
        let remaining = deadline.saturating_duration_since(Instant::now());
        let workers = self.settings.workers.get();
        let is_idle = backlog.jobs < workers;
        let estimated_wait = if is_idle { Duration::ZERO } else { backlog.work.div_f64(workers as f64) };
        if remaining <= ANSWER_MARGIN || estimated_wait <= remaining {
            return Ok(());
        }
        Err(ServiceError::DeadlineUnreachable { retry_after: self.pace.retry_after(), estimated_wait, remaining })
    }

    fn queue<J: Job, T: Send + 'static>(
        self,
        job: Arc<J>,
        input: J::Input,
        deadline: Option<Instant>,
        answer: impl FnOnce(&J::Input, &Done<J::Output>) -> T + Send + 'static,
        progress: watch::Sender<Option<J::Progress>>,
    ) -> QueuedJob<T> {
        let Self { reserved, pace, metrics, .. } = self;
        let (job_id, cost, time_limit) = (reserved.job_id(), job.cost(&input), job.time_limit(&input));
        let clocks = Clocks { time_limit, deadline, estimate: pace.estimate(cost, time_limit) };
        let queued = Queued::new(&metrics, job_id);
        let (workers, recorded) = (reserved.idle_workers(), Arc::clone(&pace));
        let work = move |stop: &StopHandle| -> Result<T, Stopped> {
            let observed = queued.started(J::NAME);
            let control = JobControl { stop, workers: &workers, progress, span: observed.span() };
            let start = Instant::now();
            let output = job.run(&input, &control)?;
            let done = Done { output, queue_wait: observed.queue_wait(), duration: start.elapsed() };
            if J::SETS_PACE {
                recorded.record(cost, done.duration);
            }
            let answer = answer(&input, &done);
            job.answered(&done);
            Ok(answer)
        };
        QueuedJob { job_id, ticket: reserved.submit(clocks, work), pace, awaited: Awaited::new(metrics, J::NAME) }
    }
}
