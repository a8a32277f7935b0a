//! The OpenAPI 3.1 document, made of the wire types, the error table, and the rules in the words of the checks.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};
use utoipa::ToSchema;
use utoipa::openapi::{RefOr, Schema};

use super::problem_json::ProblemBody;
use crate::api::error_table::ErrorCode;
use crate::api::message::limits::{LimitsMessage, RuleMessage, rules};
use crate::api::message::request::{SimulateRequest, SolveRequest};
use crate::api::message::response::{ProgressEvent, QueuedEvent, SimulateAnswer, SolveAnswer, ValidateAnswer};
use crate::service::Limits;

/// The document of a server with these limits.
pub(super) fn document(limits: &Limits) -> Vec<u8> {
    let mut schemas = schemas();
    annotate(&mut schemas, &rules(limits));
    set_maxima(&mut schemas, limits);
    allow_null_in_answers(&mut schemas);
    flatten_validate_answer(&mut schemas);
    let document = json!({
        "openapi": "3.1.0",
        "info": {
            "title": "slipdrive",
            "version": env!("CARGO_PKG_VERSION"),
            "description": env!("CARGO_PKG_DESCRIPTION"),
            "license": {"name": env!("CARGO_PKG_LICENSE"), "identifier": env!("CARGO_PKG_LICENSE")},
        },
        "security": [{}, {"api_key": []}],
        "paths": paths(),
        "components": {
            "schemas": schemas,
            "securitySchemes": {"api_key": {"type": "http", "scheme": "bearer"}},
        },
    });
    serde_json::to_vec_pretty(&document).expect("a document of names and numbers is valid JSON")
}

fn schemas() -> BTreeMap<String, Value> {
    let mut collected = Vec::new();
    collect::<SolveRequest>(&mut collected);
    collect::<SolveAnswer<'_>>(&mut collected);
    collect::<SimulateRequest>(&mut collected);
    collect::<SimulateAnswer>(&mut collected);
    collect::<ValidateAnswer<'_>>(&mut collected);
    collect::<LimitsMessage>(&mut collected);
    collect::<QueuedEvent>(&mut collected);
    collect::<ProgressEvent>(&mut collected);
    collect::<ProblemBody<'_>>(&mut collected);
    let to_value = |schema: &RefOr<Schema>| serde_json::to_value(schema).unwrap_or_default();
    collected.iter().map(|(name, schema)| (name.clone(), to_value(schema))).collect()
}

fn collect<T: ToSchema>(collected: &mut Vec<(String, RefOr<Schema>)>) {
    collected.push((T::name().into_owned(), T::schema()));
    T::schemas(collected);
}

/// Requests, by schema; the rules of their fields begin with this path.
const REQUESTS: [(&str, &str); 10] = [
    ("SolveRequest", ""),
    ("Robot", "robot."),
    ("Maneuver", "maneuver."),
    ("State", "maneuver.start."),
    ("Goal", "maneuver.goal."),
    ("SolveGrid", "grid."),
    ("Solver", "solver."),
    ("InitialGuess", "initial_guess."),
    ("SimulateRequest", ""),
    ("SimulateGrid", "grid."),
];

/// Adds rules to the properties of requests, and says that they are never null: an absent field is absent.
fn annotate(schemas: &mut BTreeMap<String, Value>, rules: &[RuleMessage]) {
    for (schema, path) in REQUESTS {
        let Some(properties) = properties_of(schemas, schema) else { continue };
        for (name, property) in properties {
            let Some(property) = property.as_object_mut() else { continue };
            without_null(property);
            if let Some(rule) = rules.iter().find(|rule| rule.field == format!("{path}{name}")) {
                property.insert("description".to_owned(), json!(format!("must be {}", rule.rule)));
                property.extend(bounds(&rule.rule));
            }
        }
    }
}

fn without_null(property: &mut Map<String, Value>) {
    if property.get("default").is_some_and(Value::is_null) {
        property.remove("default");
    }
    if let Some([only, null]) = property.get("type").and_then(Value::as_array).map(Vec::as_slice)
        && null == "null"
    {
        let only = only.clone();
        property.insert("type".to_owned(), only);
    }
    let options = property.get("oneOf").and_then(Value::as_array).cloned().unwrap_or_default();
    if let [one, null] = options.as_slice()
        && null["type"] == "null"
    {
        let one = one.as_object().cloned().unwrap_or_default();
        property.remove("oneOf");
        property.extend(one);
    }
}

/// Numbers of answers that are not finite are written as null.
fn allow_null_in_answers(schemas: &mut BTreeMap<String, Value>) {
    let is_answer = |name: &str| name != "Limits" && !REQUESTS.iter().any(|(request, _)| *request == name);
    for (_, schema) in schemas.iter_mut().filter(|(name, _)| is_answer(name)) {
        let properties = schema.get_mut("properties").and_then(Value::as_object_mut);
        for property in properties.into_iter().flat_map(Map::values_mut) {
            let number = if property["items"].is_object() { &mut property["items"] } else { property };
            if number["type"] == "number" {
                number["type"] = json!(["number", "null"]);
            }
        }
    }
}

/// The completed request with its hash: as one object, since the request alone takes no further field.
fn flatten_validate_answer(schemas: &mut BTreeMap<String, Value>) {
    let mut answer = schemas.get("SolveRequest").cloned().unwrap_or_default();
    answer["description"] = json!("The completed request, and the SHA-256 of it in hexadecimal.");
    answer["properties"]["input_hash"] = json!({"type": "string"});
    answer["required"] = json!(["robot", "maneuver", "grid", "solver", "view", "input_hash"]);
    schemas.insert("ValidateAnswer".to_owned(), answer);
}

