//! Two replicas behind a client that takes them in turn and retries: one is killed, and no solve is lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use reqwest::Client;

use crate::support::HANG_BOUND;
use crate::support::process::ServerProcess;

const SOLVES: usize = 1000;
const CALLERS: usize = 8;
/// More than enough: after a failure the other replica is asked.
const ATTEMPTS: usize = 20;

/// Takes the replicas in turn; a solve has no effect but its answer, so that it may be asked again wherever it failed.
struct RoundRobin {
    client: Client,
    urls: [String; 2],
    next: AtomicUsize,
    retries: AtomicUsize,
}

impl RoundRobin {
    async fn solve(&self, number: usize) -> String {
        let goal = 0.5 + number as f64 / SOLVES as f64;
        let body = format!(
            r#"{{"maneuver": {{"goal": {{"y_m": {goal}}}}}, "grid": {{"steps": 20, "control_intervals": 4}},
                "solver": {{"starts": 1}}, "view": "plan"}}"#
        );
        for _ in 0..ATTEMPTS {
            let url = &self.urls[self.next.fetch_add(1, Ordering::Relaxed) % 2];
            let request = self.client.post(url).header("content-type", "application/json").body(body.clone());
            let answer = match request.send().await {
                Ok(answer) if answer.status() == 200 => answer.text().await,
                Ok(answer) => {
                    assert!([429, 503].contains(&answer.status().as_u16()), "{}", answer.status());
                    tokio::time::sleep(Duration::from_millis(20)).await;
                    self.retries.fetch_add(1, Ordering::Relaxed);
                    continue;
                }
                Err(error) => Err(error),
            };
            match answer {
                Ok(text) => return text,
                Err(_) => self.retries.fetch_add(1, Ordering::Relaxed),
            };
        }
        panic!("solve {number} is lost after {ATTEMPTS} attempts");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn killed_replica_loses_no_solve() {
    let flags = ["--queue-length", "16", "--log", "warn,slipdrive::shutdown=info"];
    let (mut first, second) = (ServerProcess::start(&flags, &[]), ServerProcess::start(&flags, &[]));
    let client = Client::builder().no_proxy().timeout(HANG_BOUND).build().unwrap();
    let urls = [first.url("/solve"), second.url("/solve")];
    let replicas = Arc::new(RoundRobin { client, urls, next: AtomicUsize::new(0), retries: AtomicUsize::new(0) });
    let (next, solved) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
    let callers: Vec<_> = (0..CALLERS)
        .map(|_| {
            let (replicas, next, solved) = (Arc::clone(&replicas), Arc::clone(&next), Arc::clone(&solved));
            tokio::spawn(async move {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= SOLVES {
                        return;
                    }
                    assert!(replicas.solve(number).await.contains("\"torque_schedule\""));
                    solved.fetch_add(1, Ordering::Relaxed);
                }
            })
        })
        .collect();
    while solved.load(Ordering::Relaxed) < SOLVES / 3 {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    first.signal("KILL");
    assert_eq!(first.wait().code(), None, "it had no time to end in order");
    for caller in callers {
        caller.await.unwrap();
    }
    assert_eq!(solved.load(Ordering::Relaxed), SOLVES);
    let retries = replicas.retries.load(Ordering::Relaxed);
    assert!(retries > 0, "the kill was felt");
    println!("{SOLVES} solves, none lost, {retries} attempts repeated");
}
