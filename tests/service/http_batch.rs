//! Batches over REST: a line for each job, a line for each answer, whatever is sent and whenever it is read.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use slipdrive::api::ApiSettings;
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::server::ServerSettings;
use slipdrive::jobs::ManeuverSolver;
use slipdrive::service::ServiceSettings;
use slipdrive::solver::{RunControl, SolveInput, StopReason};
use tokio::time::timeout;

use crate::support::lines::batch;
use crate::support::{Answer, FakeSolver, Gate, HANG_BOUND, TestServer, held_solver, instant_solver, small_solution};

fn solve(request_id: &str) -> String {
    format!("{}\n", json!({"request_id": request_id, "solve": {"view": "plan"}}))
}

/// Sends all, then reads all; the lines but the last by their ids, and the last.
async fn answers(server: &TestServer, lines: &str) -> (BTreeMap<String, Value>, Value) {
    let (mut sender, mut receiver) = batch(server.address, "").await;
    assert!(sender.send(lines).await);
    let _open = sender.end().await;
    let mut lines = receiver.rest().await;
    let end = lines.pop().unwrap();
    let ids = |line: &Value| line["request_id"].as_str().map_or(format!("line {}", line["line"]), str::to_owned);
    let count = lines.len();
    let by_id: BTreeMap<_, _> = lines.into_iter().map(|line| (ids(&line), line)).collect();
    assert_eq!(by_id.len(), count, "one answer for each item");
    (by_id, end)
}

/// A solver that runs until it is stopped.
fn endless_solver() -> Arc<dyn ManeuverSolver> {
    Arc::new(FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        small_solution(StopReason::Stopped)
    }))
}

