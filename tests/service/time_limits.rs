//! Time limits of solves that alone take longer: the answer comes in time and is the best iterate.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use slipdrive::api::grpc::pb;

use crate::support::protobuf::solved_by;
use crate::support::{Answer, TestServer, real_solver};

/// Far more than the certificate of the finest grid takes on a busy machine, far less than the solves alone.
const SLACK: Duration = Duration::from_secs(3);

fn long_solve(grid: &Value, method: &str, time_limit_s: f64) -> String {
    json!({
        "maneuver": {"goal": {"x_m": 2, "y_m": 5}},
        "grid": grid,
        "solver": {"method": method, "starts": 64, "time_limit_s": time_limit_s},
        "view": "plan",
    })
    .to_string()
}

#[tokio::test]
async fn best_iterate_comes_in_time() {
    let server = TestServer::start(4, real_solver()).await;
    let grids = [
        json!({}),
        json!({"control_intervals": 1000}),
        json!({"steps": 200}),
        json!({"steps": 10_000}),
        json!({"steps": 10_000, "control_intervals": 1000}),
    ];
    for (index, grid) in grids.iter().enumerate() {
        for (method, time_limit_s) in [("nelder_mead", 0.001), ("sequential_linear", 0.02 * (index + 1) as f64)] {
            let start = Instant::now();
            let answer = server.post("/solve", long_solve(grid, method, time_limit_s)).await;
            assert!(start.elapsed() < Duration::from_secs_f64(time_limit_s) + SLACK, "{grid}, {method}");
            let answer = answer.json();
            assert_eq!(answer["stop_reason"], "time_limit", "{grid}, {method}");
            assert!(answer["final_time_s"].as_f64().unwrap() > 0.0);
            let intervals = grid["control_intervals"].as_u64().unwrap_or(40);
            let torques = answer["torque_schedule"]["left_n_m"].as_array().unwrap();
            assert_eq!(torques.len() as u64, intervals);
            // Where the certificate does not fit into the limit it claims nothing.
            let report = &answer["report"];
            let is_replayed = report["replay"]["miss_m"].is_number();
            assert_eq!(report["lower_bound_s"].is_number(), is_replayed);
            assert!(
                is_replayed || (answer["status"] != "converged" && answer["replay_confirmed"] == false),
                "{report}"
            );
        }
    }
}

#[tokio::test]
async fn finest_grid_is_answered_by_the_deadline() {
    const TIMEOUT: Duration = Duration::from_millis(500);
    let server = TestServer::start(4, real_solver()).await;
    let start = Instant::now();
    let request = server.client.post(server.url("/solve")).header("content-type", "application/json");
    let request = request.header("request-timeout-ms", TIMEOUT.as_millis().to_string());
    let answer = Answer::of(request.body(long_solve(&json!({"steps": 10_000}), "sequential_linear", 60.0))).await;
    assert!(start.elapsed() < TIMEOUT + SLACK);
    assert_eq!((answer.status, &answer.json()["stop_reason"]), (200, &"deadline".into()), "{}", answer.text());
    let start = Instant::now();
    let goal = pb::Goal { y_m: Some(5.0), ..pb::Goal::default() };
    let request = pb::SolveRequest {
        maneuver: Some(pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() }),
        grid: Some(pb::SolveGrid { steps: Some(10_000), ..pb::SolveGrid::default() }),
        ..pb::SolveRequest::default()
    };
    let solution = solved_by(&server, &request, TIMEOUT).await;
    assert!(start.elapsed() < TIMEOUT + SLACK);
    assert_eq!(solution.stop_reason(), pb::StopReason::Deadline);
}
