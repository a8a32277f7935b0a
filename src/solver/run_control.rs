//! How a running solve is stopped and observed from outside.

use super::helpers::{Alone, Helpers, SharedWork};
use crate::stop::Stop;

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

/// What ends a solve early, its observer, and the helpers that may share its work.
///
/// There are two moments: first the search is stopped, and the best decision is certified; then the certificate is cut off,
/// and what is known is answered at once.
#[derive(Clone, Copy)]
pub struct RunControl<'a> {
    stop: Stop<'a>,
    cut: Stop<'a>,
    pub(super) observer: &'a dyn ProgressObserver,
    /// Whether the observer sees phases alone.
    is_quiet: bool,
    helpers: &'a dyn Helpers,
}

impl<'a> RunControl<'a> {
    /// Control by what stops the search, and an observer.
    pub fn new(stop: impl Into<Stop<'a>>, observer: &'a dyn ProgressObserver) -> Self {
        Self { stop: stop.into(), cut: Stop::never(), observer, is_quiet: false, helpers: &Alone }
    }

    /// Lets these helpers share the work; the answer does not depend on them.
    #[must_use]
    pub fn helped_by(self, helpers: &'a dyn Helpers) -> Self {
        Self { helpers, ..self }
    }

    /// What cuts off the certificate; the search must be stopped by then.
    #[must_use]
    pub fn cut_off_by(self, cut: impl Into<Stop<'a>>) -> Self {
        Self { cut: cut.into(), ..self }
    }

    /// Runs to the end, without observer and helpers.
    pub fn unattended() -> RunControl<'static> {
        RunControl::new(Stop::never(), &NoProgress)
    }

    /// Reports no progress from now on.
    pub(super) fn quietly(self) -> Self {
        Self { is_quiet: true, ..self }
    }

    /// Control of one part of the search, stopped by `stop`, with an observer of its own and without helpers.
    pub(super) fn of_part(self, stop: Stop<'a>, observer: &'a dyn ProgressObserver) -> Self {
        Self { stop, observer, helpers: &Alone, ..self }
    }

    /// Does the work on the calling thread and on helpers; returns when it is done.
    pub fn share(&self, work: &dyn SharedWork) {
        self.helpers.share(work);
    }

    /// What stops the search.
    pub fn stop(&self) -> Stop<'a> {
        self.stop
    }

    /// What cuts off the certificate.
    pub fn cut(&self) -> Stop<'a> {
        self.cut
    }

    /// Whether the search was asked to stop.
    pub fn is_stopped(&self) -> bool {
        self.stop.is_set()
    }

    /// Notifies the observer that a phase begins, and that it ends when the result is dropped.
    #[must_use]
    pub fn enter(&self, phase: Phase) -> RunningPhase<'a> {
        self.observer.begins(phase);
        RunningPhase { observer: self.observer, phase }
    }

    /// Notifies the observer of progress.
    pub fn report(&self, progress: &SolveProgress) {
        if !self.is_quiet {
            self.observer.progress(progress);
        }
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

#[cfg(test)]
mod tests;
