//! The id of a request and its line in the log, the same for every transport.

use std::time::Instant;

use axum::http::{HeaderMap, HeaderName, Method};
use uuid::Uuid;

use super::error_table::ErrorCode;

/// Carries the id of a request in both directions.
pub(super) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Longest request id that is taken over from a caller, characters: enough for any tracing scheme, too short to
/// flood a log.
const MAX_REQUEST_ID: usize = 128;
/// Longest part of a path that is repeated in logs and problems, characters.
const MAX_PATH: usize = 200;

/// The caller's own id, if it is sane, else a new one.
pub(super) fn request_id(headers: &HeaderMap) -> String {
    let is_sane =
        |id: &&str| (1..=MAX_REQUEST_ID).contains(&id.len()) && id.bytes().all(|byte| byte.is_ascii_graphic());
    let given = headers.get(REQUEST_ID).and_then(|value| value.to_str().ok()).filter(is_sane);
    given.map_or_else(|| Uuid::now_v7().to_string(), str::to_owned)
}

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

impl RequestContext {
    /// The context of the request that arrives at this moment.
    pub(super) fn of(path: &str, headers: &HeaderMap) -> Self {
        let path = path.chars().take(MAX_PATH).collect();
        Self { arrival: Instant::now(), path, request_id: request_id(headers) }
    }
}

/// One line of the log, written when the request is over: also when the caller left and the handler was dropped.
pub(super) struct AccessLine {
    method: Method,
    context: RequestContext,
    /// HTTP or gRPC status, once there is an answer.
    pub(super) status: Option<u16>,
    /// The code of the problem that was answered, if any.
    pub(super) code: Option<&'static str>,
}

impl AccessLine {
    /// Opens the line of a request.
    pub(super) fn open(method: Method, context: RequestContext) -> Self {
        Self { method, context, status: None, code: None }
    }
}

impl Drop for AccessLine {
    fn drop(&mut self) {
        // No answer means that the caller left.
        let gone = ErrorCode::Cancelled.entry();
        let (status, code) = match self.status {
            Some(status) => (status, self.code),
            None => (gone.http_status, Some(gone.code)),
        };
        let duration_ms = self.context.arrival.elapsed().as_secs_f64() * 1e3;
        tracing::info!(
            request.id = self.context.request_id,
            http.method = %self.method,
            http.path = self.context.path,
            response.status = status,
            problem.code = code,
            request.duration_ms = duration_ms,
            "request"
        );
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
