//! What every request of a connection passes before the router: its place among the requests of the connection, and the
//! memory that it holds.

use std::error::Error;
use std::future::ready;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, HttpBody as _};
use axum::extract::Request;
use axum::http::header::CONNECTION;
use axum::http::{HeaderValue, Version};
use axum::response::Response;
use futures_util::future::Either;
use hyper::body::Incoming;
use hyper::service::service_fn;
use tower::ServiceExt as _;

use super::answer_body::AnswerBody;
use super::connection::{Connection, REQUEST_BYTES, Standing, UnderWay};
use super::memory::Lease;

/// Services that everybody may ask, for other purposes than work.
const SERVICES_FOR_GUESTS: &str = "/grpc.";

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
        let standing = standing(&connection, &request);
        match connection.enter(standing) {
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
    let held = match under_way.standing {
        // Their number bounds what they hold.
        Standing::Guest => None,
        Standing::Caller => Some(connection.lease_soon(REQUEST_BYTES).await.ok_or_else(refused_stream)?),
    };
    let version = request.version();
    request.extensions_mut().insert(Arc::clone(&connection));
    let mut response = router.oneshot(request.map(Body::new)).await?;
    if version != Version::HTTP_2 && connection.connections.is_leaving() {
        response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
    }
    let lease = response.extensions_mut().remove().unwrap_or_else(|| lease_of(&connection, &response));
    let wait = connection.wait(connection.connections.settings.write_timeout);
    Ok(response.map(|body| Body::new(AnswerBody::new(body, wait, lease, (under_way, held)))))
}

/// Whether somebody asks who may ask for work: probes and requests without a key are those of guests.
fn standing<B>(connection: &Connection, request: &Request<B>) -> Standing {
    let is_for_guests = request.uri().path().starts_with(SERVICES_FOR_GUESTS);
    if is_for_guests || !connection.connections.keys.admit(request.headers()) {
        Standing::Guest
    } else {
        Standing::Caller
    }
}

/// The lease of an answer that was not reserved before: what is known of its length.
fn lease_of(connection: &Arc<Connection>, response: &Response) -> Arc<Lease> {
    let lease = Lease::empty(connection);
    let bytes = response.body().size_hint().exact().and_then(|bytes| usize::try_from(bytes).ok());
    // Small ones are part of what the request holds.
    if let Some(bytes) = bytes.filter(|&bytes| bytes > REQUEST_BYTES) {
        lease.settle(bytes);
    }
    Arc::new(lease)
}

/// Over HTTP/2 the stream alone is reset, in the way that says that it may be tried again.
fn refused_stream() -> h2::Error {
    h2::Error::from(h2::Reason::REFUSED_STREAM)
}
