//! Holds what a server answers against the OpenAPI document that it serves.

use std::collections::HashMap;
use std::sync::Mutex;

use axum::body::{Body, to_bytes};
use axum::http::Request;
use jsonschema::Validator;
use serde_json::{Value, json};
use slipdrive::api::{ApiSettings, ApiState, rest};
use slipdrive::jobs::{Jobs, Limits};
use slipdrive::service::{Service, ServiceSettings};
use tokio::sync::OnceCell;
use tower::ServiceExt as _;

use super::instant_solver;

/// The document of a server, with the validators of its schemas.
pub(crate) struct Document {
    pub(crate) value: Value,
    validators: Mutex<HashMap<String, Validator>>,
}

/// The document of a server with default settings.
pub(crate) async fn document() -> &'static Document {
    static DOCUMENT: OnceCell<Document> = OnceCell::const_new();
    DOCUMENT.get_or_init(served).await
}

async fn served() -> Document {
    let service = Service::start(ServiceSettings::default()).unwrap();
    let jobs = Jobs::new(Limits::default(), instant_solver(), service.metrics());
    let router = rest::router(&ApiState::new(service.into(), jobs, ApiSettings::default()));
    let response =
        router.oneshot(Request::get("/openapi.json").header("host", "h").body(Body::empty()).unwrap()).await.unwrap();
    let bytes = to_bytes(response.into_body(), usize::MAX).await.unwrap();
    Document { value: serde_json::from_slice(&bytes).unwrap(), validators: Mutex::default() }
}

impl Document {
    /// Requires an answer to have the schema that the document gives it, and the faults of a refusal to point at fields of
    /// the request.
    pub(crate) fn check(&self, method: &str, path: &str, status: u16, content_type: &str, body: &[u8]) {
        let operation = &self.value["paths"][path][method.to_lowercase()];
        let about = format!("{status} of {method} {path}");
        match content_type {
            "application/problem+json" => {
                let problem: Value = serde_json::from_slice(body).unwrap();
                self.validate("Problem", &problem, &about);
                // Probes may be served elsewhere.
                if operation.is_object() && status != 404 {
                    let described = &operation["responses"][status.to_string()];
                    assert!(described.is_object(), "{about} is not described: {problem}");
                    self.check_pointers(operation, &problem);
                }
            }
            "text/event-stream" => self.check_events(&operation["responses"]["200"], body, &about),
            "application/json" if status == 200 && operation.is_object() => {
                let schema = &operation["responses"]["200"]["content"][content_type]["schema"];
                if let Some(reference) = schema["$ref"].as_str() {
                    self.validate(name_in(reference), &serde_json::from_slice(body).unwrap(), &about);
                }
            }
            _ => {}
        }
    }

    /// A line of the answer to a batch, which must have the schema of lines.
    pub(crate) fn line(&self, line: &[u8]) -> Value {
        let value = serde_json::from_slice(line).unwrap();
        let described = &self.value["paths"]["/batch"]["post"]["responses"]["200"]["content"];
        let schema = &described["application/x-ndjson"]["x-line"];
        assert!(schema.is_object(), "{described}");
        self.validate_by("a line of a batch", schema, &value, "a line");
        value
    }

    /// Requires a value to be valid under a schema.
    pub(crate) fn validate(&self, schema: &str, value: &Value, about: &str) {
        self.validate_by(schema, &json!({"$ref": format!("#/components/schemas/{schema}")}), value, about);
    }

    fn validate_by(&self, schema: &str, by: &Value, value: &Value, about: &str) {
        let mut validators = self.validators.lock().unwrap();
        let validator = validators.entry(schema.to_owned()).or_insert_with(|| {
            let mut whole = by.clone();
            whole["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
            whole["components"] = self.value["components"].clone();
            jsonschema::validator_for(&whole).unwrap()
        });
        let faults: Vec<_> =
            validator.iter_errors(value).map(|fault| format!("{}: {fault}", fault.instance_path())).collect();
        drop(validators);
        assert!(faults.is_empty(), "{about} is no {schema}: {faults:#?}");
    }

    fn check_events(&self, response: &Value, body: &[u8], about: &str) {
        let schemas = &response["content"]["text/event-stream"]["x-events"];
        let text = String::from_utf8_lossy(body);
        for event in text.split("\n\n").filter(|event| !event.starts_with(':') && !event.trim().is_empty()) {
            let field = |name: &str| event.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_default().trim();
            // `Accept` on another route gives events whose schemas are those of the route for events.
            let reference = schemas[field("event:")]["$ref"].as_str().unwrap_or("/Problem");
            if schemas.is_object() {
                self.validate(name_in(reference), &serde_json::from_str(field("data:")).unwrap(), about);
            }
        }
    }

    fn check_pointers(&self, operation: &Value, problem: &Value) {
        let request = &operation["requestBody"]["content"]["application/json"]["schema"];
        for error in problem["errors"].as_array().unwrap() {
            let pointer = error["pointer"].as_str().unwrap().strip_prefix('#').unwrap();
            // Of a field that does not exist, the object in which it stands.
            let is_unknown = error["message"].as_str().unwrap().contains("unknown field");
            let known = if is_unknown { pointer.rsplit_once('/').map_or("", |(parent, _)| parent) } else { pointer };
            assert!(self.field(request, known).is_some(), "{pointer} is no field of the request: {problem}");
        }
    }

    /// The schema at a pointer into an instance of a schema; the keywords beside a reference count too.
    pub(crate) fn field<'a>(&'a self, schema: &'a Value, pointer: &str) -> Option<&'a Value> {
        let segments = pointer.split('/').filter(|segment| !segment.is_empty());
        segments.into_iter().try_fold(schema, |schema, segment| self.below(schema, segment))
    }

    fn below<'a>(&'a self, schema: &'a Value, segment: &str) -> Option<&'a Value> {
        let own =
            if segment.parse::<usize>().is_ok() { schema.get("items") } else { schema["properties"].get(segment) };
        own.or_else(|| self.below(self.value.pointer(schema["$ref"].as_str()?.strip_prefix('#')?)?, segment))
    }
}

fn name_in(reference: &str) -> &str {
    reference.rsplit('/').next().unwrap_or_default()
}
