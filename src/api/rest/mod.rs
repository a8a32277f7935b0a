//! REST: JSON in and out, strict in what it reads, `application/problem+json` for every error.

mod batch;
mod coding;
mod cors;
mod document;
mod endpoints;
mod events;
mod extract;
mod handlers;
mod lent_body;
mod middleware;
mod openapi;
mod operation;
mod page;
mod problem_json;

use std::sync::OnceLock;

use axum::Router;
use axum::middleware::from_fn_with_state;

use crate::api::{ApiState, Probes, panic};
use document::Document;
use endpoints::{Endpoint, endpoints};
use middleware::Passage;
use operation::Access;

/// What a server says of itself, once somebody has asked.
#[derive(Default)]
pub(super) struct Documents {
    openapi: OnceLock<Document>,
    limits: OnceLock<Document>,
}

/// All endpoints of a server; probes and metrics only where they have no port of their own.
pub fn router(state: &ApiState) -> Router {
    let with_probes = state.settings.probes == Probes::WithApi;
    let served = |endpoint: &Endpoint| with_probes || endpoint.access != Access::Probe;
    // Outside the other middleware: browsers ask for leave without a key.
    cors::allowed(serving(state, served), state.settings.cors_origins.clone())
}

/// Probes and metrics alone, for a port of their own.
pub fn admin_router(state: &ApiState) -> Router {
    serving(state, |endpoint| endpoint.access == Access::Probe)
}

fn serving(state: &ApiState, is_served: impl Fn(&Endpoint) -> bool) -> Router {
    let (all, passage) = (endpoints(state), Passage::new(state));
    let served = all.into_iter().filter(is_served);
    let router = served.fold(Router::new(), |router, endpoint| router.route(&endpoint.path, endpoint.handler));
    behind(passage, router.with_state(state.clone()))
}

fn behind(passage: Passage, router: Router) -> Router {
    // Panics inside, so that their answer is a problem with an id too.
    router.layer(panic::answered()).layer(from_fn_with_state(passage, middleware::pass))
}

#[cfg(test)]
mod tests {
    use axum::body::{Body, to_bytes};
    use axum::http::{Request, StatusCode};
    use axum::routing::get;
    use tower::ServiceExt as _;

    use super::*;

    async fn panicking() -> StatusCode {
        panic!("a secret")
    }

    #[tokio::test]
    async fn panic_in_a_handler_is_a_problem_without_internals() {
        let router = behind(Passage::default(), Router::new().route("/panic", get(panicking)));
        let response =
            router.oneshot(Request::get("/panic").header("host", "h").body(Body::empty()).unwrap()).await.unwrap();
        assert_eq!(response.status(), StatusCode::INTERNAL_SERVER_ERROR);
        assert_eq!(response.headers()["content-type"], "application/problem+json");
        let body = to_bytes(response.into_body(), 10_000).await.unwrap();
        let text = String::from_utf8(body.to_vec()).unwrap();
        assert!(text.contains("\"internal\"") && !text.contains("secret"), "{text}");
    }

    #[tokio::test]
    async fn plain_errors_of_the_framework_become_problems() {
        let teapot = Router::new().route("/teapot", get(|| async { StatusCode::IM_A_TEAPOT }));
        let router = behind(Passage::default(), teapot);
        let response =
            router.oneshot(Request::get("/teapot").header("host", "h").body(Body::empty()).unwrap()).await.unwrap();
        assert_eq!(response.headers()["content-type"], "application/problem+json");
    }
}
