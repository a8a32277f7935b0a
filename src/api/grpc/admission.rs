//! The checks before a call is read, in the order of the contract: key, path, readiness, type and size, queue room.
//!
//! The message of a unary call is received here, within the limit and in time, so that a full queue refuses before
//! anything is parsed and a slow sender holds no permit.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderMap, Method, header};

use super::batch::instead_of_item;
use super::framed_body::{FRAME_HEAD_BYTES, FramedBody, HeadsAndMessages, only_message};
use crate::api::access::RequestContext;
use crate::api::read_ahead::{Pace, ReadAhead};
use crate::api::receive::{connection_of, only_probes, receive};
use crate::api::server::Use;
use crate::api::submit::Caller;
use crate::api::{ApiState, CAUSE_IS_LOGGED};
use crate::contract::{BodyLimit, ErrorCode, Problem};
use crate::jobs::{AsWritten, Jobs, Kind, Limits, Visitor};
use crate::service::{Class, Permit};

const MANEUVER_SERVICE: &str = "/slipdrive.v1.ManeuverService/";
/// The call whose items are of any kind.
const BATCH: &str = "Batch";
const HEALTH_SERVICE: &str = "/grpc.health.v1.Health/";
const REFLECTION_SERVICE: &str = "/grpc.reflection.";
/// Longest message of a health check, bytes: the name of a service.
const HEALTH_MESSAGE_BYTES: usize = 1024;

/// What a handler gets with its call.
#[derive(Clone)]
pub(super) struct Call {
    /// The id for errors and logs.
    pub(super) request_id: String,
    /// Whose it is.
    pub(super) caller: Caller,
    /// Its longest message.
    pub(super) limit: BodyLimit,
    /// The permit to queue its job, until it is taken.
    permit: Arc<Mutex<Option<Permit>>>,
}

impl Call {
    /// The reserved permit; given once.
    pub(super) fn take_permit(&self) -> Result<Permit, Problem> {
        let permit = self.permit.lock().unwrap_or_else(PoisonError::into_inner).take();
        permit.ok_or_else(|| Problem::new(ErrorCode::Internal, CAUSE_IS_LOGGED))
    }
}

/// What a method needs before it is called.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Needs {
    /// One message and a permit to queue a job of this class.
    MessageAndPermit(Class),
    /// One message.
    Message,
    /// One message, also while the server ends.
    MessageAtAnyTime,
    /// Messages as they come.
    Stream,
}

/// What is judged of a message before it is read.
type Survey = fn(&[u8]) -> Result<(), Problem>;

/// A method.
#[derive(Clone, Copy)]
struct CallNeeds {
    name: &'static str,
    needs: Needs,
    /// Its longest message.
    limit: BodyLimit,
    /// Of its message, where there is one.
    survey: Survey,
}

/// What each method needs: those of jobs, and those that wait for no worker.
pub(super) struct Methods {
    limits: Limits,
    known: Vec<CallNeeds>,
}

impl Visitor for Methods {
    fn visit<K: Kind>(&mut self, _kind: &Arc<K>) {
        let limit = K::body_limit(&self.limits);
        let (needs, survey): (_, Survey) =
            (Needs::MessageAndPermit(K::CLASS), |message| K::survey(AsWritten::Protobuf(message)));
        self.known.extend(K::METHODS.iter().map(|name| CallNeeds { name, needs, limit, survey }));
    }
}

impl Methods {
    pub(super) fn of(jobs: &Jobs) -> Self {
        let mut methods = Self { limits: *jobs.limits(), known: Vec::new() };
        jobs.each(&mut methods);
        let (largest, usual) = (methods.longest_message(), jobs.limits().body());
        let others = [
            ("Validate", Needs::Message, usual),
            ("GetLimits", Needs::MessageAtAnyTime, usual),
            // The framework that reads their messages knows one limit for all.
            ("SolveBatch", Needs::Stream, largest),
            (BATCH, Needs::Stream, largest),
        ];
        let of = |(name, needs, limit)| CallNeeds { name, needs, limit, survey: |_| Ok(()) };
        methods.known.extend(others.map(of));
        methods
    }

