//! The id of a request, its line in the log and its place in the counts, the same for every transport.

use std::mem;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::http::{HeaderMap, HeaderName, HeaderValue, Method};
use tonic::Code;
use tracing::{Span, field};
use uuid::Uuid;

use super::auth::OpenRequest;
use super::trace_context::{TRACEPARENT, TraceContext};
use crate::contract::ErrorCode;
use crate::metrics::{Answered, Metrics};

/// Carries the id of a request in both directions.
pub(super) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Longest request id that is taken over from a caller, characters: enough for any tracing scheme, too short to
/// flood a log.
const MAX_REQUEST_ID: usize = 128;
/// Longest part of a path that is repeated in logs and problems, characters.
const MAX_PATH: usize = 200;

/// The caller's own id, if it is valid, else a new one.
pub(super) fn request_id(headers: &HeaderMap) -> String {
    let is_valid =
        |id: &&str| (1..=MAX_REQUEST_ID).contains(&id.len()) && id.bytes().all(|byte| byte.is_ascii_graphic());
    let given = headers.get(REQUEST_ID).and_then(|value| value.to_str().ok()).filter(is_valid);
    given.map_or_else(|| Uuid::now_v7().to_string(), str::to_owned)
}

/// What handlers know of the request beside its content.
#[derive(Clone)]
pub(super) struct RequestContext {
    /// When its head was read: deadlines count from here.
    pub(super) arrival: Instant,
    /// Its path, shortened.
    pub(super) path: String,
    /// Where it came from.
    pub(super) peer: Option<SocketAddr>,
    /// Its id, the caller's own or a new one.
    pub(super) request_id: String,
    /// The trace that it belongs to.
    pub(super) trace: TraceContext,
    /// What becomes known of it on the way, for its line.
    pub(super) notes: Notes,
}

impl RequestContext {
    /// The context of the request that arrives at this moment, and its span.
    pub(super) fn open(path: &str, headers: &HeaderMap, peer: Option<SocketAddr>) -> (Self, Span) {
        let path: String = path.chars().take(MAX_PATH).collect();
        let request_id = request_id(headers);
        let span = tracing::info_span!("request", request.id = request_id, trace.id = field::Empty);
        let trace = TraceContext::of_request(&span, headers);
        (Self { arrival: Instant::now(), path, peer, request_id, trace, notes: Notes::default() }, span)
    }

    /// Writes the id and the trace into the head of the answer.
    pub(super) fn sign(&self, headers: &mut HeaderMap) {
        if let Ok(value) = HeaderValue::try_from(&self.request_id) {
            headers.insert(REQUEST_ID, value);
        }
        if let Some(value) = self.trace.header() {
            headers.insert(TRACEPARENT, value);
        }
    }
}

/// What is learnt of a request while it is served; clones speak of the same request.
#[derive(Clone, Default)]
pub(super) struct Notes(Arc<Mutex<Noted>>);

#[derive(Default)]
struct Noted {
    /// Whose request it is, where keys are configured.
    open: Option<OpenRequest>,
    queue_wait: Option<Duration>,
    solve_time: Option<Duration>,
    code: Option<&'static str>,
}

