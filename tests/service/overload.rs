//! Overload, panics and departures over real HTTP, held in place by gates.

use std::io::Write as _;
use std::net::TcpStream;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use slipdrive::api::ApiSettings;
use slipdrive::api::server::ServerSettings;
use slipdrive::service::{Class, ServiceSettings};
use slipdrive::solver::SolveInput;
use slipdrive::solver::{RunControl, StopReason};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::time::timeout;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use crate::support::{Answer, FakeSolver, Gate, HANG_BOUND, TestServer, held_solver, small_solution};

const BODY: &str = r#"{"maneuver": {"goal": {"y_m": 5}}}"#;

async fn next<T>(receiver: &mut UnboundedReceiver<T>) -> T {
    timeout(HANG_BOUND, receiver.recv()).await.expect("nothing hangs").expect("the sender lives")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_running_and_four_waiting_of_a_hundred_are_accepted() {
    let gate = Arc::new(Gate::default());
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |_: &SolveInput, _: &RunControl<'_>| {
        held.wait();
        small_solution(StopReason::Finished)
    });
    let server = Arc::new(TestServer::start(4, Arc::new(solver)).await);
    let (answers, mut answered) = unbounded_channel();
    for _ in 0..100 {
        let (server, answers) = (Arc::clone(&server), answers.clone());
        tokio::spawn(async move { answers.send(server.post("/solve", BODY).await) });
    }
    // The worker is still held: refusals come at once or never.
    for _ in 0..95 {
        let refused: Answer = next(&mut answered).await;
        assert_eq!(refused.status, 429, "{}", refused.text());
        assert!(refused.header("retry-after").parse::<u64>().unwrap() >= 1);
        let problem = refused.problem();
        assert_eq!((&problem["code"], &problem["retryable"]), (&"queue_full".into(), &true.into()));
        assert!(problem["retry_after_ms"].as_u64().unwrap() >= 1);
    }
    assert_eq!(server.get("/readyz").await.status, 200, "a full queue stays ready");
    assert_eq!(server.post("/validate", BODY).await.status, 200, "validation needs no place");
    assert!(answered.try_recv().is_err(), "five are held");
    gate.open();
    for _ in 0..5 {
        assert_eq!(next(&mut answered).await.status, 200);
    }
    assert_eq!(server.post("/solve", BODY).await.status, 200, "all places are free again");
}

#[tokio::test]
async fn refused_body_is_not_parsed() {
    let (gate, mut has_started, solver) = held_solver();
    let server = Arc::new(TestServer::start(0, solver).await);
    let running = {
        let server = Arc::clone(&server);
        tokio::spawn(async move { server.post("/solve", BODY).await })
    };
    next(&mut has_started).await;
    assert_eq!(server.post("/solve", "not JSON").await.status, 429);
    gate.open();
    assert_eq!(running.await.unwrap().status, 200);
    assert_eq!(server.post("/solve", "not JSON").await.status, 400);
}

#[tokio::test]
async fn panic_in_a_solve_is_a_problem_and_the_worker_goes_on() {
    let has_panicked = AtomicBool::new(false);
    let solver = FakeSolver(move |_: &SolveInput, _: &RunControl<'_>| {
        assert!(has_panicked.swap(true, Ordering::Relaxed), "injected secret");
        small_solution(StopReason::Finished)
    });
    let server = TestServer::start(0, Arc::new(solver)).await;
    let failed = server.post("/solve", BODY).await;
    assert_eq!(failed.status, 500);
    assert_eq!(failed.problem()["code"], "solver_panic");
    assert!(!failed.text().contains("secret"), "no internals: {}", failed.text());
    assert_eq!(server.post("/solve", BODY).await.status, 200);
}

#[tokio::test]
async fn caller_who_hangs_up_frees_the_worker_for_the_next() {
    let (started, mut has_started) = unbounded_channel();
    let polled_to_the_stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&polled_to_the_stop);
    let solver = FakeSolver(move |input: &SolveInput, control: &RunControl<'_>| {
        if input.settings.seed == 1 {
            started.send(()).unwrap();
            // One turn stands for one rollout.
            while !control.is_stopped() {
                std::thread::yield_now();
            }
            stopped.store(true, Ordering::Relaxed);
            return small_solution(StopReason::Stopped);
        }
        small_solution(StopReason::Finished)
    });
    let server = Arc::new(TestServer::start(1, Arc::new(solver)).await);

    let mut departing = TcpStream::connect(server.address).unwrap();
    let body = r#"{"solver": {"seed": 1, "time_limit_s": 60}}"#;
    let head = format!(
        "POST /solve HTTP/1.1\r\nhost: h\r\ncontent-type: application/json\r\ncontent-length: {}\r\n\r\n",
        body.len()
    );
    departing.write_all(format!("{head}{body}").as_bytes()).unwrap();
    next(&mut has_started).await;
    let waiting = {
        let server = Arc::clone(&server);
        tokio::spawn(async move { server.post("/solve", BODY).await })
    };
    drop(departing);
    let answer = timeout(HANG_BOUND, waiting).await.expect("the worker is freed").unwrap();
    assert_eq!(answer.status, 200);
    assert!(polled_to_the_stop.load(Ordering::Relaxed));
}