    /// The longest message of any method.
    pub(super) fn longest_message(&self) -> BodyLimit {
        self.known.iter().map(|method| method.limit).max().unwrap_or(self.limits.body())
    }

    fn find(&self, path: &str) -> Option<CallNeeds> {
        let method = path.strip_prefix(MANEUVER_SERVICE)?;
        self.known.iter().find(|known| known.name == method).copied()
    }

    /// The longest message of a method.
    pub(super) fn limit_of(&self, path: &str) -> BodyLimit {
        self.find(path).map_or(self.limits.body(), |method| method.limit)
    }

    /// Whether the path is a method of the service.
    pub(super) fn has(&self, path: &str) -> bool {
        self.find(path).is_some()
    }

    /// The method for the counts: a word of this server, whatever the caller asks.
    pub(super) fn label(&self, path: &str) -> &'static str {
        match self.find(path) {
            Some(method) => method.name,
            None if path.starts_with(HEALTH_SERVICE) => "health",
            None if path.starts_with(REFLECTION_SERVICE) => "reflection",
            None => "other",
        }
    }
}

/// Whether the path is that of a probe.
pub(super) fn is_probe(path: &str) -> bool {
    path.starts_with(HEALTH_SERVICE)
}

/// Whether the path belongs to another service, which speaks for itself.
pub(super) fn is_foreign(path: &str) -> bool {
    is_probe(path) || path.starts_with(REFLECTION_SERVICE)
}

/// The call, ready for its handler.
///
/// # Errors
/// The first check that it does not pass.
pub(super) async fn admit(
    state: &ApiState,
    methods: &Methods,
    request: Request,
    context: &RequestContext,
) -> Result<Request, Problem> {
    let path = request.uri().path();
    let connection = connection_of(request.extensions());
    if path.starts_with(HEALTH_SERVICE) {
        let (head, mut body) = request.into_parts();
        let limit = (BodyLimit::of(HEALTH_MESSAGE_BYTES), FRAME_HEAD_BYTES);
        let (message, _) = receive(&mut body, limit, state.settings.body_timeout, &connection).await?;
        return Ok(Request::from_parts(head, Body::from(message)));
    }
    if connection.may == Use::Probes {
        return Err(only_probes());
    }
    let Some(credential) = state.settings.keys.admit(request.headers()) else {
        let detail = "the API key is missing or wrong: send the metadata `authorization: Bearer KEY`";
        return Err(Problem::new(ErrorCode::Unauthenticated, detail));
    };
    credential.enter(&context.notes, &connection, state.service.metrics())?;
    let Some(CallNeeds { name, needs, limit, survey }) = methods.find(path) else { return Ok(request) };
    if request.method() != Method::POST {
        let detail = format!("`{path}` does not take {}, allowed: POST", request.method());
        return Err(Problem::new(ErrorCode::MethodNotAllowed, detail));
    }
    if needs != Needs::MessageAtAnyTime {
        state.service.check_open()?;
    }
    check_media_type(request.headers())?;
    let deadline = deadline(request.headers(), context.arrival)?;
    let (mut head, mut body) = request.into_parts();
    let body = match needs {
        Needs::Stream => {
            // Calls share their connection: what is not read of one holds up the others.
            let pace = Pace { pause_bytes: None, keeps_room: true, message_timeout: state.settings.body_timeout };
            // Items of the older call are solves.
            let instead = if name == BATCH { instead_of_item } else { |_: &[u8]| None };
            let framing = HeadsAndMessages { limit: limit.bytes, instead };
            let messages = ReadAhead::of(body, framing, pace, &connection);
            Body::new(FramedBody { messages, request_id: context.request_id.clone() })
        }
        Needs::MessageAndPermit(_) | Needs::Message | Needs::MessageAtAnyTime => {
            let limit = (limit, FRAME_HEAD_BYTES);
            let (message, lease) = receive(&mut body, limit, state.settings.body_timeout, &connection).await?;
            only_message(&message)?.map_or(Ok(()), survey)?;
            Body::from(Arc::new(lease).holding(message.into()))
        }
    };
    let permit = match needs {
        Needs::MessageAndPermit(class) => Some(state.service.reserve_in(credential.share(), class)?),
        Needs::Message | Needs::MessageAtAnyTime | Needs::Stream => None,
    };
    let (request_id, permit) = (context.request_id.clone(), Arc::new(Mutex::new(permit)));
    let caller = Caller { notes: context.notes.clone(), deadline, connection, credential };
    head.extensions.insert(Call { request_id, caller, limit, permit });
    Ok(Request::from_parts(head, body))
}

