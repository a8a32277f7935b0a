//! How long a solve takes to finish once it is stopped: its certificate and its answer.
//!
//! A plan is replayed on a finer grid and written node by node, so the time grows with the steps. A time limit allows for
//! it: the stop flag is set that much earlier.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::solver::{Refinement, SolverSettings};

/// Before anything was measured: a small cloud machine takes some 7 us per step.
const FIRST_PACE_S: f64 = 8e-6;
/// Weight of a measurement below the pace; above it counts at once, because a late answer is worse than an early one.
const SLOW_DOWN: f64 = 0.1;
/// The pace is believed within these bounds, s per step: one stall must not take all time from later solves.
const PACE_RANGE_S: (f64, f64) = (1e-6, 1e-4);
/// Certificates of fewer steps say more about the machine's load than about its pace.
const FEWEST_STEPS: usize = 100;
/// Most of a time limit that is kept for finishing.
const LARGEST_SHARE: f64 = 0.75;
/// Most of a time limit that is kept where the steps are automatic: short limits end on the first, cheap grid.
const LARGEST_AUTOMATIC_SHARE: f64 = 0.1;

/// Seconds per step that finishing has taken lately.
#[derive(Debug)]
pub(super) struct FinishingPace(Mutex<f64>);

impl Default for FinishingPace {
    fn default() -> Self {
        Self(Mutex::new(FIRST_PACE_S))
    }
}

impl FinishingPace {
    /// Takes one more finish into account.
    pub(super) fn record(&self, step_count: usize, duration: Duration) {
        if step_count < FEWEST_STEPS {
            return;
        }
        let (fastest, slowest) = PACE_RANGE_S;
        let latest = (duration.as_secs_f64() / step_count as f64).clamp(fastest, slowest);
        let mut pace = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *pace = if latest > *pace { latest } else { *pace + SLOW_DOWN * (latest - *pace) };
    }

    /// When a solve is stopped, counted from its start, so that it answers within `time_limit`.
    pub(super) fn search_time(&self, settings: &SolverSettings, time_limit: Duration) -> Duration {
        let pace = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (step_count, share) = match settings.refinement {
            Refinement::Fixed => (settings.step_count, LARGEST_SHARE),
            Refinement::UntilConfirmed { step_limit } => (step_limit, LARGEST_AUTOMATIC_SHARE),
        };
        let finishing = Duration::from_secs_f64(pace * step_count as f64).min(time_limit.mul_f64(share));
        time_limit.saturating_sub(finishing)
    }
}

/// When the search of a running solve ended, heard from its worker.
#[derive(Debug, Default)]
pub(super) struct SearchEnd(Mutex<Option<Instant>>);

impl SearchEnd {
    /// Takes the time.
    pub(super) fn mark(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }

    /// The time, if it was taken.
    pub(super) fn time(&self) -> Option<Instant> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn fixed(step_count: usize) -> SolverSettings {
        SolverSettings { step_count, refinement: Refinement::Fixed, ..SolverSettings::default() }
    }

    #[test]
    fn finer_grids_are_stopped_earlier() {
        let pace = FinishingPace::default();
        let times = [200, 10_000].map(|steps| pace.search_time(&fixed(steps), SECOND));
        assert!(times[1] < times[0] && times[0] < SECOND, "{times:?}");
    }

    #[test]
    fn slow_finish_counts_at_once_and_fast_ones_slowly() {
        let pace = FinishingPace::default();
        let before = pace.search_time(&fixed(10_000), SECOND);
        pace.record(1000, Duration::from_millis(20));
        let slow = pace.search_time(&fixed(10_000), SECOND);
        assert!(slow < before);
        pace.record(1000, Duration::from_millis(2));
        let after = pace.search_time(&fixed(10_000), SECOND);
        assert!(slow < after && after < before);
    }

    #[test]
    fn short_limits_keep_time_for_the_search() {
        let pace = FinishingPace::default();
        let limit = Duration::from_millis(1);
        assert!(pace.search_time(&fixed(10_000), limit) >= limit.mul_f64(0.24));
        assert!(pace.search_time(&SolverSettings::default(), limit) >= limit.mul_f64(0.89));
    }
}
