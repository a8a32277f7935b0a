//! Solve and simulate behind the bounded queue: what every transport and the command line share.
//!
//! The life of a request: [`Service::reserve`] gives a [`Place`] or refuses at once; the transport then parses and
//! validates its request into a domain input; [`Place::solve`] queues it and answers when a worker has run it. The
//! solver sits behind [`ManeuverSolver`], so that tests and benches can put another one there.

pub mod domain;
mod error;
pub mod limits;
mod solver;

use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

pub use error::ServiceError;
pub use limits::{DEFAULT_TIME_LIMIT_S, Limits};
pub use solver::{InProcessSolver, ManeuverSolver};

use crate::queue::{self, JobOutcome, Queue, Refusal, StopCause, StopHandle, Ticket};
use crate::solver::{
    NoProgress, RunControl, SimulateInput, Simulation, Solution, SolveInput, StopReason as SolverStop,
};

/// When a refused caller should come back.
///
/// One second is the order of a typical solve: by then a worker has most likely become free.
const RETRY_AFTER: Duration = Duration::from_secs(1);

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
}

impl Service {
    /// Starts the worker threads.
    ///
    /// # Errors
    /// When the operating system refuses a thread.
    pub fn start(settings: ServiceSettings, solver: Arc<dyn ManeuverSolver>) -> io::Result<Self> {
        let queue = Queue::start(settings.workers, settings.queue_length)?;
        Ok(Self { queue, solver, settings })
    }

    /// What is accepted at most.
    pub fn limits(&self) -> &Limits {
        &self.settings.limits
    }

    /// Whether the service takes work; a full queue is ready too.
    pub fn is_ready(&self) -> bool {
        self.queue.is_open()
    }

    /// Jobs in flight: reserved, waiting and running.
    pub fn jobs_in_flight(&self) -> usize {
        self.queue.in_flight()
    }

    /// Refuses when the service takes no work.
    ///
    /// # Errors
    /// [`ServiceError::Unavailable`] before the start and while draining.
    pub fn check_ready(&self) -> Result<(), ServiceError> {
        if self.is_ready() { Ok(()) } else { Err(ServiceError::Unavailable { retry_after: RETRY_AFTER }) }
    }

    /// Reserves a place in the queue, to be given before the request is parsed.
    ///
    /// # Errors
    /// When the queue is full or closed.
    pub fn reserve(&self) -> Result<Place, ServiceError> {
        match self.queue.reserve() {
            Ok(place) => Ok(Place { place, solver: Arc::clone(&self.solver) }),
            Err(Refusal::Full) => {
                let capacity = self.settings.workers.get().saturating_add(self.settings.queue_length);
                Err(ServiceError::QueueFull { retry_after: RETRY_AFTER, capacity })
            }
            Err(Refusal::Closed) => Err(ServiceError::Unavailable { retry_after: RETRY_AFTER }),
        }
    }

    /// Takes no more work; jobs in flight go on.
    pub fn close(&self) {
        self.queue.close();
    }

    /// Takes no more work and stops all jobs in flight; their callers get [`ServiceError::Unavailable`].
    pub fn cancel_all(&self) {
        self.queue.cancel_all(StopCause::Shutdown);
    }

    /// Closes the service, waits for the jobs in flight and ends the worker threads. Blocks.
    pub fn join(&self) {
        self.queue.join();
    }
}

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

/// The answer of a solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Solved {
    /// The plan with its report.
    pub solution: Solution,
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
    /// How long it ran on its worker.
    pub duration: Duration,
}

/// A reserved place in the queue; given back on drop.
pub struct Place {
    place: queue::Place,
    solver: Arc<dyn ManeuverSolver>,
}

impl Place {
    /// Queues a solve at once and answers when it ends. Dropping the future stops the solve.
    ///
    /// # Errors
    /// When the solver panics or the service shuts down before there is an answer.
    pub fn solve(
        self,
        input: SolveInput,
        time_limit: Duration,
    ) -> impl Future<Output = Result<Solved, ServiceError>> + Send + use<> {
        let (job_id, ticket) = self.queue_solve(input, time_limit);
        async move { solved(job_id, ticket.outcome().await) }
    }

