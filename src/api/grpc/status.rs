//! Errors as gRPC statuses with the rich details of `google.rpc`.

use std::collections::HashMap;

use prost::Message as _;
use tonic::Status;
use tonic::metadata::{MetadataMap, MetadataValue};
use tonic_types::{ErrorDetails, FieldViolation, StatusExt as _};

use crate::contract::{ErrorCode, Problem, path_of_pointer};

/// Who speaks in the error details.
const DOMAIN: &str = "slipdrive";
/// Says to retrying clients when to come back; -1: not at all.
const PUSHBACK: &str = "grpc-retry-pushback-ms";

/// What the violations in trailers may hold, bytes: clients refuse trailers of more than 8 KiB as they like, with a status that is worth
/// retrying, and some of that is for what else there is and for base64.
const VIOLATION_BYTES: usize = 3 * 1024;
/// Where it is said how many there are beyond.
const LEFT_OUT: &str = "violations_left_out";

/// The status that the caller of this request gets.
pub(super) fn of_problem(problem: &Problem, request_id: &str) -> Status {
    status(problem, request_id, VIOLATION_BYTES)
}

/// The same as a message with all violations, for answers that carry one.
pub(super) fn message_of(problem: &Problem, request_id: &str) -> tonic_types::Status {
    // Written just before: it can be read.
    tonic_types::Status::decode(status(problem, request_id, usize::MAX).details()).unwrap_or_default()
}

fn status(problem: &Problem, request_id: &str, violation_bytes: usize) -> Status {
    let entry = problem.code().entry();
    let mut details = ErrorDetails::new();
    let mut metadata = HashMap::from([("retryable".to_owned(), entry.retryable.to_string())]);
    let mut message = problem.detail().to_owned();
    if !problem.errors().is_empty() {
        let violations = violations(problem, violation_bytes);
        message = problem.detail_listing(violations.len());
        let left_out = problem.fault_count() - violations.len();
        if left_out > 0 {
            metadata.insert(LEFT_OUT.to_owned(), left_out.to_string());
        }
        details.set_bad_request(violations);
    }
    details.set_error_info(entry.code.to_uppercase(), DOMAIN, metadata);
    details.set_request_info(request_id, "");
    if let Some(wait) = problem.retry_after() {
        details.set_retry_info(Some(wait));
    }
    Status::with_error_details_and_metadata(
        tonic::Code::from(entry.grpc_code as i32),
        message,
        details,
        trailers(problem),
    )
}

/// The code in the details of a status that [`of_problem`] made.
pub(super) fn code_of(status: &Status) -> Option<ErrorCode> {
    let reason = status.get_error_details().error_info()?.reason.to_lowercase();
    ErrorCode::ALL.into_iter().find(|code| code.entry().code == reason)
}

/// The first of them, as many as take so many bytes.
fn violations(problem: &Problem, bytes: usize) -> Vec<FieldViolation> {
    let all = problem.errors().iter().map(|error| FieldViolation {
        field: path_of_pointer(&error.pointer),
        description: error.message.clone(),
        reason: error.code.to_uppercase(),
        localized_message: None,
    });
    let length = |of: &FieldViolation| of.field.len() + of.description.len() + of.reason.len();
    let mut taken = 0_usize;
    all.take_while(|violation| {
        taken += length(violation);
        taken <= bytes
    })
    .collect()
}

fn trailers(problem: &Problem) -> MetadataMap {
    let mut trailers = MetadataMap::new();
    let pushback = match problem.retry_after() {
        Some(wait) => wait.as_millis().to_string(),
        None if problem.code().entry().retryable => return trailers,
        // Retry policies go by the status alone: this says that the same request fails again.
        None => "-1".to_owned(),
    };
    if let Ok(value) = MetadataValue::try_from(pushback) {
        trailers.insert(PUSHBACK, value);
    }
    trailers
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tonic::Code;

    use super::*;
    use crate::rules::{Checks, Rule};
    use crate::service::ServiceError;

    #[test]
    fn overload_tells_when_to_come_back_in_detail_and_trailer() {
        let error = ServiceError::QueueFull { retry_after: Duration::from_millis(1500), capacity: 5 };
        let status = of_problem(&Problem::from(error), "id-1");
        assert_eq!(status.code(), Code::ResourceExhausted);
        assert_eq!(code_of(&status), Some(ErrorCode::QueueFull));
        let details = status.get_error_details();
        assert_eq!(details.error_info().unwrap().reason, "QUEUE_FULL");
        assert_eq!(details.retry_info().unwrap().retry_delay, Some(Duration::from_millis(1500)));
        assert_eq!(details.request_info().unwrap().request_id, "id-1");
        assert_eq!(status.metadata().get(PUSHBACK).unwrap(), "1500");
    }

    fn with_faults(count: usize) -> Problem {
        let mut checks = Checks::new();
        for index in 0..count {
            checks.bounds(&format!("torque_left_n_m[{index}]"), 9e9, &Rule::between(-1.0, 1.0, "N m"));
        }
        checks.finish().unwrap_err().into()
    }

    #[test]
    fn violations_in_trailers_are_few_and_the_rest_is_counted() {
        let problem = with_faults(100);
        let status = of_problem(&problem, "id-1");
        let details = status.get_error_details();
        let listed = details.bad_request().unwrap().field_violations.len();
        let left_out: usize = details.error_info().unwrap().metadata[LEFT_OUT].parse().unwrap();
        assert!(listed > 10 && listed + left_out == problem.errors().len(), "{listed} {left_out}");
        assert!(status.message().ends_with(&format!("the first {listed} are listed")), "{}", status.message());
        let trailers = status.clone().into_http::<()>().headers().iter().map(|(_, value)| value.len()).sum::<usize>();
        assert!(trailers < 6 * 1024, "{trailers}");
        assert!(message_of(&problem, "id-1").encoded_len() > 6 * 1024, "answers carry them all");
    }

    #[test]
    fn violations_that_are_listed_nowhere_are_counted_too() {
        let problem = with_faults(1000);
        let details = of_problem(&problem, "id-1").get_error_details();
        let listed = details.bad_request().unwrap().field_violations.len();
        assert_eq!(details.error_info().unwrap().metadata[LEFT_OUT], (1000 - listed).to_string());
    }

    #[test]
    fn what_fails_again_is_not_to_be_retried() {
        let status = of_problem(&Problem::new(ErrorCode::BodyTooLarge, "too large"), "id-1");
        assert_eq!(status.metadata().get(PUSHBACK).unwrap(), "-1");
    }
}
