//! What every request passes on its way in and out: its id and trace, its key, its line in the log, its count, and the
//! body of its problem.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use tracing::Instrument as _;

use super::endpoints::endpoints;
use super::lent_body::lend;
use super::operation::Access;
use super::problem_json;
use crate::api::access::{AccessLine, Endpoint, RequestContext};
use crate::api::auth::Credential;
use crate::api::receive::{connection_of, only_probes, peer_of};
use crate::api::server::{PAGE_FOLDER, Use};
use crate::api::{ApiSettings, ApiState, CAUSE_IS_LOGGED, open_line};
use crate::contract::{ErrorCode, Problem};
use crate::metrics::Metrics;

/// Counts what is asked at no route of the server.
const OTHER_ROUTE: &str = "other";

/// What the middleware needs.
#[derive(Clone, Default)]
pub(super) struct Passage {
    settings: Arc<ApiSettings>,
    metrics: Arc<Metrics>,
    /// All routes of the server, also those on another port.
    routes: Arc<[(Arc<str>, Access)]>,
}

impl Passage {
    pub(super) fn new(state: &ApiState) -> Self {
        let routes = endpoints(state).into_iter().map(|endpoint| (endpoint.path.into(), endpoint.access)).collect();
        Self { settings: Arc::clone(&state.settings), metrics: Arc::clone(state.service.metrics()), routes }
    }

    /// The route of a path, and who may ask there.
    fn route(&self, path: &str) -> (Arc<str>, Access) {
        // The files of the page count together, those that do not exist too.
        if path.starts_with(PAGE_FOLDER) {
            return (PAGE_FOLDER.into(), Access::Open);
        }
        let known = self.routes.iter().find(|(route, _)| **route == *path).cloned();
        known.unwrap_or_else(|| (OTHER_ROUTE.into(), Access::WithKey))
    }

    /// What the request is admitted by, or its refusal.
    fn admit(&self, request: &Request, access: Access, context: &RequestContext) -> Result<Credential, Problem> {
        let credential = if access == Access::WithKey {
            let credential = self.settings.keys.admit(request.headers()).ok_or_else(unauthenticated)?;
            let connection = connection_of(request.extensions());
            credential.enter(&context.notes, &connection, &self.metrics)?;
            credential
        } else {
            Credential::anybody()
        };
        check_host(request)?;
        Ok(credential)
    }
}

/// Gives the request an id and a trace, asks for its key, logs and counts it once it is answered or abandoned, and
/// writes problems out.
pub(super) async fn pass(State(passage): State<Passage>, request: Request, next: Next) -> Response {
    let (context, span) = RequestContext::open(request.uri().path(), request.headers(), peer_of(request.extensions()));
    let (route, access) = passage.route(request.uri().path());
    let is_probe = access == Access::Probe;
    let admitted = if !is_probe && connection_of(request.extensions()).may == Use::Probes {
        Err(only_probes())
    } else {
        passage.admit(&request, access, &context)
    };
    let method = request.method().clone();
    let (mut request, lender) = lend(request);
    let mut line =
        AccessLine::open(method.clone(), context.clone(), span.clone(), Endpoint::Http(route), passage.metrics);
    line.is_probe = is_probe;
    let mut response = match admitted {
        Ok(credential) => {
            request.extensions_mut().insert(context.clone());
            request.extensions_mut().insert(credential);
            next.run(request).instrument(span).await
        }
        Err(problem) => {
            drop(request);
            refusal(problem)
        }
    };
    if let Some(problem) = problem_of(&mut response, &method, &context.path) {
        line.code = Some(problem.code().entry().code);
        write_problem(&problem, &context, &mut response);
        lender.discard_rest().await;
    }
    context.sign(response.headers_mut());
    protect(response.headers_mut());
    line.status = Some(response.status().as_u16());
    open_line::hand_over(response, line, open_line::no_trailers)
}

/// Answers mean what their type says, and nobody keeps them but their caller; documents, which have a tag, say themselves how they are
/// kept.
fn protect(headers: &mut HeaderMap) {
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    if !headers.contains_key(header::ETAG) {
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
}

/// A request of HTTP/1.1 names its host exactly once (RFC 9112, section 3.2): whatever stands between otherwise sees
/// another request than this server.
fn check_host(request: &Request) -> Result<(), Problem> {
    let count = request.headers().get_all(header::HOST).iter().count();
    if request.version() != Version::HTTP_11 || count == 1 {
        return Ok(());
    }
    Err(Problem::new(ErrorCode::MalformedBody, format!("`host` is given {count} times, must be given once")))
}

fn unauthenticated() -> Problem {
    let detail = "the API key is missing or wrong: send `Authorization: Bearer KEY`";
    Problem::new(ErrorCode::Unauthenticated, detail)
}

/// The answer to a request that is not admitted.
fn refusal(problem: Problem) -> Response {
    let needs_key = problem.code() == ErrorCode::Unauthenticated;
    let mut response = problem.into_response();
    if needs_key {
        response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
    }
    response
}

/// The problem that a handler returned, or one for an error that the framework answered by itself.
fn problem_of(response: &mut Response, method: &Method, path: &str) -> Option<Problem> {
    if let Some(problem) = response.extensions_mut().remove::<Problem>() {
        return Some(problem);
    }
    let status = response.status();
    match status {
        StatusCode::NOT_FOUND => Some(Problem::new(ErrorCode::NotFound, format!("there is nothing at `{path}`"))),
        StatusCode::METHOD_NOT_ALLOWED => {
            // The router adds `allow` after this.
            let detail = format!("`{path}` does not take {method}; the header `allow` says what it takes");
            Some(Problem::new(ErrorCode::MethodNotAllowed, detail))
        }
        _ if status.is_client_error() => {
            Some(Problem::new(ErrorCode::MalformedBody, format!("the request was refused with status {status}")))
        }
        _ if status.is_server_error() => Some(Problem::new(ErrorCode::Internal, CAUSE_IS_LOGGED)),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::server::is_for_readers;
    use crate::jobs::{InProcessSolver, Jobs, Limits};
    use crate::service::{Service, ServiceSettings};

    #[test]
    fn every_path_is_a_route_of_the_counts() {
        let service = Service::start(ServiceSettings::default()).unwrap();
        let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
        let passage = Passage::new(&ApiState::new(service.into(), jobs, ApiSettings::default()));
        for path in ["/solve", "/solve/events", "/simulate", "/validate", "/examples/forward-drive"] {
            assert_eq!(passage.route(path), (path.into(), Access::WithKey));
        }
        for path in ["/", "/docs", "/openapi.json", "/limits"] {
            assert_eq!(passage.route(path), (path.into(), Access::Open));
        }
        for path in ["/page/main.js", "/page/nothing"] {
            assert_eq!(passage.route(path), ("/page/".into(), Access::Open));
        }
        assert_eq!(passage.route("/livez"), ("/livez".into(), Access::Probe));
        assert_eq!(passage.route("/solve/"), (OTHER_ROUTE.into(), Access::WithKey));
        // Connections have a list of their own.
        for (path, access) in passage.routes.iter() {
            assert_eq!(is_for_readers(path), *access == Access::Open, "{path}");
        }
    }
}
