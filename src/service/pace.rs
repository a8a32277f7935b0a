//! How fast the service has worked lately, and what that means for those who come next.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use super::domain::{Method, SolverSettings};

/// Weight of the latest job: about the last eight decide.
const LATEST_WEIGHT: f64 = 1.0 / 8.0;
/// Shortest and longest advice when to come back: a busy loop of refused callers must not form, and no estimate is
/// worth more than a minute of waiting.
const RETRY_AFTER_RANGE: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(60));

/// What a job asks for: the number of time steps that it will probably integrate. Only ratios between jobs matter; the
/// measured pace turns them into time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Work(f64);

impl Work {
    /// The work of a solve.
    pub(super) fn of_solve(settings: &SolverSettings) -> Self {
        // The forward drive of 5 m takes 281 rollouts from its first start, and 235,000 by Nelder-Mead.
        let rollouts_per_start = match settings.method {
            Method::SequentialLinear => 300.0,
            Method::NelderMead => 200_000.0,
        };
        let rollouts = (settings.start_count as f64 * rollouts_per_start).min(settings.rollout_limit as f64);
        Self(rollouts * settings.step_count as f64)
    }

    /// The work of one rollout.
    pub(super) fn of_rollout(step_count: usize) -> Self {
        Self(step_count as f64)
    }
}

/// Moving averages over the solves.
#[derive(Debug, Default)]
pub(super) struct Pace {
    /// None before the first solve.
    averages: Mutex<Option<Averages>>,
}

#[derive(Debug, Clone, Copy)]
struct Averages {
    /// Of a solve, s.
    duration: f64,
    /// Of a step, s.
    per_step: f64,
}

impl Pace {
    /// Takes the duration of one more solve into the averages.
    pub(super) fn record(&self, work: Work, duration: Duration) {
        let duration = duration.as_secs_f64();
        let latest = Averages { duration, per_step: duration / work.0.max(1.0) };
        let mut averages = self.averages.lock().unwrap_or_else(PoisonError::into_inner);
        *averages = Some(averages.map_or(latest, |averages| averages.moved_towards(latest)));
    }

    /// When a refused caller should come back: after one average solve a place has most likely become free.
    pub(super) fn retry_after(&self) -> Duration {
        let (shortest, longest) = RETRY_AFTER_RANGE;
        self.averages().map_or(shortest, |averages| seconds(averages.duration).clamp(shortest, longest))
    }

    /// How long a job that may run for `longest` will probably run. Nothing is known before the first solve: zero.
    pub(super) fn estimate(&self, work: Work, longest: Duration) -> Duration {
        self.averages().map_or(Duration::ZERO, |averages| seconds(averages.per_step * work.0)).min(longest)
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

    fn of_starts(start_count: usize) -> Work {
        Work::of_solve(&SolverSettings { start_count, ..SolverSettings::default() })
    }

    fn after(durations_s: &[f64]) -> Pace {
        let pace = Pace::default();
        for &duration in durations_s {
            pace.record(of_starts(8), Duration::from_secs_f64(duration));
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
        let milliseconds = |work| pace.estimate(work, Duration::from_secs(5)).as_millis();
        assert_eq!((milliseconds(of_starts(8)), milliseconds(of_starts(16))), (2000, 4000));
        assert_eq!(milliseconds(of_starts(64)), 5000, "no longer than it may run");
        assert_eq!(Pace::default().estimate(of_starts(8), Duration::MAX), Duration::ZERO, "nothing is known yet");
        let settings = SolverSettings { rollout_limit: 1, ..SolverSettings::default() };
        assert!(milliseconds(Work::of_solve(&settings)) < 2, "one rollout is little work");
        assert!(milliseconds(Work::of_rollout(200)) < 2);
    }

    #[test]
    fn endless_estimates_are_durations_too() {
        let pace = Pace::default();
        pace.record(Work(1.0), Duration::from_secs(60));
        assert_eq!(pace.estimate(Work(f64::MAX), Duration::MAX), Duration::MAX);
    }
}
