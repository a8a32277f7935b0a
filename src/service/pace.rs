//! How fast the service has worked lately, and what that means for those who come next.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Weight of the latest job: about the last eight decide.
const LATEST_WEIGHT: f64 = 1.0 / 8.0;
/// How much work the first figures stand for, s: a tenth of a common job, so that measured ones soon replace them. Jobs of
/// less work are forgotten as slowly as they are small.
const FIRST_WORK_S: f64 = 0.1;
/// Shortest and longest advice when to come back: a busy loop of refused callers must not form, and no estimate is
/// worth more than a minute of waiting.
const RETRY_AFTER_RANGE: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(60));

/// What a job without a time limit is expected to take at most: no estimate reaches further.
const LONGEST_ESTIMATE: Duration = Duration::from_secs(60);

/// Work, in seconds of one worker on a small cloud machine. The measured pace turns it into time on this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost(f64);

impl Cost {
    /// The work of a small cloud machine in so many seconds.
    pub fn seconds(seconds: f64) -> Self {
        Self(seconds)
    }
}

/// What a job has done of what it was expected to cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkDone {
    /// What it has done.
    pub cost: Cost,
    /// Whether it came to its end, rather than to that of its time.
    pub is_complete: bool,
}

/// How long a job kept its own worker, and all that worked for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TimeTaken {
    /// From its start to its end.
    pub(super) duration: Duration,
    /// Its own worker's and that of those it had borrowed. Clock time, not processor time: on a loaded machine a job keeps
    /// its worker for longer, and that is what others wait for.
    pub(super) of_workers: Duration,
}