    /// Like [`Place::solve`], on a thread that may block.
    ///
    /// # Errors
    /// As [`Place::solve`].
    pub fn solve_blocking(self, input: SolveInput, time_limit: Duration) -> Result<Solved, ServiceError> {
        let (job_id, ticket) = self.queue_solve(input, time_limit);
        solved(job_id, ticket.blocking_outcome())
    }

    /// Queues a simulation at once and answers when it ends. Dropping the future takes it out of the queue.
    ///
    /// # Errors
    /// When the solver panics or the service shuts down before the start.
    pub fn simulate(
        self,
        input: SimulateInput,
    ) -> impl Future<Output = Result<Simulated, ServiceError>> + Send + use<> {
        let (job_id, ticket) = self.queue_simulation(input);
        async move { simulated(job_id, ticket.outcome().await) }
    }

    /// Like [`Place::simulate`], on a thread that may block.
    ///
    /// # Errors
    /// As [`Place::simulate`].
    pub fn simulate_blocking(self, input: SimulateInput) -> Result<Simulated, ServiceError> {
        let (job_id, ticket) = self.queue_simulation(input);
        simulated(job_id, ticket.blocking_outcome())
    }

    fn queue_solve(self, input: SolveInput, time_limit: Duration) -> (u64, Ticket<Solution>) {
        let Self { place, solver } = self;
        let work = move |stop: &StopHandle| solver.solve(&input, &RunControl::new(stop.flag(), &NoProgress));
        (place.job_id(), place.fill(Some(time_limit), work))
    }

    fn queue_simulation(self, input: SimulateInput) -> (u64, Ticket<Simulation>) {
        let Self { place, solver } = self;
        // One rollout needs no time limit: its length is bounded by the grid limit.
        (place.job_id(), place.fill(None, move |_: &StopHandle| solver.simulate(&input)))
    }
}

fn solved(job_id: u64, outcome: JobOutcome<Solution>) -> Result<Solved, ServiceError> {
    let (solution, solve_time, stop_cause) = finished(job_id, outcome)?;
    let stop_reason = match (solution.stop_reason, stop_cause) {
        (SolverStop::Finished, _) => StopReason::Finished,
        (SolverStop::RolloutLimit, _) => StopReason::RolloutLimit,
        (SolverStop::Stopped, Some(StopCause::TimeLimit)) => StopReason::TimeLimit,
        (SolverStop::Stopped, Some(StopCause::Deadline)) => StopReason::Deadline,
        (SolverStop::Stopped, Some(cause @ (StopCause::CallerGone | StopCause::Shutdown))) => {
            return Err(never_answered(cause));
        }
        (SolverStop::Stopped, None) => {
            tracing::error!(job.id = job_id, "the solver says that it was stopped, but nobody stopped it");
            return Err(ServiceError::SolverPanic);
        }
    };
    Ok(Solved { solution, solve_time, stop_reason })
}

fn simulated(job_id: u64, outcome: JobOutcome<Simulation>) -> Result<Simulated, ServiceError> {
    let (simulation, duration, _) = finished(job_id, outcome)?;
    Ok(Simulated { simulation, duration })
}

fn finished<T>(job_id: u64, outcome: JobOutcome<T>) -> Result<(T, Duration, Option<StopCause>), ServiceError> {
    match outcome {
        JobOutcome::Finished { value, duration, stop_cause } => Ok((value, duration, stop_cause)),
        JobOutcome::Panicked { message } => {
            tracing::error!(job.id = job_id, panic.message = message, "a job panicked");
            Err(ServiceError::SolverPanic)
        }
        JobOutcome::NeverStarted { cause } => Err(never_answered(cause)),
    }
}

fn never_answered(cause: StopCause) -> ServiceError {
    match cause {
        StopCause::CallerGone => ServiceError::Cancelled,
        // Limits count from the start and deadlines are not set yet when a job waits, so only a shutdown remains.
        StopCause::Shutdown | StopCause::TimeLimit | StopCause::Deadline => {
            ServiceError::Unavailable { retry_after: RETRY_AFTER }
        }
    }
}
