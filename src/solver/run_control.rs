//! How a running solve is stopped and observed from outside.

use std::sync::atomic::{AtomicBool, Ordering};

use super::helpers::{Alone, Helpers, SharedWork};
use crate::optimizer::Budget;

/// What a solve reports while it runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveProgress {
    /// Final time of the best iterate, s.
    pub best_final_time: f64,
    /// Largest magnitude of its goal errors.
    pub best_goal_error: f64,
    /// The running start, from 1.
    pub start: usize,
    /// Number of starts.
    pub start_count: usize,
}

/// A part of a solve that takes time of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The local search from one start, counted from 1.
    Start {
        /// Which of the starts.
        number: usize,
    },
    /// One of the best local optima, searched on under the exact law.
    Polish,
    /// The plan on a finer grid.
    Refinement,
    /// The certificate of the best plan, from its torques alone, after the search.
    Certificate,
}

/// Observes progress; called between rollouts, so it must return quickly.
pub trait ProgressObserver: Sync {
    /// A new best iterate or a new start.
    fn progress(&self, progress: &SolveProgress);

    /// A phase begins.
    fn begins(&self, _phase: Phase) {}

    /// A phase ends.
    fn ends(&self, _phase: Phase) {}
}

/// Ignores all progress.
pub struct NoProgress;

impl ProgressObserver for NoProgress {
    fn progress(&self, _progress: &SolveProgress) {}
}

/// The stop flag, polled once per rollout, the observer of a solve, and the helpers that may share its work.
#[derive(Clone, Copy)]
pub struct RunControl<'a> {
    stop: &'a AtomicBool,
    /// Flags that end one part of the solve.
    interrupts: &'a [&'a AtomicBool],
    observer: &'a dyn ProgressObserver,
    helpers: &'a dyn Helpers,
    is_abandoned: Option<&'a (dyn Fn() -> bool + Sync)>,
}

impl<'a> RunControl<'a> {
    /// Control by a stop flag, which any thread may set, and an observer.
    pub fn new(stop: &'a AtomicBool, observer: &'a dyn ProgressObserver) -> Self {
        Self { stop, interrupts: &[], observer, helpers: &Alone, is_abandoned: None }
    }

    /// Lets these helpers share the work; the answer does not depend on them.
    #[must_use]
    pub fn helped_by(self, helpers: &'a dyn Helpers) -> Self {
        Self { helpers, ..self }
    }

    /// Asks, once stopped, whether the caller still waits: otherwise the answer is not certified.
    #[must_use]
    pub fn abandoned_when(self, is_abandoned: &'a (dyn Fn() -> bool + Sync)) -> Self {
        Self { is_abandoned: Some(is_abandoned), ..self }
    }

    /// Runs to the end, without observer and helpers.
    pub fn unattended() -> RunControl<'static> {
        static NEVER: AtomicBool = AtomicBool::new(false);
        RunControl::new(&NEVER, &NoProgress)
    }

    /// Control of one part of the solve, with flags and an observer of its own, and without helpers.
    pub(super) fn of_part<'b>(
        &self,
        interrupts: &'b [&'b AtomicBool],
        observer: &'b dyn ProgressObserver,
    ) -> RunControl<'b>
    where
        'a: 'b,
    {
        RunControl { interrupts, observer, helpers: &Alone, ..*self }
    }

    /// Rollouts that may be spent under this control.
    pub(super) fn budget(&self, rollout_limit: u64) -> Budget<'a> {
        Budget::new(self.stop, rollout_limit).interrupted_by(self.interrupts)
    }

    /// Does the work on the calling thread and on helpers; returns when it is done.
    pub fn share(&self, work: &dyn SharedWork) {
        self.helpers.share(work);
    }

    /// The stop flag itself.
    pub fn stop_flag(&self) -> &'a AtomicBool {
        self.stop
    }

    /// Whether the solve was asked to stop.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Whether the solve was stopped and the caller no longer waits for its answer.
    pub fn is_abandoned(&self) -> bool {
        self.is_stopped() && self.is_abandoned.is_some_and(|is_abandoned| is_abandoned())
    }

    /// Notifies the observer that a phase begins, and that it ends when the result is dropped.
    #[must_use]
    pub fn enter(&self, phase: Phase) -> RunningPhase<'a> {
        self.observer.begins(phase);
        RunningPhase { observer: self.observer, phase }
    }

    /// The observer of the solve.
    pub(super) fn observer(&self) -> &'a dyn ProgressObserver {
        self.observer
    }

    /// Notifies the observer of progress.
    pub fn report(&self, progress: &SolveProgress) {
        self.observer.progress(progress);
    }
}

/// A phase that has begun.
pub struct RunningPhase<'a> {
    observer: &'a dyn ProgressObserver,
    phase: Phase,
}

impl Drop for RunningPhase<'_> {
    fn drop(&mut self) {
        self.observer.ends(self.phase);
    }
}
