//! The paper's forward drive over real HTTP with the solver of the crate.

use serde_json::{Value, json};
use slipdrive::contract::json::write;
use slipdrive::contract::message::Solution;

use crate::support::{TestServer, real_solver};

async fn forward_drive(server: &TestServer) -> Value {
    let example = server.get("/examples/forward-drive").await.bytes;
    let answer = server.post("/solve", example).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.json()
}

/// Time that a wheel slips, s.
fn slip_time(answer: &Value, wheel: &str) -> f64 {
    let spans = answer["contact_modes"].as_array().unwrap();
    let slips = spans.iter().filter(|span| span[wheel] == "slip");
    slips.map(|span| span["end_s"].as_f64().unwrap() - span["start_s"].as_f64().unwrap()).sum()
}

#[tokio::test]
async fn paper_case_is_solved_as_in_the_paper() {
    let server = TestServer::start(4, real_solver()).await;
    let answer = forward_drive(&server).await;
    assert_eq!((&answer["status"], &answer["stop_reason"]), (&json!("converged"), &json!("finished")));
    let final_time = answer["final_time_s"].as_f64().unwrap();
    assert!(final_time <= 2.931, "the paper: 2.930 s, here {final_time} s");
    for (field, error) in answer["goal_error"].as_object().unwrap() {
        assert!(error.as_f64().unwrap().abs() <= 1e-6, "{field} is off by {error}");
    }
    for span in answer["contact_modes"].as_array().unwrap() {
        let sticks = span["left"] == "stick" && span["right"] == "stick";
        assert!(sticks || span["start_s"].as_f64().unwrap() >= 0.45 * final_time, "{span}");
    }
    assert!(slip_time(&answer, "right") > 0.2 * final_time);
    assert!(slip_time(&answer, "left") <= 0.02 * final_time);
    assert_eq!(answer["report"]["separations"], json!([]));
    assert!(answer["report"]["worst_contact_residual"].as_f64().unwrap() <= 1e-10);
    assert_eq!(answer["report"]["replay"]["steps"], json!(3200));
}

#[tokio::test]
async fn answer_can_be_read_back() {
    let server = TestServer::start(4, real_solver()).await;
    let example = server.get("/examples/forward-drive").await.bytes;
    for body in [
        example,
        br#"{"maneuver": {"torque_limit_left_n_m": 0, "torque_limit_right_n_m": 0, "goal": {"y_m": 1}}}"#.to_vec(),
    ] {
        let written = server.post("/solve", body).await.bytes;
        let read: Solution = serde_json::from_slice(&written).unwrap();
        assert_eq!(String::from_utf8(write(&read)), String::from_utf8(written));
    }
}

#[tokio::test]
async fn absent_steps_are_refined_and_the_completed_body_gets_the_same_plan() {
    let server = TestServer::start(4, real_solver()).await;
    let body = r#"{"maneuver": {"goal": {"y_m": 2}}, "solver": {"starts": 1}, "view": "plan"}"#;
    let answer = server.post("/solve", body).await.json();
    assert_eq!((&answer["status"], &answer["replay_confirmed"]), (&json!("converged"), &json!(true)));
    assert_eq!(answer["report"]["refinement"], "within_tolerance");
    let steps = answer["report"]["steps"].as_u64().unwrap();
    assert_eq!(answer["report"]["replay"]["steps"].as_u64().unwrap(), 16 * steps);
    let mut completed = server.post("/validate", body).await.json();
    assert_eq!(completed["grid"], json!({"control_intervals": 40}));
    completed.as_object_mut().unwrap().remove("input_hash");
    let again = server.post("/solve", completed.to_string()).await.json();
    assert_eq!(again["input_hash"], answer["input_hash"]);
    assert_eq!(again["torque_schedule"], answer["torque_schedule"]);
}

#[tokio::test]
async fn simulating_the_plan_ends_where_the_answer_says() {
    let server = TestServer::start(4, real_solver()).await;
    let answer = forward_drive(&server).await;
    let body = json!({ "torque_schedule": answer["torque_schedule"], "grid": { "steps": 200 } });
    let simulated = server.post("/simulate", body.to_string()).await;
    assert_eq!(simulated.status, 200, "{}", simulated.text());
    let trajectory = &simulated.json()["trajectory"];
    for field in ["x_m", "y_m", "heading_rad", "velocity_y_m_s", "wheel_rate_right_rad_s"] {
        let (again, planned) = (&trajectory[field][200], &answer["trajectory"][field][200]);
        // The final time is sent as interval times count: a few ulp.
        assert!((again.as_f64().unwrap() - planned.as_f64().unwrap()).abs() < 1e-9, "{field}: {again} {planned}");
    }
}
