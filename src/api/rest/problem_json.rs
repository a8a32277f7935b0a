//! Errors as RFC 9457 `application/problem+json`.
//!
//! A handler returns a [`Problem`]; it travels in the response's extensions to
//! [`super::middleware`], which knows the request and writes the body.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::contract::{FieldError, Problem};
use crate::service::seconds;

/// The body that the caller of `instance` gets.
pub(super) fn body(problem: &Problem, instance: &str, request_id: &str) -> Vec<u8> {
    let entry = problem.code().entry();
    let body = ProblemBody {
        kind: format!("urn:slipdrive:problem:{}", entry.code),
        title: entry.title,
        status: entry.http_status,
        detail: problem.detail(),
        instance,
        code: entry.code,
        retryable: entry.retryable,
        retry_after_ms: problem.retry_after().map(|wait| u64::try_from(wait.as_millis()).unwrap_or(u64::MAX)),
        request_id,
        errors: problem.errors(),
    };
    serde_json::to_vec(&body).expect("a problem of strings and numbers is valid JSON")
}

/// An error as RFC 9457 says, with the code, the faults of single fields, and when to come back.
#[derive(Serialize, ToSchema)]
#[schema(as = Problem)]
pub(super) struct ProblemBody<'a> {
    /// Names the kind of problem, as a URI.
    #[serde(rename = "type")]
    kind: String,
    /// What kind of problem it is, for people.
    title: &'a str,
    /// The status of HTTP.
    status: u16,
    /// What happened this time, for people.
    detail: &'a str,
    /// The path that was asked.
    instance: &'a str,
    /// What kind of problem it is, for programs.
    code: &'a str,
    /// Whether the same request may succeed later.
    retryable: bool,
    /// When it is worth trying again, where that is known, ms.
    #[schema(required = true)]
    retry_after_ms: Option<u64>,
    /// The id of the request, which the log of the server has too.
    request_id: &'a str,
    /// The faults of single fields.
    errors: &'a [FieldError],
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.code().entry().http_status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = status.into_response();
        if let Some(wait) = self.retry_after() {
            response.headers_mut().insert(header::RETRY_AFTER, seconds(&wait).max(1).into());
        }
        response.extensions_mut().insert(self);
        response
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::service::ServiceError;

    #[test]
    fn retry_after_is_whole_seconds_of_at_least_one() {
        for (milliseconds, seconds) in [(1, "1"), (2000, "2"), (2851, "3")] {
            let retry_after = Duration::from_millis(milliseconds);
            for error in [
                ServiceError::QueueFull { retry_after, capacity: 4 },
                ServiceError::ShareUsedUp { retry_after, capacity: 4 },
                ServiceError::Unavailable { retry_after },
            ] {
                assert!(error.to_string().ends_with(&format!("try again in {seconds} s")), "{error}");
                let response = Problem::from(error).into_response();
                assert_eq!(response.headers()[header::RETRY_AFTER], seconds);
            }
        }
    }
}
