//! The OpenAPI 3.1 document, made of the endpoints, the messages with the comments of `proto/`, the rules of the jobs and
//! the error table.

mod lines;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde_json::{Map, Value, json};
use utoipa::ToSchema;
use utoipa::openapi::{RefOr, Schema};

use super::operation::{Access, Answer, Operation, Request};
use super::problem_json::ProblemBody;
use crate::api::ApiState;
use crate::contract::ErrorCode;
use crate::contract::message::{GetLimitsResponse, Queued, ValidateResponse};
use crate::jobs::{Kind, Limits, Visitor};
use crate::rules::Rule;

/// What every request with a body may be refused with.
const REFUSALS: [ErrorCode; 9] = [
    ErrorCode::MemoryFull,
    ErrorCode::MalformedBody,
    ErrorCode::BodyTimeout,
    ErrorCode::BodyTooLarge,
    ErrorCode::UnsupportedMedia,
    ErrorCode::InvalidField,
    ErrorCode::InvalidValue,
    ErrorCode::ProblemTooLarge,
    ErrorCode::Unavailable,
];
/// What a request that waits for a worker may end with as well.
const FAILURES: [ErrorCode; 6] = [
    ErrorCode::QueueFull,
    ErrorCode::DeadlineUnreachable,
    ErrorCode::DeadlineExceeded,
    ErrorCode::TimeLimitExceeded,
    ErrorCode::SolverPanic,
    ErrorCode::Internal,
];

/// What a key is for, in the document.
const ABOUT_KEYS: &str = "An API key, where the server has any configured. Each belongs to one caller; keys may be added and \
    withdrawn while the server runs, and where several callers have keys each of them may use all workers and half of the \
    queue: beyond, `queue_full`.";

/// The document of a server with these operations, by path.
pub(super) fn document(state: &ApiState, operations: impl Iterator<Item = (String, Access, Operation)>) -> Vec<u8> {
    let mut messages = Messages::new();
    state.jobs.each(&mut messages);
    let mut bounded = Bounded { limits: state.jobs.limits(), messages };
    state.jobs.each(&mut bounded);
    let document = json!({
        "openapi": "3.1.0",
        "info": {
            "title": "slipdrive",
            "version": env!("CARGO_PKG_VERSION"),
            "description": env!("CARGO_PKG_DESCRIPTION"),
            "license": {"name": env!("CARGO_PKG_LICENSE"), "identifier": env!("CARGO_PKG_LICENSE")},
        },
        "security": [{}, {"api_key": []}],
        "paths": paths(operations),
        "components": {
            "schemas": bounded.messages.schemas,
            "securitySchemes": {"api_key": {"type": "http", "scheme": "bearer", "description": ABOUT_KEYS}},
        },
    });
    serde_json::to_vec(&document).expect("a document of names and numbers is valid JSON")
}

/// Messages of requests that answers hold too, and that keep their rules there: a robot joined with its payload is valid,
/// and so is a sample that is answered as a simulation.
const VALID_IN_ANSWERS: [&str; 8] =
    ["BodyPoint", "ManeuverLimits", "Payload", "Robot", "SimulateGrid", "SimulateRequest", "State", "WorldPoint"];

/// Schemas by name.
struct Messages {
    schemas: BTreeMap<String, Value>,
    /// Names of those that answers of jobs hold, where they need not keep the rules of requests.
    in_answers: BTreeSet<String>,
}

impl Messages {
    fn new() -> Self {
        let mut messages = Self { schemas: BTreeMap::new(), in_answers: BTreeSet::new() };
        messages.add::<ValidateResponse>();
        messages.add::<GetLimitsResponse>();
        messages.add::<Queued>();
        messages.add::<ProblemBody<'_>>();
        messages
    }

    /// Adds a schema and those that it refers to; gives their names.
    fn add<T: ToSchema>(&mut self) -> Vec<String> {
        let mut collected: Vec<(String, RefOr<Schema>)> = vec![(T::name().into_owned(), T::schema())];
        T::schemas(&mut collected);
        let names = collected.iter().map(|(name, _)| name.clone()).collect();
        let to_value = |(name, schema)| (name, serde_json::to_value(schema).unwrap_or_default());
        self.schemas.extend(collected.into_iter().map(to_value));
        names
    }

