//! REST: JSON in and out, strict in what it reads, `application/problem+json` for every error.

mod border;
mod cors;
mod events;
mod extract;
mod handlers;
mod openapi;
mod problem_json;

use std::any::Any;
use std::sync::Arc;

use axum::Router;
use axum::body::Bytes;
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use tower_http::catch_panic::CatchPanicLayer;

use crate::api::error_table::ErrorCode;
pub use crate::api::message::accept::{AcceptedSolve, forward_drive_body, read_simulate, read_solve};
pub use crate::api::message::answer::{simulate_answer, solve_answer};
pub use crate::api::message::request::View;
pub use crate::api::problem::{FieldError, Problem};
use crate::api::{ApiSettings, Door};
use crate::service::Service;

/// All endpoints over one service.
pub fn router(service: Arc<Service>, settings: ApiSettings) -> Router {
    let document = Bytes::from(openapi::document(service.limits()));
    let door = Door { service, settings: Arc::new(settings) };
    let endpoints = Router::new()
        .route("/solve", post(handlers::solve))
        .route("/simulate", post(handlers::simulate))
        .route("/validate", post(handlers::validate))
        .route("/openapi.json", get(async move || handlers::openapi(document)))
        .route("/docs", get(handlers::docs))
        .route("/limits", get(handlers::limits))
        .route("/examples/forward-drive", get(handlers::forward_drive))
        .route("/livez", get(handlers::livez))
        .route("/readyz", get(handlers::readyz))
        .with_state(door.clone());
    let origins = door.settings.cors_origins.clone();
    // Outside the border: browsers ask for leave without a key.
    cors::allowed(behind_border(endpoints, door.settings), origins)
}

fn behind_border(endpoints: Router, settings: Arc<ApiSettings>) -> Router {
    endpoints
        // Inside the border, so that the answer to a panic is a problem with an id too.
        .layer(CatchPanicLayer::custom(|panic: Box<dyn Any + Send>| problem_of_panic(panic.as_ref())))
        .layer(from_fn_with_state(settings, border::pass))
}

fn problem_of_panic(panic: &(dyn Any + Send)) -> Response {
    let text = panic.downcast_ref::<&str>().copied().or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    tracing::error!(panic.message = text.unwrap_or("none"), "a handler panicked");
    Problem::new(ErrorCode::Internal, "the log holds the cause").into_response()
}

#[cfg(test)]
mod tests {
    use axum::body::{Body, to_bytes};
    use axum::http::{Request, StatusCode};
    use tower::ServiceExt as _;

    use super::*;

    async fn panicking() -> StatusCode {
        panic!("a secret")
    }

    #[tokio::test]
    async fn panic_in_a_handler_is_a_problem_without_internals() {
        let router = behind_border(Router::new().route("/panic", get(panicking)), Arc::default());
        let response = router.oneshot(Request::get("/panic").body(Body::empty()).unwrap()).await.unwrap();
        assert_eq!(response.status(), StatusCode::INTERNAL_SERVER_ERROR);
        assert_eq!(response.headers()["content-type"], "application/problem+json");
        let body = to_bytes(response.into_body(), 10_000).await.unwrap();
        let text = String::from_utf8(body.to_vec()).unwrap();
        assert!(text.contains("\"internal\"") && !text.contains("secret"), "{text}");
    }

    #[tokio::test]
    async fn plain_errors_of_the_framework_become_problems() {
        let router =
            behind_border(Router::new().route("/teapot", get(|| async { StatusCode::IM_A_TEAPOT })), Arc::default());
        let response = router.oneshot(Request::get("/teapot").body(Body::empty()).unwrap()).await.unwrap();
        assert_eq!(response.headers()["content-type"], "application/problem+json");
    }
}