#[tokio::test]
async fn items_of_any_kind_are_answered_by_their_kind() {
    let server = TestServer::start(4, instant_solver()).await;
    let torques = json!({"interval_s": 0.1, "left_n_m": [0.1], "right_n_m": [0.1]});
    let lines = [
        json!({"request_id": "plan", "solve": {"maneuver": {"goal": {"y_m": 1}}}, "timeout_ms": 60_000}),
        json!({"request_id": "motion \"7\"", "simulate": {"torque_schedule": torques}}),
        json!({"request_id": "wrong", "simulate": {"torque_schedule": torques, "robot": {"wheel_radius_m": 0, "gravity_m_s2": -1}}}),
        json!({"request_id": "assessed", "assess": {}}),
    ];
    // The last line needs no end.
    let lines = lines.map(|line| line.to_string()).join("\r\n \n");
    let (answers, end) = answers(&server, &lines).await;
    assert_eq!(answers["plan"]["solve"]["final_time_s"], 1.5);
    assert_eq!(answers["motion \"7\""]["simulate"]["trajectory"]["time_s"], json!([0.0]));
    let problem = &answers["wrong"]["problem"];
    assert_eq!((&problem["code"], &problem["request_id"]), (&json!("invalid_value"), &json!("wrong")));
    let pointers: Vec<_> = problem["errors"].as_array().unwrap().iter().map(|error| &error["pointer"]).collect();
    assert_eq!(pointers, ["#/robot/wheel_radius_m", "#/robot/gravity_m_s2"], "as a single call says it");
    assert_eq!(answers["assessed"]["problem"]["code"], "invalid_field");
    assert_eq!(end, json!({"end": {"answered": 2, "problems": 2}}));
    let single = server.post("/solve", r#"{"maneuver": {"goal": {"y_m": 1}}}"#).await.json();
    let untimed = |mut answer: Value| {
        answer["report"]["solve_time_s"] = Value::Null;
        answer
    };
    assert_eq!(untimed(answers["plan"]["solve"].clone()), untimed(single));
    let metrics = String::from_utf8(server.service.metrics_text()).unwrap();
    assert!(metrics.contains(r#"http_request_duration_seconds_count{code="200",route="/batch"} 1"#), "{metrics}");
    assert!(metrics.contains(r#"slipdrive_rejected_total{code="invalid_value"} 1"#), "{metrics}");
}

#[tokio::test]
async fn bad_lines_are_answered_by_their_number_and_the_others_go_on() {
    let (gate, mut started, solver) = held_solver();
    let server = TestServer::start(8, solver).await;
    let (mut sender, mut receiver) = batch(server.address, "").await;
    let long = "x".repeat((1 << 20) + 2000);
    let lines = [
        &*solve("twice"),
        "\n",
        "{\"request_id\": \"a\", \n",
        "[]\n",
        &solve("twice"),
        "{\"request_id\": \"b\", \"solve\": {}, \"timeout_ms\": 0}\n",
        "{\"request_id\": \"c\", \"sovle\": {}}\n",
        "{\"request_id\": \"\", \"solve\": {}}\n",
        "{\"request_id\": \"d\", \"solve\": {\"veiw\": 1}}\n",
        &format!("{long}\n"),
        &format!("{{\"request_id\": \"e\", \"solve\": {{\"view\": \"{}\"}}}}\n", "x".repeat(300_000)),
        "{\"request_id\": \"f\"}",
    ];
    assert!(sender.send(&lines.concat()).await);
    timeout(HANG_BOUND, started.recv()).await.unwrap();
    let _open = sender.end().await;
    let expected = [
        (json!(3), Value::Null, "malformed_body"),
        (json!(4), Value::Null, "invalid_field"),
        (json!(5), Value::Null, "invalid_value"),
        (json!(6), json!("b"), "invalid_value"),
        (json!(7), json!("c"), "invalid_field"),
        (json!(8), Value::Null, "invalid_value"),
        (json!(10), Value::Null, "body_too_large"),
        (json!(12), json!("f"), "invalid_field"),
        (Value::Null, json!("d"), "invalid_field"),
        (Value::Null, json!("e"), "body_too_large"),
    ];
    let mut refused = Vec::new();
    for _ in &expected {
        let line = receiver.line().await.unwrap();
        refused.push((
            line["line"].clone(),
            line["request_id"].clone(),
            line["problem"]["code"].as_str().unwrap().to_owned(),
        ));
    }
    for (line, id, code) in expected {
        assert!(refused.contains(&(line.clone(), id.clone(), code.to_owned())), "{line} {id} {code}: {refused:?}");
    }
    gate.open();
    assert_eq!(receiver.line().await.unwrap()["solve"]["final_time_s"], 1.5, "the first of the two");
    assert_eq!(receiver.rest().await, [json!({"end": {"answered": 1, "problems": 10}})]);
}

#[tokio::test]
async fn next_line_may_wait_for_the_answer_to_the_last() {
    let server = TestServer::start(4, instant_solver()).await;
    let (mut sender, mut receiver) = batch(server.address, "").await;
    assert!(receiver.head().await.starts_with("HTTP/1.1 200 OK\r\ncontent-type: application/x-ndjson\r\n"));
    for number in 0..20 {
        // In two parts, the same id each time: it is free again.
        let (begin, rest) =
            (r#"{"request_id": "again", "#, format!("\"solve\": {{\"solver\": {{\"seed\": {number}}}}}}}\n"));
        assert!(sender.send(begin).await && sender.send(&rest).await);
        assert_eq!(receiver.line().await.unwrap()["request_id"], "again");
    }
    let _open = sender.end().await;
    assert_eq!(receiver.rest().await, [json!({"end": {"answered": 20, "problems": 0}})]);
}

#[tokio::test]
async fn answers_come_as_each_item_ends() {
    let gate = Arc::new(Gate::default());
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |input: &SolveInput, _: &RunControl<'_>| {
        if input.settings.seed == 1 {
            held.wait();
        }
        small_solution(StopReason::Finished)
    });
    let settings = ServiceSettings { workers: NonZeroUsize::new(2).unwrap(), ..ServiceSettings::default() };
    let server =
        TestServer::start_sized(settings, Arc::new(solver), ApiSettings::default(), ServerSettings::default()).await;
    let (mut sender, mut receiver) = batch(server.address, "").await;
    assert!(sender.send("{\"request_id\": \"slow\", \"solve\": {\"solver\": {\"seed\": 1}}}\n").await);
    assert!(sender.send(&[solve("a"), solve("b")].concat()).await);
    let mut ids = Vec::new();
    for _ in 0..2 {
        ids.push(receiver.line().await.unwrap()["request_id"].as_str().unwrap().to_owned());
    }
    ids.sort();
    assert_eq!(ids, ["a", "b"]);
    gate.open();
    assert_eq!(receiver.line().await.unwrap()["request_id"], "slow");
}

#[tokio::test]
async fn thousand_items_are_answered_once_each() {
    let server = TestServer::start(4, instant_solver()).await;
    let lines: String = (0..1000).map(|number| solve(&format!("item-{number}"))).collect();
    let (answers, end) = answers(&server, &lines).await;
    assert_eq!(answers.len(), 1000);
    assert!(answers.values().all(|line| line["solve"]["status"] == "converged"));
    assert_eq!(end, json!({"end": {"answered": 1000, "problems": 0}}));
    // The same by a common client, whose body has a length.
    let request =
        server.client.post(server.url("/batch")).header("content-type", "application/x-ndjson; charset=utf-8");
    let answer = Answer::of(request.body(lines)).await;
    assert_eq!((answer.status, answer.header("x-accel-buffering")), (200, "no"));
    assert_eq!(answer.text().lines().count(), 1001);
}

#[tokio::test]
async fn deadline_of_an_item_and_of_the_whole_end_with_what_there_is() {
    let server = TestServer::start(4, endless_solver()).await;
    let (mut sender, mut receiver) = batch(server.address, "request-timeout-ms: 2000\r\n").await;
    let soon = json!({"request_id": "soon", "timeout_ms": 100, "solve": {"solver": {"time_limit_s": 60}}});
    assert!(sender.send(&format!("{soon}\n")).await);
    assert_eq!(receiver.line().await.unwrap()["solve"]["stop_reason"], "deadline");
    assert!(sender.send("{\"request_id\": \"rest\", \"solve\": {\"solver\": {\"time_limit_s\": 60}}}\n").await);
    assert_eq!(receiver.line().await.unwrap()["solve"]["stop_reason"], "deadline");
    let rest = receiver.rest().await;
    assert_eq!((rest.len(), &rest[0]["problem"]["code"]), (2, &json!("deadline_exceeded")), "{rest:?}");
    assert_eq!(rest[1], json!({"end": {"answered": 2, "problems": 1}}));
}

#[tokio::test]
async fn draining_server_ends_batches_after_the_answers_in_flight() {
    let (gate, mut started, solver) = held_solver();
    let server = TestServer::start(8, solver).await;
    let (mut sender, mut receiver) = batch(server.address, "").await;
    assert!(sender.send(&solve("first")).await);
    timeout(HANG_BOUND, started.recv()).await.unwrap();
    server.service.close();
    gate.open();
    assert_eq!(receiver.line().await.unwrap()["request_id"], "first");
    let ended = receiver.line().await.unwrap();
    assert_eq!(
        (&ended["problem"]["code"], ended.get("line"), ended.get("request_id")),
        (&json!("unavailable"), None, None)
    );
    assert_eq!(receiver.line().await.unwrap(), json!({"end": {"answered": 1, "problems": 1}}));
    let (_sender, mut refused) = batch(server.address, "").await;
    assert!(refused.head().await.starts_with("HTTP/1.1 503"));
}

#[tokio::test]
async fn departure_frees_the_workers() {
    let server = TestServer::start(8, endless_solver()).await;
    let (mut sender, receiver) = batch(server.address, "").await;
    let long =
        |number| format!("{{\"request_id\": \"{number}\", \"solve\": {{\"solver\": {{\"time_limit_s\": 60}}}}}}\n");
    assert!(sender.send(&(0..5).map(long).collect::<String>()).await);
    let in_flight = async |is_reached: fn(usize) -> bool| {
        while !is_reached(server.service.jobs_in_flight()) {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    };
    timeout(HANG_BOUND, in_flight(|count| count == 5)).await.unwrap();
    drop((sender, receiver));
    timeout(HANG_BOUND / 2, in_flight(|count| count == 0)).await.expect("long before their time limit");
    let metrics = String::from_utf8(server.service.metrics_text()).unwrap();
    assert!(metrics.contains(r#"http_request_duration_seconds_count{code="499",route="/batch"} 1"#), "{metrics}");
}

#[tokio::test]
async fn line_that_does_not_end_in_time_ends_the_batch() {
    let api = ApiSettings { body_timeout: Duration::from_millis(100), ..ApiSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await;
    let (mut sender, mut receiver) = batch(server.address, "").await;
    // Between lines there is time.
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert!(sender.send(&solve("a")).await && sender.send("{\"request_id\"").await);
    assert_eq!(receiver.line().await.unwrap()["request_id"], "a");
    let rest = receiver.rest().await;
    assert!(rest.iter().any(|line| line["problem"]["code"] == "body_timeout"), "{rest:?}");
    assert_eq!(rest.last().unwrap()["end"]["answered"], 1);
}

#[tokio::test]
async fn what_is_no_batch_is_refused_before_it_is_read() {
    let api = ApiSettings { keys: ApiKeys::parse("key").unwrap(), ..ApiSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await;
    let refused = async |key: &str, media_type: &str, timeout_ms: &str| {
        let request = server.client.post(server.url("/batch")).bearer_auth(key).header("content-type", media_type);
        let answer = Answer::of(request.header("request-timeout-ms", timeout_ms).body(solve("a"))).await;
        answer.problem()["code"].as_str().unwrap().to_owned()
    };
    assert_eq!(refused("wrong", "application/json", "x").await, "unauthenticated");
    assert_eq!(refused("key", "application/json", "x").await, "unsupported_media");
    assert_eq!(refused("key", "application/x-ndjson", "x").await, "invalid_value");
}
