//! Panics of handlers, answered as problems by every transport.

use std::any::Any;

use axum::response::{IntoResponse as _, Response};
use tower_http::catch_panic::CatchPanicLayer;

use crate::contract::{ErrorCode, Problem};
use crate::service::words_of_panic;

/// Answers a panic with a problem that names no internals; the log has the cause.
pub(super) fn answered() -> CatchPanicLayer<fn(Box<dyn Any + Send>) -> Response> {
    CatchPanicLayer::custom(problem_of as fn(Box<dyn Any + Send>) -> Response)
}

#[expect(clippy::needless_pass_by_value, reason = "the layer passes it by value")]
fn problem_of(panic: Box<dyn Any + Send>) -> Response {
    let words = words_of_panic(panic.as_ref()).unwrap_or("none");
    tracing::error!(panic.message = words, "a handler panicked");
    Problem::new(ErrorCode::Internal, super::CAUSE_IS_LOGGED).into_response()
}
