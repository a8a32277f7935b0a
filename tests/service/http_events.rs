//! The event stream of a solve over real HTTP.

use std::sync::Arc;

use serde_json::Value;
use slipdrive::solver::{RunControl, StopReason};
use slipdrive::solver::{SolveInput, SolveProgress};
use tokio::sync::mpsc::unbounded_channel;
use tokio::time::timeout;

use crate::support::{Answer, FakeSolver, Gate, HANG_BOUND, TestServer, instant_solver, small_solution};

fn request(server: &TestServer) -> reqwest::RequestBuilder {
    let request = server.client.post(server.url("/solve")).header("content-type", "application/json");
    request.header("accept", "text/event-stream").body("{}")
}

/// Name and JSON of each event.
fn events(text: &str) -> Vec<(String, Value)> {
    let blocks = text.split("\n\n").filter(|block| !block.is_empty() && !block.starts_with(':'));
    blocks
        .map(|block| {
            let (name, data) = block.split_once('\n').unwrap();
            let data = serde_json::from_str(data.strip_prefix("data: ").unwrap()).unwrap();
            (name.strip_prefix("event: ").unwrap().to_owned(), data)
        })
        .collect()
}

fn progress(best_final_time: f64) -> SolveProgress {
    SolveProgress { best_final_time, best_goal_error: 0.5, start: 1, start_count: 8 }
}

#[tokio::test]
async fn stream_begins_with_the_position_and_ends_with_the_plain_answer() {
    let server = TestServer::start(1, instant_solver()).await;
    let streamed = Answer::of(request(&server)).await;
    assert_eq!((streamed.status, streamed.header("content-type")), (200, "text/event-stream"));
    assert!(!streamed.header("x-request-id").is_empty());
    let events = events(&streamed.text());
    assert_eq!(events.first().unwrap(), &("queued".to_owned(), serde_json::json!({"position": 0})));
    let (name, mut result) = events.last().unwrap().clone();
    let mut plain = server.post("/solve", "{}").await.json();
    for answer in [&mut result, &mut plain] {
        answer["report"]["solve_time_s"] = Value::Null;
    }
    assert_eq!((name.as_str(), result), ("result", plain));
}

#[tokio::test]
async fn progress_is_told_while_the_solve_runs_and_the_latest_wins() {
    let gate = Arc::new(Gate::default());
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |_: &SolveInput, control: &RunControl<'_>| {
        for step in 1..=1000 {
            control.report(&progress(f64::from(step)));
        }
        held.wait();
        small_solution(StopReason::Finished)
    });
    let server = TestServer::start(1, Arc::new(solver)).await;
    let mut response = request(&server).send().await.unwrap();
    let mut text = String::new();
    // The solve is held until its last report has arrived.
    while !text.contains(r#""best_final_time_s":1000.0"#) {
        let chunk = timeout(HANG_BOUND, response.chunk()).await.unwrap().unwrap().expect("the stream goes on");
        text.push_str(std::str::from_utf8(&chunk).unwrap());
    }
    gate.open();
    text.push_str(&response.text().await.unwrap());
    let events = events(&text);
    let names: Vec<_> = events.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!((names[0], names[1], *names.last().unwrap()), ("queued", "progress", "result"));
    assert!(names.len() < 20, "a thousand reports are coalesced: {names:?}");
    let latest = &events[events.len() - 2].1;
    let expected = serde_json::json!({"best_final_time_s": 1000.0, "best_goal_error": 0.5, "start": 1, "start_count": 8, "phase": "start"});
    assert_eq!(latest, &expected);
}

#[tokio::test]
async fn failure_after_the_start_is_the_last_event() {
    let solver = FakeSolver(|_: &SolveInput, _: &RunControl<'_>| panic!("injected secret"));
    let server = TestServer::start(1, Arc::new(solver)).await;
    let answer = Answer::of(request(&server).header("x-request-id", "caller-7")).await;
    assert_eq!(answer.status, 200, "the stream had begun");
    let events = events(&answer.text());
    let (name, problem) = events.last().unwrap();
    assert_eq!((name.as_str(), &problem["code"], &problem["status"]), ("problem", &"solver_panic".into(), &500.into()));
    assert_eq!((&problem["request_id"], &problem["instance"]), (&"caller-7".into(), &"/solve".into()));
}

#[tokio::test]
async fn refusals_are_plain_answers() {
    let server = TestServer::start(1, instant_solver()).await;
    let refused = Answer::of(request(&server).body("{")).await;
    assert_eq!((refused.status, refused.problem()["code"].as_str()), (400, Some("malformed_body")));
}

#[tokio::test]
async fn dropped_stream_stops_the_solve() {
    let (started, mut has_started) = unbounded_channel();
    let (stopped, mut has_stopped) = unbounded_channel();
    let solver = FakeSolver(move |_: &SolveInput, control: &RunControl<'_>| {
        started.send(()).unwrap();
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        stopped.send(()).unwrap();
        small_solution(StopReason::Stopped)
    });
    let server = TestServer::start(1, Arc::new(solver)).await;
    let mut response = request(&server).body(r#"{"solver": {"time_limit_s": 60}}"#).send().await.unwrap();
    assert!(response.chunk().await.unwrap().unwrap().starts_with(b"event: queued"));
    // A job that has not started would be taken out of the line in silence.
    timeout(HANG_BOUND, has_started.recv()).await.unwrap().unwrap();
    drop(response);
    timeout(HANG_BOUND, has_stopped.recv()).await.expect("the solve is stopped").unwrap();
}
