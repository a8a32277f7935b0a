//! The open connections of a server: who gets a place, who is ended when places or memory run out, and how all end.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::time::{Instant, sleep};

use super::ServerSettings;
use super::connection::{Connection, Served, TENURE, Use, Worth};
use super::memory::{Held, Purpose};
use crate::api::auth::ApiKeys;
use crate::api::{ApiSettings, ApiState, Probes};
use crate::metrics::{ConnectionEnd, Metrics};

/// Places that are kept for probes where they have no port of their own: those of a balancer, an orchestrator, a scraper
/// and a few people.
pub const PROBE_PLACES: usize = 16;
/// How often a newcomer looks for a place meanwhile.
const LOOK_INTERVAL: Duration = Duration::from_millis(5);
/// Who has kept the server waiting for less is not ended for its memory: a healthy peer takes its answer in this time.
const LEAST_WAIT: Duration = Duration::from_millis(100);

/// How often somebody is ended for memory: it takes a moment until that is released.
const RELIEF_INTERVAL: Duration = Duration::from_millis(10);

/// How far the end of the server has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    Serving,
    /// Announced: connections of HTTP/1 close after their answer.
    Leaving,
    /// No more work is taken: connections end as soon as their requests have.
    Closing,
}

/// Why there is no place for a newcomer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum NoRoom {
    /// The least used connection has come so lately that it may not have asked yet: it will make room.
    NotYet,
    /// All are at work for callers.
    AllWork,
}

/// All open connections of a server, on whatever port.
#[derive(Debug)]
pub struct Connections {
    pub(super) settings: ServerSettings,
    /// Requests without one of these are those of guests.
    pub(super) keys: ApiKeys,
    /// How many of the last places serve probes only.
    probe_places: usize,
    pub(super) held: Held,
    /// Memory was released.
    pub(super) released: Notify,
    open: Mutex<Open>,
    phase: watch::Sender<Phase>,
    pub(super) metrics: Arc<Metrics>,
}

#[derive(Debug, Default)]
struct Open {
    next_number: u64,
    connections: BTreeMap<u64, Arc<Connection>>,
    /// Those that are gone, until the last of their requests has released its memory.
    leaving: Vec<Arc<Connection>>,
    last_relief: Option<Instant>,
}

impl Connections {
    /// None so far; those of all ports that serve this API.
    pub fn of(state: &ApiState, settings: ServerSettings) -> Arc<Self> {
        let ApiSettings { keys, probes, .. } = &*state.settings;
        let probe_places = if *probes == Probes::WithApi { PROBE_PLACES } else { 0 };
        Self::new(settings, keys.clone(), probe_places, Arc::clone(state.service.metrics()))
    }

    fn new(settings: ServerSettings, keys: ApiKeys, probe_places: usize, metrics: Arc<Metrics>) -> Arc<Self> {
        Arc::new(Self {
            settings,
            keys,
            probe_places,
            held: Held::default(),
            released: Notify::new(),
            open: Mutex::default(),
            phase: watch::Sender::new(Phase::Serving),
            metrics,
        })
    }

    /// A connection of a server of its own, for requests that come without one.
    pub(in crate::api) fn detached() -> Arc<Connection> {
        let connections = Self::new(ServerSettings::default(), ApiKeys::default(), 0, Arc::default());
        let nobody = SocketAddr::new(IpAddr::V6(Ipv6Addr::UNSPECIFIED), 0);
        Arc::new(Connection::new(connections, nobody, Use::All))
    }

    /// The part of the budget that may be held for this purpose; one connection has a quarter of it.
    pub(super) fn share(&self, purpose: Purpose) -> usize {
        let quarter = self.settings.memory_budget_bytes / 4;
        match purpose {
            Purpose::Requests => 3 * quarter,
            Purpose::ReadAhead => quarter,
        }
    }

    fn open(&self) -> MutexGuard<'_, Open> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a new connection. Where all are taken, the least used connection of the largest holder makes room, as
    /// soon as it had the time to ask; none when those are all at work for a caller, or this peer has too many.
    pub(super) async fn admit(self: &Arc<Self>, peer: SocketAddr) -> Option<Place> {
        let end = Instant::now() + TENURE;
        while self.may_have_more(peer) {
            match self.place(peer) {
                Ok(place) => return Some(place),
                Err(NoRoom::AllWork) if Instant::now() >= end => break,
                Err(_) => sleep(LOOK_INTERVAL).await,
            }
        }
        self.metrics.connection_ended(ConnectionEnd::NoPlace);
        None
    }

