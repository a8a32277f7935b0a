//! What one connection does and holds: its requests, the memory that is reserved for it, and how long the server has
//! waited for its peer.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::http::Version;
use tokio::sync::Notify;
use tokio::time::Instant;

use super::connections::Connections;
use super::memory::{Held, Lease, Purpose};
use super::patience::Patience;

/// Length of the HTTP/2 preface, bytes: once as many have arrived the protocol is known, and hyper's own timers run.
const PREFACE_BYTES: u64 = 24;
/// Who comes has so much time to ask for something before others may take the place: where newcomers crowd, they wait.
pub(super) const TENURE: Duration = Duration::from_millis(100);
/// Requests of guests that one connection may have open at once: probes ask one by one, or a few together.
const MAX_GUESTS: usize = 4;
/// The same where they read the page: a browser asks for all of its files together.
const MAX_READERS: usize = 64;
/// What a request holds beside its body and its answer, bytes: its stream, its head, and the future of its handler.
pub(in crate::api) const REQUEST_BYTES: usize = 8 * 1024;

/// Who asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Standing {
    /// Somebody without a key, or a probe: few requests at a time.
    Guest,
    /// Somebody without a key who asks for the page or what it shows: as many requests as it has files.
    Reader,
    /// Somebody who may ask for work.
    Caller,
}

/// What a connection may be used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::api) enum Use {
    /// Everything.
    All,
    /// One of the last places, which are kept for probes.
    Probes,
}

/// One open connection.
#[derive(Debug)]
pub(in crate::api) struct Connection {
    pub(in crate::api) peer: SocketAddr,
    pub(in crate::api) may: Use,
    pub(super) connections: Arc<Connections>,
    pub(super) held: Held,
    /// Of the items of batches that are read and wait for memory.
    pub(in crate::api) turn: tokio::sync::Mutex<()>,
    bytes_read: AtomicU64,
    /// Whether a request came over HTTP/2.
    speaks_http2: AtomicBool,
    is_aged: AtomicBool,
    state: Mutex<State>,
    is_ended: AtomicBool,
    ended: Notify,
}

#[derive(Debug)]
struct State {
    /// Of the requests and waits so far.
    next_number: u64,
    requests: u64,
    guests: usize,
    callers: usize,
    served: Served,
    /// Whether it was looked at: on a busy machine some time after it was accepted.
    has_arrived: bool,
    last_used: Instant,
    /// For what the server waits at present.
    waits: BTreeMap<u64, Patience>,
}

/// For whom a connection has worked so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Served {
    Nobody,
    Guests,
    Callers,
}

/// How much a connection is worth keeping; the least is ended first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Worth {
    pub(super) served: Served,
    /// Whether the peer has come so lately that it may not have asked yet.
    pub(super) is_new: bool,
    has_spoken: bool,
    last_used: Instant,
}

impl Connection {
    /// Waits until the server takes no more work.
    pub(in crate::api) async fn closing(self: Arc<Self>) {
        self.connections.closing().await;
    }

