//! Accepts connections, bounds their number, age and memory, applies timeouts to them, and ends them gracefully.
//!
//! `axum::serve` keeps connections with half-sent heads and without requests open for ever, so each connection is
//! driven here: HTTP/1 and HTTP/2 on the same port, distinguished by their first bytes.

use std::collections::hash_map::RandomState;
use std::error::Error;
use std::hash::BuildHasher as _;
use std::io;
use std::iter;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior, interval, interval_at, sleep};

mod answer_body;
mod connection;
mod connections;
mod memory;
mod metered_stream;
mod patience;
mod requests;
#[cfg(feature = "tls")]
pub mod tls;

use crate::metrics::ConnectionEnd;
pub(super) use connection::{Connection, REQUEST_BYTES, Use};
use connections::Place;
pub use connections::{Connections, PROBE_PLACES};
pub(super) use memory::{Lease, Purpose, Shared};
use metered_stream::MeteredStream;
pub(super) use requests::PAGE_FOLDER;
#[cfg(test)]
pub(super) use requests::is_for_readers;

/// Limits and timeouts of a server's connections.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerSettings {
    /// Connections that may be open at once, on all ports together; a newcomer replaces the least used of the largest
    /// holder.
    pub max_connections: usize,
    /// Connections of one address that may be open at once, where there is no proxy before the server.
    pub max_connections_per_address: Option<usize>,
    /// What requests, bodies being received, answers not yet taken and items of batches may hold, bytes; one connection a
    /// quarter at most.
    pub memory_budget_bytes: usize,
    /// Requests of one HTTP/2 connection that may be open at once.
    pub max_streams: u32,
    /// How long a caller may take to send the head of a request, counted from the connection or from the end of the
    /// request before (HTTP/1), and for the TLS handshake before that.
    pub head_timeout: Duration,
    /// How long a caller may leave an answer unread, beside the time that its bytes take at the least rate; an HTTP/2
    /// connection then takes no new requests, and is cut after the same time again.
    pub write_timeout: Duration,
    /// How often an HTTP/2 connection without traffic is pinged, and how long the reply may take.
    pub ping_interval: Duration,
    /// How long an HTTP/2 connection may stay without a request.
    pub idle_timeout: Duration,
    /// Age at which a connection takes no new requests, so that load spreads over replicas; a tenth more or less, so that
    /// those who came together do not leave together.
    pub max_age: Duration,
    /// How often an aged connection is looked after: it ends once no caller's request is under way.
    pub age_grace: Duration,
    /// Certificate and key of the server; with them it speaks TLS only, without them plain text only.
    #[cfg(feature = "tls")]
    pub identity: Option<tls::Identity>,
}

impl Default for ServerSettings {
    fn default() -> Self {
        Self {
            max_connections: 512,
            max_connections_per_address: None,
            memory_budget_bytes: 64 << 20,
            max_streams: 128,
            head_timeout: Duration::from_secs(10),
            write_timeout: Duration::from_secs(30),
            ping_interval: Duration::from_secs(20),
            idle_timeout: Duration::from_secs(5 * 60),
            max_age: Duration::from_secs(30 * 60),
            age_grace: Duration::from_secs(2 * 60),
            #[cfg(feature = "tls")]
            identity: None,
        }
    }
}

/// What the process holds at rest, bytes: measured 10 MiB, and as much again.
const BASE_BYTES: usize = 20 << 20;
/// What a worker holds of the largest job and its answer while it is written, bytes.
const WORKER_BYTES: usize = 16 << 20;
/// What a connection holds at most outside the budget, bytes: a head of [`HEAD_BYTES`] in a buffer that has doubled, or the
/// buffers and tables of h2 with the requests of guests; the records of TLS; and what the system's allocator loses.
const CONNECTION_BYTES: usize = 128 * 1024;

