//! How a running solve is stopped and observed from outside.

use std::sync::atomic::{AtomicBool, Ordering};

/// What a solve tells while it runs.
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

/// Hears of progress; called between rollouts, so it must be quick.
pub trait ProgressObserver: Sync {
    /// A new best iterate or a new start.
    fn progress(&self, progress: &SolveProgress);

    /// The search is over; what is left is the certificate of its plan.
    fn search_ended(&self) {}
}

/// Listens to nothing.
pub struct NoProgress;

impl ProgressObserver for NoProgress {
    fn progress(&self, _progress: &SolveProgress) {}
}

/// The stop flag, polled once per rollout, and the observer of a solve.
#[derive(Clone, Copy)]
pub struct RunControl<'a> {
    stop: &'a AtomicBool,
    observer: &'a dyn ProgressObserver,
    is_abandoned: Option<&'a (dyn Fn() -> bool + Sync)>,
}

impl<'a> RunControl<'a> {
    /// Control by a flag that anyone may set, and an observer.
    pub fn new(stop: &'a AtomicBool, observer: &'a dyn ProgressObserver) -> Self {
        Self { stop, observer, is_abandoned: None }
    }

    /// Also asks, once stopped, whether anybody still wants the answer: an unwanted one is not certified.
    #[must_use]
    pub fn abandoned_when(self, is_abandoned: &'a (dyn Fn() -> bool + Sync)) -> Self {
        Self { is_abandoned: Some(is_abandoned), ..self }
    }

    /// Runs to the end, unobserved.
    pub fn unattended() -> RunControl<'static> {
        static NEVER: AtomicBool = AtomicBool::new(false);
        RunControl { stop: &NEVER, observer: &NoProgress, is_abandoned: None }
    }

    /// The stop flag itself.
    pub fn stop_flag(&self) -> &'a AtomicBool {
        self.stop
    }

    /// Whether the solve was asked to stop.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Whether the solve was stopped and nobody wants its answer.
    pub fn is_abandoned(&self) -> bool {
        self.is_stopped() && self.is_abandoned.is_some_and(|is_abandoned| is_abandoned())
    }

    /// Tells the observer that the certificate begins.
    pub(super) fn report_search_end(&self) {
        self.observer.search_ended();
    }

    /// Tells the observer.
    pub fn report(&self, progress: &SolveProgress) {
        self.observer.progress(progress);
    }
}
