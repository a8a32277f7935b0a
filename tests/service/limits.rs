//! The rules that a server lists are those that it keeps, and those that its OpenAPI document gives.

use serde_json::{Value, json};
use slipdrive::api::grpc::pb;
use tonic::Status;
use tonic_types::StatusExt as _;

use crate::support::conformance::document;
use crate::support::{TestServer, instant_solver};

/// Enough for the longest list of them.
const PARAMETERS: [&str; 15] = [
    "friction",
    "mass",
    "center_of_mass_right",
    "center_of_mass_forward",
    "torque",
    "torque_left",
    "start_heading",
    "torque_right",
    "payload_mass",
    "payload_right",
    "payload_forward",
    "start_x",
    "start_y",
    "delay_left",
    "delay_right",
];

/// One bound of one field, with a value on either side.
struct Bound {
    job: String,
    field: String,
    /// The keyword of JSON Schema.
    keyword: &'static str,
    limit: f64,
    inside: Value,
    outside: Value,
}

async fn bounds(server: &TestServer) -> Vec<Bound> {
    let limits = server.get("/limits").await.json();
    let rules = limits["rules"].as_array().unwrap().clone();
    rules.iter().flat_map(bounds_of).collect()
}

fn bounds_of(rule: &Value) -> Vec<Bound> {
    let text = |name: &str| rule[name].as_str().unwrap().to_owned();
    let (job, field, is_length) = (text("job"), text("field"), rule["unit"] == "items");
    let counts = ["grid.steps", "grid.control_intervals", "solver.starts", "solver.rollout_limit", "samples"];
    let integers = [&counts[..], &["start_time.sec", "start_time.nanosec"]].concat();
    let is_count = is_length || integers.contains(&field.as_str());
    let item = |index: usize| match field.as_str() {
        "joint_names" => json!(index.to_string()),
        "uncertain" => json!({"parameter": PARAMETERS[index % PARAMETERS.len()], "low": 0, "high": 0}),
        field if field.ends_with("_n_m") => json!(0),
        _ => json!({}),
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounds of counts are whole numbers")]
    let value = |number: f64| match (is_length, is_count) {
        (true, _) => json!((0..number as usize).map(item).collect::<Vec<_>>()),
        (false, true) => json!(number as i64),
        (false, false) => json!(number),
    };
    // The number itself or its neighbour, on the side that is accepted and on the other.
    let below = |bound: f64| if is_count { bound - 1.0 } else { bound.next_down() };
    let above = |bound: f64| if is_count { bound + 1.0 } else { bound.next_up() };
    let names = [
        ("minimum", if is_length { "minItems" } else { "minimum" }),
        ("exclusive_minimum", "exclusiveMinimum"),
        ("maximum", if is_length { "maxItems" } else { "maximum" }),
        ("exclusive_maximum", "exclusiveMaximum"),
    ];
    let of = |(name, keyword): (&str, &'static str)| {
        let limit = rule.get(name)?.as_f64()?;
        let (inside, outside) = match name {
            "minimum" => (limit, below(limit)),
            "exclusive_minimum" => (above(limit), limit),
            "exclusive_maximum" => (below(limit), limit),
            _ => (limit, above(limit)),
        };
        let (job, field) = (job.clone(), field.clone());
        Some(Bound { job, field, keyword, limit, inside: value(inside), outside: value(outside) })
    };
    names.into_iter().filter_map(of).collect()
}

/// A valid request with one other value.
fn request(bound: &Bound, value: &Value) -> Value {
    if bound.job == "present" {
        let plans = value.as_array().unwrap().iter().map(|_| json!({}));
        return json!({"plans": plans.collect::<Vec<_>>()});
    }
    // Three items whatever they mean: only what is said of the bound counts.
    let triangle = json!([{}, {}, {}]);
    let robot = json!({"motor_stall_torque_n_m": 1, "motor_free_speed_rad_s": 10, "footprint": triangle});
    if bound.job == "export" || bound.job == "assess" {
        let torques = json!({"interval_s": 0.1, "left_n_m": [0], "right_n_m": [0]});
        let simulate = json!({"request": {"torque_schedule": torques}, "answer": {}});
        let mut body = if bound.job == "export" {
            json!({"simulate": simulate, "format": "csv", "rate_hz": 100})
        } else {
            json!({"simulate": simulate, "tolerances": {}, "uncertain": [{"parameter": "mass", "low": 0, "high": 0}],
                   "robot": robot,
                   "payload": {"mass_kg": 0, "height_m": 0}})
        };
        *place_of(&mut body, &bound.field) = value.clone();
        return body;
    }
    let zeros = match value.as_array() {
        Some(items) if bound.field.ends_with("_n_m") => items.clone(),
        _ => vec![json!(0)],
    };
    let mut body = if bound.job == "solve" {
        json!({"maneuver": {"goal": {"y_m": 5}, "keep_in": triangle},
               "initial_guess": {"final_time_s": 1, "torque_left_n_m": zeros, "torque_right_n_m": zeros}})
    } else {
        json!({"torque_schedule": {"interval_s": 0.1, "left_n_m": zeros, "right_n_m": zeros}, "grid": {},
               "keep_in": triangle})
    };
    body["robot"] = robot;
    body["payload"] = json!({"mass_kg": 0, "height_m": 0});
    *place_of(&mut body, &bound.field) = value.clone();
    body
}

/// The field of a body; of lists that of the first item.
fn place_of<'a>(body: &'a mut Value, field: &str) -> &'a mut Value {
    field.split('.').fold(body, |place, name| match name.strip_suffix("[]") {
        Some(array) => &mut place[array][0],
        None => &mut place[name],
    })
}

