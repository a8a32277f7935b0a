//! A reserved place in the queue, and the job that fills it.

use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::watch;
use tokio::time::sleep_until;

use super::finishing::FinishingPace;
use super::observation::{Awaited, Kind, Queued, SolveObserver};
use super::pace::{Pace, Work};
use super::{ManeuverSolver, ServiceError, ServiceSettings};
use crate::metrics::Metrics;
use crate::queue::{self, ANSWER_MARGIN, Backlog, Clocks, IdleWorkers, JobOutcome, StopCause, StopHandle, Ticket};
use crate::solver::{
    Helpers, RunControl, SharedWork, SimulateInput, Simulation, Solution, SolveInput, SolveProgress,
    StopReason as SolverStop,
};

/// Shortest time between two reports of progress: enough for eyes and planners, little for networks.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// Why a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The whole search asked for was done.
    Finished,
    /// The caller's time limit passed.
    TimeLimit,
    /// The caller's deadline came near.
    Deadline,
    /// The rollout limit was used up.
    RolloutLimit,
}

impl StopReason {
    /// The name in the public contract.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::TimeLimit => "time_limit",
            Self::Deadline => "deadline",
            Self::RolloutLimit => "rollout_limit",
        }
    }
}

/// The two clocks of a solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SolveClocks {
    /// How long it may run, counted from its start on the worker.
    pub time_limit: Duration,
    /// When its caller needs the answer, counted from arrival, waiting included.
    pub deadline: Option<Instant>,
}

/// The answer of a solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Solved {
    /// The plan with its report.
    pub solution: Solution,
    /// How long it waited for a worker.
    pub queue_wait: Duration,
    /// How long the solve ran on its worker.
    pub solve_time: Duration,
    /// Why it ended.
    pub stop_reason: StopReason,
}

/// The answer of a simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// The motion.
    pub simulation: Simulation,
    /// How long it waited for a worker.
    pub queue_wait: Duration,
    /// How long it ran on its worker.
    pub duration: Duration,
}

/// A reserved place in the queue; given back on drop.
pub struct Place {
    pub(super) reserved: queue::Permit,
    pub(super) solver: Arc<dyn ManeuverSolver>,
    pub(super) pace: Arc<Pace>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) finishing: Arc<FinishingPace>,
    pub(super) settings: ServiceSettings,
}