fn check_media_type(headers: &HeaderMap) -> Result<(), Problem> {
    let unsupported = |detail: String| Err(Problem::new(ErrorCode::UnsupportedMedia, detail));
    let content_type = headers.get(header::CONTENT_TYPE);
    let is_protobuf = content_type.and_then(|value| value.to_str().ok()).is_some_and(|text| {
        let media_type = text.split(';').next().unwrap_or_default().trim();
        matches!(media_type, "application/grpc" | "application/grpc+proto")
    });
    if !is_protobuf {
        let given = content_type.map_or_else(|| "missing".to_owned(), |value| format!("{value:?}"));
        return unsupported(format!("`content-type` is {given}, must be application/grpc"));
    }
    match headers.get("grpc-encoding") {
        Some(encoding) if encoding.as_bytes() != b"identity" => {
            unsupported(format!("`grpc-encoding` is {encoding:?}, must be identity"))
        }
        _ => Ok(()),
    }
}

/// When the caller needs the answer: `grpc-timeout` after arrival, if it is given.
fn deadline(headers: &HeaderMap, arrival: Instant) -> Result<Option<Instant>, Problem> {
    let Some(given) = headers.get("grpc-timeout") else { return Ok(None) };
    let Some(timeout) = given.to_str().ok().and_then(parse_timeout) else {
        let detail = format!("`grpc-timeout` is {given:?}, must be at most 8 digits and a unit of H, M, S, m, u, n");
        return Err(Problem::new(ErrorCode::InvalidValue, detail));
    };
    // Beyond the clock's range no deadline ever comes.
    Ok(arrival.checked_add(timeout))
}

fn parse_timeout(text: &str) -> Option<Duration> {
    let (digits, unit) = text.split_at_checked(text.len().checked_sub(1)?)?;
    if digits.len() > 8 || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let number: u64 = digits.parse().ok()?;
    match unit {
        "H" => Some(Duration::from_secs(number * 3600)),
        "M" => Some(Duration::from_secs(number * 60)),
        "S" => Some(Duration::from_secs(number)),
        "m" => Some(Duration::from_millis(number)),
        "u" => Some(Duration::from_micros(number)),
        "n" => Some(Duration::from_nanos(number)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::InProcessSolver;
    use crate::metrics::Metrics;

    #[test]
    fn every_call_counts_under_its_own_name() {
        let methods = Methods::of(&Jobs::new(Limits::default(), Arc::new(InProcessSolver), &Metrics::new()));
        for method in [
            "Solve",
            "SolveStream",
            "SolveBatch",
            "Batch",
            "Simulate",
            "Present",
            "Export",
            "Assess",
            "Validate",
            "GetLimits",
        ] {
            let path = format!("{MANEUVER_SERVICE}{method}");
            assert!(methods.has(&path) && methods.label(&path) == method, "{method}");
        }
        assert_eq!(methods.label("/grpc.health.v1.Health/Check"), "health");
        assert_eq!(methods.label("/slipdrive.v1.ManeuverService/Nothing"), "other");
    }

    #[test]
    fn timeouts_have_digits_and_a_unit() {
        assert_eq!(parse_timeout("250m"), Some(Duration::from_millis(250)));
        assert_eq!(parse_timeout("99999999H"), Some(Duration::from_secs(99_999_999 * 3600)));
        for invalid in ["", "m", "1", "-1S", "123456789S", "1s", "1é"] {
            assert_eq!(parse_timeout(invalid), None, "{invalid}");
        }
    }
}