impl ServerSettings {
    /// What the process may hold at most under these settings, bytes.
    pub fn memory_bound_bytes(&self, workers: usize) -> usize {
        let of_connections = self.max_connections.saturating_mul(CONNECTION_BYTES);
        let of_workers = workers.saturating_mul(WORKER_BYTES);
        [self.memory_budget_bytes, of_connections, of_workers].into_iter().fold(BASE_BYTES, usize::saturating_add)
    }
}

/// Flow-control window of one HTTP/2 stream for requests, bytes.
pub(super) const STREAM_WINDOW_BYTES: u32 = 64 * 1024;
/// Flow-control window of a whole connection for requests, bytes. All that arrives is read at once, into the budget; half of
/// this is what h2 allows small frames to cost until they are read, which one turn of reading stays below.
const CONNECTION_WINDOW_BYTES: u32 = 512 * 1024;
/// Longest head of a request, bytes; also what a connection buffers of its answers over HTTP/1.
const HEAD_BYTES: u32 = 32 * 1024;
/// What one stream of HTTP/2 buffers of its answer, bytes.
const SEND_BUFFER_BYTES: usize = 64 * 1024;

/// How long to wait after the system refused a connection because too many files are open, until some are closed.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);
/// How long a connection may last that comes while the server ends: a probe.
const LAST_PROBE_TIMEOUT: Duration = Duration::from_secs(5);

/// Serves until `shutdown` is ready, then closes the listener, shuts the connections down gracefully, and returns when
/// the last answer is written.
pub async fn serve(
    listener: TcpListener,
    router: Router,
    connections: Arc<Connections>,
    shutdown: impl Future<Output = ()> + Send,
) {
    let mut tasks = JoinSet::new();
    tokio::pin!(shutdown);
    loop {
        tokio::select! {
            () = &mut shutdown => break,
            // Removes connections that have ended, which the set would keep otherwise.
            Some(_) = tasks.join_next(), if !tasks.is_empty() => {}
            accepted = listener.accept() => match accepted {
                Ok((stream, peer)) => {
                    if let Some(place) = connections.admit(peer).await {
                        tasks.spawn(receive(stream, router.clone(), place));
                    }
                }
                Err(error) => pause_after(&error).await,
            },
        }
    }
    drop(listener);
    connections.close();
    while tasks.join_next().await.is_some() {}
}

async fn pause_after(error: &io::Error) {
    let is_of_one_connection = matches!(
        error.kind(),
        io::ErrorKind::ConnectionAborted | io::ErrorKind::ConnectionReset | io::ErrorKind::ConnectionRefused
    );
    if !is_of_one_connection {
        tracing::error!(error = %error, "a connection cannot be accepted");
        sleep(ACCEPT_PAUSE).await;
    }
}

/// Receives one connection, plain or under TLS.
async fn receive(stream: TcpStream, router: Router, place: Place) {
    // Answers are written in one piece: Nagle's wait for more to send only adds delay.
    if let Err(error) = stream.set_nodelay(true) {
        tracing::debug!(error = %error, "a connection keeps its send delay");
    }
    let connection = &place.connection;
    connection.arrive();
    #[cfg(feature = "tls")]
    if let Some(identity) = &connection.connections.settings.identity {
        let shaken = tokio::select! {
            shaken = identity.shake_hands(stream) => shaken,
            () = sleep(connection.connections.settings.head_timeout) => {
                slow(connection);
                None
            }
            () = connection.connections.closing() => None,
            () = connection.ended() => None,
        };
        if let Some(stream) = shaken {
            drive(stream, router, connection).await;
        }
        return;
    }
    drive(stream, router, connection).await;
}

