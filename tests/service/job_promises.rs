//! What jobs are promised: permits, positions and deadlines.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use serde_json::json;
use slipdrive::jobs::ManeuverSolver;
use slipdrive::queue::{Capacity, Clocks, Queue};
use slipdrive::solver::{RunControl, SolveInput, StopReason};

use crate::support::lines::batch;
use crate::support::{FakeSolver, TestServer, small_solution};

#[test]
fn permit_that_is_given_back_after_closing_lets_idle_workers_end() {
    for _ in 0..50 {
        let queue = Queue::start(NonZeroUsize::MIN, Capacity { permits: 2, work: Duration::MAX }).unwrap();
        // The worker has been at work, and waits for more.
        drop(queue.reserve().unwrap().submit(Clocks::default(), |_| ()).blocking_outcome());
        let permit = queue.reserve().unwrap();
        std::thread::sleep(Duration::from_millis(2));
        queue.close();
        std::thread::sleep(Duration::from_millis(2));
        drop(permit);
        let (told, ended) = channel();
        std::thread::spawn(move || {
            queue.join();
            let _ = told.send(());
        });
        assert!(ended.recv_timeout(Duration::from_secs(10)).is_ok(), "the worker waits for ever");
    }
}

#[test]
fn a_job_is_told_how_many_are_before_it() {
    let queue = Queue::start(NonZeroUsize::new(2).unwrap(), Capacity { permits: 8, work: Duration::MAX }).unwrap();
    let (release, released) = channel::<()>();
    let released = Arc::new(std::sync::Mutex::new(released));
    let (started, has_started) = channel();
    let mut tickets = Vec::new();
    for (count, position) in [0, 0, 1, 2, 3].into_iter().enumerate() {
        let permit = queue.reserve().unwrap();
        assert_eq!(permit.position(), position, "after {count}");
        let (started, released) = (started.clone(), Arc::clone(&released));
        tickets.push(permit.submit(Clocks::default(), move |_| {
            let _ = started.send(());
            let _ = released.lock().unwrap().recv();
        }));
        if count < 2 {
            has_started.recv().unwrap();
        }
    }
    drop(release);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_nearer_of_the_deadlines_of_an_item_and_of_its_batch_counts() {
    let endless: Arc<dyn ManeuverSolver> = Arc::new(FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        small_solution(StopReason::Stopped)
    }));
    let server = TestServer::start(4, endless).await;
    for (of_item, of_batch) in [(300, 40_000), (40_000, 300)] {
        let begin = Instant::now();
        let (mut sender, mut receiver) = batch(server.address, &format!("request-timeout-ms: {of_batch}\r\n")).await;
        let line = json!({"request_id": "a", "solve": {"maneuver": {"goal": {"y_m": 1}}, "solver": {"time_limit_s": 30}, "view": "plan"}, "timeout_ms": of_item});
        assert!(sender.send(&format!("{line}\n")).await);
        let _open = sender.end().await;
        let lines = receiver.rest().await;
        assert!(begin.elapsed() < Duration::from_secs(15), "{of_item} {of_batch}: {:?}", begin.elapsed());
        let of_item = lines.iter().find(|line| line["request_id"] == "a").unwrap_or_else(|| panic!("{lines:?}"));
        assert_eq!(of_item["solve"]["stop_reason"], "deadline", "{lines:?}");
    }
}
