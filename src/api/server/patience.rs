//! How long a peer may keep the server waiting: a budget of time that bytes taken earn back at a minimum rate, so that a
//! single byte now and then does not reset the clock.

use std::time::Duration;

use tokio::time::Instant;

/// Rate at which a peer has to take what it asked for, bytes per second: a poor mobile link does better, and the largest
/// answer is through in about a minute.
const LEAST_RATE: usize = 64 * 1024;

/// The time that a peer has left.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patience {
    full: Duration,
    left: Duration,
    since: Option<Instant>,
}

impl Patience {
    pub(super) fn new(full: Duration) -> Self {
        Self { full, left: full, since: None }
    }

    /// The server waits from now on.
    pub(super) fn begin(&mut self) {
        self.since.get_or_insert_with(Instant::now);
    }

    /// The peer has taken so many bytes; a wait is over.
    pub(super) fn end(&mut self, bytes: usize) {
        let waited = self.since.take().map_or(Duration::ZERO, |since| since.elapsed());
        let earned = Duration::from_secs_f64(bytes as f64 / LEAST_RATE as f64);
        self.left = self.left.saturating_sub(waited).saturating_add(earned).min(self.full);
    }

    /// When the time runs out, while the server waits.
    pub(super) fn until(&self) -> Option<Instant> {
        // Beyond the range of the clock: never.
        self.since.and_then(|since| since.checked_add(self.left))
    }

    /// How much of its time the peer has used up, while the server waits.
    pub(super) fn spent(&self) -> Option<Duration> {
        self.since.map(|since| self.full.saturating_sub(self.left.saturating_sub(since.elapsed())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FULL: Duration = Duration::from_secs(10);
    const SECOND: Duration = Duration::from_secs(1);

    #[tokio::test(start_paused = true)]
    async fn bytes_earn_time_at_the_least_rate_and_no_more() {
        let mut patience = Patience::new(FULL);
        assert_eq!((patience.until(), patience.spent()), (None, None));
        for _ in 0..8 {
            patience.begin();
            tokio::time::advance(2 * SECOND).await;
            patience.end(LEAST_RATE);
        }
        patience.begin();
        assert_eq!(patience.spent(), Some(8 * SECOND), "each round costs a second more than it earns");
        patience.end(100 * LEAST_RATE);
        patience.begin();
        assert_eq!(patience.until(), Some(Instant::now() + FULL), "nobody earns more than the whole");
    }
}
