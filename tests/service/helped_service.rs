//! Idle workers of the service help with a search: same bytes, and never at the cost of another caller.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use slipdrive::api::rest::{read_solve, solve_answer};
use slipdrive::service::domain::SolveInput;
use slipdrive::service::{ManeuverSolver, Service, ServiceError, ServiceSettings, SolveClocks, SolveEvent};
use slipdrive::solver::{RunControl, SharedWork, StopReason};
use tokio::task::JoinSet;
use tokio::time::timeout;

use crate::support::{FakeSolver, HANG_BOUND, real_solver, small_solution};

fn service(workers: usize, solver: Arc<dyn ManeuverSolver>) -> Service {
    let workers = NonZeroUsize::new(workers).unwrap();
    Service::start(ServiceSettings { workers, ..ServiceSettings::default() }, solver).unwrap()
}

fn body(number: usize, rollout_limit: u64) -> String {
    let (x, y) = (number as f64 * 0.4 - 0.6, 1.0 + number as f64 * 0.3);
    format!(
        r#"{{"maneuver": {{"goal": {{"x_m": {x}, "y_m": {y}}}}}, "grid": {{"steps": 24, "control_intervals": 6}},
             "solver": {{"rollout_limit": {rollout_limit}}}}}"#
    )
}

/// The bytes of the answer, with a solve time of zero.
async fn answer(service: &Service, body: &str) -> Vec<u8> {
    let accepted = read_solve(body.as_bytes(), service.limits()).unwrap();
    let clocks = SolveClocks { time_limit: Duration::from_secs(60), deadline: None };
    let solving = service.reserve().unwrap().solve(accepted.input.clone(), clocks, |solved| solved);
    let mut solved = timeout(HANG_BOUND, solving).await.expect("nothing hangs").unwrap();
    solved.solve_time = Duration::ZERO;
    solve_answer(&accepted, &solved)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn callers_of_any_number_of_workers_get_the_same_bytes() {
    let bodies: Vec<_> = (0..3).flat_map(|number| [2_000_000, 500].map(|limit| body(number, limit))).collect();
    let one = service(1, real_solver());
    let mut expected = Vec::new();
    for body in &bodies {
        expected.push(answer(&one, body).await);
    }
    for workers in [2, 3, 8] {
        let service = Arc::new(service(workers, real_solver()));
        // One by one: all other workers help. Then all at once: they come and go.
        for (body, expected) in bodies.iter().zip(&expected) {
            assert!(answer(&service, body).await == *expected, "{workers} workers: {body}");
        }
        let mut callers = JoinSet::new();
        for (body, expected) in bodies.iter().cloned().zip(expected.clone()) {
            let service = Arc::clone(&service);
            callers.spawn(async move { assert!(answer(&service, &body).await == expected, "{body}") });
        }
        while callers.join_next().await.transpose().unwrap().is_some() {}
        assert_eq!(service.jobs_in_flight(), 0);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn second_caller_does_not_wait_for_the_helped_search_of_the_first() {
    let service = service(2, real_solver());
    let long = r#"{"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 5000, "control_intervals": 40}, "solver": {"starts": 64, "time_limit_s": 60}}"#;
    let accepted = read_solve(long.as_bytes(), service.limits()).unwrap();
    let clocks = SolveClocks { time_limit: accepted.time_limit, deadline: None };
    let mut first = service.reserve().unwrap().start_solve(accepted.input, clocks, drop).unwrap();
    // It runs, and has had time to find the other worker idle.
    let event = timeout(HANG_BOUND, first.next_event()).await.expect("nothing hangs");
    assert!(matches!(event, SolveEvent::Progress(_)), "{event:?}");
    for number in 0..3 {
        answer(&service, &body(number, 300)).await;
        assert_eq!(service.jobs_in_flight(), 1, "the first still runs");
    }
    drop(first);
    let empty = async {
        while service.jobs_in_flight() > 0 {
            tokio::task::yield_now().await;
        }
    };
    timeout(HANG_BOUND, empty).await.expect("whoever helped is free again");
    answer(&service, &body(0, 300)).await;
}

/// Two parts that wait for each other; the second to come panics.
struct PanickingPair {
    open: AtomicUsize,
    under_way: AtomicUsize,
}

impl SharedWork for PanickingPair {
    fn open_parts(&self) -> usize {
        self.open.load(Ordering::SeqCst)
    }

    fn take_part(&self, _recalled: &AtomicBool) -> bool {
        if self.open.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |open| open.checked_sub(1)).is_err() {
            return false;
        }
        self.under_way.fetch_add(1, Ordering::SeqCst);
        while self.under_way.load(Ordering::SeqCst) < 2 {
            std::thread::yield_now();
        }
        assert!(std::thread::current().name() != Some("slipdrive-helper"), "injected into the helper");
        true
    }
}

#[tokio::test]
async fn panic_of_a_helper_is_a_solver_panic_and_the_workers_go_on() {
    let panics = AtomicUsize::new(3);
    let solver = FakeSolver(move |_: &SolveInput, control: &RunControl<'_>| {
        if panics.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1)).is_ok() {
            control.share(&PanickingPair { open: AtomicUsize::new(2), under_way: AtomicUsize::new(0) });
        }
        small_solution(StopReason::Finished)
    });
    let service = service(2, Arc::new(solver));
    let solve = || {
        let clocks = SolveClocks { time_limit: Duration::from_secs(60), deadline: None };
        service.reserve().unwrap().solve(SolveInput::forward_drive(), clocks, drop)
    };
    for _ in 0..3 {
        assert_eq!(timeout(HANG_BOUND, solve()).await.expect("nothing hangs"), Err(ServiceError::SolverPanic));
    }
    assert_eq!(timeout(HANG_BOUND, solve()).await.expect("both workers go on"), Ok(()));
}
