//! Why and how a job is signalled to stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// Why a job was signalled to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopCause {
    /// Its time limit, counted from its start on the worker, has passed.
    TimeLimit,
    /// The deadline of its caller, counted from arrival, is near.
    Deadline,
    /// Nobody waits for the answer any more.
    CallerGone,
    /// The process ends.
    Shutdown,
}

/// The stop flag of one job and the first cause that set it; clones share both.
#[derive(Debug, Clone, Default)]
pub struct StopHandle {
    state: Arc<StopState>,
}

#[derive(Debug, Default)]
struct StopState {
    flag: AtomicBool,
    cause: OnceLock<(StopCause, Instant)>,
}

impl StopHandle {
    /// A handle whose flag is not set.
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

    /// What stopped the job, if anything did.
    pub fn cause(&self) -> Option<StopCause> {
        self.state.cause.get().map(|&(cause, _)| cause)
    }

    /// When the job was signalled to stop, if it was.
    pub fn stopped_at(&self) -> Option<Instant> {
        self.state.cause.get().map(|&(_, time)| time)
    }

    /// The flag itself, for work that polls it.
    pub fn flag(&self) -> &AtomicBool {
        &self.state.flag
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_cause_is_kept() {
        let stop = StopHandle::new();
        assert_eq!((stop.cause(), stop.flag().load(Ordering::Acquire)), (None, false));
        stop.stop(StopCause::TimeLimit);
        stop.clone().stop(StopCause::CallerGone);
        assert_eq!((stop.cause(), stop.flag().load(Ordering::Acquire)), (Some(StopCause::TimeLimit), true));
    }
}
