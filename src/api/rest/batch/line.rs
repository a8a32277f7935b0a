//! One line of a batch: `{"request_id": "a", "timeout_ms": 5000, "solve": {..}}`.

use std::sync::Arc;

use super::kinds::{Asked, Kinds};
use crate::api::batch::Item;
use crate::contract::convert::required;
use crate::contract::{ErrorCode, Problem, json};

const REQUEST_ID: &str = "request_id";
const TIMEOUT: &str = "timeout_ms";

/// The item of a line.
///
/// # Errors
/// `malformed_body` or `invalid_field` where not even its id can be read.
pub(super) fn read(line: &[u8], kinds: &Kinds) -> Result<Item<Asked>, Problem> {
    let fields = json::read_fields(line)?;
    let value_of = |name: &str| fields.iter().find(|(field, _)| field == name).map(|(_, value)| *value);
    let request_id = required(value_of(REQUEST_ID), REQUEST_ID)?;
    let request_id = json::read_field(REQUEST_ID, request_id)?;
    let timeout = value_of(TIMEOUT).map(|value| json::read_field::<json::Count>(TIMEOUT, value)).transpose();
    // Whatever is beyond the type is as good as no deadline.
    let timeout_ms = timeout.as_ref().ok().and_then(Option::as_ref).map(json::Count::saturated);
    let others = fields.iter().filter(|(name, _)| name != REQUEST_ID && name != TIMEOUT);
    let others: Vec<_> = others.map(|(name, value)| (name.as_str(), value.get())).collect();
    let request = timeout.and_then(|_| asked(&others, kinds));
    Ok(Item { request_id, timeout_ms, request })
}

fn asked(fields: &[(&str, &str)], kinds: &Kinds) -> Result<Asked, Problem> {
    if let Some((name, _)) = fields.iter().find(|(name, _)| kinds.find(name).is_none()) {
        let known = [REQUEST_ID, TIMEOUT].into_iter().chain(kinds.names());
        let known: Vec<_> = known.map(|name| format!("`{name}`")).collect();
        return Err(json::faulty_field(name, &format!("unknown field, expected one of {}", known.join(", "))));
    }
    match fields {
        [(name, value)] => {
            let kind = kinds.find(name).map(Arc::clone);
            let kind = kind.ok_or_else(|| Problem::new(ErrorCode::Internal, crate::api::CAUSE_IS_LOGGED))?;
            Ok(Asked { kind, body: value.as_bytes().to_vec() })
        }
        [] => Err(json::faulty_field("", &format!("missing one of {}", listed(kinds.names())))),
        [_, (second, _), ..] => {
            let all = listed(fields.iter().map(|(name, _)| *name));
            Err(json::faulty_field(second, &format!("a line asks for one job, this one for {all}")))
        }
    }
}

fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::{InProcessSolver, Jobs, Limits};
    use crate::metrics::Metrics;

    fn kinds() -> Kinds {
        Kinds::of(&Jobs::new(Limits::default(), Arc::new(InProcessSolver), &Metrics::new()))
    }

    #[test]
    fn line_names_an_item_and_what_it_asks() {
        let line = r#" {"solve": { "view": "plan" } , "request_id": "a\"b", "timeout_ms": 5e3}"#;
        let item = read(line.as_bytes(), &kinds()).unwrap();
        assert_eq!((item.request_id.as_str(), item.timeout_ms), ("a\"b", Some(5000)));
        assert_eq!(item.request.ok().unwrap().body, br#"{ "view": "plan" }"#);
    }

    #[test]
    fn timeout_beyond_the_clock_is_none_that_ends_anything() {
        for timeout_ms in ["5000000000", "99999999999999999999"] {
            let line = format!(r#"{{"request_id": "a", "solve": {{}}, "timeout_ms": {timeout_ms}}}"#);
            assert_eq!(read(line.as_bytes(), &kinds()).unwrap().timeout_ms, Some(u32::MAX));
        }
    }

    #[test]
    fn line_without_a_readable_id_is_no_item() {
        for (line, code, pointer) in [
            ("{", ErrorCode::MalformedBody, None),
            (r#"{"request_id": "a", "solve": {}} x"#, ErrorCode::MalformedBody, None),
            (r#"{"request_id": "a", "solve": {]}}"#, ErrorCode::MalformedBody, None),
            ("[]", ErrorCode::InvalidField, Some("#")),
            ("null", ErrorCode::InvalidField, Some("#")),
            (r#"{"solve": {}}"#, ErrorCode::InvalidField, Some("#/request_id")),
            (r#"{"request_id": 7, "solve": {}}"#, ErrorCode::InvalidField, Some("#/request_id")),
            (r#"{"request_id": null, "solve": {}}"#, ErrorCode::InvalidField, Some("#/request_id")),
            (r#"{"request_id": "a", "request_id": "b"}"#, ErrorCode::InvalidField, Some("#/request_id")),
        ] {
            let problem = read(line.as_bytes(), &kinds()).err().unwrap();
            let pointer_of = problem.errors().first().map(|error| error.pointer.as_str());
            assert_eq!((problem.code(), pointer_of), (code, pointer), "{line}: {problem}");
        }
        assert_eq!(read(b"{\"request_id\": \"\xff\"}", &kinds()).err().unwrap().code(), ErrorCode::MalformedBody);
    }

    #[test]
    fn item_that_asks_for_nothing_or_too_much_says_so() {
        for (line, pointer) in [
            (r#"{"request_id": "a"}"#, "#"),
            (r#"{"request_id": "a", "solv": {}}"#, "#/solv"),
            (r#"{"request_id": "a", "solve": {}, "simulate": {}}"#, "#/simulate"),
            (r#"{"request_id": "a", "solve": {}, "timeout_ms": -1}"#, "#/timeout_ms"),
            (r#"{"request_id": "a", "solve": {}, "timeout_ms": null}"#, "#/timeout_ms"),
        ] {
            let item = read(line.as_bytes(), &kinds()).ok().unwrap();
            let problem = item.request.err().unwrap();
            assert_eq!((item.request_id.as_str(), problem.code()), ("a", ErrorCode::InvalidField));
            assert_eq!(problem.errors()[0].pointer, pointer, "{line}: {problem}");
        }
    }
}
