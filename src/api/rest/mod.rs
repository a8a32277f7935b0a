//! REST: JSON in and out, strict in what it reads, `application/problem+json` for every error.

mod border;
mod convert_goal;
mod convert_request;
mod convert_response;
mod extract;
mod handlers;
mod problem;
mod strict;
mod wire_request;
mod wire_response;

use std::any::Any;
use std::io;
use std::sync::Arc;

use axum::Router;
use axum::middleware::from_fn;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::serve::ListenerExt;
use tokio::net::TcpListener;
use tower_http::catch_panic::CatchPanicLayer;

pub use convert_request::{AcceptedSolve, read_simulate, read_solve};
pub use convert_response::{simulate_answer, solve_answer};
pub use problem::{FieldError, Problem};
pub use wire_request::View;

use crate::api::error_table::ErrorCode;
use crate::service::Service;

/// All endpoints over one service.
pub fn router(service: Arc<Service>) -> Router {
    Router::new()
        .route("/solve", post(handlers::solve))
        .route("/simulate", post(handlers::simulate))
        .route("/validate", post(handlers::validate))
        .route("/examples/forward-drive", get(handlers::forward_drive))
        .route("/livez", get(handlers::livez))
        .route("/readyz", get(handlers::readyz))
        .with_state(service)
        // Inside the border, so that the answer to a panic is a problem with an id too.
        .layer(CatchPanicLayer::custom(|panic: Box<dyn Any + Send>| problem_of_panic(panic.as_ref())))
        .layer(from_fn(border::pass))
}

/// Serves until `shutdown` is ready, then lets the answers under way finish.
///
/// # Errors
/// When the listener fails for good.
pub async fn serve(
    listener: TcpListener,
    service: Arc<Service>,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> io::Result<()> {
    // Answers are written in one piece: waiting for more to send only adds delay.
    let listener = listener.tap_io(|stream| {
        if let Err(error) = stream.set_nodelay(true) {
            tracing::debug!(error = %error, "a connection keeps its send delay");
        }
    });
    axum::serve(listener, router(service)).with_graceful_shutdown(shutdown).await
}

fn problem_of_panic(panic: &(dyn Any + Send)) -> Response {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    tracing::error!(panic.message = text.unwrap_or("none"), "a handler panicked");
    Problem::new(ErrorCode::Internal, "the log holds the cause").into_response()
}
