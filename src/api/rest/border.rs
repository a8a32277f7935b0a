//! What every request passes on its way in and out: its id, its line in the log, and the body of its problem.

use std::time::Instant;

use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use tracing::Instrument as _;
use uuid::Uuid;

use super::problem_json;
use crate::api::error_table::ErrorCode;
use crate::api::problem::Problem;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Longest request id that is taken over from a caller, characters: enough for any tracing scheme, too short to
/// flood a log.
const MAX_REQUEST_ID: usize = 128;
/// Longest part of a path that is repeated in logs and problems, characters.
const MAX_PATH: usize = 200;

/// What handlers know of the request beside its content.
#[derive(Debug, Clone)]
pub(super) struct RequestContext {
    /// When its head was read: deadlines count from here.
    pub(super) arrival: Instant,
    /// Its path, shortened.
    pub(super) path: String,
    /// Its id, the caller's own or a new one.
    pub(super) request_id: String,
}

/// Gives the request an id, logs it once it is answered or abandoned, and writes problems out.
pub(super) async fn pass(mut request: Request, next: Next) -> Response {
    let request_id = request_id(request.headers());
    let path: String = request.uri().path().chars().take(MAX_PATH).collect();
    let mut line = AccessLine::open(request.method().clone(), path, request_id);
    request.extensions_mut().insert(RequestContext {
        arrival: line.start,
        path: line.path.clone(),
        request_id: line.request_id.clone(),
    });
    let span = tracing::info_span!("request", request.id = line.request_id);
    let mut response = next.run(request).instrument(span).await;
    if let Some(problem) = problem_of(&mut response, &line) {
        line.code = Some(problem.code().entry().code);
        write_problem(&problem, &line, &mut response);
    }
    if let Ok(value) = HeaderValue::try_from(&line.request_id) {
        response.headers_mut().insert(REQUEST_ID, value);
    }
    line.status = Some(response.status());
    response
}

fn request_id(headers: &HeaderMap) -> String {
    let is_sane =
        |id: &&str| (1..=MAX_REQUEST_ID).contains(&id.len()) && id.bytes().all(|byte| byte.is_ascii_graphic());
    let given = headers.get(REQUEST_ID).and_then(|value| value.to_str().ok()).filter(is_sane);
    given.map_or_else(|| Uuid::now_v7().to_string(), str::to_owned)
}

/// The problem that a handler returned, or one for an error that the framework answered by itself.
fn problem_of(response: &mut Response, line: &AccessLine) -> Option<Problem> {
    if let Some(problem) = response.extensions_mut().remove::<Problem>() {
        return Some(problem);
    }
    let status = response.status();
    let (method, path) = (&line.method, &line.path);
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

fn write_problem(problem: &Problem, line: &AccessLine, response: &mut Response) {
    let entry = problem.code().entry();
    *response.status_mut() = StatusCode::from_u16(entry.http_status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    *response.body_mut() = Body::from(problem_json::body(problem, &line.path, &line.request_id));
    let headers = response.headers_mut();
    headers.remove(header::CONTENT_LENGTH);
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
}

/// One line of the log, written when the request is over: also when the caller left and the handler was dropped.
struct AccessLine {
    method: Method,
    path: String,
    request_id: String,
    start: Instant,
    status: Option<StatusCode>,
    code: Option<&'static str>,
}

impl AccessLine {
    fn open(method: Method, path: String, request_id: String) -> Self {
        Self { method, path, request_id, start: Instant::now(), status: None, code: None }
    }
}

impl Drop for AccessLine {
    fn drop(&mut self) {
        // No answer means that the caller left.
        let gone = ErrorCode::Cancelled.entry();
        let (status, code) = match self.status {
            Some(status) => (status.as_u16(), self.code),
            None => (gone.http_status, Some(gone.code)),
        };
        let duration_ms = self.start.elapsed().as_secs_f64() * 1e3;
        tracing::info!(
            request.id = self.request_id,
            http.method = %self.method,
            http.path = self.path,
            http.status = status,
            problem.code = code,
            request.duration_ms = duration_ms,
            "request"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id_for(given: &'static str) -> String {
        request_id(&HeaderMap::from_iter([(REQUEST_ID, HeaderValue::from_static(given))]))
    }

    #[test]
    fn sane_request_id_is_taken_over() {
        assert_eq!(id_for("caller-7:a/b"), "caller-7:a/b");
    }

    #[test]
    fn odd_request_id_is_replaced() {
        for odd in ["", "two words"] {
            assert_eq!(Uuid::parse_str(&id_for(odd)).unwrap().get_version_num(), 7, "{odd:?}");
        }
    }
}
