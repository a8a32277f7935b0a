//! What `/metrics` tells after known requests.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::json;
use slipdrive::api::grpc::pb;
use slipdrive::api::server::{self, ServerSettings};
use slipdrive::api::{ApiSettings, Probes, rest};
use slipdrive::jobs::Jobs;
use slipdrive::solver::SolveInput;
use slipdrive::solver::{RunControl, StopReason};
use tokio::net::TcpListener;
use tokio::sync::mpsc::unbounded_channel;
use tokio::time::timeout;

use crate::support::process::sample_in;
use crate::support::{Answer, FakeSolver, HANG_BOUND, TestServer, held_solver, instant_solver, small_solution};

const BODY: &str = r#"{"maneuver": {"goal": {"y_m": 5}}}"#;

async fn metrics(server: &TestServer) -> String {
    server.get("/metrics").await.text()
}

/// Waits until a sample has a value: some counts come a moment after the answer.
async fn until(server: &TestServer, sample: &str, value: f64) {
    let waited = timeout(HANG_BOUND, async {
        while sample_in(&metrics(server).await, sample) != value {
            tokio::task::yield_now().await;
        }
    });
    assert!(waited.await.is_ok(), "{sample} is never {value} in {}", metrics(server).await);
}

#[tokio::test]
async fn solves_are_counted_by_their_outcome() {
    let server = TestServer::start(4, instant_solver()).await;
    assert_eq!(server.get("/metrics").await.header("content-type"), "text/plain; version=0.0.4");
    for _ in 0..3 {
        assert_eq!(server.post("/solve", BODY).await.status, 200);
    }
    let torques = json!({"interval_s": 0.1, "left_n_m": [0.1], "right_n_m": [0.1]});
    let plan = json!({"request": {"torque_schedule": torques}, "answer": {}});
    let light = json!({"simulate": plan, "format": "csv", "rate_hz": 10}).to_string();
    assert_eq!(server.post("/export", light).await.status, 200);
    let outcome = "method=\"sequential_linear\",status=\"converged\"";
    until(&server, "slipdrive_http_request_duration_seconds_count{code=\"200\",route=\"/solve\"}", 3.0).await;
    let text = metrics(&server).await;
    let sample = |name: &str| sample_in(&text, name);
    let solves = "slipdrive_solves_total{method=\"sequential_linear\",status=\"converged\",stop_reason=\"finished\"}";
    assert_eq!(sample(solves), 3.0);
    assert_eq!(sample(&format!("slipdrive_solve_duration_seconds_count{{{outcome}}}")), 3.0);
    assert_eq!(sample("slipdrive_queue_wait_seconds_count"), 3.0, "light jobs wait for no worker");
    assert_eq!(sample("slipdrive_rollouts_total"), 6.0, "two each");
    assert_eq!((sample("slipdrive_workers{state=\"idle\"}"), sample("slipdrive_workers{state=\"busy\"}")), (1.0, 0.0));
    assert!(sample("process_resident_memory_bytes") > 1e6 && sample("process_open_fds") > 3.0);
    assert!(text.contains("process_cpu_seconds_total"));
}

#[tokio::test]
async fn refusals_are_counted_by_code_with_their_duration() {
    let (gate, mut has_started, solver) = held_solver();
    let server = Arc::new(TestServer::start(1, solver).await);
    let solve = || {
        let server = Arc::clone(&server);
        tokio::spawn(async move { server.post("/solve", BODY).await.status })
    };
    let running = solve();
    timeout(HANG_BOUND, has_started.recv()).await.unwrap();
    let waiting = solve();
    until(&server, "slipdrive_queue_depth", 1.0).await;
    assert_eq!(sample_in(&metrics(&server).await, "slipdrive_workers{state=\"busy\"}"), 1.0);
    assert_eq!(sample_in(&metrics(&server).await, "slipdrive_rejected_total{code=\"queue_full\"}"), 0.0);
    assert_eq!(solve().await.unwrap(), 429);
    assert_eq!(server.post("/solve", "{").await.status, 429);
    until(&server, "slipdrive_rejected_total{code=\"queue_full\"}", 2.0).await;
    let text = metrics(&server).await;
    assert_eq!(sample_in(&text, "slipdrive_rejection_duration_seconds_count{code=\"queue_full\"}"), 2.0);
    assert_eq!(sample_in(&text, "slipdrive_rejection_duration_seconds_bucket{code=\"queue_full\",le=\"60\"}"), 2.0);
    gate.open();
    assert_eq!((running.await.unwrap(), waiting.await.unwrap()), (200, 200));
    until(&server, "slipdrive_queue_depth", 0.0).await;
}