    /// Where the bounds of the field at a dotted path below a schema are written: in the schema of its object, or, where
    /// answers hold such objects too and need not keep them, beside the reference to it.
    fn field(&mut self, root: &str, path: &str) -> Option<&mut Map<String, Value>> {
        let (mut schema, mut rest) = (root.to_owned(), path);
        while let Some((object, below)) = rest.split_once('.') {
            // `corners[].x_m`: the items of an array are the objects.
            let (object, is_array) = object.strip_suffix("[]").map_or((object, false), |array| (array, true));
            let property = self.schemas.get(&schema)?.get("properties")?.get(object)?;
            let property = if is_array { property.get("items")? } else { property };
            let target = property["$ref"].as_str()?.rsplit('/').next()?.to_owned();
            if self.in_answers.contains(&target) {
                let kind = self.schemas.get(&target)?.get("properties")?.get(below)?.get("type")?.clone();
                let bounds = &mut self.schemas.get_mut(&schema)?["properties"][object]["properties"][below];
                *bounds = json!({"type": kind});
                return bounds.as_object_mut();
            }
            (schema, rest) = (target, below);
        }
        self.schemas.get_mut(&schema)?.get_mut("properties")?.get_mut(rest)?.as_object_mut()
    }
}

impl Visitor for Messages {
    fn visit<K: Kind>(&mut self, _kind: &Arc<K>) {
        self.add::<K::Request>();
        let in_answer = self.add::<K::Answer>();
        self.in_answers.extend(in_answer.into_iter().filter(|name| !VALID_IN_ANSWERS.contains(&name.as_str())));
        if K::REPORTS_PROGRESS {
            self.add::<K::Report>();
        }
    }
}

/// Writes the rules of all kinds into the schemas.
struct Bounded<'a> {
    limits: &'a Limits,
    messages: Messages,
}

impl Visitor for Bounded<'_> {
    fn visit<K: Kind>(&mut self, _kind: &Arc<K>) {
        for (path, rule) in K::rules(self.limits).fields {
            let field = self.messages.field(&K::Request::name(), &path);
            bound(field.unwrap_or_else(|| panic!("`{path}` is no field of /{}", K::NAME)), &rule);
        }
    }
}

fn bound(field: &mut Map<String, Value>, rule: &Rule) {
    let is_length = rule.unit == Rule::ITEMS;
    let is_integer = is_length || field.get("type").is_some_and(|kind| kind == "integer");
    #[expect(clippy::cast_possible_truncation, reason = "bounds of counts are whole numbers far below 2^53")]
    let number = |bound: f64| if is_integer { json!(bound as i64) } else { json!(bound) };
    let (lower, upper) = match (is_length, rule.exclusive_minimum, rule.exclusive_maximum) {
        (true, ..) => ("minItems", "maxItems"),
        (false, true, false) => ("exclusiveMinimum", "maximum"),
        (false, true, true) => ("exclusiveMinimum", "exclusiveMaximum"),
        (false, false, false) => ("minimum", "maximum"),
        (false, false, true) => ("minimum", "exclusiveMaximum"),
    };
    field.remove("minimum");
    field.insert(lower.to_owned(), number(rule.minimum));
    if rule.maximum.is_finite() {
        field.insert(upper.to_owned(), number(rule.maximum));
    }
}

fn paths(operations: impl Iterator<Item = (String, Access, Operation)>) -> Map<String, Value> {
    let path = |(path, access, operation): (String, Access, Operation)| {
        let method = if operation.request.is_some() { "post" } else { "get" };
        (path, json!({ method: written(&operation, access) }))
    };
    operations.map(path).collect()
}

