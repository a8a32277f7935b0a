//! What every call passes on its way in and out: its id and trace, its admission, its line in the log, its count, and
//! the details of errors that the framework answers by itself.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use tonic::{Code, Status};
use tracing::Instrument as _;

use super::admission::{self, Methods};
use super::status;
use super::until_closing::UntilClosing;
use crate::api::access::{self, AccessLine, Endpoint, RequestContext};
use crate::api::receive::{connection_of, peer_of};
use crate::api::{ApiState, open_line};
use crate::contract::{BodyLimit, ErrorCode, Problem};

/// What the middleware needs.
#[derive(Clone)]
pub(super) struct Passage {
    pub(super) state: ApiState,
    pub(super) methods: Arc<Methods>,
}

/// Gives the call an id and a trace, admits it or not, and logs and counts it once it is answered or abandoned.
pub(super) async fn pass(State(Passage { state, methods }): State<Passage>, request: Request, next: Next) -> Response {
    let (context, span) = RequestContext::open(request.uri().path(), request.headers(), peer_of(request.extensions()));
    let endpoint = Endpoint::Grpc(methods.label(&context.path));
    let metrics = Arc::clone(state.service.metrics());
    let mut line = AccessLine::open(request.method().clone(), context.clone(), span.clone(), endpoint, metrics);
    line.is_probe = admission::is_probe(&context.path);
    let (connection, is_grpc) = (connection_of(request.extensions()), is_grpc(request.headers()));
    let mut response = match admission::admit(&state, &methods, request, &context).await {
        Ok(request) => next.run(request).instrument(span).await,
        Err(problem) => answer(&problem, is_grpc, &context),
    };
    if let Some(problem) = problem_of(&mut response, &methods, &context.path) {
        response = answer(&problem, is_grpc, &context);
    }
    if admission::is_foreign(&context.path) {
        response = response.map(|body| Body::new(UntilClosing::of(body, connection)));
    }
    context.sign(response.headers_mut());
    line.status = Some(access::status_number(Code::Ok));
    read_status(response.headers(), &mut line);
    open_line::hand_over(response, line, read_status)
}

/// Takes the status, and the code in its details, into the line; answers without a stream have them in their head.
fn read_status(headers: &HeaderMap, line: &mut AccessLine) {
    if let Some(status) = Status::from_header_map(headers) {
        line.status = Some(access::status_number(status.code()));
        line.code = status::code_of(&status).map(|code| code.entry().code);
    }
}

/// Whether a call says that it is one.
fn is_grpc(headers: &HeaderMap) -> bool {
    headers.get(header::CONTENT_TYPE).is_some_and(|value| value.as_bytes().starts_with(b"application/grpc"))
}

/// Clients and probes of plain HTTP, which may have the wrong port, see what went wrong by the status.
fn answer(problem: &Problem, is_grpc: bool, context: &RequestContext) -> Response {
    let mut response: Response = status::of_problem(problem, &context.request_id).into_http();
    if !is_grpc {
        let status = StatusCode::from_u16(problem.code().entry().http_status);
        *response.status_mut() = status.unwrap_or(StatusCode::BAD_REQUEST);
    }
    if problem.code() == ErrorCode::UnsupportedMedia {
        response.headers_mut().insert("grpc-accept-encoding", HeaderValue::from_static("identity"));
    }
    response
}

/// The problem of a panic, or of an error that the framework answered by itself: those bear no details.
fn problem_of(response: &mut Response, methods: &Methods, path: &str) -> Option<Problem> {
    if let Some(problem) = response.extensions_mut().remove::<Problem>() {
        return Some(problem);
    }
    let status = Status::from_header_map(response.headers())?;
    let is_own = !status.details().is_empty() || admission::is_foreign(path);
    (status.code() != Code::Ok && !is_own)
        .then(|| of_framework(&status, methods.has(path), path, methods.limit_of(path)))
}

/// tonic reports messages that it cannot read as `INTERNAL` or `OUT_OF_RANGE`, which blames the server.
pub(super) fn of_framework(status: &Status, is_call: bool, path: &str, limit: BodyLimit) -> Problem {
    match status.code() {
        Code::Unimplemented if is_call => Problem::new(ErrorCode::UnsupportedMedia, status.message()),
        Code::Unimplemented => Problem::new(ErrorCode::NotFound, format!("there is nothing at `{path}`")),
        Code::OutOfRange | Code::ResourceExhausted => Problem::body_too_large(limit),
        Code::Cancelled => Problem::new(ErrorCode::Cancelled, "the caller left"),
        Code::Ok
        | Code::Unknown
        | Code::InvalidArgument
        | Code::DeadlineExceeded
        | Code::NotFound
        | Code::AlreadyExists
        | Code::PermissionDenied
        | Code::FailedPrecondition
        | Code::Aborted
        | Code::Internal
        | Code::Unavailable
        | Code::DataLoss
        | Code::Unauthenticated => Problem::new(ErrorCode::MalformedBody, status.message()),
    }
}
