//! How long a solve takes to finish once it is stopped: its certificate and its answer.
//!
//! A plan is replayed on a finer grid and written node by node, so the time grows with the steps. Time limits and deadlines
//! allow for it: the stop flag is set that much earlier.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::service::Finishing;
use crate::solver::{Refinement, SolverSettings};

/// Before anything was measured: a small cloud machine takes some 10 us per step, and up to 30 us where contacts nearly lift or
/// there are limits.
const FIRST_PACE_S: f64 = 3e-5;
/// A worker that wants the processor on a busy machine waits that long for its turn.
const TURN: Duration = Duration::from_millis(20);
/// Weight of a measurement below the pace; above it counts at once, because a late answer is worse than an early one.
const SLOW_DOWN: f64 = 0.1;
/// The pace is believed within these bounds, s per step: one stall must not take all time from later solves.
const PACE_RANGE_S: (f64, f64) = (1e-6, 1e-4);
/// Certificates of fewer steps say more about the machine's load than about its pace.
const FEWEST_STEPS: usize = 100;
/// Most of the available time that is kept for finishing.
const LARGEST_SHARE: f64 = 0.75;
/// Most of it where the steps are automatic: short searches end on the first, cheap grid.
const LARGEST_AUTOMATIC_SHARE: f64 = 0.1;

/// No solve is cut off before it has run that long, so that the shortest limits have a plan too: recording one on the largest
/// grid takes some 10 ms, and more on a busy machine.
const LEAST_TIME: Duration = Duration::from_millis(250);

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

    /// What a solve with these settings keeps free of its time.
    pub(super) fn finishing(&self, settings: &SolverSettings) -> Finishing {
        let pace = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (step_count, largest_share) = match settings.refinement {
            Refinement::Fixed => (settings.step_count, LARGEST_SHARE),
            Refinement::UntilConfirmed { step_limit } => (step_limit, LARGEST_AUTOMATIC_SHARE),
        };
        let time = TURN + Duration::from_secs_f64(pace * step_count as f64);
        Finishing { time, largest_share, least_time: LEAST_TIME }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn fixed(step_count: usize) -> SolverSettings {
        SolverSettings { step_count, refinement: Refinement::Fixed, ..SolverSettings::default() }
    }

    /// What a limit of a second leaves for the search.
    fn search_time(pace: &FinishingPace, step_count: usize) -> Duration {
        SECOND.saturating_sub(pace.finishing(&fixed(step_count)).kept_of(SECOND))
    }

    #[test]
    fn finer_grids_are_stopped_earlier() {
        let pace = FinishingPace::default();
        let times = [200, 10_000].map(|steps| search_time(&pace, steps));
        assert!(times[1] < times[0] && times[0] < SECOND, "{times:?}");
    }

    #[test]
    fn slow_finish_counts_at_once_and_fast_ones_slowly() {
        let pace = FinishingPace::default();
        let before = search_time(&pace, 10_000);
        pace.record(1000, Duration::from_millis(50));
        let slow = search_time(&pace, 10_000);
        assert!(slow < before);
        pace.record(1000, Duration::from_millis(2));
        let after = search_time(&pace, 10_000);
        assert!(slow < after && after < before);
    }

    #[test]
    fn short_limits_keep_time_for_the_search() {
        let pace = FinishingPace::default();
        let limit = Duration::from_millis(1);
        let kept = |settings: &SolverSettings| pace.finishing(settings).kept_of(limit);
        assert!(kept(&fixed(10_000)) <= limit.mul_f64(0.76));
        assert!(kept(&SolverSettings::default()) <= limit.mul_f64(0.11));
    }
}