/// Drives one connection to its end.
async fn drive<S: AsyncRead + AsyncWrite + Unpin + Send + 'static>(
    stream: S,
    router: Router,
    connection: &Arc<Connection>,
) {
    let connections = &connection.connections;
    let settings = &connections.settings;
    let io = TokioIo::new(MeteredStream::new(stream, settings.write_timeout, Arc::clone(connection)));
    let builder = builder(settings);
    let served = builder.serve_connection(io, requests::service(router, Arc::clone(connection)));
    tokio::pin!(served);

    let is_late = connections.is_closing();
    let max_age = if is_late { LAST_PROBE_TIMEOUT } else { settings.max_age.mul_f64(jitter()) };
    let silent = sleep(settings.head_timeout);
    let aged = sleep(max_age);
    tokio::pin!(silent, aged);
    let mut expired = interval_at(Instant::now() + max_age + settings.age_grace, settings.age_grace);
    let mut idle = interval_at(Instant::now() + settings.idle_timeout, settings.idle_timeout);
    // Beside the patience of the stream: an answer that waits for the window of its HTTP/2 stream is not yet written.
    let mut unread = interval(settings.write_timeout / 4);
    unread.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut is_watched, mut is_ending, mut seen, mut unread_until) = (true, false, 0, None);
    loop {
        let must_end = tokio::select! {
            ended = &mut served => {
                if let Err(error) = ended {
                    tracing::debug!(error = %error, "a connection failed");
                    if is_slow(error.as_ref(), connection) {
                        slow(connection);
                    }
                }
                return;
            }
            () = connection.ended() => return,
            // Until the first bytes show which protocol it is, hyper runs no timer of its own.
            () = &mut silent, if is_watched => {
                if !connection.has_sent_preface() {
                    return slow(connection);
                }
                is_watched = false;
                false
            }
            () = connections.closing(), if !is_ending && !is_late => true,
            // Over HTTP/1 the next answer says so: a request may be on its way already.
            () = &mut aged, if !is_ending && !connection.is_aged() => connection.age(),
            _ = expired.tick() => {
                if !connection.has_callers() {
                    return;
                }
                true
            }
            _ = idle.tick() => connection.is_idle_since(&mut seen),
            now = unread.tick() => match unread_until {
                _ if !connection.is_out_of_patience() => {
                    unread_until = None;
                    false
                }
                None => {
                    unread_until = Some(now + settings.write_timeout);
                    true
                }
                Some(end) if now >= end => return slow(connection),
                Some(_) => false,
            },
        };
        if must_end && !is_ending {
            is_ending = true;
            served.as_mut().graceful_shutdown();
        }
    }
}

/// Whether the peer was waited for in vain: to read, or for the head of its first request. Between requests it may be silent.
fn is_slow(error: &(dyn Error + 'static), connection: &Connection) -> bool {
    let is_timed_out = |error: &io::Error| error.kind() == io::ErrorKind::TimedOut;
    iter::successors(Some(error), |&error| error.source()).any(|error| {
        error.downcast_ref().is_some_and(is_timed_out)
            || error.downcast_ref().and_then(h2::Error::get_io).is_some_and(is_timed_out)
            || error.downcast_ref().is_some_and(hyper::Error::is_timeout) && !connection.had_request()
    })
}

fn slow(connection: &Connection) {
    connection.connections.metrics.connection_ended(ConnectionEnd::Slow);
}

/// A factor from 0.9 to 1.1.
fn jitter() -> f64 {
    0.9 + 0.2 * (RandomState::new().hash_one(()) as f64 / u64::MAX as f64)
}

fn builder(settings: &ServerSettings) -> auto::Builder<TokioExecutor> {
    let mut builder = auto::Builder::new(TokioExecutor::new());
    builder
        .http1()
        .timer(TokioTimer::new())
        .header_read_timeout(settings.head_timeout)
        .max_buf_size(HEAD_BYTES as usize);
    builder
        .http2()
        .timer(TokioTimer::new())
        .keep_alive_interval(settings.ping_interval)
        .keep_alive_timeout(settings.ping_interval)
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .max_header_list_size(HEAD_BYTES)
        .max_send_buf_size(SEND_BUFFER_BYTES)
        .max_concurrent_streams(settings.max_streams);
    builder
}
