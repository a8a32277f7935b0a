//! What a connection has done so far.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

/// Length of the preface of HTTP/2, bytes: after as many the protocol is known, and its own timers run.
const PREFACE_BYTES: u64 = 24;

/// Counts of one connection.
#[derive(Debug, Default)]
pub(super) struct Activity {
    bytes_read: AtomicU64,
    requests: AtomicU64,
    under_way: AtomicUsize,
    /// Answers of which a part was handed over and the next was not asked for, and since when.
    unread: Mutex<BTreeMap<u64, Instant>>,
}

impl Activity {
    /// Counts bytes that arrived.
    pub(super) fn read(&self, bytes: usize) {
        self.bytes_read.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Counts a request until the result is dropped.
    pub(super) fn enter(this: &Arc<Self>) -> UnderWay {
        let number = this.requests.fetch_add(1, Ordering::Relaxed);
        this.under_way.fetch_add(1, Ordering::Relaxed);
        UnderWay { activity: Arc::clone(this), number }
    }

    /// Whether the caller has left an answer unread for longer than `patience`.
    pub(super) fn is_unread_for(&self, patience: Duration) -> bool {
        self.unread().values().any(|since| since.elapsed() > patience)
    }

    fn unread(&self) -> MutexGuard<'_, BTreeMap<u64, Instant>> {
        self.unread.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether enough has arrived to tell the protocol.
    pub(super) fn has_spoken(&self) -> bool {
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
    /// A part of the answer was handed over: until the next is asked for, the caller is to read.
    pub(super) fn handed_over(&self) {
        self.activity.unread().insert(self.number, Instant::now());
    }

    /// The next part was asked for.
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
        let (activity, patience) = (Arc::new(Activity::default()), Duration::from_secs(1));
        let under_way = Activity::enter(&activity);
        under_way.handed_over();
        tokio::time::advance(patience).await;
        assert!(!activity.is_unread_for(patience));
        tokio::time::advance(patience).await;
        assert!(activity.is_unread_for(patience));
        under_way.asked_for();
        assert!(!activity.is_unread_for(patience), "the next part takes its time here");
        under_way.handed_over();
        drop(under_way);
        tokio::time::advance(2 * patience).await;
        assert!(!activity.is_unread_for(patience), "it is over");
    }
}
