//! Receives a body within its limit, its time and the byte budget, the same for every transport.

use std::error::Error;
use std::future::poll_fn;
use std::io;
use std::iter;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use axum::http::Extensions;
use tokio::time::timeout;

use super::server::{Connection, Connections, Lease, Purpose};
use crate::contract::{BodyLimit, ErrorCode, Problem};

/// Room for a body at first, bytes, as part of what every request holds: most are no longer.
const FIRST_BYTES: usize = 2 * 1024;
/// When it is worth trying again after a lack of memory or places: those who do not read, or do not ask, make room at
/// once.
pub(super) const RETRY: Duration = Duration::from_secs(1);
/// Refused bodies are read on for this long, and up to [`MAX_DISCARDED_BYTES`]: a connection closed with unread bytes
/// is reset, and the caller never sees the refusal.
pub(super) const DISCARD_TIMEOUT: Duration = Duration::from_secs(1);
const MAX_DISCARDED_BYTES: usize = 16 * 1024 * 1024;

/// The connection that a request came by.
pub(super) fn connection_of(extensions: &Extensions) -> Arc<Connection> {
    extensions.get().cloned().unwrap_or_else(Connections::detached)
}

/// Its other end.
pub(super) fn peer_of(extensions: &Extensions) -> Option<SocketAddr> {
    extensions.get::<Arc<Connection>>().map(|connection| connection.peer)
}

/// The refusal of work on a connection that has one of the last places.
pub(super) fn only_probes() -> Problem {
    let detail = "all connections of this server are taken; the last ones serve probes only";
    Problem::new(ErrorCode::Unavailable, detail).worth_retrying_after(Some(RETRY))
}

/// The refusal for lack of memory.
pub(super) fn memory_full() -> Problem {
    let detail = "bodies and answers on their way hold all the memory of this connection or of the server";
    Problem::new(ErrorCode::MemoryFull, detail).worth_retrying_after(Some(RETRY))
}

/// A body that cannot be read: malformed where its chunks are, else its caller left.
fn unreadable(error: &axum::Error) -> Problem {
    let causes = iter::successors(error.source(), |&cause| cause.source());
    let mut kinds = causes.filter_map(|cause| cause.downcast_ref::<io::Error>()).map(io::Error::kind);
    if kinds.any(|kind| matches!(kind, io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData)) {
        Problem::new(ErrorCode::MalformedBody, format!("the body cannot be read: {error}"))
    } else {
        Problem::new(ErrorCode::Cancelled, format!("the body ended before it was complete: {error}"))
    }
}

/// A whole body, and the memory that is reserved for it; `head_bytes` of it come beside what `limit` counts.
///
/// # Errors
/// `body_too_large`, `body_timeout`, `memory_full`, `malformed_body`, or `cancelled` when it ends too early.
pub(super) async fn receive(
    body: &mut Body,
    (limit, head_bytes): (BodyLimit, usize),
    body_timeout: Duration,
    connection: &Arc<Connection>,
) -> Result<(Vec<u8>, Lease), Problem> {
    let _wait = connection.wait(body_timeout).begun();
    let received = timeout(body_timeout, read_within(body, (limit, head_bytes), connection)).await;
    received.unwrap_or_else(|_| Err(body_timed_out(body_timeout)))
}

/// The refusal of a body, or of a message of many, that takes too long.
pub(super) fn body_timed_out(after: Duration) -> Problem {
    Problem::new(ErrorCode::BodyTimeout, format!("the body was not complete after {after:?}"))
}

/// Reads on for a moment, so that the caller has sent all and sees the refusal. Whether the rest came in time or not,
/// that is the same.
pub(super) async fn discard(body: &mut Body) {
    let discarded = async {
        let mut discarded = 0;
        while let Some(Ok(chunk)) = next_chunk(body).await {
            discarded += chunk.len();
            if discarded > MAX_DISCARDED_BYTES {
                return;
            }
        }
    };
    let _ = timeout(DISCARD_TIMEOUT, discarded).await;
}

async fn read_within(
    body: &mut Body,
    (limit, head_bytes): (BodyLimit, usize),
    connection: &Arc<Connection>,
) -> Result<(Vec<u8>, Lease), Problem> {
    let most = limit.bytes + head_bytes;
    let lease = Lease::empty(connection, Purpose::Requests);
    let mut bytes = Vec::with_capacity(FIRST_BYTES);
    while let Some(chunk) = next_chunk(body).await {
        let chunk = chunk.map_err(|error| unreadable(&error))?;
        let length = bytes.len() + chunk.len();
        if length > most {
            return Err(Problem::body_too_large(limit));
        }
        let more = length.max(2 * bytes.len()).min(most).saturating_sub(bytes.capacity());
        if length > bytes.capacity() {
            if !lease.grow_soon(more).await {
                return Err(memory_full());
            }
            bytes.reserve_exact(bytes.capacity() + more - bytes.len());
        }
        bytes.extend_from_slice(&chunk);
    }
    Ok((bytes, lease))
}

/// The next bytes of the body; trailers count as no bytes.
pub(super) async fn next_chunk(body: &mut Body) -> Option<Result<Bytes, axum::Error>> {
    let frame = poll_fn(|context| Pin::new(&mut *body).poll_frame(context)).await?;
    Some(frame.map(|frame| frame.into_data().unwrap_or_default()))
}
