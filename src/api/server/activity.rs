//! What a connection has done so far.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Length of the preface of HTTP/2, bytes: after as many the protocol is known, and its own timers run.
const PREFACE_BYTES: u64 = 24;

/// Counts of one connection.
#[derive(Debug, Default)]
pub(super) struct Activity {
    bytes_read: AtomicU64,
    requests: AtomicU64,
    under_way: AtomicUsize,
}

impl Activity {
    /// Counts bytes that arrived.
    pub(super) fn read(&self, bytes: usize) {
        self.bytes_read.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Counts a request until the result is dropped.
    pub(super) fn enter(this: &Arc<Self>) -> UnderWay {
        this.requests.fetch_add(1, Ordering::Relaxed);
        this.under_way.fetch_add(1, Ordering::Relaxed);
        UnderWay(Arc::clone(this))
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
pub(super) struct UnderWay(Arc<Activity>);

impl Drop for UnderWay {
    fn drop(&mut self) {
        self.0.under_way.fetch_sub(1, Ordering::Relaxed);
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
}