    fn may_have_more(&self, peer: SocketAddr) -> bool {
        let limit = self.settings.max_connections_per_address;
        limit.is_none_or(|limit| self.open().of_holder(Holder::of(peer)) < limit)
    }

    fn place(self: &Arc<Self>, peer: SocketAddr) -> Result<Place, NoRoom> {
        let mut open = self.open();
        let may = self.make_room(&open)?;
        let connection = Arc::new(Connection::new(Arc::clone(self), peer, may));
        let number = open.next_number;
        open.next_number += 1;
        open.connections.insert(number, Arc::clone(&connection));
        self.metrics.connection_opened();
        Ok(Place { connection, number })
    }

    /// What a new connection may be used for.
    fn make_room(&self, open: &Open) -> Result<Use, NoRoom> {
        let for_all = self.settings.max_connections.saturating_sub(self.probe_places);
        for (may, places) in [(Use::All, for_all), (Use::Probes, self.probe_places)] {
            if open.alive().filter(|connection| connection.may == may).count() < places {
                return Ok(may);
            }
            if let Some((worth, least_used)) = open.least_used(may) {
                // Probes are short: they need no protection from each other.
                if worth.is_new && may == Use::All {
                    return Err(NoRoom::NotYet);
                }
                self.end(least_used, ConnectionEnd::NoPlace);
                return Ok(may);
            }
        }
        Err(NoRoom::AllWork)
    }

    /// Ends the connection that leaves most unread for longest, unless as many bytes as are too many are about to be
    /// released.
    pub(super) fn relieve(&self, excess_bytes: usize) {
        if excess_bytes == 0 {
            return;
        }
        let mut open = self.open();
        if open.last_relief.is_some_and(|last| last.elapsed() < RELIEF_INTERVAL) {
            return;
        }
        open.last_relief = Some(Instant::now());
        let held = |connection: &Arc<Connection>| connection.held.total();
        open.forget_released();
        let ended = open.connections.values().filter(|connection| connection.is_ended());
        let leaving: usize = ended.chain(&open.leaving).map(held).sum();
        if excess_bytes <= leaving {
            return;
        }
        // Who holds less than the others is not the cause.
        let mean = open.alive().map(held).sum::<usize>() / open.alive().count().max(1);
        let unread = |connection: &Arc<Connection>| {
            let (held, wait) = (held(connection), connection.longest_wait());
            (held >= mean && wait >= LEAST_WAIT).then(|| held as u128 * wait.as_millis())
        };
        let candidates = open.alive().filter_map(|connection| Some((unread(connection)?, connection)));
        if let Some((_, worst)) = candidates.max_by_key(|(unread, _)| *unread) {
            self.end(worst, ConnectionEnd::Unread);
        }
    }

    fn end(&self, connection: &Connection, cause: ConnectionEnd) {
        tracing::debug!(peer.address = %connection.peer, connection.end = cause.as_str(), "a connection is ended");
        self.metrics.connection_ended(cause);
        connection.end();
    }

    /// Asks the peers to go elsewhere: what they ask meanwhile is still answered.
    pub fn announce_end(&self) {
        self.phase.send_if_modified(|phase| raise(phase, Phase::Leaving));
    }

    /// Lets connections end with their last answer: HTTP/2 is told by GOAWAY at once.
    pub fn close(&self) {
        self.phase.send_if_modified(|phase| raise(phase, Phase::Closing));
    }

    /// Whether the end was announced.
    pub(super) fn is_leaving(&self) -> bool {
        *self.phase.borrow() >= Phase::Leaving
    }

    /// Whether no more work is taken.
    pub(super) fn is_closing(&self) -> bool {
        *self.phase.borrow() >= Phase::Closing
    }

    /// Waits until no more work is taken.
    pub(super) async fn closing(&self) {
        // The sender lives as long as this.
        let _ = self.phase.subscribe().wait_for(|phase| *phase >= Phase::Closing).await;
    }
}

fn raise(phase: &mut Phase, to: Phase) -> bool {
    let is_new = *phase < to;
    *phase = to.max(*phase);
    is_new
}