fn written(operation: &Operation, access: Access) -> Value {
    let mut errors = operation.errors.clone();
    if access == Access::WithKey {
        errors.push(ErrorCode::Unauthenticated);
    }
    let mut written = json!({"operationId": operation.id, "summary": operation.summary});
    if operation.has_events {
        let about = format!("With `Accept: text/event-stream` it answers as `/{}/events` does.", operation.id);
        written["description"] = json!(about);
    }
    if let Some(request) = &operation.request {
        let mut parameters = vec![request_id()];
        if !matches!(request, Request::Immediate(_)) {
            parameters.push(request_timeout());
        }
        errors.extend(errors_of(request, &operation.answer));
        written["parameters"] = json!(parameters);
        written["requestBody"] = json!({"required": true, "content": content_of(request)});
    }
    if access == Access::WithKey && !errors.contains(&ErrorCode::QueueFull) {
        // Who has many requests open beside those of other callers is refused whatever it asks.
        errors.push(ErrorCode::QueueFull);
    }
    if access != Access::WithKey {
        written["security"] = json!([]);
    }
    let mut responses = responses_of(&errors);
    responses.insert("200".to_owned(), success(&operation.answer));
    written["responses"] = json!(responses);
    written
}

fn content_of(request: &Request) -> Value {
    match request {
        Request::Immediate(name) | Request::Queued(name) => json!({"application/json": schema(name)}),
        Request::Lines(jobs) => lines::request(jobs),
    }
}

fn errors_of(request: &Request, answer: &Answer) -> Vec<ErrorCode> {
    // A stream begins with its status: what happens later is an event or a line.
    match (request, answer) {
        (Request::Lines(_), _) => lines::REFUSALS.to_vec(),
        (Request::Immediate(_), _) => REFUSALS.to_vec(),
        (Request::Queued(_), Answer::Events { .. }) => {
            [&REFUSALS[..], &[ErrorCode::QueueFull, ErrorCode::DeadlineUnreachable]].concat()
        }
        (Request::Queued(_), _) => [&REFUSALS[..], &FAILURES].concat(),
    }
}

fn success(answer: &Answer) -> Value {
    match answer {
        Answer::Json(name) => json!({"description": "done", "content": {"application/json": schema(name)}}),
        Answer::Object(meaning) => {
            json!({"description": meaning, "content": {"application/json": {"schema": {"type": "object"}}}})
        }
        Answer::Text(meaning) => {
            json!({"description": meaning, "content": {"text/plain": {"schema": {"type": "string"}}}})
        }
        Answer::Events { progress, result } => {
            let about = "the events `queued`, then `progress` as it comes, and last either `result` or `problem`; the data \
                         of each is one line of JSON, by the schemas in `x-events`";
            let of = |name: &str| schema(name)["schema"].clone();
            let events = json!({
                "queued": of("Queued"), "progress": of(progress), "result": of(result), "problem": of("Problem"),
            });
            let content = json!({"schema": {"type": "string"}, "x-events": events});
            json!({"description": about, "content": {"text/event-stream": content}})
        }
        Answer::Lines(jobs) => lines::answer(jobs),
    }
}

/// One response per status, which names its codes.
fn responses_of(codes: &[ErrorCode]) -> BTreeMap<String, Value> {
    let mut by_status: BTreeMap<u16, Vec<String>> = BTreeMap::new();
    for code in codes {
        let entry = code.entry();
        by_status.entry(entry.http_status).or_default().push(format!("`{}`: {}", entry.code, entry.title));
    }
    let response = |(status, codes): (u16, Vec<String>)| {
        let content = json!({"application/problem+json": schema("Problem")});
        (status.to_string(), json!({"description": codes.join("; "), "content": content}))
    };
    by_status.into_iter().map(response).collect()
}

pub(super) fn schema(name: &str) -> Value {
    json!({"schema": {"$ref": format!("#/components/schemas/{name}")}})
}

fn request_id() -> Value {
    let about =
        "repeated in the answer where it is 1 to 128 printable characters of ASCII without spaces, else replaced";
    parameter("X-Request-Id", &json!({"type": "string"}), about)
}

fn request_timeout() -> Value {
    let about = "milliseconds from arrival, waiting included, until the answer is needed";
    parameter("Request-Timeout-Ms", &json!({"type": "integer", "minimum": 1}), about)
}

fn parameter(name: &str, schema: &Value, description: &str) -> Value {
    json!({"name": name, "in": "header", "required": false, "schema": schema, "description": description})
}
