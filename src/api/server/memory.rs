//! The byte budget: what bodies being received and answers not yet taken may hold, reserved before the memory is.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::body::Bytes;
use tokio::time::{Instant, timeout_at};

use super::connection::Connection;

/// A lease up to this size may use the whole budget, larger ones three quarters of it: requests as small as most are get
/// through while large answers have used up theirs.
const SMALL_BYTES: usize = 16 * 1024;
/// How long a request waits for memory that others are about to release.
const RELEASE_WAIT: Duration = Duration::from_millis(100);

/// Memory that is reserved for one request; released on drop.
#[derive(Debug)]
pub(in crate::api) struct Lease {
    connection: Arc<Connection>,
    bytes: AtomicUsize,
}

impl Lease {
    /// Nothing so far.
    pub(in crate::api) fn empty(connection: &Arc<Connection>) -> Self {
        Self { connection: Arc::clone(connection), bytes: AtomicUsize::new(0) }
    }

    /// Reserves more; false, and nothing changes, where the budget of the connection or of the process is used up.
    pub(in crate::api) fn grow(&self, bytes: usize) -> bool {
        let connections = &self.connection.connections;
        let budget = connections.memory_budget();
        let is_small = self.bytes.load(Ordering::Relaxed) + bytes <= SMALL_BYTES;
        let of_process = if is_small { budget } else { budget / 4 * 3 };
        if !added(&self.connection.held_bytes, bytes, budget / 4) {
            return false;
        }
        if !added(&connections.held_bytes, bytes, of_process) {
            self.connection.held_bytes.fetch_sub(bytes, Ordering::Relaxed);
            connections.relieve(bytes);
            return false;
        }
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
        connections.metrics.held(bytes, 0);
        true
    }

    /// Like [`Lease::grow`], after giving others a moment to release theirs.
    pub(in crate::api) async fn grow_soon(&self, bytes: usize) -> bool {
        let end = Instant::now() + RELEASE_WAIT;
        loop {
            let released = self.connection.connections.released.notified();
            tokio::pin!(released);
            // Registered before the attempt, so that no release in between is missed.
            released.as_mut().enable();
            if self.grow(bytes) {
                return true;
            }
            if timeout_at(end, released).await.is_err() {
                return false;
            }
        }
    }

    /// Holds exactly so many bytes from now on. Work that is done is not thrown away: beyond the budget, the connection
    /// that leaves most unread is ended for it.
    pub(in crate::api) fn settle(&self, bytes: usize) {
        let before = self.bytes.swap(bytes, Ordering::Relaxed);
        if bytes == before {
            return;
        }
        let connections = &self.connection.connections;
        for held in [&self.connection.held_bytes, &connections.held_bytes] {
            held.fetch_add(bytes, Ordering::Relaxed);
            held.fetch_sub(before, Ordering::Relaxed);
        }
        connections.metrics.held(bytes, before);
        if bytes < before {
            connections.released.notify_waiters();
        } else if connections.held_bytes.load(Ordering::Relaxed) > connections.memory_budget() {
            connections.relieve(0);
        }
    }

    /// Holds so many bytes less.
    pub(in crate::api) fn shrink(&self, bytes: usize) {
        self.settle(self.bytes.load(Ordering::Relaxed).saturating_sub(bytes));
    }

    /// The same bytes, which hold the lease until the last copy of them is dropped.
    pub(in crate::api) fn holding(self: &Arc<Self>, bytes: Bytes) -> Bytes {
        Bytes::from_owner(Held { bytes, _lease: Arc::clone(self) })
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.settle(0);
    }
}

struct Held {
    bytes: Bytes,
    _lease: Arc<Lease>,
}

impl AsRef<[u8]> for Held {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

fn added(held: &AtomicUsize, bytes: usize, limit: usize) -> bool {
    let add = |held: usize| held.checked_add(bytes).filter(|&sum| sum <= limit);
    held.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add).is_ok()
}