/// The bounds in a rule such as `> 0 m` or `between -1 and 1 m`.
fn bounds(rule: &str) -> Map<String, Value> {
    let words: Vec<_> = rule.split(' ').collect();
    let bounds = match words.as_slice() {
        [">", bound, ..] => vec![("exclusiveMinimum", *bound)],
        [">=", bound, ..] => vec![("minimum", *bound)],
        ["between", lower, "and", upper, ..] => vec![("minimum", *lower), ("maximum", *upper)],
        _ => Vec::new(),
    };
    let numbers =
        bounds.into_iter().filter_map(|(name, bound)| Some((name.to_owned(), json!(bound.parse::<f64>().ok()?))));
    numbers.collect()
}

fn set_maxima(schemas: &mut BTreeMap<String, Value>, limits: &Limits) {
    let maxima = [
        ("SolveGrid", "steps", json!(limits.max_steps)),
        ("SolveGrid", "control_intervals", json!(limits.max_control_intervals)),
        ("Solver", "starts", json!(limits.max_starts)),
        ("Solver", "rollout_limit", json!(limits.max_rollout_limit)),
        ("Solver", "time_limit_s", json!(limits.max_time_limit_s)),
    ];
    for (schema, name, maximum) in maxima {
        let property = properties_of(schemas, schema).and_then(|properties| properties.get_mut(name)?.as_object_mut());
        if let Some(property) = property {
            property.insert("maximum".to_owned(), maximum);
        }
    }
}

fn properties_of<'a>(schemas: &'a mut BTreeMap<String, Value>, name: &str) -> Option<&'a mut Map<String, Value>> {
    schemas.get_mut(name)?.get_mut("properties")?.as_object_mut()
}

fn paths() -> Value {
    let solve = json!({
        "200": {
            "description": "a plan, whatever its status; with `Accept: text/event-stream` the events `queued`, \
                            `progress`, and last either `result` or `problem`",
            "content": {
                "application/json": schema("SolveAnswer"),
                "text/event-stream": {"schema": {"type": "string"}},
            },
        },
    });
    json!({
        "/solve": {"post": post("solve", "solves one maneuver", "SolveRequest", &solve, Kind::Queued)},
        "/simulate": {"post": post("simulate", "integrates one torque schedule", "SimulateRequest", &ok("SimulateAnswer"), Kind::Queued)},
        "/validate": {"post": post("validate", "checks and completes a maneuver", "SolveRequest", &ok("ValidateAnswer"), Kind::Immediate)},
        "/limits": {"get": get("limits", "what this server accepts at most", &ok("Limits"))},
        "/examples/forward-drive": {"get": get("forward_drive", "a complete body for `/solve`: the paper's case", &ok("SolveRequest"))},
        "/livez": {"get": get("livez", "whether the process lives", &plain("it does"))},
        "/readyz": {"get": get("readyz", "whether new callers are welcome", &plain("they are"))},
    })
}

/// Whether a request waits for a worker.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Queued,
    Immediate,
}

fn post(id: &str, summary: &str, body: &str, answers: &Value, kind: Kind) -> Value {
    let mut responses = errors_of(&REFUSALS);
    responses.extend(answers.as_object().cloned().unwrap_or_default());
    let about = "echoed where it is 1 to 128 printable characters of ASCII without spaces, else replaced";
    let mut parameters = vec![parameter("X-Request-Id", &json!({"type": "string"}), about)];
    if kind == Kind::Queued {
        let about = "milliseconds from arrival, waiting included, until the answer is needed";
        parameters.push(parameter("Request-Timeout-Ms", &json!({"type": "integer", "minimum": 1}), about));
        responses.extend(errors_of(&[ErrorCode::QueueFull, ErrorCode::DeadlineUnreachable]));
        responses.extend(errors_of(&[ErrorCode::DeadlineExceeded]));
        responses.extend(errors_of(&[ErrorCode::SolverPanic, ErrorCode::Internal]));
    }
    json!({
        "operationId": id,
        "summary": summary,
        "parameters": parameters,
        "requestBody": {"required": true, "content": {"application/json": schema(body)}},
        "responses": responses,
    })
}

/// What every request with a body may be refused with.
const REFUSALS: [ErrorCode; 9] = [
    ErrorCode::MalformedBody,
    ErrorCode::Unauthenticated,
    ErrorCode::BodyTimeout,
    ErrorCode::BodyTooLarge,
    ErrorCode::UnsupportedMedia,
    ErrorCode::InvalidField,
    ErrorCode::InvalidValue,
    ErrorCode::ProblemTooLarge,
    ErrorCode::Unavailable,
];

fn get(id: &str, summary: &str, answers: &Value) -> Value {
    let mut responses = errors_of(&[ErrorCode::Unauthenticated, ErrorCode::Unavailable]);
    responses.extend(answers.as_object().cloned().unwrap_or_default());
    json!({"operationId": id, "summary": summary, "responses": responses})
}

/// One response per status, which names its codes.
fn errors_of(codes: &[ErrorCode]) -> Map<String, Value> {
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

fn ok(name: &str) -> Value {
    json!({"200": {"description": "done", "content": {"application/json": schema(name)}}})
}

fn plain(description: &str) -> Value {
    json!({"200": {"description": description, "content": {"application/json": {"schema": {"type": "object"}}}}})
}

fn schema(name: &str) -> Value {
    json!({"schema": {"$ref": format!("#/components/schemas/{name}")}})
}

fn parameter(name: &str, schema: &Value, description: &str) -> Value {
    json!({"name": name, "in": "header", "required": false, "schema": schema, "description": description})
}
