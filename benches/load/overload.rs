//! Ten times the capacity of one worker: goodput, refusals and memory must hold.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use slipdrive::api::grpc::pb::View;
use tokio::time::{MissedTickBehavior, interval, timeout};

use crate::callers::{Callers, Question, Transport};
use crate::offer::offer;
use crate::process::{Server, WORKER};
use crate::tally::Latencies;
use crate::verdict::Verdict;

/// What one worker can do, and ten times as much.
#[derive(Debug, Args)]
pub struct Arguments {
    /// How long the overload lasts.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// How many times the capacity is offered.
    #[arg(long, default_value_t = 10.0)]
    factor: f64,
}

impl Default for Arguments {
    fn default() -> Self {
        Self { seconds: 60.0, factor: 10.0 }
    }
}

const CAPACITY_SECONDS: f64 = 10.0;
const SINGLE_SECONDS: f64 = 20.0;
/// Growth from the first quarter of the overload to the last that still counts as flat: the variation of the allocator.
const FLAT_BYTES: u64 = 8 << 20;

/// Goodput of one phase.
struct Goodput {
    per_second: f64,
    /// Solves per second of processor time of the worker, which other load on the machine hardly changes.
    per_cpu_second: f64,
    /// Share of one core that the worker had.
    share: f64,
}

impl std::fmt::Display for Goodput {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { per_second, per_cpu_second, share } = self;
        write!(
            formatter,
            "{per_second:.1} solves/s, the worker had {share:.2} of a core, {per_cpu_second:.1} solves per second of it"
        )
    }
}

pub async fn run(arguments: &Arguments) -> Verdict {
    let Arguments { seconds, factor } = *arguments;
    println!("overload: one worker, the forward drive from one start, REST and gRPC in turn");
    let server = Server::start("real");
    let callers = Callers::connect(&server.addresses).await;
    let question = Question::new(5.0, View::Plan);
    let mut verdict = Verdict::default();

    let meter = Phase::begin(&server);
    let solved = solve_in_turn(&callers, &question).await;
    let closed = meter.end(&server, solved);
    println!("  closed loop, 16 callers: {closed}");
    // What the worker does with a core of its own, whatever else runs on the machine.
    let capacity = closed.per_cpu_second;

    let meter = Phase::begin(&server);
    let (single, single_sent) = offer(&callers, &question, capacity, SINGLE_SECONDS).await;
    let at_one = meter.end(&server, single.count("ok"));
    println!("  1x offered: {at_one}");
    single.print();

    let meter = Phase::begin(&server);
    let watch = tokio::spawn(watch_health(callers.clone(), Duration::from_secs_f64(seconds)));
    let ((tally, sent), memory) =
        tokio::join!(offer(&callers, &question, factor * capacity, seconds), memory_of(&server, seconds));
    let at_factor = meter.end(&server, tally.count("ok"));
    println!("  {factor}x offered, {sent} requests in {seconds} s: {at_factor}");
    tally.print();
    let (checks, failures, waits) = watch.await.unwrap();
    let seen = server.end();

    println!("  offered were {capacity:.1} and {:.1} requests/s", factor * capacity);
    let ratio = at_factor.per_second / at_one.per_second;
    let cpu_ratio = at_factor.per_cpu_second / at_one.per_cpu_second;
    let found = format!("{:.1} %, per processor time of the worker {:.1} %", 100.0 * ratio, 100.0 * cpu_ratio);
    verdict.require("goodput is at least 95 % of that at 1x", ratio >= 0.95, &found);
    let p99 = seen["refusal_p99_ms"].as_f64().unwrap();
    let found = format!(
        "p50 {} ms, p99 {p99} ms, max {} ms of {}",
        seen["refusal_p50_ms"], seen["refusal_max_ms"], seen["refusals"]
    );
    verdict.require("refusals take at most 5 ms (p99, in the server)", p99 <= 5.0, &found);
    let (early, late) = memory;
    let found = format!("{} KiB early, {} KiB late", early >> 10, late >> 10);
    verdict.require("memory is flat", late <= early + FLAT_BYTES, &found);
    let is_complete = tally.is_complete(sent) && single.is_complete(single_sent);
    // The echo of the server itself has asked for two more answers over each transport.
    let asked = sent + single_sent + solved + 4;
    let is_seen = seen["solves"] == asked;
    let found =
        format!("{} and {} answers, {} solves seen of {asked} asked", single.total(), tally.total(), seen["solves"]);
    verdict.require("every request is answered exactly once", is_complete && is_seen, &found);
    let only_refused = tally.count("ok") + tally.count("queue_full") == sent;
    verdict.require(
        "what is not solved is refused as `queue_full`",
        only_refused,
        &format!("{}", tally.count("queue_full")),
    );
    verdict.require(
        "health is answered throughout",
        checks > 0 && failures == 0,
        &format!("{failures} of {checks} failed, {waits}"),
    );
    verdict
}

/// Solves in a closed loop, in which each caller waits for its answer before it asks again.
async fn solve_in_turn(callers: &Callers, question: &Question) -> u64 {
    let (begin, solved) = (Instant::now(), AtomicU64::new(0));
    let lasts = Duration::from_secs_f64(CAPACITY_SECONDS);
    let one = async |number: u64| {
        while begin.elapsed() < lasts {
            let outcome = callers.ask(number, Transport::of(number), question, Instant::now()).await;
            assert_eq!(outcome.code, "ok");
            solved.fetch_add(1, Ordering::Relaxed);
        }
    };
    futures_util::future::join_all((0..16).map(one)).await;
    solved.into_inner()
}

/// Clock and processor time since the begin of a phase.
struct Phase {
    begin: Instant,
    cpu_time: Duration,
}

impl Phase {
    fn begin(server: &Server) -> Self {
        Self { begin: Instant::now(), cpu_time: server.cpu_time(WORKER) }
    }

    fn end(self, server: &Server, solved: u64) -> Goodput {
        let elapsed = self.begin.elapsed().as_secs_f64();
        let cpu_time = server.cpu_time(WORKER).saturating_sub(self.cpu_time).as_secs_f64();
        Goodput {
            per_second: solved as f64 / elapsed,
            per_cpu_second: solved as f64 / cpu_time,
            share: cpu_time / elapsed,
        }
    }
}

/// Largest memory in the first quarter and in the last, bytes.
async fn memory_of(server: &Server, seconds: f64) -> (u64, u64) {
    let (begin, mut early, mut late) = (Instant::now(), 0, 0);
    let mut ticks = interval(Duration::from_millis(200));
    while begin.elapsed().as_secs_f64() < seconds {
        ticks.tick().await;
        let (memory, share) = (server.memory_bytes(), begin.elapsed().as_secs_f64() / seconds);
        if share < 0.25 {
            early = memory.max(early);
        } else if share > 0.75 {
            late = memory.max(late);
        }
    }
    (early, late)
}

/// Checks the health over both transports ten times a second.
async fn watch_health(callers: Callers, lasts: Duration) -> (u64, u64, Latencies) {
    let (begin, mut checks, mut failures, mut waits) = (Instant::now(), 0, 0, Latencies::default());
    let mut ticks = interval(Duration::from_millis(100));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while begin.elapsed() < lasts {
        ticks.tick().await;
        let asked = Instant::now();
        let is_ready = timeout(Duration::from_secs(1), callers.are_ready()).await.unwrap_or(false);
        waits.record(asked.elapsed());
        checks += 1;
        failures += u64::from(!is_ready);
    }
    (checks, failures, waits)
}
