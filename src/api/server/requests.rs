//! What every request of a connection passes before the router: its place among the requests of the connection, and the
//! memory that it holds.

use std::error::Error;
use std::future::ready;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, HttpBody as _};
use axum::extract::Request;
use axum::http::header::CONNECTION;
use axum::http::{HeaderMap, HeaderValue, Version};
use axum::response::Response;
use futures_util::future::Either;
use hyper::body::Incoming;
use hyper::service::service_fn;
use tower::ServiceExt as _;

use super::answer_body::{AnswerBody, Answered};
use super::connection::{Connection, REQUEST_BYTES, Standing, UnderWay};
use super::memory::{Ceiling, Lease, Purpose, Shared};
use crate::api::open_line::OpenLine;

/// What everybody may ask: services for other purposes than work, and probes.
const FOR_GUESTS: [&str; 4] = ["/grpc.", "/livez", "/readyz", "/metrics"];
/// The page and what it shows, beside the files in its folder: what everybody may read.
const FOR_READERS: [&str; 4] = ["/", "/docs", "/limits", "/openapi.json"];
/// Where the files are served that the page loads.
pub(in crate::api) const PAGE_FOLDER: &str = "/page/";
/// Most fields of a head: hyper's own limit over HTTP/1.
const MAX_FIELDS: usize = 100;
/// What a field of a head holds beside its name and value, bytes: its place in the map, and two allocations.
const FIELD_BYTES: usize = 160;
/// Longest head of a guest with what it holds, bytes.
const MAX_GUEST_HEAD_BYTES: usize = 8 * 1024;

/// Answers the requests of one connection.
pub(super) fn service(
    router: Router,
    connection: Arc<Connection>,
) -> impl hyper::service::Service<
    Request<Incoming>,
    Response = Response,
    Error = Box<dyn Error + Send + Sync>,
    Future: Send + 'static,
> {
    service_fn(move |request| {
        connection.speak(request.version());
        let standing = standing(&connection, &request);
        let entered = if is_too_long(request.headers(), standing) { None } else { connection.enter(standing) };
        match entered {
            // Boxed, so that a refused stream holds next to nothing.
            Some(under_way) => {
                Either::Left(Box::pin(answer(router.clone(), Arc::clone(&connection), request, under_way)))
            }
            None => Either::Right(ready(Err(refused_stream().into()))),
        }
    })
}

async fn answer(
    router: Router,
    connection: Arc<Connection>,
    mut request: Request<Incoming>,
    under_way: UnderWay,
) -> Result<Response, Box<dyn Error + Send + Sync>> {
    let (version, method) = (request.version(), request.method().clone());
    let held = Lease::empty(&connection, Purpose::Requests);
    let bytes = REQUEST_BYTES + head_bytes(request.headers());
    match (under_way.standing, version) {
        // Their number bounds what they hold.
        (Standing::Guest, _) => {}
        // At once or not at all: a crowd without a key must not wait beside callers.
        (Standing::Reader, Version::HTTP_2) if held.grow(Ceiling::Half, bytes) => {}
        (Standing::Caller, Version::HTTP_2) if held.grow_soon(bytes).await => {}
        (Standing::Reader | Standing::Caller, Version::HTTP_2) => return Err(refused_stream().into()),
        // There is one at a time, and without an answer the connection would end.
        (Standing::Reader | Standing::Caller, _) => held.settle(bytes),
    }
    request.extensions_mut().insert(Arc::clone(&connection));
    let mut response = router.oneshot(request.map(Body::new)).await?;
    if version != Version::HTTP_2 && (connection.is_aged() || connection.connections.is_leaving()) {
        response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
    }
    let lease = response.extensions_mut().remove().unwrap_or_else(|| lease_of(&connection, &response));
    let wait = connection.wait(connection.connections.settings.write_timeout);
    let line = OpenLine::of(&mut response);
    let request = Answered { method, line, _under_way: under_way, _held: held };
    Ok(response.map(|body| Body::new(AnswerBody::new(body, wait, lease, request))))
}

/// Who asks: probes and requests without a key are those of guests, or of readers.
fn standing<B>(connection: &Connection, request: &Request<B>) -> Standing {
    let path = request.uri().path();
    if FOR_GUESTS.iter().any(|prefix| path.starts_with(prefix)) {
        Standing::Guest
    } else if connection.connections.keys.admit(request.headers()).is_some() {
        Standing::Caller
    } else if is_for_readers(path) {
        Standing::Reader
    } else {
        Standing::Guest
    }
}

/// Whether everybody may read what is at this path.
pub(in crate::api) fn is_for_readers(path: &str) -> bool {
    FOR_READERS.contains(&path) || path.starts_with(PAGE_FOLDER)
}

/// What a head holds, beside what every request does.
fn head_bytes(headers: &HeaderMap) -> usize {
    headers.iter().map(|(name, value)| name.as_str().len() + value.len() + FIELD_BYTES).sum()
}

fn is_too_long(headers: &HeaderMap, standing: Standing) -> bool {
    headers.len() > MAX_FIELDS || standing == Standing::Guest && head_bytes(headers) > MAX_GUEST_HEAD_BYTES
}

/// The lease of an answer that was not reserved before: what is known of its length.
fn lease_of(connection: &Arc<Connection>, response: &Response) -> Arc<Lease> {
    let lease = Lease::empty(connection, Purpose::Requests);
    if response.extensions().get::<Shared>().is_some() {
        return Arc::new(lease);
    }
    let bytes = response.body().size_hint().exact().and_then(|bytes| usize::try_from(bytes).ok());
    // Small ones are part of what the request holds.
    if let Some(bytes) = bytes.filter(|&bytes| bytes > REQUEST_BYTES) {
        lease.settle(bytes);
    }
    Arc::new(lease)
}

/// Over HTTP/2 the stream alone is reset, in the way that says that it may be tried again; over HTTP/1, which has few
/// reasons for it, the connection ends.
fn refused_stream() -> h2::Error {
    h2::Error::from(h2::Reason::REFUSED_STREAM)
}
