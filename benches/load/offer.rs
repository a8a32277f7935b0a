//! Offers load in an open loop: on a fixed schedule, whatever becomes of the answers.

use std::time::{Duration, Instant};

use clap::Args;
use slipdrive::api::grpc::pb::View;
use tokio::task::JoinSet;
use tokio::time::sleep_until;

use crate::callers::{Addresses, Callers, Question, Transport};
use crate::tally::Tally;
use crate::verdict::Verdict;

/// Load on a running server.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    addresses: Addresses,
    /// Requests per second, over both transports together.
    #[arg(long, default_value_t = 100.0)]
    rate: f64,
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
}

pub async fn run(arguments: &Arguments) -> Verdict {
    let callers = Callers::connect(&arguments.addresses).await;
    let question = Question::new(5.0, View::Plan);
    let (tally, sent) = offer(&callers, &question, arguments.rate, arguments.seconds).await;
    println!("{sent} requests in {} s", arguments.seconds);
    tally.print();
    let mut verdict = Verdict::default();
    verdict.require("every request is answered once", tally.is_complete(sent), &format!("{} answers", tally.total()));
    verdict
}

/// Sends `rate` requests per second, evenly spaced, over both transports in turn, and waits for all answers.
pub async fn offer(callers: &Callers, question: &Question, rate: f64, seconds: f64) -> (Tally, u64) {
    let (begin, mut tally, mut asked) = (Instant::now(), Tally::default(), JoinSet::new());
    let mut sent = 0;
    while (sent as f64) < rate * seconds {
        let (number, scheduled) = (sent, begin + Duration::from_secs_f64(sent as f64 / rate));
        sent += 1;
        sleep_until(scheduled.into()).await;
        let (callers, question) = (callers.clone(), question.clone());
        asked.spawn(async move { callers.ask(number, Transport::of(number), &question, scheduled).await });
        while let Some(outcome) = asked.try_join_next() {
            tally.record(outcome.unwrap());
        }
    }
    while let Some(outcome) = asked.join_next().await {
        tally.record(outcome.unwrap());
    }
    (tally, sent)
}
