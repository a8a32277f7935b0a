//! How many plans a request has, before they are read: an empty one is two bytes of a message, and kilobytes once it is read.

use prost::bytes::Bytes;
use serde::Deserialize;
use serde_json::value::RawValue;

use super::PLANS_RULE;
use crate::contract::{ErrorCode, Problem, json};
use crate::jobs::AsWritten;
use crate::rules::Checks;

/// So many are read, so that all that is wrong with them can be said at once.
const MOST_READ: usize = 64;

/// The plans of a message, not yet read.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct PlansOfMessage {
    #[prost(bytes = "bytes", repeated, tag = "1")]
    plans: Vec<Bytes>,
}

#[derive(Deserialize)]
struct PlansOfJson<'a> {
    #[serde(borrow, default)]
    plans: Vec<&'a RawValue>,
}

/// Refuses a request with far too many plans.
pub(super) fn check(request: AsWritten<'_>) -> Result<(), Problem> {
    match request {
        AsWritten::Json(body) => check_count(json::read_object::<PlansOfJson<'_>>(body)?.plans.len()),
        AsWritten::Protobuf(message) => {
            let plans: Result<PlansOfMessage, _> = prost::Message::decode(message);
            plans.map_err(|error| Problem::new(ErrorCode::MalformedBody, error.to_string()))?.check()
        }
    }
}

impl PlansOfMessage {
    /// Refuses far too many of them.
    pub(crate) fn check(&self) -> Result<(), Problem> {
        check_count(self.plans.len())
    }

    /// As many without content.
    pub(crate) fn emptied(&self) -> Self {
        Self { plans: vec![Bytes::new(); self.plans.len()] }
    }
}

fn check_count(count: usize) -> Result<(), Problem> {
    let mut checks = Checks::new();
    if count > MOST_READ {
        checks.length("plans", count, &PLANS_RULE);
    }
    Ok(checks.finish()?)
}

#[cfg(test)]
mod tests {
    use prost::Message as _;

    use super::*;
    use crate::contract::message::{PresentRequest, PresentedPlan};
    use crate::jobs::present::Present;
    use crate::jobs::{Kind as _, Limits};

    #[test]
    fn far_too_many_plans_are_counted_and_not_read() {
        let request = |count| PresentRequest { plans: vec![PresentedPlan::default(); count], report: false };
        for count in [0, 4, MOST_READ, MOST_READ + 1, 5000] {
            let is_read = count <= MOST_READ;
            let in_json = format!("{{\"plans\": [{}]}}", vec!["{}"; count].join(","));
            for judged in [
                Present::survey(AsWritten::Protobuf(&request(count).encode_to_vec())),
                Present::survey(AsWritten::Json(in_json.as_bytes())),
            ] {
                let problem = judged.err();
                assert_eq!(problem.is_none(), is_read, "{count}");
                if let Some(problem) = problem {
                    assert_eq!((problem.code(), &*problem.errors()[0].pointer), (ErrorCode::InvalidValue, "#/plans"));
                    assert!(problem.detail().contains(&count.to_string()), "{problem}");
                }
            }
        }
        for faulty in ["{\"plans\": 5}", "{\"plans\": [], \"plans\": []}", "{\"plans\": [}"] {
            let read = Present::read(faulty.as_bytes(), &Limits::default()).unwrap_err();
            assert_eq!(Present::survey(AsWritten::Json(faulty.as_bytes())).unwrap_err(), read);
        }
        assert!(Present::survey(AsWritten::Protobuf(&[0x0a, 0x05])).is_err(), "its end is missing");
    }
}