impl Open {
    /// The connections that were not ended from outside.
    fn alive(&self) -> impl Iterator<Item = &Arc<Connection>> {
        self.connections.values().filter(|connection| !connection.is_ended())
    }

    fn forget_released(&mut self) {
        self.leaving.retain(|connection| connection.held.total() > 0);
    }

    fn of_holder(&self, holder: Holder) -> usize {
        self.alive().filter(|connection| Holder::of(connection.peer) == holder).count()
    }

    /// The least used connection of the largest holder that has any without work for a caller; first those of holders
    /// that have one which never worked for any.
    fn least_used(&self, may: Use) -> Option<(Worth, &Arc<Connection>)> {
        let mut holders = BTreeMap::<Holder, (usize, Option<_>)>::new();
        for connection in self.alive().filter(|connection| connection.may == may) {
            let (count, least) = holders.entry(Holder::of(connection.peer)).or_default();
            *count += 1;
            if let Some(worth) = connection.worth()
                && least.as_ref().is_none_or(|(least, _)| worth < *least)
            {
                *least = Some((worth, connection));
            }
        }
        let candidates = holders.into_values().filter_map(|(count, least)| Some((count, least?)));
        candidates.max_by_key(|(count, (worth, _))| (worth.served < Served::Callers, *count)).map(|(_, least)| least)
    }
}

/// Whose connections count together: an address, or the smallest network of version 6 that a site is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Holder(IpAddr);

impl Holder {
    fn of(peer: SocketAddr) -> Self {
        Self(match peer.ip().to_canonical() {
            IpAddr::V6(address) => IpAddr::V6((address.to_bits() >> 64 << 64).into()),
            address @ IpAddr::V4(_) => address,
        })
    }
}

/// The place of one connection; free again on drop.
#[derive(Debug)]
pub(super) struct Place {
    pub(super) connection: Arc<Connection>,
    number: u64,
}

impl Drop for Place {
    fn drop(&mut self) {
        let connections = &self.connection.connections;
        let mut open = connections.open();
        let connection = open.connections.remove(&self.number);
        open.leaving.extend(connection);
        open.forget_released();
        drop(open);
        connections.metrics.connection_closed();
    }
}

#[cfg(test)]
mod tests {
    use super::super::connection::Standing;
    use super::super::memory::{Ceiling, Lease};
    use super::*;

    fn connections(max_connections: usize, probe_places: usize) -> Arc<Connections> {
        with_settings(ServerSettings { max_connections, ..ServerSettings::default() }, probe_places)
    }

    fn with_settings(settings: ServerSettings, probe_places: usize) -> Arc<Connections> {
        Connections::new(settings, ApiKeys::default(), probe_places, Arc::default())
    }

    fn peer(last: u8) -> SocketAddr {
        SocketAddr::from(([10, 0, 0, last], 1))
    }

    /// A connection that was admitted and looked at.
    async fn admitted(connections: &Arc<Connections>, last: u8) -> Place {
        let place = connections.admit(peer(last)).await.unwrap();
        place.connection.arrive();
        place
    }

    fn lease(connection: &Arc<Connection>, bytes: usize) -> Option<Lease> {
        let lease = Lease::empty(connection, Purpose::Requests);
        lease.grow(Ceiling::BySize, bytes).then_some(lease)
    }

    #[tokio::test(start_paused = true)]
    async fn newcomer_replaces_the_least_used_of_the_largest_holder() {
        let connections = connections(3, 0);
        let _small = admitted(&connections, 1).await;
        let places = [admitted(&connections, 2).await, admitted(&connections, 2).await];
        drop(places[0].connection.enter(Standing::Caller));
        let begin = Instant::now();
        let newcomer = admitted(&connections, 3).await;
        assert!(begin.elapsed() >= TENURE, "the others had time to ask");
        assert_eq!(newcomer.connection.may, Use::All);
        assert!(places[1].connection.is_ended() && !places[0].connection.is_ended());
    }

    #[tokio::test(start_paused = true)]
    async fn newcomer_waits_for_who_is_looked_at_late() {
        let connections = connections(1, 0);
        let place = connections.admit(peer(1)).await.unwrap();
        let late = async {
            sleep(TENURE / 2).await;
            place.connection.arrive();
        };
        let (newcomer, ()) = tokio::join!(connections.admit(peer(2)), late);
        assert!(newcomer.is_some() && place.connection.is_ended());
    }

