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
use crate::api::{ApiSettings, Door, Probes};
use crate::service::Service;
use border::Border;

/// Every route, for the counts: what is asked elsewhere counts as [`OTHER_ROUTE`].
const ROUTES: [&str; 10] = [
    "/solve",
    "/simulate",
    "/validate",
    "/openapi.json",
    "/docs",
    "/limits",
    "/examples/forward-drive",
    "/livez",
    "/readyz",
    "/metrics",
];
/// Those of them that may have a port of their own; open to everyone, since probes and scrapers have no keys.
const PROBES: [&str; 3] = ["/livez", "/readyz", "/metrics"];
const OTHER_ROUTE: &str = "other";

/// All endpoints over one service; probes and metrics only where they have no port of their own.
pub fn router(service: Arc<Service>, settings: ApiSettings) -> Router {
    let document = Bytes::from(openapi::document(service.limits(), settings.probes));
    let with_probes = settings.probes == Probes::WithApi;
    let door = Door { service, settings: Arc::new(settings) };
    let endpoints = Router::new()
        .route("/solve", post(handlers::solve))
        .route("/simulate", post(handlers::simulate))
        .route("/validate", post(handlers::validate))
        .route("/openapi.json", get(async move || handlers::openapi(document)))
        .route("/docs", get(handlers::docs))
        .route("/limits", get(handlers::limits))
        .route("/examples/forward-drive", get(handlers::forward_drive));
    let endpoints = if with_probes { endpoints.merge(probes()) } else { endpoints };
    let origins = door.settings.cors_origins.clone();
    // Outside the border: browsers ask for leave without a key.
    cors::allowed(behind_border(endpoints.with_state(door.clone()), Border::of(&door)), origins)
}

/// Probes and metrics alone, for a port of their own.
pub fn admin_router(service: Arc<Service>, settings: ApiSettings) -> Router {
    let door = Door { service, settings: Arc::new(settings) };
    behind_border(probes().with_state(door.clone()), Border::of(&door))
}

fn probes() -> Router<Door> {
    Router::new()
        .route("/livez", get(handlers::livez))
        .route("/readyz", get(handlers::readyz))
        .route("/metrics", get(handlers::metrics))
}

fn behind_border(endpoints: Router, border: Border) -> Router {
    endpoints
        // Inside the border, so that the answer to a panic is a problem with an id too.
        .layer(CatchPanicLayer::custom(|panic: Box<dyn Any + Send>| problem_of_panic(panic.as_ref())))
        .layer(from_fn_with_state(border, border::pass))
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
        let router = behind_border(Router::new().route("/panic", get(panicking)), Border::default());
        let response = router.oneshot(Request::get("/panic").body(Body::empty()).unwrap()).await.unwrap();
        assert_eq!(response.status(), StatusCode::INTERNAL_SERVER_ERROR);
        assert_eq!(response.headers()["content-type"], "application/problem+json");
        let body = to_bytes(response.into_body(), 10_000).await.unwrap();
        let text = String::from_utf8(body.to_vec()).unwrap();
        assert!(text.contains("\"internal\"") && !text.contains("secret"), "{text}");
    }

    #[test]
    fn every_described_path_is_a_route_of_the_counts() {
        let document: serde_json::Value =
            serde_json::from_slice(&openapi::document(&crate::service::Limits::default(), Probes::WithApi)).unwrap();
        for path in document["paths"].as_object().unwrap().keys() {
            assert!(ROUTES.contains(&path.as_str()), "{path}");
        }
    }

    #[tokio::test]
    async fn plain_errors_of_the_framework_become_problems() {
        let router =
            behind_border(Router::new().route("/teapot", get(|| async { StatusCode::IM_A_TEAPOT })), Border::default());
        let response = router.oneshot(Request::get("/teapot").body(Body::empty()).unwrap()).await.unwrap();
        assert_eq!(response.headers()["content-type"], "application/problem+json");
    }
}
