//! Deadlines over real HTTP: they count from arrival, waiting included.

use std::sync::Arc;

use slipdrive::solver::SolveInput;
use slipdrive::solver::{RunControl, StopReason};
use tokio::sync::mpsc::unbounded_channel;

use crate::support::{Answer, FakeSolver, Gate, TestServer, small_solution};

async fn post(server: &TestServer, body: &'static str, timeout_ms: &str) -> Answer {
    let request = server.client.post(server.url("/solve")).header("content-type", "application/json");
    Answer::of(request.header("request-timeout-ms", timeout_ms).body(body)).await
}

fn spin_until_stopped(control: &RunControl<'_>) {
    while !control.is_stopped() {
        std::thread::yield_now();
    }
}

#[tokio::test]
async fn deadline_ends_a_solve_with_its_best_plan() {
    let solver = FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        spin_until_stopped(control);
        small_solution(StopReason::Stopped)
    });
    let server = TestServer::start(0, Arc::new(solver)).await;
    let answer = post(&server, r#"{"solver": {"time_limit_s": 60}}"#, "200").await;
    assert_eq!((answer.status, &answer.json()["stop_reason"]), (200, &"deadline".into()), "{}", answer.text());
}

#[tokio::test]
async fn earlier_time_limit_outruns_the_deadline() {
    let solver = FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        spin_until_stopped(control);
        small_solution(StopReason::Stopped)
    });
    let server = TestServer::start(0, Arc::new(solver)).await;
    let answer = post(&server, r#"{"solver": {"time_limit_s": 0.001}}"#, "60000").await;
    assert_eq!((answer.status, &answer.json()["stop_reason"]), (200, &"time_limit".into()));
}

#[tokio::test]
async fn whole_search_whose_certificate_is_cut_off_has_not_finished() {
    let solver = FakeSolver(|input: &SolveInput, control: &RunControl<'_>| {
        while !control.cut().is_set() {
            std::thread::yield_now();
        }
        let reasons = [StopReason::Finished, StopReason::RolloutLimit];
        let mut solution = small_solution(reasons[usize::try_from(input.settings.seed).unwrap()]);
        solution.report.replay = None;
        solution
    });
    let server = TestServer::start(0, Arc::new(solver)).await;
    let by_deadline = r#"{"solver": {"time_limit_s": 60, "seed": 0}}"#;
    let by_limit = r#"{"solver": {"time_limit_s": 0.001, "seed": 1}}"#;
    for (body, timeout_ms, stop_reason) in [(by_deadline, "50", "deadline"), (by_limit, "60000", "time_limit")] {
        let answer = post(&server, body, timeout_ms).await;
        assert_eq!((answer.status, &answer.json()["stop_reason"]), (200, &stop_reason.into()), "{}", answer.text());
    }
}

#[tokio::test]
async fn deadline_that_passes_in_the_line_is_answered_at_once_and_nothing_is_started() {
    let gate = Arc::new(Gate::default());
    let (started, mut has_started) = unbounded_channel();
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |input: &SolveInput, _: &RunControl<'_>| {
        started.send(input.settings.seed).unwrap();
        held.wait();
        small_solution(StopReason::Finished)
    });
    let server = Arc::new(TestServer::start(1, Arc::new(solver)).await);
    let running = {
        let server = Arc::clone(&server);
        // Nobody expects to wait long for a single rollout.
        let body = r#"{"solver": {"seed": 1, "rollout_limit": 1}}"#;
        tokio::spawn(async move { server.post("/solve", body).await })
    };
    assert_eq!(has_started.recv().await, Some(1));
    // The worker is held: only the watchdog can answer.
    let late = post(&server, r#"{"solver": {"seed": 2}}"#, "50").await;
    assert_eq!((late.status, late.problem()["code"].as_str()), (504, Some("deadline_exceeded")));
    assert_eq!(late.problem()["retryable"], true);
    assert_eq!(server.service.jobs_in_flight(), 1, "its place is free again");
    gate.open();
    assert_eq!(running.await.unwrap().status, 200);
    assert!(has_started.try_recv().is_err());
}

#[tokio::test]
async fn wait_that_would_outlast_the_deadline_is_refused_at_admission() {
    let gate = Arc::new(Gate::default());
    let (started, mut has_started) = unbounded_channel();
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |input: &SolveInput, control: &RunControl<'_>| {
        started.send(()).unwrap();
        if input.settings.seed == 1 {
            held.wait();
            return small_solution(StopReason::Finished);
        }
        spin_until_stopped(control);
        small_solution(StopReason::Stopped)
    });
    let server = Arc::new(TestServer::start(4, Arc::new(solver)).await);
    // The average of the solve durations is that of this one.
    assert_eq!(server.post("/solve", r#"{"solver": {"time_limit_s": 0.5}}"#).await.status, 200);
    has_started.recv().await.unwrap();
    let running = {
        let server = Arc::clone(&server);
        tokio::spawn(async move { server.post("/solve", r#"{"solver": {"seed": 1}}"#).await })
    };
    has_started.recv().await.unwrap();
    let refused = post(&server, "{}", "300").await;
    assert_eq!((refused.status, refused.problem()["code"].as_str()), (429, Some("deadline_unreachable")));
    assert!(refused.header("retry-after").parse::<u64>().unwrap() >= 1);
    assert_eq!(server.service.jobs_in_flight(), 1, "nothing was queued");
    gate.open();
    assert_eq!(running.await.unwrap().status, 200);
}

#[tokio::test]
async fn timeout_that_is_no_number_is_refused() {
    let server = TestServer::start(1, crate::support::instant_solver()).await;
    for timeout in ["soon", "-1", "0", "1.5"] {
        let answer = post(&server, "{}", timeout).await;
        assert_eq!((answer.status, answer.problem()["code"].as_str()), (422, Some("invalid_value")), "{timeout}");
    }
    assert_eq!(post(&server, "{}", "18446744073709551615").await.status, 200);
}

#[tokio::test]
async fn wait_behind_short_solves_is_not_taken_for_one_behind_long_ones() {
    let gate = Arc::new(Gate::default());
    let (started, mut has_started) = unbounded_channel();
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |input: &SolveInput, control: &RunControl<'_>| {
        started.send(()).unwrap();
        if input.settings.seed == 1 {
            held.wait();
            return small_solution(StopReason::Finished);
        }
        spin_until_stopped(control);
        let mut solution = small_solution(StopReason::Stopped);
        solution.report.rollouts = 40_000;
        solution
    });
    let server = Arc::new(TestServer::start(4, Arc::new(solver)).await);
    // The pace: 40,000 rollouts take half a second, the 200 of one start some ms.
    assert_eq!(server.post("/solve", r#"{"solver": {"starts": 64, "time_limit_s": 0.5}}"#).await.status, 200);
    has_started.recv().await.unwrap();
    let running = {
        let server = Arc::clone(&server);
        let body = r#"{"solver": {"starts": 1, "seed": 1}}"#;
        tokio::spawn(async move { server.post("/solve", body).await })
    };
    has_started.recv().await.unwrap();
    let waiting = post(&server, "{}", "300").await;
    assert_eq!((waiting.status, waiting.problem()["code"].as_str()), (504, Some("deadline_exceeded")), "it was queued");
    gate.open();
    assert_eq!(running.await.unwrap().status, 200);
}