    #[tokio::test(start_paused = true)]
    async fn work_for_a_caller_is_not_ended_and_probes_have_places_left() {
        let connections = connections(PROBE_PLACES + 1, PROBE_PLACES);
        let busy = admitted(&connections, 1).await;
        let _under_way = busy.connection.enter(Standing::Caller);
        let mut probes = Vec::new();
        let mut refused = Vec::new();
        for _ in 0..=PROBE_PLACES {
            let probe = admitted(&connections, 1).await;
            // Callers who do not read why they are refused there do not keep them.
            refused.push(probe.connection.enter(Standing::Caller));
            probes.push(probe);
        }
        assert!(probes.iter().all(|place| place.connection.may == Use::Probes));
        assert!(probes[0].connection.is_ended(), "the first one makes room for the last");
        assert!(!busy.connection.is_ended());
    }

    #[tokio::test(start_paused = true)]
    async fn nobody_is_admitted_where_all_work_and_probes_are_apart() {
        let connections = connections(1, 0);
        let busy = admitted(&connections, 1).await;
        let under_way = busy.connection.enter(Standing::Caller);
        assert!(connections.admit(peer(2)).await.is_none());
        drop((under_way, busy));
        assert!(connections.admit(peer(2)).await.is_some());
    }

    #[tokio::test(start_paused = true)]
    async fn hard_limit_counts_the_places_of_one_address() {
        let settings = ServerSettings { max_connections_per_address: Some(1), ..ServerSettings::default() };
        let connections = with_settings(settings, 0);
        let _place = admitted(&connections, 1).await;
        assert!(connections.admit(peer(1)).await.is_none());
        assert!(connections.admit(peer(2)).await.is_some());
    }

    #[test]
    fn addresses_of_one_site_count_together() {
        let of = |text: &str| Holder::of(SocketAddr::new(text.parse().unwrap(), 1));
        assert_eq!(of("2001:db8::1"), of("2001:db8::ffff:1"));
        assert_ne!(of("2001:db8::1"), of("2001:db8:0:1::1"));
        assert_eq!(of("::ffff:10.0.0.1"), of("10.0.0.1"));
    }

    #[test]
    fn memory_of_who_is_gone_counts_until_it_is_released() {
        let connections = connections(3, 0);
        let place = connections.place(peer(1)).unwrap();
        let lease = lease(&place.connection, 1000);
        drop(place);
        assert_eq!((connections.open().leaving.len(), connections.held.total()), (1, 1000));
        drop(lease);
        drop(connections.place(peer(2)));
        assert_eq!((connections.open().leaving.len(), connections.held.total()), (0, 0));
    }

    #[tokio::test(start_paused = true)]
    async fn who_leaves_most_unread_is_ended_for_the_memory_of_others() {
        let settings = ServerSettings { memory_budget_bytes: 1 << 20, ..ServerSettings::default() };
        let connections = with_settings(settings, 0);
        let places = [1, 2, 3, 4].map(|last| connections.place(peer(last)).unwrap());
        let quarter = 3 << 16;
        let leases = places.each_ref().map(|place| lease(&place.connection, quarter));
        assert!(leases[2].is_some() && leases[3].is_none(), "three quarters are for large ones");
        assert!(places.iter().all(|place| !place.connection.is_ended()), "nobody has waited for them yet");
        let waits = [&places[1], &places[2]].map(|place| place.connection.wait(Duration::from_secs(30)));
        let [mut longer, mut shorter] = waits;
        longer.begin();
        tokio::time::advance(2 * LEAST_WAIT).await;
        shorter.begin();
        tokio::time::advance(LEAST_WAIT).await;
        assert!(lease(&places[3].connection, quarter).is_none(), "not yet released");
        let is_ended = places.each_ref().map(|place| place.connection.is_ended());
        assert_eq!(is_ended, [false, true, false, false]);
        assert!(lease(&places[3].connection, quarter).is_none());
        assert!(!places[2].connection.is_ended(), "enough is about to be released");
        drop((leases, longer));
        assert!(lease(&places[3].connection, quarter).is_some());
    }
}
