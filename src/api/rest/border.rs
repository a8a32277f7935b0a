//! What every request passes on its way in and out: its id and trace, its key, its line in the log, its count, and the
//! body of its problem.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use tracing::Instrument as _;

use super::{OTHER_ROUTE, PROBES, ROUTES, problem_json};
use crate::api::access::{AccessLine, Endpoint, RequestContext};
use crate::api::error_table::ErrorCode;
use crate::api::problem::Problem;
use crate::api::{ApiSettings, Door, observed_body};
use crate::metrics::Metrics;

/// What the border needs.
#[derive(Clone, Default)]
pub(super) struct Border {
    settings: Arc<ApiSettings>,
    metrics: Arc<Metrics>,
}

impl Border {
    pub(super) fn of(door: &Door) -> Self {
        let metrics = Arc::clone(door.service.metrics());
        metrics.expect_rejections(ErrorCode::answered().map(|code| code.entry().code));
        Self { settings: Arc::clone(&door.settings), metrics }
    }
}

/// Gives the request an id and a trace, asks for its key, logs and counts it once it is answered or abandoned, and
/// writes problems out.
pub(super) async fn pass(
    State(Border { settings, metrics }): State<Border>,
    mut request: Request,
    next: Next,
) -> Response {
    let (context, span) = RequestContext::open(request.uri().path(), request.headers());
    let method = request.method().clone();
    let endpoint = Endpoint::Http(route_of(request.uri().path()));
    let mut line = AccessLine::open(method.clone(), context.clone(), span.clone(), endpoint, metrics);
    let mut response = if may_pass(&settings, &request) {
        request.extensions_mut().insert(context.clone());
        next.run(request).instrument(span).await
    } else {
        unauthenticated()
    };
    if let Some(problem) = problem_of(&mut response, &method, &context.path) {
        line.code = Some(problem.code().entry().code);
        write_problem(&problem, &context, &mut response);
    }
    context.sign(response.headers_mut());
    line.status = Some(response.status().as_u16());
    observed_body::follow(response, line, observed_body::no_trailers)
}

fn route_of(path: &str) -> &'static str {
    ROUTES.iter().find(|route| **route == path).copied().unwrap_or(OTHER_ROUTE)
}

fn may_pass(settings: &ApiSettings, request: &Request) -> bool {
    PROBES.contains(&request.uri().path()) || settings.keys.admit(request.headers())
}

fn unauthenticated() -> Response {
    let detail = "the API key is missing or wrong: send `Authorization: Bearer KEY`";
    let mut response = Problem::new(ErrorCode::Unauthenticated, detail).into_response();
    response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
    response
}

/// The problem that a handler returned, or one for an error that the framework answered by itself.
fn problem_of(response: &mut Response, method: &axum::http::Method, path: &str) -> Option<Problem> {
    if let Some(problem) = response.extensions_mut().remove::<Problem>() {
        return Some(problem);
    }
    let status = response.status();
    match status {
        StatusCode::NOT_FOUND => Some(Problem::new(ErrorCode::NotFound, format!("there is nothing at `{path}`"))),
        StatusCode::METHOD_NOT_ALLOWED => {
            let allowed = response.headers().get(header::ALLOW).and_then(|value| value.to_str().ok());
            let detail = format!("`{path}` does not take {method}, allowed: {}", allowed.unwrap_or("nothing"));
            Some(Problem::new(ErrorCode::MethodNotAllowed, detail))
        }
        _ if status.is_client_error() => {
            Some(Problem::new(ErrorCode::MalformedBody, format!("the request was refused with status {status}")))
        }
        _ if status.is_server_error() => Some(Problem::new(ErrorCode::Internal, "the log holds the cause")),
        _ => None,
    }
}

fn write_problem(problem: &Problem, context: &RequestContext, response: &mut Response) {
    let entry = problem.code().entry();
    *response.status_mut() = StatusCode::from_u16(entry.http_status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    *response.body_mut() = Body::from(problem_json::body(problem, &context.path, &context.request_id));
    let headers = response.headers_mut();
    headers.remove(header::CONTENT_LENGTH);
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
}
