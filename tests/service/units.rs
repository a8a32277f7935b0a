//! What is exported and said: between nodes, by either reference point, in the units that stand beside the numbers.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::{Value, json};
use slipdrive::jobs::assess::Assess;
use slipdrive::jobs::{Jobs, Kind as _, Limits};
use slipdrive::service::{Class, Service, ServiceSettings};

use crate::export::{columns, exported};
use crate::support::{TestServer, real_solver};

/// The columns of the rows that a motion is exported as.
async fn exported_columns(server: &TestServer, request: &Value, rate_hz: f64) -> BTreeMap<String, Vec<f64>> {
    let body = json!({"simulate": {"request": request, "answer": {}}, "format": "csv", "rate_hz": rate_hz});
    columns(&exported(server, &body).await.0["trajectory.csv"])
}

#[tokio::test]
async fn between_nodes_wheels_turn_by_the_area_below_their_rates() {
    let server = TestServer::start(4, real_solver()).await;
    let torques = json!({"interval_s": 0.2, "left_n_m": [0.6, -0.2], "right_n_m": [0.6, 0.1]});
    // Ten points in each of four steps.
    let of = exported_columns(&server, &json!({"torque_schedule": torques, "grid": {"steps": 4}}), 100.0).await;
    let times = &of["time_s"];
    for (position, rate) in [
        ("wheel_angle_left_rad", "wheel_rate_left_rad_s"),
        ("wheel_angle_right_rad", "wheel_rate_right_rad_s"),
        ("yaw_rad", "yaw_rate_rad_s"),
    ] {
        let (position, rate) = (&of[position], &of[rate]);
        for at in 1..times.len() {
            let area = 0.5 * (times[at] - times[at - 1]) * (rate[at - 1] + rate[at]);
            // Rates are linear within each step, whose ends are points.
            assert!((position[at] - position[at - 1] - area).abs() < 1e-12, "{} s: {area}", times[at]);
        }
    }
}

#[tokio::test]
async fn files_speak_of_the_axle_midpoint_whatever_the_plan_speaks_of() {
    let server = TestServer::start(4, real_solver()).await;
    let torques = json!({"interval_s": 0.2, "left_n_m": [0.2, -0.2], "right_n_m": [0.3, 0.1]});
    let (right, forward) = (-0.02, 0.07);
    let by_center = json!({"torque_schedule": torques, "grid": {"steps": 40}});
    // The same start: the axle midpoint is to the right of the centre of mass and behind it.
    let start = json!({"x_m": -right, "y_m": -forward});
    let by_axle =
        json!({"torque_schedule": torques, "grid": {"steps": 40}, "reference_point": "axle_midpoint", "start": start});
    let (one, other) =
        (exported_columns(&server, &by_center, 100.0).await, exported_columns(&server, &by_axle, 100.0).await);
    for (name, values) in &one {
        for (one, other) in values.iter().zip(&other[name]) {
            assert!((one - other).abs() < 1e-12, "{name}: {one} {other}");
        }
    }
}

/// The number before a unit in the sentence that begins so.
fn said(words: &Value, topic: &str, before: &str) -> f64 {
    let sentences = words["certificate"].as_array().unwrap().iter().map(|of| of.as_str().unwrap());
    let sentence = sentences.into_iter().find(|of| of.starts_with(topic)).unwrap_or_else(|| panic!("{topic}: {words}"));
    let head = &sentence[..sentence.find(before).unwrap_or_else(|| panic!("{before} in {sentence}"))];
    head.rsplit(' ').find(|word| !word.is_empty()).unwrap().parse().unwrap()
}

#[tokio::test]
async fn words_tell_the_numbers_of_the_answer_in_their_units() {
    let server = TestServer::start(4, real_solver()).await;
    let request = json!({"maneuver": {"goal": {"x_m": 0.5, "y_m": 2}, "limits": {"speed_m_s": 1.0}},
                         "grid": {"steps": 60, "control_intervals": 12}, "solver": {"starts": 1}, "view": "plan"});
    let mut answer = server.post("/solve", request.to_string()).await.json();
    let number = |answer: &Value, pointer: &str| answer.pointer(pointer).unwrap().as_f64().unwrap();
    // As of a plan whose speed is exceeded on the finer grid.
    answer["report"]["limits"][0]["replay_excess"] = json!(0.0325);
    let body = json!({"plans": [{"solve": {"request": request, "answer": answer}}]});
    let words = server.post("/present", body.to_string()).await.json()["plans"][0].clone();
    // Three digits are shown.
    let is_near = |found: f64, expected: f64| (found / expected - 1.0).abs() < 6e-3;
    let least = number(&answer, "/report/least_normal_load/share");
    assert!(is_near(said(&words, "Loads: ", " % of the weight"), 100.0 * least), "{words}");
    let slower = number(&answer, "/final_time_s") / number(&answer, "/report/lower_bound_s") - 1.0;
    assert!(is_near(said(&words, "Lower bound: ", " % longer"), 100.0 * slower), "{words}");
    assert!(is_near(said(&words, "Limit maneuver.limits.speed_m_s", " % on the finer one"), 3.25), "{words}");
    assert_eq!(said(&words, "Sensitivity: ", " % less friction"), 10.0, "{words}");
    let miss = number(&answer, "/report/replay/miss_m");
    assert!(is_near(said(&words, "Replay: ", " mm"), 1e3 * miss), "{words}");
}

#[tokio::test]
async fn table_of_an_assessment_has_per_cents() {
    let torques = json!({"interval_s": 1, "left_n_m": [0.3, -0.3], "right_n_m": [0.3, -0.3]});
    let request = json!({"robot": {"center_of_mass_right_m": 0}, "torque_schedule": torques, "grid": {"steps": 40}});
    let body = json!({"simulate": {"request": request, "answer": {}}, "samples": 200,
                      "uncertain": [{"parameter": "start_heading", "low": -0.1, "high": 0.1}],
                      "tolerances": {"across_m": 0.04}});
    let service = Service::start(ServiceSettings::default()).unwrap();
    let jobs = Jobs::new(Limits::default(), real_solver(), service.metrics());
    let accepted = Assess::read(body.to_string().as_bytes(), jobs.limits()).unwrap();
    let told = |accepted: &_, done: &_| (Assess::answer(accepted, done), Assess::table(accepted, done));
    let running = service.reserve(Class::Heavy).unwrap().submit(Arc::clone(&jobs.assess), accepted, None, told);
    let (answer, table) = running.unwrap().outcome().await.unwrap();
    let expected = format!(
        "{:.1} %, {} of 200 samples, 95 % interval {:.1} to {:.1} %",
        100.0 * answer.success_rate,
        answer.successes,
        100.0 * answer.success_rate_low,
        100.0 * answer.success_rate_high
    );
    assert!(table.contains(&expected) && answer.success_rate > 0.2, "{expected} is not in {table}");
}
