//! What sound requests get, over real HTTP with a solver that answers at once.

use std::sync::Arc;

use serde_json::{Value, json};
use slipdrive::api::ApiSettings;
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::server::ServerSettings;
use slipdrive::shooting::{Goal, StateComponent};
use slipdrive::solver::SolveInput;
use slipdrive::solver::{RunControl, StopReason};

use crate::support::{Answer, FakeSolver, TestServer, instant_solver, real_solver, small_solution};

async fn server() -> TestServer {
    TestServer::start(4, instant_solver()).await
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn sorted(mut names: Vec<&str>) -> Vec<&str> {
    names.sort_unstable();
    names
}

#[tokio::test]
async fn full_answer_has_every_field_of_the_contract() {
    let answer = server().await.post("/solve", r#"{"maneuver": {"goal": {"y_m": 5}}}"#).await;
    assert_eq!((answer.status, answer.header("content-type")), (200, "application/json"));
    let answer = answer.json();
    let expected = "status stop_reason replay_confirmed reason final_time_s torque_schedule contact_modes end_state goal_error \
                    trajectory contacts report applied_limits solver_version input_hash";
    assert_eq!(keys(&answer), sorted(expected.split_whitespace().collect()));
    let expected = "method steps control_intervals iterations rollouts solve_time_s starts_tried distinct_optima \
                    worst_contact_residual predicted_decrease_s lower_bound_s lower_bound_assumption separations least_normal_load \
                    indeterminate_steps slip_reversals switching_sign_violations replay refinement";
    assert_eq!(keys(&answer["report"]), sorted(expected.split_whitespace().collect()));
    let expected = "x_m y_m heading_rad velocity_x_m_s velocity_y_m_s yaw_rate_rad_s wheel_rate_left_rad_s \
                    wheel_rate_right_rad_s";
    assert_eq!(keys(&answer["goal_error"]), sorted(expected.split_whitespace().collect()));
    assert_eq!(
        answer["torque_schedule"],
        json!({"interval_s": 0.75, "left_n_m": [1.0, -1.0], "right_n_m": [1.0, -1.0]})
    );
    assert_eq!((&answer["status"], &answer["stop_reason"]), (&json!("converged"), &json!("finished")));
    assert_eq!(answer["applied_limits"], json!({"time_limit_s": 10.0}));
}

#[tokio::test]
async fn plan_view_leaves_out_trajectory_and_contacts() {
    let answer = server().await.post("/solve", r#"{"view": "plan"}"#).await.json();
    assert!(answer.get("trajectory").is_none() && answer.get("contacts").is_none(), "{answer}");
    assert!(answer["report"].is_object());
}

#[tokio::test]
async fn constrained_wheel_angle_appears_in_the_goal_error() {
    let body = r#"{"maneuver": {"goal": {"wheel_angle_left_rad": 1}}}"#;
    let answer = server().await.post("/solve", body).await.json();
    let angles = (answer["goal_error"].get("wheel_angle_left_rad"), answer["goal_error"].get("wheel_angle_right_rad"));
    assert_eq!(angles, (Some(&json!(0.0)), None));
}

#[tokio::test]
async fn same_request_gives_the_same_bytes_apart_from_times() {
    let server = server().await;
    let without_time = |answer: Answer| {
        let mut answer = answer.json();
        answer["report"]["solve_time_s"] = Value::Null;
        answer.to_string()
    };
    let (first, second) = (server.post("/solve", "{}").await, server.post("/solve", "{}").await);
    assert_eq!(without_time(first), without_time(second));
}

#[tokio::test]
async fn validation_completes_the_body_and_the_completed_body_means_the_same() {
    let server = server().await;
    let body =
        r#"{"maneuver": {"start": {"x_m": 0.1}, "goal": {"y_m": 5, "free": ["heading_rad"]}}, "grid": {"steps": 300}}"#;
    let validated = server.post("/validate", body).await;
    assert_eq!(validated.status, 200, "{}", validated.text());
    let mut completed = validated.json();
    let hash = completed.as_object_mut().unwrap().remove("input_hash").unwrap();
    assert_eq!(hash.as_str().unwrap().len(), 64);
    assert_eq!(completed["maneuver"]["goal"]["x_m"], 0.1, "absent: the start's value");
    assert_eq!(
        completed["maneuver"]["goal"]["free"],
        json!(["heading_rad", "wheel_angle_left_rad", "wheel_angle_right_rad"])
    );
    assert_eq!(completed["grid"], json!({"steps": 300, "control_intervals": 40}));
    let again = server.post("/validate", completed.to_string()).await.json();
    assert_eq!(again["input_hash"], hash);
    assert_eq!(server.post("/solve", body).await.json()["input_hash"], hash);
    let as_tables_write_it = server.post("/validate", body.replace("300", "300.0")).await.json();
    assert_eq!(as_tables_write_it["input_hash"], hash);
    // A load of no mass is none.
    let unloaded = body.replacen('{', r#"{"payload": {"mass_kg": 0, "height_m": 1}, "#, 1);
    assert_eq!(server.post("/validate", unloaded).await.json()["input_hash"], hash);
}

#[tokio::test]
async fn numbers_keep_their_bits_through_validation() {
    let server = server().await;
    // Shortest decimal forms that a fast, sloppy parser reads one unit off.
    for number in ["0.9161396723341167", "1.0715660391703367", "8.41e-1", "3.141592653589793"] {
        let body = format!(r#"{{"maneuver": {{"goal": {{"y_m": {number}}}}}}}"#);
        let completed = server.post("/validate", body).await.json();
        let value: f64 = number.parse().unwrap();
        assert_eq!(completed["maneuver"]["goal"]["y_m"].as_f64().unwrap().to_bits(), value.to_bits());
    }
}

#[tokio::test]
async fn forward_drive_example_is_complete_and_solvable() {
    let server = server().await;
    let example = server.get("/examples/forward-drive").await;
    assert_eq!(example.status, 200);
    let mut validated = server.post("/validate", example.bytes.clone()).await.json();
    let hash = validated.as_object_mut().unwrap().remove("input_hash").unwrap();
    assert_eq!(validated, example.json(), "nothing is left to complete");
    assert_eq!(example.json()["grid"]["steps"], 200);
    assert_eq!(example.json()["maneuver"]["goal"]["y_m"], 5.0);
    let solved = server.post("/solve", example.bytes).await;
    assert_eq!((solved.status, &solved.json()["input_hash"]), (200, &hash));
}

#[tokio::test]
async fn goal_reaches_the_solver_as_the_contract_says() {
    let (goals, mut seen) = tokio::sync::mpsc::unbounded_channel();
    let solver = FakeSolver(move |input: &SolveInput, _: &RunControl<'_>| {
        goals.send(input.maneuver.goal).unwrap();
        small_solution(StopReason::Finished)
    });
    let server = TestServer::start(4, Arc::new(solver)).await;
    let body =
        r#"{"maneuver": {"start": {"x_m": 2, "velocity_x_m_s": 1}, "goal": {"y_m": 5, "free": ["yaw_rate_rad_s"]}}}"#;
    assert_eq!(server.post("/solve", body).await.status, 200);
    let mut expected = Goal::at_rest(2.0, 5.0, 0.0);
    expected.set(StateComponent::YawRate, None);
    assert_eq!(seen.recv().await, Some(expected));
}

#[tokio::test]
async fn simulation_answers_with_trajectory_and_contacts() {
    let server = server().await;
    let body = json!({
        "reference_point": "axle_midpoint",
        "start": {"y_m": 1},
        "torque_schedule": {"interval_s": 0.5, "left_n_m": [1, -1], "right_n_m": [1, -1]},
        "grid": {"steps": 100},
        "contact_solver": "fixed_point",
    });
    let answer = server.post("/simulate", body.to_string()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    let expected = "end_state trajectory contacts contact_modes separations worst_contact_residual indeterminate_steps \
                    slip_reversals";
    assert_eq!(keys(&answer.json()), sorted(expected.split_whitespace().collect()));
}

#[tokio::test]
async fn steps_of_a_simulation_without_a_grid_give_all_intervals_as_many() {
    let server = TestServer::start(4, real_solver()).await;
    for (intervals, steps) in [(1, 200), (40, 200), (150, 300), (999, 999)] {
        let torques = json!(vec![0.1; intervals]);
        let body = json!({"torque_schedule": {"interval_s": 0.01, "left_n_m": torques, "right_n_m": torques}});
        let answer = server.post("/simulate", body.to_string()).await.json();
        assert_eq!(answer["trajectory"]["time_s"].as_array().unwrap().len(), steps + 1);
    }
}

#[tokio::test]
async fn probes_answer() {
    let server = server().await;
    assert_eq!((server.get("/livez").await.status, server.get("/readyz").await.status), (200, 200));
}

#[tokio::test]
async fn request_id_is_echoed_or_made() {
    let server = server().await;
    let request = server.client.get(server.url("/livez")).header("x-request-id", "caller-7");
    assert_eq!(Answer::of(request).await.header("x-request-id"), "caller-7");
    let (first, second) = (server.get("/livez").await, server.get("/livez").await);
    assert!(!first.header("x-request-id").is_empty());
    assert_ne!(first.header("x-request-id"), second.header("x-request-id"));
}

#[tokio::test]
async fn solver_of_the_crate_answers_the_same_bytes_twice_apart_from_times() {
    let server = TestServer::start(4, real_solver()).await;
    let example = server.get("/examples/forward-drive").await.bytes;
    let mut answers = Vec::new();
    for _ in 0..2 {
        let answer = server.post("/solve", example.clone()).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        let mut answer = answer.json();
        answer["report"]["solve_time_s"] = Value::Null;
        answers.push(answer.to_string());
    }
    assert_eq!(answers[0], answers[1]);
}

fn from_page(server: &TestServer, method: reqwest::Method, origin: &str) -> reqwest::RequestBuilder {
    let request = server.client.request(method, server.url("/solve")).header("origin", origin);
    request.header("access-control-request-method", "POST").header("content-type", "application/json").body("{}")
}

#[tokio::test]
async fn pages_of_other_origins_may_call_only_where_they_are_named() {
    let page = "https://fleet.example";
    let closed = server().await;
    for method in [reqwest::Method::OPTIONS, reqwest::Method::POST] {
        let answer = Answer::of(from_page(&closed, method, page)).await;
        assert_eq!(answer.header("access-control-allow-origin"), "", "off by default");
    }
    let api = ApiSettings {
        keys: ApiKeys::parse("secret").unwrap(),
        cors_origins: vec![page.parse().unwrap()],
        ..ApiSettings::default()
    };
    let open = TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await;
    let leave = Answer::of(from_page(&open, reqwest::Method::OPTIONS, page)).await;
    assert_eq!((leave.status, leave.header("access-control-allow-origin")), (200, page), "without a key");
    assert!(leave.header("access-control-allow-headers").contains("request-timeout-ms"));
    let solved = Answer::of(from_page(&open, reqwest::Method::POST, page).bearer_auth("secret")).await;
    assert_eq!((solved.status, solved.header("access-control-allow-origin")), (200, page));
    let other = Answer::of(from_page(&open, reqwest::Method::POST, "https://other.example")).await;
    assert_eq!((other.status, other.header("access-control-allow-origin")), (401, ""));
}
