//! The checks before a call is read, in the order of the contract: key, path, readiness, type and size, queue room.
//!
//! The message of a unary call is received here, within the limit and in time, so that a full queue refuses before
//! anything is parsed and a slow sender holds no place in the queue.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderMap, Method, header};
use http_body_util::{BodyExt as _, LengthLimitError, Limited};
use tokio::time::timeout;

use crate::api::Door;
use crate::api::access::{Notes, RequestContext};
use crate::api::error_table::ErrorCode;
use crate::api::problem::Problem;
use crate::service::Place;

const MANEUVER_SERVICE: &str = "/slipdrive.v1.ManeuverService/";
const HEALTH_SERVICE: &str = "/grpc.health.v1.Health/";
const REFLECTION_SERVICE: &str = "/grpc.reflection.";
/// Compression flag and length before each message.
const FRAME_HEAD_BYTES: usize = 5;

/// What a handler gets with its call.
#[derive(Clone)]
pub(super) struct Call {
    /// The id for errors and logs.
    pub(super) request_id: String,
    /// What its line in the log tells of its jobs.
    pub(super) notes: Notes,
    /// When the caller needs the answer.
    pub(super) deadline: Option<Instant>,
    /// The place in the queue, until it is taken.
    place: Arc<Mutex<Option<Place>>>,
}

impl Call {
    /// The reserved place; given once.
    pub(super) fn take_place(&self) -> Result<Place, Problem> {
        let place = self.place.lock().unwrap_or_else(PoisonError::into_inner).take();
        place.ok_or_else(|| Problem::new(ErrorCode::Internal, "the log holds the cause"))
    }
}

/// What a method needs before it is called.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Needs {
    /// One message and a place in the queue.
    MessageAndPlace,
    /// One message.
    Message,
    /// One message, also while the server ends.
    MessageAtAnyTime,
    /// Messages as they come.
    Stream,
}

/// The method for the counts: a word of this server, whatever the caller asks.
pub(super) fn method_of(path: &str) -> &'static str {
    const METHODS: [&str; 6] = ["Solve", "SolveStream", "SolveBatch", "Simulate", "Validate", "GetLimits"];
    let method = path.strip_prefix(MANEUVER_SERVICE).unwrap_or_default();
    match METHODS.iter().find(|known| **known == method) {
        Some(known) => known,
        None if path.starts_with(HEALTH_SERVICE) => "health",
        None if path.starts_with(REFLECTION_SERVICE) => "reflection",
        None => "other",
    }
}

fn needs_of(path: &str) -> Option<Needs> {
    match path.strip_prefix(MANEUVER_SERVICE)? {
        "Solve" | "SolveStream" | "Simulate" => Some(Needs::MessageAndPlace),
        "Validate" => Some(Needs::Message),
        "GetLimits" => Some(Needs::MessageAtAnyTime),
        "SolveBatch" => Some(Needs::Stream),
        _ => None,
    }
}

/// Whether the path is a method of the service.
pub(super) fn is_call(path: &str) -> bool {
    needs_of(path).is_some()
}

/// Whether the path belongs to another service, which speaks for itself.
pub(super) fn is_foreign(path: &str) -> bool {
    path.starts_with(HEALTH_SERVICE) || path.starts_with(REFLECTION_SERVICE)
}

/// The call, ready for its handler.
///
/// # Errors
/// The first check that it does not pass.
pub(super) async fn admit(door: &Door, request: Request, context: &RequestContext) -> Result<Request, Problem> {
    let path = request.uri().path();
    if !path.starts_with(HEALTH_SERVICE) && !door.settings.keys.admit(request.headers()) {
        let detail = "the API key is missing or wrong: send the metadata `authorization: Bearer KEY`";
        return Err(Problem::new(ErrorCode::Unauthenticated, detail));
    }
    let Some(needs) = needs_of(path) else { return Ok(request) };
    if request.method() != Method::POST {
        let detail = format!("`{path}` does not take {}, allowed: POST", request.method());
        return Err(Problem::new(ErrorCode::MethodNotAllowed, detail));
    }
    if needs != Needs::MessageAtAnyTime {
        door.service.check_open()?;
    }
    check_media_type(request.headers())?;
    let deadline = deadline(request.headers(), context.arrival)?;
    let (mut head, body) = request.into_parts();
    let body = match needs {
        Needs::Stream => body,
        Needs::MessageAndPlace | Needs::Message | Needs::MessageAtAnyTime => {
            receive(body, door.service.limits().max_body_bytes, door.settings.body_timeout).await?
        }
    };
    let place = if needs == Needs::MessageAndPlace { Some(door.service.reserve()?) } else { None };
    let (request_id, notes) = (context.request_id.clone(), context.notes.clone());
    head.extensions.insert(Call { request_id, notes, deadline, place: Arc::new(Mutex::new(place)) });
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
        return unsupported(format!("`content-type` is {content_type:?}, must be application/grpc"));
    }
    match headers.get("grpc-encoding") {
        Some(encoding) if encoding.as_bytes() != b"identity" => {
            unsupported(format!("`grpc-encoding` is {encoding:?}, must be identity"))
        }
        _ => Ok(()),
    }
}

async fn receive(body: Body, limit: usize, patience: Duration) -> Result<Body, Problem> {
    let collected = timeout(patience, Limited::new(body, limit + FRAME_HEAD_BYTES).collect()).await;
    match collected {
        Ok(Ok(collected)) => Ok(Body::from(collected.to_bytes())),
        Ok(Err(error)) if error.is::<LengthLimitError>() => Err(Problem::body_too_large(limit)),
        Ok(Err(error)) => {
            Err(Problem::new(ErrorCode::MalformedBody, format!("the message ended before it was complete: {error}")))
        }
        Err(_) => Err(Problem::new(ErrorCode::BodyTimeout, format!("the message was not complete after {patience:?}"))),
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

    #[test]
    fn every_call_counts_under_its_own_name() {
        for method in ["Solve", "SolveStream", "SolveBatch", "Simulate", "Validate", "GetLimits"] {
            let path = format!("{MANEUVER_SERVICE}{method}");
            assert!(is_call(&path) && method_of(&path) == method, "{method}");
        }
        assert_eq!(method_of("/grpc.health.v1.Health/Check"), "health");
        assert_eq!(method_of("/slipdrive.v1.ManeuverService/Nothing"), "other");
    }

    #[test]
    fn timeouts_have_digits_and_a_unit() {
        assert_eq!(parse_timeout("250m"), Some(Duration::from_millis(250)));
        assert_eq!(parse_timeout("99999999H"), Some(Duration::from_secs(99_999_999 * 3600)));
        for odd in ["", "m", "1", "-1S", "123456789S", "1s", "1é"] {
            assert_eq!(parse_timeout(odd), None, "{odd}");
        }
    }
}
