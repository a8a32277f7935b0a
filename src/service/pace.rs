//! How fast the service has worked lately, and what that means for those who come next.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Weight of the latest job: about the last eight decide.
const LATEST_WEIGHT: f64 = 1.0 / 8.0;
/// Shortest and longest advice when to come back: a busy loop of refused callers must not form, and no estimate is
/// worth more than a minute of waiting.
const RETRY_AFTER_RANGE: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(60));

/// What a job without a time limit is expected to take at most: no estimate reaches further.
const LONGEST_ESTIMATE: Duration = Duration::from_secs(60);

/// What a job asks for: the number of time steps that it will probably integrate. Only ratios between jobs matter; the
/// measured pace turns them into time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost(f64);

impl Cost {
    /// The cost of that many time steps.
    pub fn of_steps(steps: f64) -> Self {
        Self(steps)
    }
}

/// Moving averages over the jobs that set the pace.
#[derive(Debug, Default)]
pub(super) struct Pace {
    /// None before the first of them.
    averages: Mutex<Option<Averages>>,
}

#[derive(Debug, Clone, Copy)]
struct Averages {
    /// Of a job, s.
    duration: f64,
    /// Of a step, s.
    per_step: f64,
}

impl Pace {
    /// Takes the duration of one more job into the averages.
    pub(super) fn record(&self, work: Cost, duration: Duration) {
        let duration = duration.as_secs_f64();
        let latest = Averages { duration, per_step: duration / work.0.max(1.0) };
        let mut averages = self.averages.lock().unwrap_or_else(PoisonError::into_inner);
        *averages = Some(averages.map_or(latest, |averages| averages.moved_towards(latest)));
    }

    /// When a refused caller should come back: after one average job a permit has most likely become free.
    pub(super) fn retry_after(&self) -> Duration {
        let (shortest, longest) = RETRY_AFTER_RANGE;
        self.averages().map_or(shortest, |averages| seconds(averages.duration).clamp(shortest, longest))
    }

    /// How long a job under this time limit will probably run. Nothing is known before the first job: zero.
    pub(super) fn estimate(&self, work: Cost, time_limit: Option<Duration>) -> Duration {
        let estimate = self.averages().map_or(Duration::ZERO, |averages| seconds(averages.per_step * work.0));
        estimate.min(time_limit.unwrap_or(LONGEST_ESTIMATE))
    }

    fn averages(&self) -> Option<Averages> {
        *self.averages.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Averages {
    fn moved_towards(self, latest: Self) -> Self {
        let moved = |average: f64, latest: f64| average + LATEST_WEIGHT * (latest - average);
        Self { duration: moved(self.duration, latest.duration), per_step: moved(self.per_step, latest.per_step) }
    }
}

/// Beyond the clock's range: for ever.
fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_starts(start_count: f64) -> Cost {
        Cost::of_steps(start_count * 60_000.0)
    }

    fn after(durations_s: &[f64]) -> Pace {
        let pace = Pace::default();
        for &duration in durations_s {
            pace.record(of_starts(8.0), Duration::from_secs_f64(duration));
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
    fn estimate_follows_what_is_asked_at_the_latest_pace() {
        let pace = after(&[2.0]);
        let milliseconds = |cost| pace.estimate(cost, Some(Duration::from_secs(5))).as_millis();
        assert_eq!((milliseconds(of_starts(8.0)), milliseconds(of_starts(16.0))), (2000, 4000));
        assert_eq!(milliseconds(of_starts(64.0)), 5000, "no longer than it may run");
        assert_eq!(Pace::default().estimate(of_starts(8.0), None), Duration::ZERO, "nothing is known yet");
        assert!(milliseconds(Cost::of_steps(200.0)) < 2, "one rollout is little work");
    }

    #[test]
    fn endless_estimates_are_durations_too() {
        let pace = Pace::default();
        pace.record(Cost::of_steps(1.0), Duration::from_secs(60));
        assert_eq!(pace.estimate(Cost::of_steps(f64::MAX), Some(Duration::MAX)), Duration::MAX);
        assert_eq!(pace.estimate(Cost::of_steps(f64::MAX), None), LONGEST_ESTIMATE);
    }
}
