//! How fast the service has answered lately, and what that means for those who come next.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Weight of the latest solve: about the last eight decide.
const LATEST_WEIGHT: f64 = 1.0 / 8.0;
/// Shortest and longest advice when to come back: a busy loop of refused callers must not form, and no estimate is
/// worth more than a minute of waiting.
const RETRY_AFTER_RANGE: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(60));

/// Moving average of the solve durations.
#[derive(Debug, Default)]
pub(super) struct Pace {
    /// Average in s; none before the first solve.
    average: Mutex<Option<f64>>,
}

impl Pace {
    /// Takes the duration of one more solve into the average.
    pub(super) fn record(&self, duration: Duration) {
        let mut average = self.average.lock().unwrap_or_else(PoisonError::into_inner);
        let latest = duration.as_secs_f64();
        *average = Some(average.map_or(latest, |average| average + LATEST_WEIGHT * (latest - average)));
    }

    /// When a refused caller should come back: after one average solve a place has most likely become free.
    pub(super) fn retry_after(&self) -> Duration {
        let (shortest, longest) = RETRY_AFTER_RANGE;
        self.average().map_or(shortest, |average| average.clamp(shortest, longest))
    }

    /// How long a job waits for a worker behind `jobs_ahead` others that wait or run. Nothing is known before the first
    /// solve: zero.
    pub(super) fn estimated_wait(&self, jobs_ahead: usize, workers: usize) -> Duration {
        if jobs_ahead < workers {
            return Duration::ZERO;
        }
        self.average().unwrap_or_default().mul_f64(jobs_ahead as f64 / workers as f64)
    }

    /// Worker time that this many jobs are expected to take.
    pub(super) fn expected_cost(&self, jobs: usize) -> Duration {
        self.average().unwrap_or_default().mul_f64(jobs as f64)
    }

    fn average(&self) -> Option<Duration> {
        let average = *self.average.lock().unwrap_or_else(PoisonError::into_inner);
        average.map(Duration::from_secs_f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(durations_s: &[f64]) -> Pace {
        let pace = Pace::default();
        for &duration in durations_s {
            pace.record(Duration::from_secs_f64(duration));
        }
        pace
    }

    #[test]
    fn advice_follows_the_average_within_its_range() {
        let seconds = |durations: &[f64]| after(durations).retry_after().as_secs_f64();
        assert_eq!(seconds(&[]), 1.0);
        assert_eq!(seconds(&[0.01]), 1.0);
        assert_eq!(seconds(&[4.0, 12.0]), 5.0);
        assert_eq!(seconds(&[1e3]), 60.0);
    }

    #[test]
    fn wait_is_what_is_ahead_shared_by_the_workers() {
        let pace = after(&[2.0]);
        assert_eq!(pace.estimated_wait(1, 2), Duration::ZERO, "a worker is idle");
        assert_eq!(pace.estimated_wait(6, 2), Duration::from_secs(6));
        assert_eq!(Pace::default().estimated_wait(6, 2), Duration::ZERO, "nothing is known yet");
    }
}
