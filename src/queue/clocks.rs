//! When a job is stopped and cut off, and how long it will keep a worker.

use std::time::{Duration, Instant};

use super::stop::StopCause;
use super::watchdog::Signal;

/// How long before a deadline an answer must be complete: time to send it. Of the time until a near deadline it is at most
/// half: whoever needs an answer within 20 ms may get one.
pub const ANSWER_MARGIN: Duration = Duration::from_millis(20);

/// What a job does after it was signalled to stop.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Finishing {
    /// How long that will probably take.
    pub time: Duration,
    /// Most of the available time that is kept free for it.
    pub largest_share: f64,
    /// How long it may run before a time limit cuts it off: the shortest limits have an answer too.
    pub least_time: Duration,
}

impl Finishing {
    /// How long a job under this time limit runs at least, where it uses up what is not kept free.
    pub fn at_least_for(&self, time_limit: Option<Duration>) -> Duration {
        let beyond = |limit: Duration| (limit < self.time).then(|| self.time.min(limit.max(self.least_time)));
        time_limit.and_then(beyond).unwrap_or_default()
    }

    /// What is kept free for it of the time that a job has.
    pub fn kept_of(&self, available: Duration) -> Duration {
        self.time.min(available.mul_f64(self.largest_share))
    }
}

/// The two clocks of a job, and how long it is expected to run.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Clocks {
    /// How long the job may take, counted from its start on the worker.
    pub time_limit: Option<Duration>,
    /// When its caller needs the answer, waiting included; the answer is to be complete [`ANSWER_MARGIN`] earlier, or less
    /// where the deadline is near: the job is cut off then, and never started after that.
    pub deadline: Option<Instant>,
    /// When the job was submitted: a deadline is near or far from here. Unknown, it is far.
    pub submitted: Option<Instant>,
    /// What both clocks keep free for the time after the signal to stop.
    pub finishing: Finishing,
    /// How long it is expected to run: the part of the queue's capacity for work that it takes.
    pub estimate: Duration,
}

impl Clocks {
    /// How long before its deadline the answer is to be complete.
    pub fn answer_margin(&self) -> Duration {
        let available = self.deadline.zip(self.submitted).map(|(end, start)| end.saturating_duration_since(start));
        available.map_or(ANSWER_MARGIN, |available| ANSWER_MARGIN.min(available / 2))
    }

    /// When a job under this deadline is not started any more.
    pub(super) fn last_start(&self) -> Option<Instant> {
        // A time that the clock cannot represent lies in the past: never start.
        self.deadline.map(|deadline| deadline.checked_sub(self.answer_margin()).unwrap_or_else(Instant::now))
    }

    /// When a job that starts at this time is signalled, how and why; its deadline cuts it off besides.
    pub(super) fn signals(&self, start: Instant) -> [Option<(Instant, Signal, StopCause)>; 3] {
        let until_deadline = self.last_start().map(|end| end.saturating_duration_since(start));
        let search = |available: Duration| available.saturating_sub(self.finishing.kept_of(available));
        let cut_off = self.time_limit.map(|limit| limit.max(self.finishing.least_time));
        [
            (self.time_limit.map(search), Signal::Stop, StopCause::TimeLimit),
            (cut_off, Signal::CutOff, StopCause::TimeLimit),
            (until_deadline.map(search), Signal::Stop, StopCause::Deadline),
        ]
        // A limit beyond the range of the clock never passes.
        .map(|(time, signal, cause)| Some((start.checked_add(time?)?, signal, cause)))
    }

    /// How long a job that started at `start` will probably still run at `now`; it may start later than that.
    ///
    /// One that has outlasted its estimate is expected to go on for as long as it has overrun, or for its estimate again:
    /// nothing better is known.
    pub(super) fn expected_rest(&self, start: Instant, now: Instant) -> Duration {
        let elapsed = now.saturating_duration_since(start);
        let limit = self.time_limit.map(|limit| limit.max(self.finishing.least_time).saturating_sub(elapsed));
        let until_deadline = self.deadline.map(|deadline| deadline.saturating_duration_since(start.max(now)));
        let rest = self.estimate.abs_diff(elapsed).min(self.estimate);
        let ends = [Some(rest), limit, until_deadline];
        ends.into_iter().flatten().min().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn both_clocks_keep_the_finishing_time_free() {
        let start = Instant::now();
        let finishing = Finishing { time: SECOND / 10, largest_share: 0.5, least_time: SECOND / 5 };
        let deadline = Some(start + ANSWER_MARGIN + SECOND);
        let clocks = Clocks { time_limit: Some(SECOND / 10), deadline, finishing, estimate: SECOND, submitted: None };
        let signals = [
            (start + SECOND / 20, Signal::Stop, StopCause::TimeLimit),
            (start + SECOND / 5, Signal::CutOff, StopCause::TimeLimit),
            (start + SECOND * 9 / 10, Signal::Stop, StopCause::Deadline),
        ];
        assert_eq!(clocks.signals(start), signals.map(Some));
        let endless = Clocks { time_limit: Some(Duration::MAX), ..Clocks::default() };
        assert_eq!(endless.signals(start), [None; 3]);
    }

    #[test]
    fn near_deadlines_keep_half_of_their_time_free() {
        let start = Instant::now();
        let last_start = |deadline: Duration| {
            let clocks = Clocks { deadline: Some(start + deadline), submitted: Some(start), ..Clocks::default() };
            clocks.last_start().unwrap() - start
        };
        let times = [0, 2, 20, 40, 100].map(|ms| last_start(Duration::from_millis(ms)).as_millis());
        assert_eq!(times, [0, 1, 10, 20, 80]);
        let passed = Clocks { deadline: Some(start), submitted: Some(start + SECOND), ..Clocks::default() };
        assert_eq!(passed.last_start(), Some(start));
    }

    #[test]
    fn rest_is_bounded_by_both_clocks() {
        let start = Instant::now();
        let rest = |clocks: Clocks, elapsed: Duration| clocks.expected_rest(start, start + elapsed);
        let unlimited = Clocks { estimate: 3 * SECOND, ..Clocks::default() };
        assert_eq!(rest(unlimited, SECOND), 2 * SECOND);
        assert_eq!(rest(unlimited, 5 * SECOND), 2 * SECOND, "as much again as it has overrun");
        assert_eq!(rest(unlimited, 100 * SECOND), 3 * SECOND, "at most its estimate again");
        assert_eq!(rest(Clocks { time_limit: Some(2 * SECOND), ..unlimited }, SECOND), SECOND);
        assert_eq!(rest(Clocks { deadline: Some(start + SECOND), ..unlimited }, SECOND), Duration::ZERO);
        assert_eq!(unlimited.expected_rest(start + SECOND, start), 3 * SECOND, "it starts later");
    }
}