#[tokio::test]
async fn ends_of_jobs_are_counted() {
    let (started, mut has_started) = unbounded_channel();
    let has_panicked = AtomicBool::new(false);
    let solver = FakeSolver(move |input: &SolveInput, control: &RunControl<'_>| {
        assert!(input.settings.seed != 7 || has_panicked.swap(true, Ordering::Relaxed), "injected");
        started.send(()).unwrap();
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        small_solution(StopReason::Stopped)
    });
    let server = Arc::new(TestServer::start(1, Arc::new(solver)).await);
    assert_eq!(server.post("/solve", r#"{"solver": {"seed": 7}}"#).await.status, 500);
    until(&server, "slipdrive_solver_panics_total", 1.0).await;
    until(&server, "slipdrive_rejected_total{code=\"solver_panic\"}", 1.0).await;

    let departing = {
        let server = Arc::clone(&server);
        tokio::spawn(async move { server.post("/solve", BODY).await })
    };
    timeout(HANG_BOUND, has_started.recv()).await.unwrap();
    departing.abort();
    until(&server, "slipdrive_cancelled_total{cause=\"caller_gone\"}", 1.0).await;
    until(&server, "slipdrive_http_request_duration_seconds_count{code=\"499\",route=\"/solve\"}", 1.0).await;
    assert_eq!(sample_in(&metrics(&server).await, "slipdrive_rejected_total{code=\"cancelled\"}"), 0.0);

    let running = {
        let server = Arc::clone(&server);
        // Nobody expects to wait long for a single rollout.
        tokio::spawn(async move { server.post("/solve", r#"{"solver": {"rollout_limit": 1}}"#).await.status })
    };
    timeout(HANG_BOUND, has_started.recv()).await.unwrap();
    let waiting = server.client.post(server.url("/solve")).header("content-type", "application/json").body(BODY);
    assert_eq!(Answer::of(waiting.header("request-timeout-ms", "100")).await.status, 504);
    server.service.cancel_all();
    assert_eq!(running.await.unwrap(), 503);
    let ends = [("panicked", 1.0), ("caller_gone", 1.0), ("deadline", 1.0), ("shutdown", 1.0), ("finished", 0.0)];
    for (outcome, count) in ends {
        until(&server, &format!("slipdrive_jobs_total{{job=\"solve\",outcome=\"{outcome}\"}}"), count).await;
    }
}

#[tokio::test]
async fn calls_are_counted_by_method_and_status_name() {
    let server = TestServer::start(4, instant_solver()).await;
    let mut client = server.grpc().await;
    client.solve(pb::SolveRequest::default()).await.unwrap();
    let robot = pb::Robot { wheel_radius_m: Some(0.0), ..pb::Robot::default() };
    client.solve(pb::SolveRequest { robot: Some(robot), ..pb::SolveRequest::default() }).await.unwrap_err();
    let mut events = client.solve_stream(pb::SolveStreamRequest::default()).await.unwrap().into_inner();
    while events.message().await.unwrap().is_some() {}
    for (method, code) in [("Solve", "OK"), ("Solve", "INVALID_ARGUMENT"), ("SolveStream", "OK")] {
        let sample = format!("slipdrive_grpc_request_duration_seconds_count{{code=\"{code}\",method=\"{method}\"}}");
        until(&server, &sample, 1.0).await;
    }
    until(&server, "slipdrive_rejected_total{code=\"invalid_value\"}", 1.0).await;
}

#[tokio::test]
async fn labels_hold_no_words_of_callers() {
    let server = TestServer::start(4, instant_solver()).await;
    for path in ["/nowhere", "/solve/17", "/secret?key=1"] {
        assert_eq!(server.get(path).await.status, 404, "{path}");
    }
    until(&server, "slipdrive_http_request_duration_seconds_count{code=\"404\",route=\"other\"}", 3.0).await;
    let text = metrics(&server).await;
    assert!(!text.contains("secret") && !text.contains("17\""), "{text}");
    let own: BTreeSet<_> = text.lines().filter_map(|line| line.strip_prefix("# TYPE slipdrive_")).collect();
    let known: BTreeSet<_> = Jobs::families().iter().map(|family| family.name).collect();
    assert!(own.iter().all(|line| known.contains(format!("slipdrive_{}", line.split(' ').next().unwrap()).as_str())));
}

#[tokio::test]
async fn probes_of_their_own_port_are_not_beside_the_api() {
    let api = ApiSettings { probes: Probes::Apart, ..ApiSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let admin = listener.local_addr().unwrap();
    let router = rest::admin_router(&server.state);
    let task = tokio::spawn(server::serve(listener, router, Arc::clone(&server.connections), std::future::pending()));
    for path in ["/livez", "/readyz", "/metrics"] {
        assert_eq!(server.get(path).await.status, 404, "{path}");
        let answer = server.client.get(format!("http://{admin}{path}")).send().await.unwrap();
        assert_eq!(answer.status(), 200, "{path}");
    }
    assert_eq!(server.client.get(format!("http://{admin}/limits")).send().await.unwrap().status(), 404);
    let paths = server.get("/openapi.json").await.json()["paths"].clone();
    assert!(paths["/metrics"].is_null() && paths["/solve"].is_object());
    task.abort();
}
