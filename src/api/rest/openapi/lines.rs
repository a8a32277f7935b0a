//! What the document says of bodies of many lines. OpenAPI 3.1 has a schema for a whole body only, so that of one line stands
//! in `x-line`.

use serde_json::{Map, Value, json};

use super::schema;
use crate::api::rest::batch::MEDIA_TYPE;
use crate::api::rest::operation::Job;
use crate::contract::ErrorCode;

/// What a request may be refused with before its lines are read; what comes later is a line.
pub(super) const REFUSALS: [ErrorCode; 4] =
    [ErrorCode::MalformedBody, ErrorCode::UnsupportedMedia, ErrorCode::InvalidValue, ErrorCode::Unavailable];

/// The body of a request.
pub(super) fn request(jobs: &[Job]) -> Value {
    let mut properties = Map::from_iter([
        (
            "request_id".to_owned(),
            json!({
                "description": "Names the item in its answer: unique among the unanswered items, at most 128 bytes of UTF-8.",
                "type": "string", "minLength": 1, "maxLength": 128,
            }),
        ),
        (
            "timeout_ms".to_owned(),
            json!({
                "description": "When the answer is needed, ms after the line was read, waiting included.",
                "type": "integer", "minimum": 1,
            }),
        ),
    ]);
    properties.extend(jobs.iter().map(|job| (job.name.to_owned(), reference(&job.request))));
    let one_of: Vec<_> = jobs.iter().map(|job| json!({"required": [job.name]})).collect();
    content(&json!({
        "type": "object",
        "properties": properties,
        "required": ["request_id"],
        "oneOf": one_of,
        "additionalProperties": false,
    }))
}

/// The success.
pub(super) fn answer(jobs: &[Job]) -> Value {
    let about = "a line for each item as it ends, in any order: its answer under the name of its kind, or its `problem`; \
                 `line` counts the lines of the request from 1 where one began no item, and a `problem` without \
                 `request_id` and `line` is that of the whole batch; the last line is `end`; each by the schema in `x-line`";
    let id = json!({"description": "The id of the item.", "type": "string"});
    let count = json!({"type": "integer", "minimum": 0});
    let mut lines: Vec<_> = jobs
        .iter()
        .map(|job| object(&json!({"request_id": id, job.name: reference(&job.answer)}), &["request_id", job.name]))
        .collect();
    let line = json!({"description": "The number of the line that began no item.", "type": "integer", "minimum": 1});
    let problem = json!({"line": line, "request_id": id, "problem": reference("Problem")});
    lines.push(object(&problem, &["problem"]));
    let end = object(&json!({"answered": count, "problems": count}), &["answered", "problems"]);
    lines.push(object(&json!({"end": end}), &["end"]));
    json!({"description": about, "content": content(&json!({"oneOf": lines}))})
}

fn content(line: &Value) -> Value {
    json!({MEDIA_TYPE: {"schema": {"type": "string"}, "x-line": line}})
}

fn object(properties: &Value, required: &[&str]) -> Value {
    json!({"type": "object", "properties": properties, "required": required})
}

fn reference(name: &str) -> Value {
    schema(name)["schema"].clone()
}
