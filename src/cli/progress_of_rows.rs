//! How far a sweep is: a line that changes on a terminal, else a line now and then.

use std::io::{self, IsTerminal as _, Write as _};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use slipdrive::sweep::Progress;

/// Time between two plain lines: a log of a day stays readable.
const PLAIN_INTERVAL: Duration = Duration::from_secs(10);

/// Shows progress on standard error.
pub(super) struct ProgressLine {
    bar: Option<ProgressBar>,
    last_line: Instant,
}

impl ProgressLine {
    /// A line for so many things.
    pub(super) fn new(count: u64) -> Self {
        let style = ProgressStyle::with_template("{spinner} [{bar:24}] {wide_msg}");
        let bar = style.ok().filter(|_| io::stderr().is_terminal()).map(|style| {
            let bar = ProgressBar::with_draw_target(Some(count), ProgressDrawTarget::stderr());
            bar.with_style(style.progress_chars("=> "))
        });
        Self { bar, last_line: Instant::now() }
    }

    /// Shows how many are done.
    pub(super) fn show(&mut self, done: u64, words: impl FnOnce() -> String) {
        if let Some(bar) = &self.bar {
            bar.set_position(done);
            bar.set_message(words());
        } else if self.last_line.elapsed() >= PLAIN_INTERVAL {
            // A terminal may go away while the sweep goes on.
            let _ = writeln!(io::stderr(), "{}", words());
            self.last_line = Instant::now();
        }
    }

    /// Takes the line away.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Shows how many rows are done.
pub(super) struct ProgressOfRows {
    line: ProgressLine,
    start: Instant,
    /// Rows that were done before.
    done_before: u64,
}

impl ProgressOfRows {
    /// Begins with what was done before.
    pub(super) fn of(progress: &Progress) -> Self {
        Self { line: ProgressLine::new(progress.rows), start: Instant::now(), done_before: progress.done }
    }

    /// Shows how far it is.
    pub(super) fn show(&mut self, progress: &Progress) {
        let words = || words(progress, progress.done - self.done_before, self.start.elapsed());
        self.line.show(progress.done, words);
    }

    /// Takes the line away.
    pub(super) fn finish(&self) {
        self.line.finish();
    }
}

/// What is done, how fast, and how long the rest will take at that rate.
fn words(progress: &Progress, done: u64, elapsed: Duration) -> String {
    let rate = done as f64 / elapsed.as_secs_f64();
    if done == 0 || !rate.is_finite() {
        return progress.to_string();
    }
    let left = Duration::try_from_secs_f64((progress.rows - progress.done) as f64 / rate).unwrap_or(Duration::MAX);
    format!("{progress}; {rate:.3} rows/s, {} left", in_words(left))
}

/// A duration in its two largest units.
fn in_words(duration: Duration) -> String {
    let seconds = duration.as_secs();
    match (seconds / 86_400, seconds / 3600 % 24, seconds / 60 % 60) {
        (0, 0, 0) => format!("{seconds} s"),
        (0, 0, minutes) => format!("{minutes} min {} s", seconds % 60),
        (0, hours, minutes) => format!("{hours} h {minutes} min"),
        (days, hours, _) => format!("{days} d {hours} h"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_say_rate_and_rest() {
        let progress = Progress { rows: 4000, done: 1000, ..Progress::default() };
        let expected = "1000 of 4000 rows; 10.000 rows/s, 5 min 0 s left";
        assert_eq!(words(&progress, 500, Duration::from_secs(50)), expected);
        assert_eq!(words(&progress, 0, Duration::from_secs(50)), "1000 of 4000 rows");
    }

    #[test]
    fn durations_have_two_units() {
        let seconds = [9, 61, 3660, 90_000];
        let words = seconds.map(|seconds| in_words(Duration::from_secs(seconds)));
        assert_eq!(words, ["9 s", "1 min 1 s", "1 h 1 min", "1 d 1 h"]);
    }
}