impl Notes {
    /// Notes whose request it is.
    pub(super) fn opened(&self, open: OpenRequest) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).open = Some(open);
    }

    /// Notes a job: of a batch the longest wait, and the work of all items.
    pub(super) fn job(&self, queue_wait: Duration, work: Duration) {
        let mut noted = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        noted.queue_wait = noted.queue_wait.max(Some(queue_wait));
        noted.solve_time = Some(noted.solve_time.unwrap_or_default() + work);
    }

    /// Notes the problem that a stream ends with.
    pub(super) fn problem(&self, code: ErrorCode) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).code = Some(code.entry().code);
    }

    /// What was noted, which ends the request.
    fn take(&self) -> Noted {
        mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Where a request goes, in words of the server: routes and methods, never the path of a caller.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Endpoint {
    /// A route of REST.
    Http(Arc<str>),
    /// A method of gRPC.
    Grpc(&'static str),
}

/// One line of the log and one count, written when the request is over: also when the caller left and the handler was
/// dropped.
pub(super) struct AccessLine {
    method: Method,
    context: RequestContext,
    /// Ends with the line.
    _span: Span,
    endpoint: Endpoint,
    metrics: Arc<Metrics>,
    /// HTTP or gRPC status, once there is an answer.
    pub(super) status: Option<u16>,
    /// The code of the problem that was answered, if any.
    pub(super) code: Option<&'static str>,
    /// Whether it is a probe or a scrape, which come every few seconds.
    pub(super) is_probe: bool,
}

impl AccessLine {
    /// Opens the line of a request.
    pub(super) fn open(
        method: Method,
        context: RequestContext,
        span: Span,
        endpoint: Endpoint,
        metrics: Arc<Metrics>,
    ) -> Self {
        Self { method, context, _span: span, endpoint, metrics, status: None, code: None, is_probe: false }
    }

    /// The caller left before the end of the answer; a refusal stays one.
    pub(super) fn abandon(&mut self) {
        if self.code.is_none() {
            self.status = None;
        }
    }

    /// Status and code: without an answer, those of a caller who left.
    fn outcome(&self, noted: &Noted) -> (u16, Option<&'static str>) {
        let gone = ErrorCode::Cancelled.entry();
        match (self.status, &self.endpoint) {
            (Some(status), _) => (status, self.code.or(noted.code)),
            (None, Endpoint::Http(_)) => (gone.http_status, Some(gone.code)),
            (None, Endpoint::Grpc(_)) => (status_number(Code::from(gone.grpc_code as i32)), Some(gone.code)),
        }
    }

    fn is_success(&self, status: u16) -> bool {
        match &self.endpoint {
            Endpoint::Http(_) => status < 400,
            Endpoint::Grpc(_) => status == status_number(Code::Ok),
        }
    }

    /// Writes the line: successful probes are of interest to nobody but their developers.
    fn write(&self, (status, code): (u16, Option<&'static str>), noted: &Noted, duration: Duration) {
        let milliseconds = |duration: Duration| duration.as_secs_f64() * 1e3;
        // The level of an event is fixed when it is compiled.
        macro_rules! line {
            ($level:ident) => {
                tracing::$level!(
                    parent: Span::none(),
                    request.id = self.context.request_id,
                    trace.id = self.context.trace.trace_id(),
                    http.method = %self.method,
                    http.path = self.context.path,
                    peer.address = self.context.peer.map(field::display),
                    caller.name = noted.open.as_ref().map(OpenRequest::caller),
                    response.status = status,
                    problem.code = code,
                    queue.wait_ms = noted.queue_wait.map(milliseconds),
                    solve.duration_ms = noted.solve_time.map(milliseconds),
                    request.duration_ms = milliseconds(duration),
                    "request"
                )
            };
        }
        if self.is_probe && self.is_success(status) { line!(debug) } else { line!(info) }
    }

    fn count(&self, (status, code): (u16, Option<&'static str>), duration: Duration) {
        match &self.endpoint {
            Endpoint::Http(route) => {
                self.metrics.answered(Answered::Http { route, status: &status.to_string() }, duration);
            }
            Endpoint::Grpc(method) => {
                let code = grpc_code_name(Code::from(i32::from(status)));
                self.metrics.answered(Answered::Grpc { method, code }, duration);
            }
        }
        if let Some(code) = code.filter(|&code| code != ErrorCode::Cancelled.entry().code) {
            self.metrics.rejected_after(code, duration);
        }
    }
}

impl Drop for AccessLine {
    fn drop(&mut self) {
        let duration = self.context.arrival.elapsed();
        let noted = self.context.notes.take();
        let (status, code) = self.outcome(&noted);
        self.count((status, code), duration);
        if let Some(open) = &noted.open {
            self.metrics.caller_asked(open.caller());
        }
        self.write((status, code), &noted, duration);
    }
}

/// The number of a gRPC status.
pub(super) fn status_number(code: Code) -> u16 {
    u16::try_from(i32::from(code)).unwrap_or_default()
}

/// The name of a gRPC status in the words of its specification.
const fn grpc_code_name(code: Code) -> &'static str {
    match code {
        Code::Ok => "OK",
        Code::Cancelled => "CANCELLED",
        Code::Unknown => "UNKNOWN",
        Code::InvalidArgument => "INVALID_ARGUMENT",
        Code::DeadlineExceeded => "DEADLINE_EXCEEDED",
        Code::NotFound => "NOT_FOUND",
        Code::AlreadyExists => "ALREADY_EXISTS",
        Code::PermissionDenied => "PERMISSION_DENIED",
        Code::ResourceExhausted => "RESOURCE_EXHAUSTED",
        Code::FailedPrecondition => "FAILED_PRECONDITION",
        Code::Aborted => "ABORTED",
        Code::OutOfRange => "OUT_OF_RANGE",
        Code::Unimplemented => "UNIMPLEMENTED",
        Code::Internal => "INTERNAL",
        Code::Unavailable => "UNAVAILABLE",
        Code::DataLoss => "DATA_LOSS",
        Code::Unauthenticated => "UNAUTHENTICATED",
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn id_for(given: &'static str) -> String {
        request_id(&HeaderMap::from_iter([(REQUEST_ID, HeaderValue::from_static(given))]))
    }

    #[test]
    fn valid_request_id_is_taken_over() {
        assert_eq!(id_for("caller-7:a/b"), "caller-7:a/b");
    }

    #[test]
    fn invalid_request_id_is_replaced() {
        for invalid in ["", "two words"] {
            assert_eq!(Uuid::parse_str(&id_for(invalid)).unwrap().get_version_num(), 7, "{invalid:?}");
        }
    }
}