#[tokio::test]
async fn waiting_job_of_a_caller_who_hung_up_is_never_started() {
    let gate = Arc::new(Gate::default());
    let (held, seeds) = (Arc::clone(&gate), Arc::new(Mutex::new(Vec::new())));
    let seen = Arc::clone(&seeds);
    let solver = FakeSolver(move |input: &SolveInput, _: &RunControl<'_>| {
        seen.lock().unwrap().push(input.settings.seed);
        held.wait();
        small_solution(StopReason::Finished)
    });
    let server = Arc::new(TestServer::start(1, Arc::new(solver)).await);
    let post = |seed: u64| {
        let server = Arc::clone(&server);
        tokio::spawn(async move { server.post("/solve", format!(r#"{{"solver": {{"seed": {seed}}}}}"#)).await })
    };
    let in_flight = async |count: usize| {
        while server.service.jobs_in_flight() != count {
            tokio::task::yield_now().await;
        }
    };
    let first = post(1);
    timeout(HANG_BOUND, in_flight(1)).await.unwrap();
    let departing = post(2);
    timeout(HANG_BOUND, in_flight(2)).await.unwrap();
    // Dropping the request closes its connection.
    departing.abort();
    timeout(HANG_BOUND, in_flight(1)).await.expect("the place of the caller who left is free at once");
    gate.open();
    assert_eq!(first.await.unwrap().status, 200);
    assert_eq!(post(3).await.unwrap().status, 200);
    assert_eq!(*seeds.lock().unwrap(), [1, 3]);
}

#[tokio::test]
async fn time_limit_ends_a_solve_with_its_best_plan() {
    let solver = FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        small_solution(StopReason::Stopped)
    });
    let server = TestServer::start(0, Arc::new(solver)).await;
    let answer = server.post("/solve", r#"{"solver": {"time_limit_s": 0.001}}"#).await;
    assert_eq!((answer.status, &answer.json()["stop_reason"]), (200, &"time_limit".into()));
    assert_eq!(answer.json()["applied_limits"]["time_limit_s"], 0.001);
}

#[tokio::test]
async fn draining_server_is_alive_but_not_ready_and_finishes_what_it_has() {
    let (gate, mut has_started, solver) = held_solver();
    let server = Arc::new(TestServer::start(1, solver).await);
    let running = {
        let server = Arc::clone(&server);
        tokio::spawn(async move { server.post("/solve", BODY).await })
    };
    next(&mut has_started).await;
    server.service.close();
    assert_eq!(server.get("/livez").await.status, 200);
    for refused in [server.get("/readyz").await, server.post("/solve", BODY).await] {
        assert_eq!(refused.status, 503);
        assert!(refused.header("retry-after").parse::<u64>().unwrap() >= 1);
        assert_eq!(refused.problem()["code"], "unavailable");
    }
    gate.open();
    assert_eq!(running.await.unwrap().status, 200);
}

#[tokio::test]
async fn cancelled_service_answers_unavailable() {
    let (started, mut has_started) = unbounded_channel();
    let solver = FakeSolver(move |_: &SolveInput, control: &RunControl<'_>| {
        started.send(()).unwrap();
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        small_solution(StopReason::Stopped)
    });
    let server = Arc::new(TestServer::start(1, Arc::new(solver)).await);
    let post = || {
        let server = Arc::clone(&server);
        tokio::spawn(async move { server.post("/solve", BODY).await })
    };
    let running = post();
    next(&mut has_started).await;
    server.service.cancel_all();
    let answer = running.await.unwrap();
    assert_eq!((answer.status, answer.problem()["code"].as_str()), (503, Some("unavailable")));
}

#[tokio::test]
async fn solver_that_claims_a_stop_that_nobody_asked_for_is_a_fault_of_the_server() {
    let solver = FakeSolver(|_: &SolveInput, _: &RunControl<'_>| small_solution(StopReason::Stopped));
    let server = TestServer::start(0, Arc::new(solver)).await;
    let answer = server.post("/solve", BODY).await;
    assert_eq!((answer.status, answer.problem()["code"].as_str()), (500, Some("solver_panic")));
}

#[tokio::test]
async fn solves_run_on_named_worker_threads() {
    let (names, mut seen) = unbounded_channel();
    let solver = FakeSolver(move |_: &SolveInput, _: &RunControl<'_>| {
        names.send(std::thread::current().name().map(str::to_owned)).unwrap();
        small_solution(StopReason::Finished)
    });
    let server = TestServer::start(0, Arc::new(solver)).await;
    assert_eq!(server.post("/solve", BODY).await.status, 200);
    assert_eq!(next(&mut seen).await.as_deref(), Some("slipdrive-worker-0"));
}

#[tokio::test]
async fn server_whose_workers_are_all_stuck_is_not_alive_until_one_comes_back() {
    // Never looks at its stop flag.
    let (gate, mut has_started, solver) = held_solver();
    let settings = ServiceSettings {
        workers: NonZeroUsize::new(2).unwrap(),
        stuck_after: Duration::from_millis(20),
        ..ServiceSettings::default()
    };
    let (api, connections) = (ApiSettings::default(), ServerSettings::default());
    let server = Arc::new(TestServer::start_sized(settings, solver, api, connections).await);
    let mut health = HealthClient::new(server.channel().await);
    let mut callers = Vec::new();
    for _ in 0..2 {
        let server = Arc::clone(&server);
        callers.push(tokio::spawn(async move { server.post("/solve", BODY).await }));
        // One that waits would be taken out of the line in silence.
        next(&mut has_started).await;
    }
    let stuck = async |count: usize| {
        while server.service.stuck_workers() != count {
            tokio::task::yield_now().await;
        }
    };
    callers[0].abort();
    timeout(HANG_BOUND, stuck(1)).await.unwrap();
    assert_eq!((server.get("/livez").await.status, server.get("/readyz").await.status), (200, 200), "one is left");
    callers[1].abort();
    timeout(HANG_BOUND, stuck(2)).await.unwrap();
    for refused in [server.get("/livez").await, server.get("/readyz").await, server.post("/solve", BODY).await] {
        assert_eq!((refused.status, refused.problem()["code"].as_str()), (503, Some("unavailable")));
    }
    let mut becomes = async |expected: ServingStatus| {
        let mut told = health.watch(HealthCheckRequest::default()).await.unwrap().into_inner();
        while told.message().await.unwrap().unwrap().status() != expected {}
    };
    timeout(HANG_BOUND, becomes(ServingStatus::NotServing)).await.expect("probes of gRPC are told");
    gate.open();
    timeout(HANG_BOUND, becomes(ServingStatus::Serving)).await.expect("and told again");
    assert_eq!((server.get("/livez").await.status, server.post("/solve", BODY).await.status), (200, 200));
}

#[tokio::test]
async fn expected_work_of_what_waits_is_bounded_beside_its_number() {
    let gate = Arc::new(Gate::default());
    let (held, holds) = (Arc::clone(&gate), Arc::new(AtomicBool::new(false)));
    let is_held = Arc::clone(&holds);
    let solver = FakeSolver(move |_: &SolveInput, control: &RunControl<'_>| {
        if is_held.load(Ordering::Relaxed) {
            held.wait();
            return small_solution(StopReason::Finished);
        }
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        small_solution(StopReason::Stopped)
    });
    let settings =
        ServiceSettings { queue_length: 100, queue_work: Duration::from_secs(2), ..ServiceSettings::default() };
    let (api, connections) = (ApiSettings::default(), ServerSettings::default());
    let server = Arc::new(TestServer::start_sized(settings, Arc::new(solver), api, connections).await);
    // This one tells the pace: half a second for one start.
    let measured = server.post("/solve", r#"{"solver": {"starts": 1, "time_limit_s": 0.5}}"#).await;
    assert_eq!(measured.status, 200);
    holds.store(true, Ordering::Relaxed);
    // It is expected to take some 30 s, but a worker is idle.
    let running = {
        let server = Arc::clone(&server);
        let body = r#"{"solver": {"starts": 64, "time_limit_s": 60}}"#;
        tokio::spawn(async move { server.post("/solve", body).await })
    };
    while server.service.jobs_in_flight() != 1 {
        tokio::task::yield_now().await;
    }
    // Refused as soon as the expected work is known: the place is filled a moment after it was taken.
    while server.service.reserve(Class::Heavy).is_ok() {
        tokio::task::yield_now().await;
    }
    let refused = server.post("/solve", BODY).await;
    assert_eq!((refused.status, refused.problem()["code"].as_str()), (429, Some("queue_full")));
    gate.open();
    assert_eq!(running.await.unwrap().status, 200);
    assert_eq!(server.post("/solve", BODY).await.status, 200, "nothing is expected any more");
}
