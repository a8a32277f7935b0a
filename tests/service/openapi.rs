//! The OpenAPI document is what was agreed on: a change must be meant.
//!
//! After a change that is meant: `SLIPDRIVE_UPDATE_SNAPSHOTS=1 cargo test --test service openapi`, then
//! `clients/python/make_types.py`.

use std::path::Path;

use serde_json::Value;

use crate::support::{TestServer, instant_solver};

#[tokio::test]
async fn document_is_the_committed_one() {
    let answer = TestServer::start(4, instant_solver()).await.get("/openapi.json").await;
    assert_eq!((answer.status, answer.header("content-type")), (200, "application/json"));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/openapi.json");
    // Over the wire it has no white space.
    let served = serde_json::to_string_pretty(&answer.json()).unwrap() + "\n";
    if std::env::var_os("SLIPDRIVE_UPDATE_SNAPSHOTS").is_some() {
        std::fs::write(&path, &served).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap();
    let difference = served.lines().zip(committed.lines()).position(|(served, committed)| served != committed);
    assert!(served == committed, "the document differs from {} at line {difference:?}", path.display());
}

#[tokio::test]
async fn every_reference_leads_to_a_schema() {
    let document = TestServer::start(4, instant_solver()).await.get("/openapi.json").await.json();
    assert_eq!(document["openapi"], "3.1.0");
    let mut references = Vec::new();
    collect(&document, &mut references);
    assert!(references.len() > 20, "{references:?}");
    for reference in references {
        let pointer = reference.strip_prefix('#').unwrap();
        assert!(document.pointer(pointer).is_some(), "{reference} leads nowhere");
    }
}

fn collect(value: &Value, references: &mut Vec<String>) {
    if let Some(reference) = value["$ref"].as_str() {
        references.push(reference.to_owned());
    }
    let children = value.as_object().into_iter().flat_map(|object| object.values());
    for child in children.chain(value.as_array().into_iter().flatten()) {
        collect(child, references);
    }
}

#[tokio::test]
async fn requests_have_rules_and_no_further_fields() {
    let document = TestServer::start(4, instant_solver()).await.get("/openapi.json").await.json();
    let robot = &document["components"]["schemas"]["Robot"];
    assert_eq!(robot["additionalProperties"], false);
    let radius = &robot["properties"]["wheel_radius_m"];
    assert_eq!((&radius["minimum"], &radius["maximum"]), (&1e-3.into(), &10.0.into()));
    assert!(radius["description"].as_str().unwrap().contains("default 0.06"), "{radius}");
    assert!(robot["required"].as_array().is_none_or(Vec::is_empty), "all fields have defaults");
    let grid = &document["components"]["schemas"]["SolveGrid"]["properties"]["steps"];
    assert_eq!((&grid["minimum"], &grid["maximum"]), (&1.into(), &10_000.into()));
}

#[tokio::test]
async fn every_field_has_a_meaning_and_none_a_default() {
    let document = TestServer::start(4, instant_solver()).await.get("/openapi.json").await.json();
    let schemas = document["components"]["schemas"].as_object().unwrap();
    for (name, schema) in schemas {
        assert!(!schema["description"].as_str().unwrap_or_default().is_empty(), "{name} has no meaning");
        for (field, property) in schema["properties"].as_object().into_iter().flatten() {
            // Of what may be null, beside the reference.
            let meaning = property["description"].as_str().or_else(|| property["oneOf"][0]["description"].as_str());
            assert!(meaning.is_some_and(|text| !text.is_empty()), "{name}.{field} has no meaning: {property}");
            // Generators turn it into a field that callers must send.
            assert!(property.get("default").is_none(), "{name}.{field} has a default: {property}");
        }
    }
}

#[tokio::test]
async fn keys_are_asked_for_where_they_are_checked() {
    let document = TestServer::start(4, instant_solver()).await.get("/openapi.json").await.json();
    for (path, operations) in document["paths"].as_object().unwrap() {
        for operation in operations.as_object().unwrap().values() {
            let is_open = ["/livez", "/readyz", "/metrics", "/limits"].contains(&path.as_str());
            assert_eq!(operation["responses"].get("401").is_none(), is_open, "{path}");
            assert_eq!(operation["security"] == Value::Array(Vec::new()), is_open, "{path}");
        }
    }
}
