//! Why and how a job is signalled to stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// Why a job was signalled to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopCause {
    /// Its time limit, counted from its start on the worker.
    TimeLimit,
    /// The deadline of its caller, counted from arrival.
    Deadline,
    /// Nobody waits for the answer any more.
    CallerGone,
    /// The process ends.
    Shutdown,
}

/// The two flags of one job and the first cause that set each; clones share them.
///
/// A job that is stopped completes its answer with what it has; one that is cut off returns at once.
#[derive(Debug, Clone, Default)]
pub struct StopHandle {
    state: Arc<StopState>,
}

#[derive(Debug, Default)]
struct StopState {
    flag: AtomicBool,
    cause: OnceLock<(StopCause, Instant)>,
    cut_flag: AtomicBool,
    cut_cause: OnceLock<StopCause>,
}

impl StopHandle {
    /// A handle whose flags are not set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Signals the job to stop; only the first cause is kept.
    pub fn stop(&self, cause: StopCause) {
        let first = self.state.cause.set((cause, Instant::now())).is_ok();
        if first {
            self.state.flag.store(true, Ordering::Release);
        }
    }

    /// Cuts the job off, and stops it where it was not stopped before; only the first cause is kept.
    pub fn cut_off(&self, cause: StopCause) {
        let first = self.state.cut_cause.set(cause).is_ok();
        if first {
            self.state.cut_flag.store(true, Ordering::Release);
        }
        self.stop(cause);
    }

    /// What stopped the job, if anything did.
    pub fn cause(&self) -> Option<StopCause> {
        self.state.cause.get().map(|&(cause, _)| cause)
    }

    /// What cut the job off, if anything did.
    pub fn cut_cause(&self) -> Option<StopCause> {
        self.state.cut_cause.get().copied()
    }

    /// When the job was signalled to stop, if it was.
    pub fn stopped_at(&self) -> Option<Instant> {
        self.state.cause.get().map(|&(_, time)| time)
    }

    /// The flag of a stopped job, for work that polls it.
    pub fn flag(&self) -> &AtomicBool {
        &self.state.flag
    }

    /// The flag of a job that is cut off, for work that polls it.
    pub fn cut_flag(&self) -> &AtomicBool {
        &self.state.cut_flag
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flags(stop: &StopHandle) -> [bool; 2] {
        [stop.flag(), stop.cut_flag()].map(|flag| flag.load(Ordering::Acquire))
    }

    #[test]
    fn first_cause_is_kept() {
        let stop = StopHandle::new();
        assert_eq!((stop.cause(), stop.cut_cause(), flags(&stop)), (None, None, [false, false]));
        stop.stop(StopCause::TimeLimit);
        assert_eq!((stop.cause(), stop.cut_cause(), flags(&stop)), (Some(StopCause::TimeLimit), None, [true, false]));
        stop.clone().cut_off(StopCause::CallerGone);
        stop.cut_off(StopCause::Deadline);
        let causes = (stop.cause(), stop.cut_cause());
        assert_eq!((causes, flags(&stop)), ((Some(StopCause::TimeLimit), Some(StopCause::CallerGone)), [true, true]));
    }

    #[test]
    fn job_that_is_cut_off_is_stopped_too() {
        let stop = StopHandle::new();
        stop.cut_off(StopCause::Shutdown);
        assert_eq!((stop.cause(), flags(&stop)), (Some(StopCause::Shutdown), [true, true]));
    }
}