/// Whether a refusal names the bound of a field.
fn names(bound: &Bound, message: &str) -> bool {
    let Some((beginning, rule)) = message.split_once(", must be ") else { return false };
    let numbers = rule.split(|c: char| !(c.is_ascii_digit() || ".-e".contains(c)));
    beginning.starts_with(&format!("`{}` is ", bound.field.replace("[]", "[0]")))
        && numbers.filter_map(|number| number.parse::<f64>().ok()).any(|number| number == bound.limit)
}

async fn refusal_of_rest(server: &TestServer, bound: &Bound, value: &Value) -> Vec<String> {
    let answer = server.post(&format!("/{}", bound.job), request(bound, value).to_string()).await;
    let errors = answer.json()["errors"].as_array().cloned().unwrap_or_default();
    errors.iter().map(|error| error["message"].as_str().unwrap().to_owned()).collect()
}

async fn refusal_of_grpc(server: &TestServer, bound: &Bound, value: &Value) -> Vec<String> {
    let (mut client, body) = (server.grpc().await, request(bound, value));
    let outcome: Result<(), Status> = match bound.job.as_str() {
        "solve" => client.solve(serde_json::from_value::<pb::SolveRequest>(body).unwrap()).await.map(drop),
        "present" => client.present(serde_json::from_value::<pb::PresentRequest>(body).unwrap()).await.map(drop),
        "assess" => client.assess(serde_json::from_value::<pb::AssessRequest>(body).unwrap()).await.map(drop),
        "export" => client.export(serde_json::from_value::<pb::ExportRequest>(body).unwrap()).await.map(drop),
        _ => client.simulate(serde_json::from_value::<pb::SimulateRequest>(body).unwrap()).await.map(drop),
    };
    let details = outcome.err().map(|status| status.get_error_details());
    let violations = details.and_then(|details| Some(details.bad_request()?.field_violations.clone()));
    violations.into_iter().flatten().map(|violation| violation.description).collect()
}

#[tokio::test]
async fn every_listed_bound_is_kept_by_both_transports() {
    let server = TestServer::start(4, instant_solver()).await;
    let bounds = bounds(&server).await;
    assert!(bounds.len() > 100, "{} bounds", bounds.len());
    for bound in &bounds {
        let about = format!("{} of {} in {}: {}", bound.keyword, bound.field, bound.job, bound.limit);
        let inside = [
            refusal_of_rest(&server, bound, &bound.inside).await,
            refusal_of_grpc(&server, bound, &bound.inside).await,
        ];
        let named = |messages: &Vec<String>| messages.iter().any(|message| names(bound, message));
        assert!(!inside.iter().any(named), "{about}: {inside:?}");
        let outside = [
            refusal_of_rest(&server, bound, &bound.outside).await,
            refusal_of_grpc(&server, bound, &bound.outside).await,
        ];
        assert!(outside.iter().all(named), "{about}: {outside:?}");
    }
}

#[tokio::test]
async fn document_has_the_listed_bounds() {
    let server = TestServer::start(4, instant_solver()).await;
    let document = document().await;
    for bound in bounds(&server).await {
        let path = format!("/{}", bound.job);
        let request = &document.value["paths"][path]["post"]["requestBody"]["content"]["application/json"]["schema"];
        let field = document
            .field(request, &bound.field.replace("[]", "/0").replace('.', "/"))
            .unwrap_or_else(|| panic!("{}", bound.field));
        assert_eq!(field[bound.keyword].as_f64(), Some(bound.limit), "{} of {}: {field}", bound.keyword, bound.field);
    }
}
