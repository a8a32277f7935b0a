//! What a kind of job is to the service, and what the service lends it while it runs.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use tokio::sync::watch;
use tracing::Span;

use super::pace::{Cost, WorkDone};
use crate::queue::{Finishing, IdleWorkers, StopCause, StopHandle};

/// Which threads run a kind of job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// The workers, which may be busy for a minute.
    Heavy,
    /// One thread beside them, for what is bounded below 50 ms on usual input: a picture never waits behind a solve.
    Light,
}

/// One kind of job.
pub trait Job: Send + Sync + 'static {
    /// Its name in routes, commands, metrics and spans: one word in `snake_case`.
    const NAME: &'static str;
    /// Which threads run it.
    const CLASS: Class = Class::Heavy;
    /// What it works on; kept until its answer is written.
    type Input: Send + 'static;
    /// What comes out.
    type Output: Send + 'static;
    /// What it reports while it runs; `()` if nothing.
    type Progress: Copy + Send + Sync + 'static;

    /// What it will probably take.
    fn cost(&self, input: &Self::Input) -> Cost;

    /// What it took, in the measure of [`Job::cost`]: as much as that says, where the input alone tells. None if it ended without
    /// such work.
    fn work_done(&self, input: &Self::Input, _output: &Self::Output) -> Option<WorkDone> {
        Some(WorkDone { cost: self.cost(input), is_complete: true })
    }

    /// When it is cut off, counted from its start; none where the input bounds it.
    fn time_limit(&self, _input: &Self::Input) -> Option<Duration> {
        None
    }

    /// What it does once it is stopped; its time limit and its deadline keep that much time free.
    fn finishing(&self, _input: &Self::Input) -> Finishing {
        Finishing::default()
    }

    /// Runs on a worker.
    ///
    /// # Errors
    /// When it was cut off before there was anything to answer.
    fn run(&self, input: &Self::Input, control: &JobControl<'_, Self::Progress>) -> Result<Self::Output, Stopped>;

    /// Called on the worker when the answer is written, for counts and measurements of its own.
    fn answered(&self, _done: &Done<Self::Output>) {}
}

/// What came out of a job, and how long it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Done<T> {
    /// What came out.
    pub output: T,
    /// How long it waited for a worker.
    pub queue_wait: Duration,
    /// How long it ran on its worker.
    pub duration: Duration,
}

/// Why a job has no answer, found while it ran.
#[derive(Debug, Clone)]
pub enum Stopped {
    /// It was stopped.
    By(StopCause),
    /// It says that it was stopped, but nobody stopped it.
    Unasked,
    /// What it was to work on contradicts itself, or is of no use, which only running it shows.
    Contradicted {
        /// The path of the field that is at fault.
        field: &'static str,
        /// What speaks against it, for people.
        fault: String,
    },
}

/// The stop flags of a running job, the channel for its progress, and the workers that may help.
pub struct JobControl<'a, P> {
    pub(super) stop: &'a StopHandle,
    pub(super) workers: &'a IdleWorkers,
    /// Nothing waits and nothing fails when nobody reads it.
    pub(super) progress: watch::Sender<Option<P>>,
    pub(super) span: &'a Span,
}

impl<P> JobControl<'_, P> {
    /// The flags and the causes behind them.
    pub fn stop(&self) -> &StopHandle {
        self.stop
    }

    /// Why a job that was cut off has no answer.
    pub fn cut_off(&self) -> Stopped {
        if let Some(cause) = self.stop.cut_cause() {
            return Stopped::By(cause);
        }
        tracing::error!("a job says that it was cut off, but nobody cut it off");
        Stopped::Unasked
    }

    /// The span of the run, for spans of its phases.
    pub fn span(&self) -> &Span {
        self.span
    }

    /// Reports the latest progress.
    pub fn report(&self, progress: P) {
        self.progress.send_replace(Some(progress));
    }

    /// Does work in parts on this worker and on idle ones; see [`IdleWorkers::share`].
    pub fn share(&self, open_parts: &(dyn Fn() -> usize + Sync), take_part: &(dyn Fn(&AtomicBool) -> bool + Sync)) {
        self.workers.share(open_parts, take_part);
    }
}
