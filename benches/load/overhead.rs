//! Measures what the service adds to a solve: the solver does nothing, and an echo of the same bytes is the baseline.

use std::time::{Duration, Instant};

use clap::Args;
use slipdrive::api::grpc::pb::View;
use tokio::task::JoinSet;
use tokio::time::sleep_until;

use crate::callers::{Callers, Outcome, Question, Transport};
use crate::process::Server;
use crate::tally::Latencies;
use crate::verdict::Verdict;

/// The service around a solver that does nothing.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Requests per round and transport.
    #[arg(long, default_value_t = 1000)]
    requests: u64,
    /// Requests per second, to the service and to the echo in turn.
    #[arg(long, default_value_t = 400.0)]
    rate: f64,
}

impl Default for Arguments {
    fn default() -> Self {
        Self { requests: 1000, rate: 400.0 }
    }
}

const ROUNDS: usize = 5;

pub async fn run(arguments: &Arguments) -> Verdict {
    println!("overhead: a solver that answers at once, 200 steps, median of {ROUNDS} rounds of {}", arguments.requests);
    let server = Server::start("idle");
    let service = Callers::connect(&server.addresses).await;
    let echo = Callers::connect(&server.echo).await;
    let mut verdict = Verdict::default();
    for transport in [Transport::Rest, Transport::Grpc] {
        for view in [View::Plan, View::Full] {
            let question = Question::new(5.0, view);
            let mut rounds = Vec::new();
            for _ in 0..ROUNDS {
                rounds.push(round(arguments, transport, &question, [&service, &echo]).await);
            }
            let median = |side: usize, quantile: f64| {
                let mut values: Vec<_> = rounds.iter().map(|round| round[side].quantile_ms(quantile)).collect();
                values.sort_unstable_by(f64::total_cmp);
                values[ROUNDS / 2]
            };
            let (p50, p99) = (median(0, 0.5), median(0, 0.99));
            let found =
                format!("p50 {p50:.3} ms (echo {:.3}), p99 {p99:.3} ms (echo {:.3})", median(1, 0.5), median(1, 0.99));
            let requirement = format!("{transport:?} {}: p50 at most 0.3 ms, p99 at most 2 ms", question.view);
            verdict.require(&requirement, p50 <= 0.3 && p99 <= 2.0, &found);
        }
    }
    server.end();
    verdict
}

/// Latencies of the service and of the echo, from the sending: the timer of the generator is no finer than a
/// millisecond. The schedule is kept whatever the answers do.
async fn round(
    arguments: &Arguments,
    transport: Transport,
    question: &Question,
    sides: [&Callers; 2],
) -> [Latencies; 2] {
    let (begin, mut asked) = (Instant::now(), JoinSet::new());
    for number in 0..2 * arguments.requests {
        let scheduled = begin + Duration::from_secs_f64(number as f64 / arguments.rate);
        sleep_until(scheduled.into()).await;
        let side = usize::from(!number.is_multiple_of(2));
        let (callers, question) = (sides[side].clone(), question.clone());
        asked.spawn(async move { (side, callers.ask(number, transport, &question, Instant::now()).await) });
    }
    let mut latencies = [Latencies::default(), Latencies::default()];
    while let Some(outcome) = asked.join_next().await {
        let (side, Outcome { code, latency, .. }) = outcome.unwrap();
        assert_eq!(code, "ok");
        latencies[side].record(latency);
    }
    latencies
}
