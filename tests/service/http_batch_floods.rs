//! Batches over REST whose callers send more than they read: none holds more than its share, and others are served.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use serde_json::json;
use slipdrive::api::ApiSettings;
use slipdrive::api::server::ServerSettings;
use slipdrive::jobs::ManeuverSolver;
use slipdrive::robot::State;
use slipdrive::simulation::Trajectory;
use slipdrive::solver::{RunControl, Solution, SolveInput, StopReason};
use tokio::time::timeout;

use crate::support::http2::{Connection, DATA, END_STREAM, HEADERS, WINDOW_UPDATE};
use crate::support::lines::batch;
use crate::support::{FakeSolver, HANG_BOUND, TestServer, held_solver, instant_solver, small_solution};

/// Longest line, and what a batch may send before it reads, bytes.
const LIMIT: usize = (1 << 20) + 1024;
/// More than the buffers of both sides of a connection hold, bytes.
const BUFFERS: usize = 16 << 20;

/// A solver whose answers have some 90 kB each.
fn wordy_solver() -> Arc<dyn ManeuverSolver> {
    Arc::new(FakeSolver(|_: &SolveInput, _: &RunControl<'_>| {
        let state = vec![State::default(); 2_000];
        let trajectory = Trajectory { time: vec![0.1; state.len()], state, ..Trajectory::default() };
        Solution { trajectory, ..small_solution(StopReason::Finished) }
    }))
}

/// An item of some 10 kB.
fn long_line(number: usize, view: &str) -> String {
    let torques = vec![0.25; 1000];
    let guess = json!({"final_time_s": 1, "torque_left_n_m": torques, "torque_right_n_m": torques});
    format!("{}\n", json!({"request_id": number.to_string(), "solve": {"initial_guess": guess, "view": view}}))
}

fn held_bytes(server: &TestServer) -> usize {
    let text = String::from_utf8(server.service.metrics_text()).unwrap();
    let line = text.lines().find(|line| line.starts_with("slipdrive_held_bytes")).unwrap();
    line.rsplit_once(' ').unwrap().1.parse().unwrap()
}

/// Waits until the same bytes are held over many turns of the server, far longer than others have to release theirs.
async fn nothing_more_is_taken(server: &TestServer) {
    let (mut held, mut unchanged) = (0, 0);
    while unchanged < 20 {
        tokio::time::sleep(Duration::from_millis(50)).await;
        let now = held_bytes(server);
        unchanged = if now == held { unchanged + 1 } else { 0 };
        held = now;
    }
}

#[tokio::test]
async fn who_sends_all_before_reading_gets_all_answers() {
    let server = TestServer::start(16, wordy_solver()).await;
    let lines: Vec<_> = (0..300).map(|number| format!("{{\"request_id\": \"{number}\", \"solve\": {{}}}}\n")).collect();
    let lines = lines.concat();
    // As long as it may be, by white space before the line feeds.
    let padded = lines.replace('\n', &format!("{}\n", " ".repeat((LIMIT - lines.len()) / 300 - 8)));
    let (mut sender, mut receiver) = batch(server.address, "").await;
    for part in padded.as_bytes().chunks(10_000) {
        let sent = sender.send(std::str::from_utf8(part).unwrap());
        assert!(timeout(HANG_BOUND, sent).await.expect("the server reads on though nothing is read"));
    }
    let _open = sender.end().await;
    tokio::time::sleep(Duration::from_millis(200)).await;
    let lines = receiver.rest().await;
    assert_eq!(lines.len(), 301);
    assert_eq!(lines[300], json!({"end": {"answered": 300, "problems": 0}}));
}

#[tokio::test]
async fn longer_body_needs_a_caller_who_reads_and_holds_no_more() {
    let server = TestServer::start(16, instant_solver()).await;
    let (mut sender, mut receiver) = batch(server.address, "").await;
    let sending = tokio::spawn(async move {
        for number in 0..600 {
            assert!(sender.send(&long_line(number, "plan")).await);
        }
        sender.end().await
    });
    let (mut most, mut answered) = (0, 0);
    while let Some(line) = receiver.line().await {
        most = most.max(held_bytes(&server));
        answered += usize::from(line.get("solve").is_some());
    }
    assert_eq!(answered, 600);
    assert!(long_line(0, "plan").len() * 600 > 4 * LIMIT && most < 2 * LIMIT, "{most} bytes were held");
    drop(sending.await.unwrap());
}

