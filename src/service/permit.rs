//! A permit to queue one job, and the job that uses it.

use std::sync::Arc;
use std::time::Instant;

use tokio::sync::watch;

use super::ServiceError;
use super::job::{Class, Done, Job, JobControl, Stopped};
use super::observation::{Awaited, Queued};
use super::pace::{Cost, Pace, TimeTaken};
use super::running::{QueuedJob, Running};
use super::share::Taken;
use crate::metrics::Metrics;
use crate::queue::{self, Clocks, StopHandle};

/// How much longer than estimated a wait may be. One job may need twice the work of another that looks alike; over several
/// that follow each other this averages out to about a quarter.
const ERROR_OF_WAITS: f64 = 0.25;

/// Leave to queue one job; given back on drop.
pub struct Permit {
    pub(super) reserved: queue::Permit,
    pub(super) class: Class,
    /// Its place in the share of its caller.
    pub(super) taken: Option<Taken>,
    pub(super) pace: Arc<Pace>,
    pub(super) metrics: Arc<Metrics>,
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
        let (cost, time_limit) = (job.cost(&input), job.time_limit(&input));
        let finishing = job.finishing(&input);
        // However short the time limit, what follows it takes its time.
        let estimate = self.pace.estimate(J::NAME, cost, time_limit).max(finishing.at_least_for(time_limit));
        let clocks = Clocks { time_limit, deadline, submitted: Some(Instant::now()), finishing, estimate };
        self.check_reachable(&clocks)?;
        let position = self.reserved.position();
        let (report, progress) = watch::channel(None);
        Ok(Running { position, progress, job: self.queue(job, (input, cost), clocks, answer, report) })
    }

    /// Refuses a job that would probably be stopped as soon as it starts. A deadline that has passed already is no matter
    /// of waiting: its job is queued, and never started.
    fn check_reachable(&self, clocks: &Clocks) -> Result<(), ServiceError> {
        let Some(deadline) = clocks.deadline else { return Ok(()) };
        let remaining = deadline.saturating_duration_since(Instant::now());
        let estimated_wait = self.reserved.expected_wait().mul_f64(1.0 + ERROR_OF_WAITS);
        let margin = clocks.answer_margin();
        let kept = margin + clocks.finishing.kept_of(remaining);
        if estimated_wait.is_zero() || remaining <= margin || estimated_wait.saturating_add(kept) <= remaining {
            return Ok(());
        }
        Err(ServiceError::DeadlineUnreachable { retry_after: self.pace.retry_after(), estimated_wait, kept, remaining })
    }

    fn queue<J: Job, T: Send + 'static>(
        self,
        job: Arc<J>,
        (input, cost): (J::Input, Cost),
        clocks: Clocks,
        answer: impl FnOnce(&J::Input, &Done<J::Output>) -> T + Send + 'static,
        progress: watch::Sender<Option<J::Progress>>,
    ) -> QueuedJob<T> {
        let Self { reserved, class, mut taken, pace, metrics } = self;
        if let Some(taken) = &mut taken {
            taken.expect(clocks.estimate);
        }
        let job_id = reserved.job_id();
        let queued = Queued::new(&metrics, job_id, class);
        let (workers, recorded) = (reserved.idle_workers(), Arc::clone(&pace));
        let work = move |stop: &StopHandle| -> Result<T, Stopped> {
            // Given back with the work, also when it is taken out of the queue.
            let _taken = taken;
            let observed = queued.started(J::NAME);
            let control = JobControl { stop, workers: &workers, progress, span: observed.span() };
            let start = Instant::now();
            let output = job.run(&input, &control)?;
            let done = Done { output, queue_wait: observed.queue_wait(), duration: start.elapsed() };
            let answer = answer(&input, &done);
            if let Some(work) = job.work_done(&input, &done.output) {
                let duration = start.elapsed();
                let of_workers = duration.saturating_add(workers.lent_time());
                recorded.record(J::NAME, cost, work, TimeTaken { duration, of_workers });
            }
            job.answered(&done);
            Ok(answer)
        };
        QueuedJob { job_id, ticket: reserved.submit(clocks, work), pace, awaited: Awaited::new(metrics, J::NAME) }
    }
}