impl Place {
    /// Queues a solve at once. What its caller gets is made by `answer` on the worker, off the async runtime.
    ///
    /// # Errors
    /// When the wait for a worker would outlast the deadline.
    pub fn start_solve<T: Send + 'static>(
        self,
        input: SolveInput,
        clocks: SolveClocks,
        answer: impl FnOnce(Solved) -> T + Send + 'static,
    ) -> Result<RunningSolve<T>, ServiceError> {
        let ahead = self.reserved.backlog();
        self.check_reachable(clocks.deadline, ahead)?;
        let position = (ahead.jobs + 1).saturating_sub(self.settings.workers.get());
        let (tell, progress) = watch::channel(None);
        let queued = self.queue_solve(input, clocks, answer, tell);
        let outcome = Box::pin(queued.outcome());
        Ok(RunningSolve { position, progress, next_report: Instant::now(), outcome })
    }

    /// Queues a solve at once and answers when it ends. Dropping the future stops the solve.
    ///
    /// # Errors
    /// When the deadline cannot be kept, the solver panics, or the service shuts down before there is an answer.
    pub fn solve<T: Send + 'static>(
        self,
        input: SolveInput,
        clocks: SolveClocks,
        answer: impl FnOnce(Solved) -> T + Send + 'static,
    ) -> impl Future<Output = Result<T, ServiceError>> + Send {
        let running = self.start_solve(input, clocks, answer);
        async move { running?.outcome().await }
    }

    /// Like [`Place::solve`], on a thread that may block.
    ///
    /// # Errors
    /// As [`Place::solve`].
    pub fn solve_blocking(self, input: SolveInput, clocks: SolveClocks) -> Result<Solved, ServiceError> {
        self.check_reachable(clocks.deadline, self.reserved.backlog())?;
        let (tell, _nobody) = watch::channel(None);
        self.queue_solve(input, clocks, |solved| solved, tell).blocking_outcome()
    }

    /// Queues a simulation at once and answers when it ends. Dropping the future takes it out of the queue.
    ///
    /// # Errors
    /// When the deadline passes, the solver panics or the service shuts down before the start.
    pub fn simulate<T: Send + 'static>(
        self,
        input: SimulateInput,
        deadline: Option<Instant>,
        answer: impl FnOnce(Simulated) -> T + Send + 'static,
    ) -> impl Future<Output = Result<T, ServiceError>> + Send {
        let reachable = self.check_reachable(deadline, self.reserved.backlog());
        let queued = reachable.map(|()| self.queue_simulation(input, deadline, answer));
        async move { queued?.outcome().await }
    }

    /// Like [`Place::simulate`] without a deadline, on a thread that may block.
    ///
    /// # Errors
    /// As [`Place::simulate`].
    pub fn simulate_blocking(self, input: SimulateInput) -> Result<Simulated, ServiceError> {
        self.queue_simulation(input, None, |simulated| simulated).blocking_outcome()
    }

    /// Refuses when the jobs ahead would keep the workers busy beyond the deadline. One that has passed already is no
    /// matter of waiting: its job is queued, and never started.
    fn check_reachable(&self, deadline: Option<Instant>, ahead: Backlog) -> Result<(), ServiceError> {
        let Some(deadline) = deadline else { return Ok(()) };
        let remaining = deadline.saturating_duration_since(Instant::now());
        let workers = self.settings.workers.get();
        let is_idle = ahead.jobs < workers;
        let estimated_wait = if is_idle { Duration::ZERO } else { ahead.work.div_f64(workers as f64) };
        if remaining <= ANSWER_MARGIN || estimated_wait <= remaining {
            return Ok(());
        }
        Err(ServiceError::DeadlineUnreachable { retry_after: self.pace.retry_after(), estimated_wait, remaining })
    }

    fn queue_solve<T: Send + 'static>(
        self,
        input: SolveInput,
        clocks: SolveClocks,
        answer: impl FnOnce(Solved) -> T + Send + 'static,
        tell: watch::Sender<Option<SolveProgress>>,
    ) -> QueuedJob<T> {
        let Self { reserved: place, solver, pace, metrics, finishing, settings: _ } = self;
        let search_time = finishing.search_time(&input.settings, clocks.time_limit);
        let (job_id, recorded, asked) = (place.job_id(), Arc::clone(&pace), Work::of_solve(&input.settings));
        let (queued, helpers) = (Queued::new(&metrics, job_id), BorrowedWorkers(place.idle_workers()));
        let work = move |stop: &StopHandle| {
            let running = queued.started(Kind::Solve);
            let observer = SolveObserver::new(tell, &running);
            let start = Instant::now();
            let is_abandoned = || matches!(stop.cause(), Some(StopCause::CallerGone | StopCause::Shutdown));
            let control = RunControl::new(stop.flag(), &observer).abandoned_when(&is_abandoned).helped_by(&helpers);
            let solution = solver.solve(&input, &control);
            let solve_time = start.elapsed();
            let stop_reason = stop_reason(job_id, solution.stop_reason, stop.cause())?;
            recorded.record(asked, solve_time);
            let solved = Solved { solution, queue_wait: running.queue_wait(), solve_time, stop_reason };
            running.solved(&solved);
            let step_count = solved.solution.report.step_count;
            let answer = answer(solved);
            if let Some(duration) = observer.search_end.elapsed() {
                finishing.record(step_count, duration);
            }
            Ok(answer)
        };
        let SolveClocks { time_limit, deadline } = clocks;
        let clocks = Clocks { time_limit: Some(search_time), deadline, estimate: pace.estimate(asked, time_limit) };
        QueuedJob { job_id, ticket: place.submit(clocks, work), pace, awaited: Awaited::new(metrics) }
    }

    fn queue_simulation<T: Send + 'static>(
        self,
        input: SimulateInput,
        deadline: Option<Instant>,
        answer: impl FnOnce(Simulated) -> T + Send + 'static,
    ) -> QueuedJob<T> {
        let Self { reserved: place, solver, pace, metrics, finishing: _, settings } = self;
        let longest = Duration::from_secs_f64(settings.limits.max_time_limit_s);
        let estimate = pace.estimate(Work::of_rollout(input.step_count), longest);
        let queued = Queued::new(&metrics, place.job_id());
        let work = move |_: &StopHandle| {
            let running = queued.started(Kind::Simulate);
            let start = Instant::now();
            let simulation = solver.simulate(&input);
            let (queue_wait, duration) = (running.queue_wait(), start.elapsed());
            Ok(answer(Simulated { simulation, queue_wait, duration }))
        };
        // One rollout needs no time limit: its length is bounded by the grid limit.
        let clocks = Clocks { time_limit: None, deadline, estimate };
        let job_id = place.job_id();
        QueuedJob { job_id, ticket: place.submit(clocks, work), pace, awaited: Awaited::new(metrics) }
    }
}

/// Why the work of a job has no answer, found while it ran.
#[derive(Debug, Clone, Copy)]
enum NoAnswer {
    Stopped(StopCause),
    BrokenPromise,
}