#[tokio::test]
async fn who_never_reads_is_read_up_to_the_limit_and_then_ended() {
    let settings = ServerSettings { write_timeout: Duration::from_secs(1), ..ServerSettings::default() };
    let server = TestServer::start_with(16, wordy_solver(), ApiSettings::default(), settings).await;
    let (mut sender, receiver) = batch(server.address, "").await;
    let sent = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&sent);
    let sending = tokio::spawn(async move {
        for number in 0.. {
            let line = long_line(number, "full");
            if !sender.send(&line).await {
                break;
            }
            count.fetch_add(line.len(), Ordering::Relaxed);
        }
    });
    let mut most = 0;
    while !sending.is_finished() {
        most = most.max(held_bytes(&server));
        assert_eq!(server.post("/validate", "{}").await.status, 200, "others are served");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    // The window of items, answered and unread, beside what was read ahead.
    assert!(most < 2 * LIMIT + 16 * 400_000, "{most} bytes were held");
    let sent = sent.load(Ordering::Relaxed);
    // What was answered fills the buffers on the way back, some 10 kB of lines for each 90 kB.
    assert!(sent < LIMIT + 2 * BUFFERS, "{sent} bytes were sent");
    drop(receiver);
    let released = async {
        while held_bytes(&server) > 0 || server.service.jobs_in_flight() > 0 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    timeout(HANG_BOUND, released).await.expect("all is released");
}

#[tokio::test]
async fn batch_beyond_the_memory_ends_with_a_problem() {
    let settings = ServerSettings { memory_budget_bytes: 1 << 20, ..ServerSettings::default() };
    let (gate, mut started, solver) = held_solver();
    let server = TestServer::start_with(64, solver, ApiSettings::default(), settings).await;
    let (mut sender, mut receiver) = batch(server.address, "").await;
    assert!(sender.send("{\"request_id\": \"first\", \"solve\": {\"view\": \"plan\"}}\n").await);
    timeout(HANG_BOUND, started.recv()).await.unwrap();
    for number in 0..60 {
        sender.send(&long_line(number, "plan")).await;
    }
    timeout(HANG_BOUND, nothing_more_is_taken(&server)).await.expect("the memory is full");
    gate.open();
    let _open = sender.end().await;
    let lines = receiver.rest().await;
    let [.., problem, end] = &lines[..] else { panic!("{lines:?}") };
    assert_eq!((&problem["problem"]["code"], problem.get("line")), (&json!("memory_full"), None));
    // An item that was read may find no room for its answer.
    let [answered, problems] = ["answered", "problems"].map(|name| end["end"][name].as_u64().unwrap());
    assert!((1..60).contains(&answered) && problems >= 1 && lines.len() as u64 == answered + problems + 1, "{end}");
}

#[tokio::test]
async fn batches_of_many_small_frames_share_one_connection() {
    const ITEMS: usize = 1_000;
    let server = TestServer::start(64, instant_solver()).await;
    let mut connection = Connection::open(server.address, 1 << 30).await;
    connection.send(WINDOW_UPDATE, 0, 0, &(1_u32 << 30).to_be_bytes()).await;
    let streams = [1, 3, 5];
    for stream in streams {
        connection.request(stream, "/batch", 0).await;
    }
    for number in 0..ITEMS {
        let flags = if number + 1 == ITEMS { END_STREAM } else { 0 };
        let line = format!("{{\"request_id\":\"{number}\",\"solve\":{{\"view\":\"plan\"}}}}\n");
        for stream in streams {
            connection.send(DATA, flags, stream, line.as_bytes()).await;
        }
    }
    for _ in streams {
        assert!(connection.reads_up_to(HEADERS).await, "each has a head");
    }
    let done = async {
        let count = "slipdrive_http_request_duration_seconds_count{code=\"200\",route=\"/batch\"} 3";
        while !String::from_utf8(server.service.metrics_text()).unwrap().contains(count) {
            assert!(connection.reads_up_to(DATA).await, "all lines come");
        }
    };
    timeout(HANG_BOUND, done).await.expect("all are answered");
}
