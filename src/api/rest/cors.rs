//! Pages of other origins that may call from a browser.

use std::time::Duration;

use axum::Router;
use axum::http::{HeaderValue, Method, header};
use tower_http::cors::{AllowOrigin, CorsLayer};

use super::extract::REQUEST_TIMEOUT_MS;
use crate::api::access::REQUEST_ID;
use crate::api::trace_context::TRACEPARENT;

/// How long a browser may remember the leave: as long as any of them does that people use.
const MAX_AGE: Duration = Duration::from_secs(2 * 60 * 60);

/// The router, for pages of these origins too; unchanged when there are none.
pub(super) fn allowed(router: Router, origins: Vec<HeaderValue>) -> Router {
    if origins.is_empty() {
        return router;
    }
    let layer = CorsLayer::new()
        .allow_origin(AllowOrigin::list(origins))
        .allow_methods([Method::GET, Method::POST])
        .allow_headers([header::AUTHORIZATION, header::CONTENT_TYPE, REQUEST_ID, REQUEST_TIMEOUT_MS, TRACEPARENT])
        .expose_headers([header::RETRY_AFTER, REQUEST_ID, TRACEPARENT])
        .max_age(MAX_AGE);
    router.layer(layer)
}