    pub(super) fn new(connections: Arc<Connections>, peer: SocketAddr, may: Use) -> Self {
        let state = State {
            next_number: 0,
            requests: 0,
            guests: 0,
            callers: 0,
            served: Served::Nobody,
            has_arrived: false,
            last_used: Instant::now(),
            waits: BTreeMap::new(),
        };
        Self {
            peer,
            may,
            connections,
            held: Held::default(),
            turn: tokio::sync::Mutex::new(()),
            bytes_read: AtomicU64::new(0),
            speaks_http2: AtomicBool::new(false),
            is_aged: AtomicBool::new(false),
            state: Mutex::new(state),
            is_ended: AtomicBool::new(false),
            ended: Notify::new(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The server looks at the connection for the first time.
    pub(super) fn arrive(&self) {
        let mut state = self.state();
        state.has_arrived = true;
        state.last_used = Instant::now();
    }

    /// How many connections there may be beside this one and with it.
    pub(in crate::api) fn max_connections(&self) -> usize {
        self.connections.settings.max_connections
    }

    /// The protocol of a request.
    pub(super) fn speak(&self, version: Version) {
        self.speaks_http2.store(version == Version::HTTP_2, Ordering::Relaxed);
    }

    /// The connection is to take no new requests. Returns whether it can be told so now: over HTTP/1 only an answer can.
    pub(super) fn age(&self) -> bool {
        self.is_aged.store(true, Ordering::Relaxed);
        self.speaks_http2.load(Ordering::Relaxed)
    }

    pub(super) fn is_aged(&self) -> bool {
        self.is_aged.load(Ordering::Relaxed)
    }

    /// Counts bytes that arrived.
    pub(super) fn read(&self, bytes: usize) {
        self.bytes_read.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Whether the head of a request has arrived.
    pub(super) fn had_request(&self) -> bool {
        self.state().requests > 0
    }

    /// Whether enough bytes have arrived to know the protocol.
    pub(super) fn has_sent_preface(&self) -> bool {
        self.had_request() || self.bytes_read.load(Ordering::Relaxed) >= PREFACE_BYTES
    }

    /// Counts a request as under way until the result is dropped; none when the connection has too many of its kind.
    pub(super) fn enter(self: &Arc<Self>, standing: Standing) -> Option<UnderWay> {
        let mut state = self.state();
        state.last_used = Instant::now();
        state.requests += 1;
        match standing {
            Standing::Guest if state.guests >= MAX_GUESTS => return None,
            Standing::Reader if state.guests >= MAX_READERS => return None,
            Standing::Guest | Standing::Reader => {
                state.guests += 1;
                state.served = state.served.max(Served::Guests);
            }
            Standing::Caller => {
                state.callers += 1;
                state.served = Served::Callers;
            }
        }
        Some(UnderWay { connection: Arc::clone(self), standing })
    }

    /// Whether no request is under way and none came since `seen` was last set here.
    pub(super) fn is_idle_since(&self, seen: &mut u64) -> bool {
        let state = self.state();
        let before = std::mem::replace(seen, state.requests);
        *seen == before && state.callers + state.guests == 0
    }

    /// Whether a caller waits for an answer or takes one.
    pub(super) fn has_callers(&self) -> bool {
        self.state().callers > 0
    }

    /// What the connection is worth; none while a caller's request is under way, which those for probes refuse.
    pub(super) fn worth(&self) -> Option<Worth> {
        let state = self.state();
        let State { served, has_arrived, last_used, .. } = *state;
        let has_spoken = self.bytes_read.load(Ordering::Relaxed) > 0;
        let is_new = served == Served::Nobody && (!has_arrived || last_used.elapsed() < TENURE);
        (state.callers == 0 || self.may == Use::Probes).then_some(Worth { served, is_new, has_spoken, last_used })
    }

    /// Prepares a wait for the peer, who has `full` time for it in all.
    pub(in crate::api) fn wait(self: &Arc<Self>, full: Duration) -> Wait {
        let mut state = self.state();
        let number = state.next_number;
        state.next_number += 1;
        Wait { connection: Arc::clone(self), number, patience: Patience::new(full) }
    }

    /// Whether the peer has used up its time for anything.
    pub(super) fn is_out_of_patience(&self) -> bool {
        let now = Instant::now();
        self.state().waits.values().filter_map(Patience::until).any(|until| until <= now)
    }

    /// The longest time that the peer has kept the server waiting for one of its requests.
    pub(super) fn longest_wait(&self) -> Duration {
        self.state().waits.values().filter_map(Patience::spent).max().unwrap_or_default()
    }

    /// Ends the connection at once.
    pub(super) fn end(&self) {
        self.is_ended.store(true, Ordering::Release);
        self.ended.notify_one();
    }

    /// Whether the connection is about to be gone.
    pub(super) fn is_ended(&self) -> bool {
        self.is_ended.load(Ordering::Acquire)
    }

    /// Waits until the connection is ended from outside.
    pub(super) async fn ended(&self) {
        self.ended.notified().await;
    }

    /// Reserves memory for a request of this connection, after giving others a moment to release theirs; none when the
    /// budget is used up.
    pub(in crate::api) async fn lease_soon(self: &Arc<Self>, bytes: usize) -> Option<Lease> {
        let lease = Lease::empty(self, Purpose::Requests);
        lease.grow_soon(bytes).await.then_some(lease)
    }

    /// Reserves memory for the answer to an item of a batch and for the item, after as long a wait as it takes; none where that is for
    /// ever.
    pub(in crate::api) async fn lease_at_last(
        self: &Arc<Self>,
        answer_bytes: usize,
        item_bytes: usize,
    ) -> Option<Lease> {
        let lease = Lease::empty(self, Purpose::Requests);
        lease.grow_at_last(answer_bytes, item_bytes).await.then_some(lease)
    }
}

/// A request under way.
#[derive(Debug)]
pub(super) struct UnderWay {
    connection: Arc<Connection>,
    pub(super) standing: Standing,
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        let mut state = self.connection.state();
        state.last_used = Instant::now();
        match self.standing {
            Standing::Guest | Standing::Reader => state.guests -= 1,
            Standing::Caller => state.callers -= 1,
        }
    }
}

/// What the server waits for, from time to time: the rest of a body, or that an answer is taken.
#[derive(Debug)]
pub(in crate::api) struct Wait {
    connection: Arc<Connection>,
    number: u64,
    patience: Patience,
}

impl Wait {
    /// The same, from now on.
    pub(in crate::api) fn begun(mut self) -> Self {
        self.begin();
        self
    }

    /// The server waits from now on.
    pub(super) fn begin(&mut self) {
        self.patience.begin();
        self.connection.state().waits.insert(self.number, self.patience);
    }

    /// The wait is over, and the peer has taken so many bytes: any delay from now on is the server's own.
    pub(super) fn end(&mut self, bytes: usize) {
        let was_waiting = self.patience.spent().is_some();
        self.patience.end(bytes);
        if was_waiting {
            self.connection.state().waits.remove(&self.number);
        }
    }

    /// When the peer's time runs out, while the server waits.
    pub(super) fn until(&self) -> Option<Instant> {
        self.patience.until()
    }
}

impl Drop for Wait {
    fn drop(&mut self) {
        self.end(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn connection() -> Arc<Connection> {
        Connections::detached()
    }

    #[test]
    fn connection_is_idle_without_requests_old_and_new() {
        let connection = connection();
        let mut seen = 0;
        let under_way = connection.enter(Standing::Caller);
        assert!(!connection.is_idle_since(&mut seen), "one came");
        assert!(!connection.is_idle_since(&mut seen), "it is under way");
        drop(under_way);
        assert!(connection.is_idle_since(&mut seen));
    }

    #[test]
    fn guests_ask_for_little_at_a_time() {
        let connection = connection();
        let guests: Vec<_> = (0..MAX_GUESTS).filter_map(|_| connection.enter(Standing::Guest)).collect();
        assert_eq!(guests.len(), MAX_GUESTS);
        assert!(connection.enter(Standing::Guest).is_none());
        assert!(connection.enter(Standing::Caller).is_some(), "callers are not held back by them");
        let readers: Vec<_> = (0..MAX_READERS).filter_map(|_| connection.enter(Standing::Reader)).collect();
        assert_eq!(guests.len() + readers.len(), MAX_READERS, "all without a key count together");
        drop((guests, readers));
        assert!(connection.enter(Standing::Guest).is_some());
    }

    #[tokio::test(start_paused = true)]
    async fn answer_is_unread_from_one_part_to_the_next() {
        let (connection, full) = (connection(), Duration::from_secs(1));
        let mut wait = connection.wait(full);
        wait.begin();
        tokio::time::advance(full / 2).await;
        assert!(!connection.is_out_of_patience());
        tokio::time::advance(full / 2).await;
        assert!(connection.is_out_of_patience());
        wait.end(usize::MAX);
        assert!(!connection.is_out_of_patience(), "the server takes its time to make the next part");
        wait.begin();
        drop(wait);
        tokio::time::advance(2 * full).await;
        assert!(!connection.is_out_of_patience(), "it is over");
    }
}