fn stop_reason(job_id: u64, claimed: SolverStop, cause: Option<StopCause>) -> Result<StopReason, NoAnswer> {
    match (claimed, cause) {
        (SolverStop::Finished, _) => Ok(StopReason::Finished),
        (SolverStop::RolloutLimit, _) => Ok(StopReason::RolloutLimit),
        (SolverStop::Stopped, Some(StopCause::TimeLimit)) => Ok(StopReason::TimeLimit),
        (SolverStop::Stopped, Some(StopCause::Deadline)) => Ok(StopReason::Deadline),
        (SolverStop::Stopped, Some(cause @ (StopCause::CallerGone | StopCause::Shutdown))) => {
            Err(NoAnswer::Stopped(cause))
        }
        (SolverStop::Stopped, None) => {
            tracing::error!(job.id = job_id, "the solver says that it was stopped, but nobody stopped it");
            Err(NoAnswer::BrokenPromise)
        }
    }
}

/// A job in the queue, and what is needed to tell its outcome.
struct QueuedJob<T> {
    job_id: u64,
    ticket: Ticket<Result<T, NoAnswer>>,
    pace: Arc<Pace>,
    awaited: Awaited,
}

impl<T> QueuedJob<T> {
    async fn outcome(self) -> Result<T, ServiceError> {
        let Self { job_id, ticket, pace, awaited } = self;
        awaited.answered(answered(job_id, ticket.outcome().await, &pace))
    }

    fn blocking_outcome(self) -> Result<T, ServiceError> {
        let Self { job_id, ticket, pace, awaited } = self;
        awaited.answered(answered(job_id, ticket.blocking_outcome(), &pace))
    }
}

fn answered<T>(job_id: u64, outcome: JobOutcome<Result<T, NoAnswer>>, pace: &Pace) -> Result<T, ServiceError> {
    match outcome {
        JobOutcome::Finished { value: Ok(answer), duration } => {
            tracing::debug!(job.id = job_id, job.duration_ms = duration.as_secs_f64() * 1e3, "a job finished");
            Ok(answer)
        }
        JobOutcome::Finished { value: Err(NoAnswer::BrokenPromise), .. } => Err(ServiceError::SolverPanic),
        JobOutcome::Finished { value: Err(NoAnswer::Stopped(cause)), .. } | JobOutcome::NeverStarted { cause } => {
            Err(never_answered(cause, pace))
        }
        JobOutcome::Panicked { message } => {
            tracing::error!(job.id = job_id, panic.message = message, "a job panicked");
            Err(ServiceError::SolverPanic)
        }
    }
}

fn never_answered(cause: StopCause, pace: &Pace) -> ServiceError {
    match cause {
        StopCause::CallerGone => ServiceError::Cancelled,
        StopCause::Deadline => ServiceError::DeadlineExceeded,
        // Time limits count from the start: they end no wait.
        StopCause::Shutdown | StopCause::TimeLimit => ServiceError::Unavailable { retry_after: pace.retry_after() },
    }
}

/// Lets idle workers work on a solve.
struct BorrowedWorkers(IdleWorkers);

impl Helpers for BorrowedWorkers {
    fn share(&self, work: &dyn SharedWork) {
        self.0.share(&|| work.open_parts(), &|is_recalled| work.take_part(is_recalled));
    }
}

/// A queued or running solve. Dropping it stops the solve.
pub struct RunningSolve<T> {
    position: usize,
    progress: watch::Receiver<Option<SolveProgress>>,
    /// No report of progress before this time.
    next_report: Instant,
    outcome: Pin<Box<dyn Future<Output = Result<T, ServiceError>> + Send>>,
}

/// What happened to a solve.
#[derive(Debug)]
pub enum SolveEvent<T> {
    /// Progress: the latest, whatever was missed.
    Progress(SolveProgress),
    /// The end; nothing comes after it.
    Ended(Result<T, ServiceError>),
}

impl<T> RunningSolve<T> {
    /// The place in the line when the solve was queued: 0 when a worker was idle, 1 when it is the next to start.
    pub fn position(&self) -> usize {
        self.position
    }

    /// Waits for the end.
    ///
    /// # Errors
    /// As [`Place::solve`].
    pub async fn outcome(self) -> Result<T, ServiceError> {
        self.outcome.await
    }

    /// Waits for what happens next; must not be called after the end.
    pub async fn next_event(&mut self) -> SolveEvent<T> {
        let Self { progress, next_report, outcome, .. } = self;
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
            ended = outcome => SolveEvent::Ended(ended),
            Some(latest) = report => {
                *next_report = Instant::now() + PROGRESS_INTERVAL;
                SolveEvent::Progress(latest)
            }
        }
    }
}
