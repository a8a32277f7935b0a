//! What a connection has done so far; its timers use it to decide whether to end it.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

/// Length of the HTTP/2 preface, bytes: once as many have arrived the protocol is known, and hyper's own timers run.
const PREFACE_BYTES: u64 = 24;

/// Counts of one connection.
#[derive(Debug, Default)]
pub(super) struct Activity {
    bytes_read: AtomicU64,
    requests: AtomicU64,
    under_way: AtomicUsize,
    /// Answers of which a part was handed over to hyper and the next has not been asked for, and since when.
    unread: Mutex<BTreeMap<u64, Instant>>,
}

impl Activity {
    /// Counts bytes that arrived.
    pub(super) fn read(&self, bytes: usize) {
        self.bytes_read.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Counts a request as under way until the result is dropped.
    pub(super) fn enter(this: &Arc<Self>) -> UnderWay {
        let number = this.requests.fetch_add(1, Ordering::Relaxed);
        this.under_way.fetch_add(1, Ordering::Relaxed);
        UnderWay { activity: Arc::clone(this), number }
    }

    /// Whether the caller has left an answer unread for longer than `timeout`.
    pub(super) fn is_unread_for(&self, timeout: Duration) -> bool {
        self.unread().values().any(|since| since.elapsed() > timeout)
    }

    fn unread(&self) -> MutexGuard<'_, BTreeMap<u64, Instant>> {
        self.unread.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether enough bytes have arrived to know the protocol.
    pub(super) fn has_sent_preface(&self) -> bool {
        self.requests.load(Ordering::Relaxed) > 0 || self.bytes_read.load(Ordering::Relaxed) >= PREFACE_BYTES
    }

    /// Whether no request is under way and none came since `seen` was last set here.
    pub(super) fn is_idle_since(&self, seen: &mut u64) -> bool {
        let before = std::mem::replace(seen, self.requests.load(Ordering::Relaxed));
        *seen == before && self.under_way.load(Ordering::Relaxed) == 0
    }
}

/// A request under way.
#[derive(Debug)]
pub(super) struct UnderWay {
    activity: Arc<Activity>,
    number: u64,
}

impl UnderWay {
    /// A part of the answer was handed over: until the next is asked for, the server waits for the caller to read.
    pub(super) fn handed_over(&self) {
        self.activity.unread().insert(self.number, Instant::now());
    }

    /// The next part was asked for: the caller has read, and any delay from now on is the server's own.
    pub(super) fn asked_for(&self) {
        self.activity.unread().remove(&self.number);
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        self.asked_for();
        self.activity.under_way.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connection_is_idle_without_requests_old_and_new() {
        let activity = Arc::new(Activity::default());
        let mut seen = 0;
        let under_way = Activity::enter(&activity);
        assert!(!activity.is_idle_since(&mut seen), "one came");
        assert!(!activity.is_idle_since(&mut seen), "it is under way");
        drop(under_way);
        assert!(activity.is_idle_since(&mut seen));
    }

    #[tokio::test(start_paused = true)]
    async fn answer_is_unread_from_one_part_to_the_next() {
        let (activity, timeout) = (Arc::new(Activity::default()), Duration::from_secs(1));
        let under_way = Activity::enter(&activity);
        under_way.handed_over();
        tokio::time::advance(timeout).await;
        assert!(!activity.is_unread_for(timeout));
        tokio::time::advance(timeout).await;
        assert!(activity.is_unread_for(timeout));
        under_way.asked_for();
        assert!(!activity.is_unread_for(timeout), "the server takes its time to make the next part");
        under_way.handed_over();
        drop(under_way);
        tokio::time::advance(2 * timeout).await;
        assert!(!activity.is_unread_for(timeout), "it is over");
    }
}
