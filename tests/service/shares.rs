//! Several callers with keys: none of them keeps the others from their answers.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use slipdrive::api::ApiSettings;
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::server::ServerSettings;
use slipdrive::service::ServiceSettings;
use slipdrive::solver::{RunControl, SolveInput, StopReason};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::time::timeout;

use crate::support::lines::batch;
use crate::support::{Answer, FakeSolver, Gate, HANG_BOUND, TestServer, held_solver, instant_solver, small_solution};

const TWO_CALLERS: &str = "flood:a\nquiet:b";

fn with_keys(text: &str) -> ApiSettings {
    ApiSettings { keys: ApiKeys::parse(text).unwrap(), ..ApiSettings::default() }
}

async fn solve(server: &TestServer, key: &str, seed: u64) -> Answer {
    let body = format!(r#"{{"solver": {{"seed": {seed}}}}}"#);
    let request = server.client.post(server.url("/solve")).bearer_auth(key);
    Answer::of(request.header("content-type", "application/json").body(body)).await
}

/// Asks without waiting for the answer.
fn ask(server: &Arc<TestServer>, key: &'static str, seeds: impl Iterator<Item = u64>) -> UnboundedReceiver<Answer> {
    let (answers, answered) = unbounded_channel();
    for seed in seeds {
        let (server, answers) = (Arc::clone(server), answers.clone());
        tokio::spawn(async move { answers.send(solve(&server, key, seed).await) });
    }
    answered
}

async fn next<T>(receiver: &mut UnboundedReceiver<T>) -> T {
    timeout(HANG_BOUND, receiver.recv()).await.expect("nothing hangs").expect("the sender lives")
}

/// Waits until so many jobs are in flight.
async fn in_flight(server: &TestServer, jobs: usize) {
    let filled = async {
        while server.service.jobs_in_flight() != jobs {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    timeout(HANG_BOUND, filled).await.expect("they are queued");
}

/// Waits until so many jobs wait for a worker; those in flight may not have come so far.
async fn waiting(server: &TestServer, jobs: usize) {
    let depth = format!("slipdrive_queue_depth {jobs}");
    let waits = || String::from_utf8(server.service.metrics_text()).unwrap().lines().any(|line| line == depth);
    let all_wait = async {
        while !waits() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    timeout(HANG_BOUND, all_wait).await.expect("they wait");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn flood_of_one_key_takes_its_share_and_no_more() {
    let (gate, mut started, solver) = held_solver();
    let server = TestServer::start_with(4, solver, with_keys(TWO_CALLERS), ServerSettings::default()).await;
    let server = Arc::new(server);
    let mut flood = ask(&server, "a", 1..=20);
    next(&mut started).await;
    // One runs, and two wait in half of the queue.
    for _ in 0..17 {
        let refused = next(&mut flood).await;
        assert_eq!((refused.status, &refused.problem()["code"]), (429, &"queue_full".into()));
        assert!(refused.problem()["detail"].as_str().unwrap().contains("share"), "{}", refused.text());
        assert!(refused.header("retry-after").parse::<u64>().unwrap() >= 1);
    }
    let mut quiet = ask(&server, "b", 1..=2);
    in_flight(&server, 5).await;
    let metrics = String::from_utf8(server.service.metrics_text()).unwrap();
    for line in [
        "slipdrive_caller_jobs{caller=\"flood\"} 3",
        "slipdrive_caller_jobs{caller=\"quiet\"} 2",
        "slipdrive_caller_refused_total{caller=\"flood\"} 17",
        "slipdrive_caller_refused_total{caller=\"quiet\"} 0",
    ] {
        assert!(metrics.lines().any(|found| found == line), "{line} in {metrics}");
    }
    gate.open();
    for answers in [&mut flood, &mut quiet] {
        assert_eq!((next(answers).await.status, next(answers).await.status), (200, 200));
    }
    assert_eq!(next(&mut flood).await.status, 200);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn callers_take_turns_in_the_queue() {
    let gate = Arc::new(Gate::default());
    let (held, (tell, mut order)) = (Arc::clone(&gate), unbounded_channel());
    let solver = FakeSolver(move |input: &SolveInput, _: &RunControl<'_>| {
        tell.send(input.settings.seed).unwrap();
        held.wait();
        small_solution(StopReason::Finished)
    });
    let server =
        Arc::new(TestServer::start_with(8, Arc::new(solver), with_keys(TWO_CALLERS), ServerSettings::default()).await);
    let mut answers = Vec::new();
    for (index, (key, seed)) in [("a", 1), ("a", 2), ("a", 3), ("a", 4), ("b", 5), ("b", 6)].into_iter().enumerate() {
        answers.push(ask(&server, key, seed..=seed));
        if index == 0 {
            // While it waits, it has a turn, which changes those of the others.
            assert_eq!(next(&mut order).await, 1);
        }
        waiting(&server, index).await;
    }
    gate.open();
    for expected in [2, 5, 3, 6, 4] {
        assert_eq!(next(&mut order).await, expected);
    }
    for mut answer in answers {
        assert_eq!(next(&mut answer).await.status, 200);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn caller_without_others_has_the_whole_queue() {
    let (gate, mut started, solver) = held_solver();
    let server =
        Arc::new(TestServer::start_with(4, solver, with_keys("fleet:old,fleet:new"), ServerSettings::default()).await);
    let mut answers = ask(&server, "old", 1..=5);
    next(&mut started).await;
    in_flight(&server, 5).await;
    gate.open();
    for _ in 0..5 {
        assert_eq!(next(&mut answers).await.status, 200);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn batches_wait_for_their_share_where_single_requests_are_refused() {
    let (gate, mut started, solver) = held_solver();
    let server = Arc::new(TestServer::start_with(8, solver, with_keys(TWO_CALLERS), ServerSettings::default()).await);
    let (mut sender, mut receiver) = batch(server.address, "authorization: Bearer a\r\n").await;
    for item in 0..10 {
        assert!(sender.send(&format!("{{\"request_id\": \"{item}\", \"solve\": {{}}}}\n")).await);
    }
    next(&mut started).await;
    // Of the five of its share, one is left to its other requests.
    in_flight(&server, 4).await;
    let mut single = ask(&server, "a", 1..=1);
    in_flight(&server, 5).await;
    assert_eq!(solve(&server, "a", 1).await.status, 429);
    gate.open();
    assert_eq!(next(&mut single).await.status, 200);
    // Closed, it would be that of a caller who left.
    let _open = sender.end().await;
    assert_eq!(receiver.rest().await.last().unwrap()["end"]["answered"], 10);
}

/// How long a request of the other caller may take beside the flood: fifty times the job, and machines that do much else.
const IN_TIME: Duration = Duration::from_secs(2);
const JOB: Duration = Duration::from_millis(20);

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn flood_of_one_key_leaves_the_requests_of_another_in_time() {
    let solver = FakeSolver(|_: &SolveInput, _: &RunControl<'_>| {
        std::thread::sleep(JOB);
        small_solution(StopReason::Finished)
    });
    let settings = ServiceSettings { workers: NonZeroUsize::MIN, queue_length: 256, ..ServiceSettings::default() };
    let (solver, keys) = (Arc::new(solver), with_keys(TWO_CALLERS));
    let server = Arc::new(TestServer::start_sized(settings, solver, keys, ServerSettings::default()).await);
    let is_over = Arc::new(AtomicBool::new(false));
    let floods: Vec<_> = (0..160)
        .map(|seed| {
            let (server, is_over) = (Arc::clone(&server), Arc::clone(&is_over));
            tokio::spawn(async move {
                while !is_over.load(Ordering::Relaxed) {
                    if solve(&server, "a", seed).await.status == 429 {
                        tokio::time::sleep(JOB).await;
                    }
                }
            })
        })
        .collect();
    in_flight(&server, 129).await;
    let mut longest = Duration::ZERO;
    for seed in 1..=20 {
        let begin = Instant::now();
        let answer = solve(&server, "b", seed).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        longest = longest.max(begin.elapsed());
    }
    println!("longest request beside the flood: {longest:?}");
    assert!(longest < IN_TIME, "one took {longest:?}");
    is_over.store(true, Ordering::Relaxed);
    for flood in floods {
        flood.abort();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn open_requests_of_one_key_leave_half_of_the_connections() {
    // Sixteen of them are for probes.
    let settings = ServerSettings { max_connections: 36, ..ServerSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), with_keys(TWO_CALLERS), settings).await;
    let mut open = Vec::new();
    for _ in 0..18 {
        let (sender, mut receiver) = batch(server.address, "authorization: Bearer a\r\n").await;
        assert!(receiver.head().await.starts_with("HTTP/1.1 200"));
        open.push((sender, receiver));
    }
    let refused = solve(&server, "a", 1).await;
    assert_eq!((refused.status, &refused.problem()["code"]), (429, &"queue_full".into()), "{}", refused.text());
    assert_eq!(solve(&server, "b", 1).await.status, 200);
    let (sender, mut receiver) = open.pop().unwrap();
    let _open = sender.end().await;
    receiver.rest().await;
    assert_eq!(solve(&server, "a", 1).await.status, 200);
}