/// Moving averages over the jobs that did work, apart by kind.
#[derive(Debug, Default)]
pub(super) struct Pace(Mutex<BTreeMap<&'static str, Averages>>);

/// Of the jobs of one kind.
#[derive(Debug, Clone, Copy, Default)]
struct Averages {
    /// Of a job, s; none before the first.
    duration: Option<f64>,
    /// Time of workers by work done.
    slowness: Ratio,
    /// Work needed by work expected.
    effort: Ratio,
}

/// A ratio of two sums that forget: large jobs count for more than small ones.
#[derive(Debug, Clone, Copy)]
struct Ratio {
    found: f64,
    expected: f64,
}

impl Pace {
    /// Takes one more job of this kind into the averages.
    pub(super) fn record(&self, kind: &'static str, cost: Cost, done: WorkDone, time: TimeTaken) {
        let mut kinds = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kinds.entry(kind).or_default().record(cost.0, done, time);
    }

    /// When a refused caller should come back: after one average job of the longest kind a permit has most likely become
    /// free.
    pub(super) fn retry_after(&self) -> Duration {
        let (shortest, longest) = RETRY_AFTER_RANGE;
        let kinds = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let durations = kinds.values().filter_map(|averages| averages.duration).map(seconds);
        durations.max().unwrap_or_default().clamp(shortest, longest)
    }

    /// How long a job of this kind will probably keep a worker that nobody helps.
    pub(super) fn estimate(&self, kind: &'static str, cost: Cost, time_limit: Option<Duration>) -> Duration {
        let kinds = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Averages { slowness, effort, .. } = kinds.get(kind).copied().unwrap_or_default();
        seconds(cost.0 * effort.value() * slowness.value()).min(time_limit.unwrap_or(LONGEST_ESTIMATE))
    }
}

impl Averages {
    fn record(&mut self, expected: f64, done: WorkDone, time: TimeTaken) {
        let duration = time.duration.as_secs_f64();
        self.duration = Some(self.duration.map_or(duration, |average| average + LATEST_WEIGHT * (duration - average)));
        self.slowness.record(time.of_workers.as_secs_f64(), done.cost.0);
        // A job that was stopped tells what it needs at least.
        if done.is_complete || done.cost.0 > expected * self.effort.value() {
            self.effort.record(done.cost.0, expected);
        }
    }
}

impl Ratio {
    /// What was known is forgotten by the work that replaces it: any number of the least jobs says little of large ones.
    fn record(&mut self, found: f64, expected: f64) {
        let kept = (1.0 - LATEST_WEIGHT).powf((expected / FIRST_WORK_S).min(1.0));
        self.found = kept * self.found + found;
        self.expected = kept * self.expected + expected;
    }

    fn value(self) -> f64 {
        self.found / self.expected
    }
}

impl Default for Ratio {
    fn default() -> Self {
        Self { found: FIRST_WORK_S, expected: FIRST_WORK_S }
    }
}

/// Beyond the clock's range: for ever.
fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: &str = "kind";
    const MINUTE: Option<Duration> = Some(Duration::from_secs(60));

    /// A job of so many seconds on one worker.
    fn taken(seconds: f64) -> TimeTaken {
        let duration = Duration::from_secs_f64(seconds);
        TimeTaken { duration, of_workers: duration }
    }

    fn complete(seconds: f64) -> WorkDone {
        WorkDone { cost: Cost::seconds(seconds), is_complete: true }
    }

    fn stopped(seconds: f64) -> WorkDone {
        WorkDone { is_complete: false, ..complete(seconds) }
    }

    /// After so many equal jobs that were expected to cost a second each.
    fn after(count: usize, done: WorkDone, time: TimeTaken) -> Pace {
        let pace = Pace::default();
        for _ in 0..count {
            pace.record(KIND, Cost::seconds(1.0), done, time);
        }
        pace
    }

    fn estimate_s(pace: &Pace, cost: f64) -> f64 {
        pace.estimate(KIND, Cost::seconds(cost), MINUTE).as_secs_f64()
    }

    /// Within what the first figures still weigh after some jobs.
    fn is_near(found: f64, expected: f64) -> bool {
        (found / expected - 1.0).abs() < 0.01
    }

    #[test]
    fn advice_follows_the_average_within_its_range() {
        let advice = |durations: &[f64]| {
            let pace = Pace::default();
            for &duration in durations {
                pace.record(KIND, Cost::seconds(1.0), complete(1.0), taken(duration));
            }
            pace.retry_after().as_secs_f64()
        };
        assert_eq!(advice(&[]), 1.0);
        assert_eq!(advice(&[0.01]), 1.0);
        assert_eq!(advice(&[4.0, 12.0]), 5.0);
        assert_eq!(advice(&[1e3]), 60.0);
    }

    #[test]
    fn estimate_follows_what_is_asked_at_the_latest_pace() {
        assert_eq!(estimate_s(&Pace::default(), 2.0), 2.0, "nothing is known but the cost");
        let pace = after(20, complete(1.0), taken(3.0));
        assert!(is_near(estimate_s(&pace, 1.0), 3.0) && is_near(estimate_s(&pace, 2.0), 6.0));
        assert_eq!(estimate_s(&pace, 30.0), 60.0, "no longer than it may run");
        assert_eq!(pace.estimate("other", Cost::seconds(2.0), None), Duration::from_secs(2), "each kind has its own");
    }

    #[test]
    fn any_number_of_the_least_jobs_says_little_of_large_ones() {
        let pace = after(20, complete(1.0), taken(1.0));
        for _ in 0..100 {
            pace.record(KIND, Cost::seconds(1e-4), complete(1e-4), taken(1e-3));
        }
        assert!(estimate_s(&pace, 1.0) < 1.2, "{}", estimate_s(&pace, 1.0));
    }

    #[test]
    fn needed_work_is_learnt_apart_from_the_time_it_takes() {
        let pace = after(20, complete(2.0), taken(3.0));
        assert!(is_near(estimate_s(&pace, 1.0), 3.0));
        pace.record(KIND, Cost::seconds(1.0), stopped(0.5), taken(0.75));
        assert!(is_near(estimate_s(&pace, 1.0), 3.0), "it was stopped at the pace of the others");
    }

    #[test]
    fn stopped_jobs_tell_the_pace_and_what_is_needed_at_least() {
        assert!(is_near(estimate_s(&after(20, stopped(0.1), taken(0.5)), 1.0), 5.0));
        assert!(is_near(estimate_s(&after(20, stopped(2.0), taken(4.0)), 1.0), 4.0));
    }

    #[test]
    fn time_of_borrowed_workers_counts() {
        let helped = TimeTaken { duration: Duration::from_secs(1), of_workers: Duration::from_secs(4) };
        assert!(is_near(estimate_s(&after(20, complete(1.0), helped), 1.0), 4.0));
    }

    #[test]
    fn jobs_with_next_to_no_work_teach_next_to_nothing() {
        let pace = Pace::default();
        pace.record(KIND, Cost::seconds(1e-6), complete(1e-6), taken(1e-3));
        assert!(is_near(estimate_s(&pace, 1.0), 1.01));
    }

    #[test]
    fn endless_estimates_are_durations_too() {
        let pace = after(1, complete(1.0), taken(60.0));
        assert_eq!(pace.estimate(KIND, Cost::seconds(f64::MAX), Some(Duration::MAX)), Duration::MAX);
        assert_eq!(pace.estimate(KIND, Cost::seconds(f64::MAX), None), LONGEST_ESTIMATE);
    }
}
