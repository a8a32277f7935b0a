//! Waits are estimated from the work that was done, so that callers who would wait in vain are refused at once.

use std::sync::Arc;
use std::time::{Duration, Instant};

use slipdrive::solver::{RunControl, Solution, SolveInput, StopReason};
use tokio::task::JoinSet;

use crate::support::{Answer, FakeSolver, TestServer, small_solution};

/// What the fake search takes of the processor for one rollout: 100 ms for the 200 that one start is expected to need.
const ROLLOUT: Duration = Duration::from_micros(500);
const ROLLOUTS: u64 = 200;
const CALLERS: usize = 20;

/// Seed 1 stands at its goal; the others search.
fn search(input: &SolveInput, control: &RunControl<'_>) -> Solution {
    let mut solution = small_solution(StopReason::Finished);
    solution.report.rollouts = 0;
    while input.settings.seed != 1 && solution.report.rollouts < ROLLOUTS {
        if control.is_stopped() {
            solution.stop_reason = StopReason::Stopped;
            break;
        }
        let begin = Instant::now();
        while begin.elapsed() < ROLLOUT {
            std::hint::spin_loop();
        }
        solution.report.rollouts += 1;
    }
    solution
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn crowd_is_refused_but_for_those_that_can_be_served() {
    let server = Arc::new(TestServer::start(64, Arc::new(FakeSolver(search))).await);
    for _ in 0..10 {
        assert_eq!(server.post("/solve", r#"{"solver": {"starts": 1}}"#).await.status, 200);
    }
    for _ in 0..50 {
        assert_eq!(server.post("/solve", r#"{"solver": {"starts": 1, "seed": 1}}"#).await.status, 200);
    }
    let mut callers = JoinSet::new();
    for _ in 0..CALLERS {
        let server = Arc::clone(&server);
        callers.spawn(async move {
            let request = server.client.post(server.url("/solve")).header("content-type", "application/json");
            // Long enough for five of them.
            let request = request.header("request-timeout-ms", "500").body(r#"{"solver": {"starts": 1}}"#);
            let answer = Answer::of(request).await;
            (answer.status, if answer.status == 200 { String::new() } else { answer.problem()["code"].to_string() })
        });
    }
    let ended = callers.join_all().await;
    let count = |status: u16| ended.iter().filter(|(found, _)| *found == status).count();
    // A stalled machine serves fewer, and lets some wait in vain.
    assert!(count(200) >= 1 && count(429) >= CALLERS / 2, "{ended:?}");
    assert_eq!(count(200) + count(429) + count(504), CALLERS, "{ended:?}");
    assert!(ended.iter().all(|(status, code)| *status != 429 || code == r#""deadline_unreachable""#), "{ended:?}");
}
