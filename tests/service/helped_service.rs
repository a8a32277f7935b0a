//! Idle workers of the service help with a search: same bytes, and never at the cost of another caller.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use futures_util::StreamExt as _;
use slipdrive::contract::json;
use slipdrive::jobs::solve::{AcceptedSolve, Progressed, Solve, Solved};
use slipdrive::jobs::{Jobs, Kind as _, Limits, ManeuverSolver};
use slipdrive::service::{Class, Done, Event, Running, Service, ServiceError, ServiceSettings};
use slipdrive::solver::{RunControl, SharedWork, SolveInput, StopReason};
use tokio::task::JoinSet;
use tokio::time::timeout;

use crate::support::{FakeSolver, HANG_BOUND, real_solver, small_solution};

/// A service and its jobs, without transports.
struct Workers {
    service: Service,
    jobs: Jobs,
}

impl Workers {
    fn start(workers: usize, solver: Arc<dyn ManeuverSolver>) -> Self {
        let workers = NonZeroUsize::new(workers).unwrap();
        let service = Service::start(ServiceSettings { workers, ..ServiceSettings::default() }).unwrap();
        let jobs = Jobs::new(Limits::default(), solver, service.metrics());
        Self { service, jobs }
    }

    /// A solve under way; what comes out is made by `answer`.
    fn solve<T: Send + 'static>(
        &self,
        body: &str,
        answer: fn(&AcceptedSolve, &Done<Solved>) -> T,
    ) -> Running<T, Progressed> {
        let accepted = Solve::read(body.as_bytes(), self.jobs.limits()).unwrap();
        self.service
            .reserve(Class::Heavy)
            .unwrap()
            .submit(Arc::clone(&self.jobs.solve), accepted, None, answer)
            .unwrap()
    }

    /// The bytes of the answer, with a solve time of zero.
    async fn answer(&self, body: &str) -> Vec<u8> {
        let running = self.solve(body, |accepted, done| {
            json::write(&Solve::answer(accepted, &Done { duration: Duration::ZERO, ..done.clone() }))
        });
        timeout(HANG_BOUND, running.outcome()).await.expect("nothing hangs").unwrap()
    }
}

fn body(number: usize, rollout_limit: u64) -> String {
    let (x, y) = (number as f64 * 0.4 - 0.6, 1.0 + number as f64 * 0.3);
    format!(
        r#"{{"maneuver": {{"goal": {{"x_m": {x}, "y_m": {y}}}}}, "grid": {{"steps": 24, "control_intervals": 6}},
             "solver": {{"rollout_limit": {rollout_limit}}}}}"#
    )
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn callers_of_any_number_of_workers_get_the_same_bytes() {
    let bodies: Vec<_> = (0..3).flat_map(|number| [2_000_000, 500].map(|limit| body(number, limit))).collect();
    let one = Workers::start(1, real_solver());
    let mut expected = Vec::new();
    for body in &bodies {
        expected.push(one.answer(body).await);
    }
    for workers in [2, 3, 8] {
        let helped = Arc::new(Workers::start(workers, real_solver()));
        // One by one: all other workers help. Then all at once: they come and go.
        for (body, expected) in bodies.iter().zip(&expected) {
            assert!(helped.answer(body).await == *expected, "{workers} workers: {body}");
        }
        let mut callers = JoinSet::new();
        for (body, expected) in bodies.iter().cloned().zip(expected.clone()) {
            let helped = Arc::clone(&helped);
            callers.spawn(async move { assert!(helped.answer(&body).await == expected, "{body}") });
        }
        while callers.join_next().await.transpose().unwrap().is_some() {}
        assert_eq!(helped.service.jobs_in_flight(), 0);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn second_caller_does_not_wait_for_the_helped_search_of_the_first() {
    let two = Workers::start(2, real_solver());
    let long = r#"{"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 5000, "control_intervals": 40}, "solver": {"starts": 64, "time_limit_s": 60}}"#;
    let mut first = Box::pin(two.solve(long, |_, _| ()).events());
    let mut next_event = async || timeout(HANG_BOUND, first.next()).await.expect("nothing hangs");
    // It runs, and has had time to find the other worker idle.
    let events = [next_event().await, next_event().await];
    assert!(matches!(events, [Some(Event::Queued(0)), Some(Event::Progress(_))]), "{events:?}");
    for number in 0..3 {
        two.answer(&body(number, 300)).await;
        assert_eq!(two.service.jobs_in_flight(), 1, "the first still runs");
    }
    drop(first);
    let empty = async {
        while two.service.jobs_in_flight() > 0 {
            tokio::task::yield_now().await;
        }
    };
    timeout(HANG_BOUND, empty).await.expect("whoever helped is free again");
    two.answer(&body(0, 300)).await;
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
    let two = Workers::start(2, Arc::new(solver));
    let solve = || two.solve("{}", |_, _| ()).outcome();
    for _ in 0..3 {
        assert_eq!(timeout(HANG_BOUND, solve()).await.expect("nothing hangs"), Err(ServiceError::SolverPanic));
    }
    assert_eq!(timeout(HANG_BOUND, solve()).await.expect("both workers go on"), Ok(()));
}
