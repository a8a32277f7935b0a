//! Receives a JSON body: readiness, size and type are judged before the first byte is parsed.

use std::time::{Duration, Instant};

use axum::body::Body;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};

use super::batch;
use crate::api::ApiState;
use crate::api::receive::{connection_of, receive};
use crate::api::server::Lease;
use crate::contract::{BodyLimit, ErrorCode, Problem};

/// One JSON object.
pub(super) const JSON: &str = "application/json";
/// How long the caller waits for the answer.
pub(super) const REQUEST_TIMEOUT_MS: HeaderName = HeaderName::from_static("request-timeout-ms");

/// When the caller needs the answer: `Request-Timeout-Ms` after arrival, if it is given.
///
/// # Errors
/// `invalid_value` when it is no whole number of milliseconds.
pub(super) fn deadline(headers: &HeaderMap, arrival: Instant) -> Result<Option<Instant>, Problem> {
    let Some(given) = headers.get(REQUEST_TIMEOUT_MS) else { return Ok(None) };
    let milliseconds = given.to_str().ok().and_then(|text| text.parse::<u64>().ok()).filter(|&number| number > 0);
    let Some(milliseconds) = milliseconds else {
        let detail = format!("`request-timeout-ms` is {given:?}, must be a whole number of milliseconds, at least 1");
        return Err(Problem::new(ErrorCode::InvalidValue, detail));
    };
    // Beyond the clock's range no deadline ever comes.
    Ok(arrival.checked_add(Duration::from_millis(milliseconds)))
}

/// The body of a JSON request, within `limit`, and the memory that is reserved for it.
///
/// # Errors
/// `unavailable`, `unsupported_media`, and those of [`receive`], in the order of the contract.
pub(super) async fn json_body(
    state: &ApiState,
    head: &Parts,
    mut body: Body,
    limit: BodyLimit,
) -> Result<(Vec<u8>, Lease), Problem> {
    admit(state, &head.headers, limit)?;
    receive(&mut body, (limit, 0), state.settings.body_timeout, &connection_of(&head.extensions)).await
}

/// When the caller of a request of many lines needs all answers.
///
/// # Errors
/// `unavailable`, `unsupported_media` and `invalid_value`, in the order of the contract.
pub(super) fn admit_lines(state: &ApiState, headers: &HeaderMap, arrival: Instant) -> Result<Option<Instant>, Problem> {
    state.service.check_open()?;
    check_media_type(headers, batch::MEDIA_TYPE)?;
    deadline(headers, arrival)
}

fn admit(state: &ApiState, headers: &HeaderMap, limit: BodyLimit) -> Result<(), Problem> {
    state.service.check_open()?;
    let declared = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse::<u64>().ok());
    if declared.is_some_and(|length| length > limit.bytes as u64) {
        return Err(Problem::body_too_large(limit));
    }
    check_media_type(headers, JSON)
}

fn check_media_type(headers: &HeaderMap, expected: &str) -> Result<(), Problem> {
    let unsupported = |detail: String| Err(Problem::new(ErrorCode::UnsupportedMedia, detail));
    if let Some(encoding) = headers.get(header::CONTENT_ENCODING)
        && !encoding.as_bytes().eq_ignore_ascii_case(b"identity")
    {
        return unsupported(format!("`content-encoding` is {encoding:?}, must be identity"));
    }
    let is_undone = |coding: &HeaderValue| coding.as_bytes().eq_ignore_ascii_case(b"chunked");
    if let Some(coding) = headers.get_all(header::TRANSFER_ENCODING).iter().find(|coding| !is_undone(coding)) {
        return unsupported(format!("`transfer-encoding` is {coding:?}, must be chunked"));
    }
    let Some(given) = headers.get(header::CONTENT_TYPE) else {
        return unsupported(format!("`content-type` is missing, must be {expected}"));
    };
    let text = given.to_str().unwrap_or_default();
    let mut parts = text.split(';').map(str::trim);
    let is_expected = parts.next().is_some_and(|media_type| media_type.eq_ignore_ascii_case(expected));
    let is_utf8 = parts.all(|parameter| match parameter.split_once('=') {
        Some((name, value)) if name.eq_ignore_ascii_case("charset") => {
            value.trim_matches('"').eq_ignore_ascii_case("utf-8")
        }
        _ => true,
    });
    if is_expected && is_utf8 {
        Ok(())
    } else {
        unsupported(format!("`content-type` is {given:?}, must be {expected} in UTF-8"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_supported(content_type: &'static str) -> bool {
        let headers = HeaderMap::from_iter([(header::CONTENT_TYPE, HeaderValue::from_static(content_type))]);
        check_media_type(&headers, JSON).is_ok()
    }

    #[test]
    fn json_in_utf8_is_supported_and_nothing_else() {
        for supported in ["application/json", "Application/JSON; charset=UTF-8", "application/json;charset=\"utf-8\""] {
            assert!(is_supported(supported), "{supported}");
        }
        for unsupported in ["", "text/plain", "application/jsonp", "application/json; charset=latin1"] {
            assert!(!is_supported(unsupported), "{unsupported}");
        }
    }

    #[test]
    fn compressed_bodies_are_not_supported() {
        let with = |name, value| {
            let json = (header::CONTENT_TYPE, HeaderValue::from_static("application/json"));
            check_media_type(&HeaderMap::from_iter([json, (name, HeaderValue::from_static(value))]), JSON)
        };
        for name in [header::CONTENT_ENCODING, header::TRANSFER_ENCODING] {
            assert_eq!(with(name, "gzip").unwrap_err().code(), ErrorCode::UnsupportedMedia);
        }
        assert!(with(header::TRANSFER_ENCODING, "gzip, chunked").is_err());
        assert!(with(header::TRANSFER_ENCODING, "Chunked").is_ok());
    }
}
