//! Robots whose friction is hard to resolve, so that a rollout of many steps takes seconds: workers are free soon after a
//! deadline, a departure and the server's own limit.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use slipdrive::api::ApiSettings;
use slipdrive::api::grpc::pb;
use slipdrive::api::server::ServerSettings;
use slipdrive::jobs::Limits;
use slipdrive::service::ServiceSettings;
use slipdrive::solver::{Report, RunControl, Solution, SolveInput, Status, StopReason};
use tokio::time::{sleep, timeout};

use crate::support::slow_simulation::slow_simulation;
use crate::support::{Answer, FakeSolver, TestServer, real_solver, small_solution};

/// What a caller of these tests waits, ms.
const PATIENCE_MS: u64 = 300;
/// Far above the milliseconds that a worker takes to obey on a busy machine, far below the rollouts alone.
const OBEYS_WITHIN: Duration = Duration::from_secs(8);

/// The exact solver of contacts takes up to a millisecond in each of 10,000 steps.
fn slow_solve() -> Value {
    let torques = |shift: f64| (0..100).map(|index| 2.0 * (f64::from(index) * 1.7 + shift).sin()).collect::<Vec<_>>();
    json!({
        "robot": {
            "chassis_mass_kg": 7.413, "wheel_mass_kg": 8.257, "chassis_yaw_inertia_kg_m2": 0.01234,
            "wheel_diametral_inertia_kg_m2": 1.27, "wheel_spin_inertia_kg_m2": 0.004_612, "wheel_radius_m": 0.3388,
            "track_width_m": 3.017, "axle_to_front_support_m": 0.03469, "center_of_mass_height_m": 0.008_886,
            "wheel_friction_coefficient": 0.695, "front_friction_coefficient": 1.757,
        },
        "maneuver": {
            "goal": {"x_m": 1, "y_m": 2, "heading_rad": 0.7},
            "torque_limit_left_n_m": 2, "torque_limit_right_n_m": 2,
        },
        "grid": {"steps": 10_000, "control_intervals": 100},
        "initial_guess": {"final_time_s": 9.1, "torque_left_n_m": torques(0.0), "torque_right_n_m": torques(1.0)},
        "solver": {"time_limit_s": 60},
        "view": "plan",
    })
}

async fn until_idle(server: &TestServer, what: &str) {
    let idle = async {
        while server.service.jobs_in_flight() > 0 {
            sleep(Duration::from_millis(5)).await;
        }
    };
    timeout(OBEYS_WITHIN, idle).await.unwrap_or_else(|_| panic!("{what}: the worker is still busy"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn deadline_ends_rollouts_of_hard_friction() {
    let server = TestServer::start(1, real_solver()).await;
    for (path, body) in [("/simulate", slow_simulation()), ("/solve", slow_solve())] {
        let start = Instant::now();
        let request = server.client.post(server.url(path)).header("content-type", "application/json");
        let request = request.header("request-timeout-ms", PATIENCE_MS).body(body.to_string());
        let answer = Answer::of(request).await;
        assert!(start.elapsed() < OBEYS_WITHIN, "{path}: {:?}", start.elapsed());
        if path == "/solve" && answer.status == 200 {
            // On a fast machine the motion of its plan is known in time, but not whether each step has one solution.
            assert_eq!(answer.json()["stop_reason"], "deadline");
        } else {
            assert_eq!((answer.status, answer.problem()["code"].as_str()), (504, Some("deadline_exceeded")), "{path}");
        }
        until_idle(&server, path).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn departure_ends_rollouts_of_hard_friction() {
    let server = TestServer::start(1, real_solver()).await;
    for (path, body) in [("/simulate", slow_simulation()), ("/solve", slow_solve())] {
        let patience = Duration::from_millis(PATIENCE_MS);
        assert!(timeout(patience, server.post(path, body.to_string())).await.is_err(), "{path} is slow");
        until_idle(&server, path).await;
    }
}

/// A server whose own limit passes soon.
pub(crate) async fn impatient_server() -> TestServer {
    let limits = Limits { max_time_limit_s: 0.2, ..Limits::default() };
    let (api, server) = (ApiSettings::default(), ServerSettings::default());
    TestServer::start_limited(limits, ServiceSettings::default(), real_solver(), api, server).await
}

#[tokio::test]
async fn certificate_that_is_cut_off_has_neither_replay_nor_bound() {
    let solver = FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        while !control.cut().is_set() {
            std::thread::yield_now();
        }
        let solution = small_solution(StopReason::Finished);
        let report = Report { replay: None, lower_bound: None, lower_bound_assumption: None, ..solution.report };
        Solution { status: Status::Feasible, replay_confirmed: false, report, ..solution }
    });
    let server = TestServer::start(1, Arc::new(solver)).await;
    let answer = server.post("/solve", r#"{"solver": {"time_limit_s": 0.05}}"#).await.json();
    assert_eq!((&answer["status"], &answer["replay_confirmed"]), (&json!("feasible"), &json!(false)));
    let report = answer["report"].as_object().unwrap();
    for field in ["replay", "lower_bound_s", "lower_bound_assumption"] {
        assert_eq!(report.get(field), Some(&Value::Null), "{field}");
    }
    let request = pb::SolveRequest {
        solver: Some(pb::Solver { time_limit_s: Some(0.05), ..pb::Solver::default() }),
        ..pb::SolveRequest::default()
    };
    let answer = server.grpc().await.solve(request).await.unwrap().into_inner();
    let report = answer.solution.unwrap().report.unwrap();
    assert!(report.replay.is_none() && report.lower_bound_s.is_nan());
    assert_eq!(report.lower_bound_assumption(), pb::LowerBoundAssumption::Unspecified);
}
