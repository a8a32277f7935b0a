//! The byte budget: what bodies being received and answers not yet taken may hold, reserved before the memory is.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use axum::body::Bytes;
use tokio::time::{Instant, timeout_at};

use super::connection::Connection;

/// A lease up to this size may use the whole share of requests: those as small as most get through while large ones have
/// used up theirs.
const SMALL_BYTES: usize = 16 * 1024;
/// How long a request waits for memory that others are about to release.
const RELEASE_WAIT: Duration = Duration::from_millis(100);

/// Says of an answer that its bytes are in memory anyway, once for all who ask: nothing is reserved for them.
#[derive(Debug, Clone, Copy)]
pub(in crate::api) struct Shared;

/// What memory is held for. Each has a share of its own: what waits for memory must not hold what it waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::api) enum Purpose {
    /// Requests under way, their bodies and their answers: three quarters of the budget.
    Requests,
    /// Items of batches that were not begun: a quarter.
    ReadAhead,
}

/// What is held for each purpose, by one connection or by all.
#[derive(Debug, Default)]
pub(super) struct Held {
    requests: AtomicUsize,
    read_ahead: AtomicUsize,
}

impl Held {
    fn of(&self, purpose: Purpose) -> &AtomicUsize {
        match purpose {
            Purpose::Requests => &self.requests,
            Purpose::ReadAhead => &self.read_ahead,
        }
    }

    /// For all purposes.
    pub(super) fn total(&self) -> usize {
        self.requests.load(Ordering::Relaxed) + self.read_ahead.load(Ordering::Relaxed)
    }
}

/// How much of its share a lease may use up to the brim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ceiling {
    /// All for small leases, three quarters for large ones.
    BySize,
    /// Half, for items of batches and for readers without a key: the rest is left to single callers.
    Half,
}

/// Memory that is reserved for one request; released on drop.
#[derive(Debug)]
pub(in crate::api) struct Lease {
    connection: Arc<Connection>,
    purpose: Purpose,
    bytes: AtomicUsize,
}

impl Lease {
    /// Nothing so far.
    pub(in crate::api) fn empty(connection: &Arc<Connection>, purpose: Purpose) -> Self {
        Self { connection: Arc::clone(connection), purpose, bytes: AtomicUsize::new(0) }
    }

    /// Reserves more; false, and nothing changes, where the share of the connection or of the process is used up.
    pub(super) fn grow(&self, ceiling: Ceiling, bytes: usize) -> bool {
        let connections = &self.connection.connections;
        let share = connections.share(self.purpose);
        let is_small = self.bytes.load(Ordering::Relaxed) + bytes <= SMALL_BYTES;
        let limit = match (self.purpose, ceiling) {
            (Purpose::ReadAhead, _) => share,
            (Purpose::Requests, Ceiling::BySize) if is_small => share,
            (Purpose::Requests, Ceiling::BySize) => share / 4 * 3,
            (Purpose::Requests, Ceiling::Half) => share / 2,
        };
        let [of_connection, of_process] = [&self.connection.held, &connections.held].map(|held| held.of(self.purpose));
        if !added(of_connection, bytes, share / 4) {
            return false;
        }
        if !added(of_process, bytes, limit) {
            of_connection.fetch_sub(bytes, Ordering::Relaxed);
            connections.relieve((of_process.load(Ordering::Relaxed) + bytes).saturating_sub(limit));
            return false;
        }
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
        connections.metrics.held_changed(signed(bytes));
        true
    }

    /// Reserves for an item of a batch, after as long a wait as it takes; false where one connection never has so much as the answer
    /// needs. What the item holds beside it counts as far as that fits.
    pub(super) async fn grow_at_last(&self, answer_bytes: usize, item_bytes: usize) -> bool {
        let connections = &self.connection.connections;
        let most = connections.share(self.purpose) / 4;
        if answer_bytes > most {
            return false;
        }
        let bytes = answer_bytes.saturating_add(item_bytes).min(most);
        loop {
            let released = connections.released.notified();
            tokio::pin!(released);
            released.as_mut().enable();
            if self.grow(Ceiling::Half, bytes) {
                return true;
            }
            released.await;
        }
    }

    /// Like [`Lease::grow`], after giving others a moment to release theirs.
    pub(in crate::api) async fn grow_soon(&self, bytes: usize) -> bool {
        let end = Instant::now() + RELEASE_WAIT;
        loop {
            let released = self.connection.connections.released.notified();
            tokio::pin!(released);
            // Registered before the attempt, so that no release in between is missed.
            released.as_mut().enable();
            if self.grow(Ceiling::BySize, bytes) {
                return true;
            }
            if timeout_at(end, released).await.is_err() {
                return false;
            }
        }
    }

    /// Holds exactly so many bytes from now on; nobody grows the lease meanwhile. Work that is done is not thrown away:
    /// beyond the budget, the connection that leaves most unread is ended for it.
    pub(in crate::api) fn settle(&self, bytes: usize) {
        let before = self.bytes.load(Ordering::Relaxed);
        if bytes <= before {
            self.shrink(before - bytes);
            return;
        }
        let connections = &self.connection.connections;
        for held in [&self.bytes, self.connection.held.of(self.purpose), connections.held.of(self.purpose)] {
            held.fetch_add(bytes - before, Ordering::Relaxed);
        }
        connections.metrics.held_changed(signed(bytes - before));
        let held = connections.held.of(self.purpose).load(Ordering::Relaxed);
        connections.relieve(held.saturating_sub(connections.share(self.purpose)));
    }

    /// Holds so many bytes less.
    pub(in crate::api) fn shrink(&self, bytes: usize) {
        if bytes == 0 {
            return;
        }
        let connections = &self.connection.connections;
        for held in [&self.bytes, self.connection.held.of(self.purpose), connections.held.of(self.purpose)] {
            held.fetch_sub(bytes, Ordering::Relaxed);
        }
        connections.metrics.held_changed(-signed(bytes));
        connections.released.notify_waiters();
    }

    /// The same bytes, which hold the lease until the last copy of them is dropped.
    pub(in crate::api) fn holding(self: &Arc<Self>, bytes: Bytes) -> Bytes {
        Bytes::from_owner(LeasedBytes { bytes, _lease: Arc::clone(self) })
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.shrink(self.bytes.load(Ordering::Relaxed));
    }
}

struct LeasedBytes {
    bytes: Bytes,
    _lease: Arc<Lease>,
}

impl AsRef<[u8]> for LeasedBytes {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

fn signed(bytes: usize) -> i64 {
    i64::try_from(bytes).unwrap_or(i64::MAX)
}

fn added(held: &AtomicUsize, bytes: usize, limit: usize) -> bool {
    let add = |held: usize| held.checked_add(bytes).filter(|&sum| sum <= limit);
    held.fetch_update(Ordering::Relaxed, Ordering::Relaxed, add).is_ok()
}
