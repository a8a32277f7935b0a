//! Callers who mean no good against the program itself, in a process of its own, while good callers go on asking.
//!
//! Each row starts a server, plays one attack at full size, and prints a line: memory above that before the attack, the
//! latencies of the good requests, how long the attackers' connections lived, and whether the requirement is met.

mod attacker;
mod calls;
mod crowd;
mod deadlines;
mod found;
pub mod good;
mod memory;
pub mod program;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use futures_util::FutureExt as _;
use futures_util::future::BoxFuture;
use tokio::time::{Instant, sleep};

use crate::verdict::Verdict;
use found::Found;
use good::{GoodCallers, GoodTally};
use program::{Log, Program};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The server to attack.
    #[arg(long, default_value = env!("CARGO_BIN_EXE_slipdrive"))]
    program: PathBuf,
    /// Only the rows with these numbers.
    #[arg(long = "row")]
    rows: Vec<u8>,
    /// How long an attack may last.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
}

/// The key that the server knows.
pub const KEY: &str = "key-of-the-bench";
/// How long the server may take to give memory back.
const RECOVERY: Duration = Duration::from_secs(10);
/// A container of 256 MiB holds the server at rest and this above it.
const MAX_PEAK_BYTES: u64 = 128 << 20;
/// What an allocator may keep for itself.
const MAX_KEPT_BYTES: u64 = 32 << 20;
const MAX_GOOD_P99: Duration = Duration::from_millis(250);
/// Probes of an orchestrator give up after a second by default.
const MAX_NEWCOMER: Duration = Duration::from_secs(1);
/// Connections of the largest attack on both doors, and as many again as slack.
const MIN_OPEN_FILES: u64 = 5_000;

/// What an attack needs to know.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    pub rest: SocketAddr,
    pub grpc: SocketAddr,
    pub process: u32,
    /// When the attack must be over.
    pub end: Instant,
}

/// What must hold beside the attack's own requirement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Requirement {
    /// Memory is bounded and given back, and good callers notice nothing.
    Memory,
    /// Good callers, newcomers among them, are answered within a second.
    Newcomers,
    /// Good callers are answered at all.
    Answers,
    /// Nothing else: the server ends meanwhile.
    Nothing,
}

/// One line of the table.
pub struct Row {
    pub number: u8,
    pub name: &'static str,
    flags: &'static [&'static str],
    log: Log,
    pub requirement: Requirement,
    pub attack: fn(Target) -> BoxFuture<'static, Found>,
}

/// All attacks.
pub fn rows() -> Vec<Row> {
    use Requirement::{Answers, Memory, Newcomers, Nothing};
    type Attack = fn(Target) -> BoxFuture<'static, Found>;
    let row = |number, name, requirement, attack: Attack| Row {
        number,
        name,
        flags: &[],
        log: Log::Discarded,
        requirement,
        attack,
    };
    vec![
        row(1, "no key: 128 `Check` that announce 4 MB and stall", Memory, |on| memory::stalled(on, "Check").boxed()),
        row(1, "no key: 128 `Watch` that announce 4 MB and stall", Memory, |on| memory::stalled(on, "Watch").boxed()),
        row(2, "no key: 500 half-sent heads of 400 KB", Memory, |on| memory::half_sent_heads(on).boxed()),
        row(3, "no key: 100 x 128 `Watch`", Memory, |on| memory::watches(on).boxed()),
        row(3, "no key: 100 x 128 unread `/metrics`", Memory, |on| memory::unread_metrics(on).boxed()),
        row(3, "no key: 100 x 128 unread refusals (401)", Memory, |on| memory::unread_refusals(on).boxed()),
        row(4, "no key: 1,100 connections per door kept open by pings", Newcomers, |on| crowd::pinging(on).boxed()),
        row(4, "no key: 1,100 silent connections per door", Newcomers, |on| crowd::silent(on).boxed()),
        row(5, "REST: 128 `/simulate` of 10,000 steps, unread", Memory, |on| memory::unread_rest(on, 1).boxed()),
        row(5, "the same, 64 KiB read per 20 s", Memory, |on| memory::slowly_read_rest(on).boxed()),
        row(5, "the same, unread on three connections", Memory, |on| memory::unread_rest(on, 3).boxed()),
        row(5, "gRPC: 128 `Simulate` of 10,000 steps, unread", Memory, |on| memory::unread_grpc(on).boxed()),
        row(6, "REST: 50 x 128 half-sent bodies", Memory, |on| memory::half_sent_rest(on).boxed()),
        row(6, "gRPC: 50 x 128 half-sent messages", Memory, |on| memory::half_sent_grpc(on).boxed()),
        row(7, "fixed point, deadline 1 s", Answers, |on| deadlines::fixed_point(on).boxed()),
        row(7, "fixed point, hang-up after 1 s", Answers, |on| deadlines::fixed_point_hang_up(on).boxed()),
        row(8, "unlucky robot, 200 steps, deadline 500 ms", Answers, |on| deadlines::unlucky(on, 200).boxed()),
        row(8, "unlucky robot, 10,000 steps, deadline 500 ms", Answers, |on| deadlines::unlucky(on, 10_000).boxed()),
        row(8, "unlucky robot, 200 steps, hang-up", Answers, |on| deadlines::unlucky_hang_up(on, 200).boxed()),
        row(8, "unlucky robot, 10,000 steps, hang-up", Answers, |on| deadlines::unlucky_hang_up(on, 10_000).boxed()),
        row(9, "well-meant: 200 batches of 100 small items", Answers, |on| calls::small_batches(on).boxed()),
        Row {
            flags: &["--log", "info"],
            log: Log::Unread,
            ..row(11, "log pipe that nobody reads", Answers, |on| calls::unread_log(on).boxed())
        },
        Row {
            flags: &["--drain-delay-s", "1"],
            ..row(12, "stop signal with solves in flight", Nothing, |on| calls::stop_signal(on).boxed())
        },
        row(13, "solves of 10,000 steps with deadlines", Answers, |on| deadlines::solves(on).boxed()),
    ]
}

pub async fn run(arguments: &Arguments) -> Verdict {
    require_open_files();
    println!("hostile: {}", arguments.program.display());
    let mut verdict = Verdict::default();
    for row in rows() {
        if arguments.rows.is_empty() || arguments.rows.contains(&row.number) {
            play(&row, arguments, &mut verdict).await;
        }
    }
    verdict
}

/// Plays one row and prints its line.
async fn play(row: &Row, arguments: &Arguments, verdict: &mut Verdict) {
    let program = Program::start(&arguments.program, row.flags, row.log).await;
    let good = GoodCallers::start(&program).await;
    let base = program.memory_bytes();
    let sampler = program.sample_memory();
    let end = Instant::now() + Duration::from_secs_f64(arguments.seconds);
    let target = Target { rest: program.rest, grpc: program.grpc, process: program.id(), end };
    let found = (row.attack)(target).await;
    let good = good.stop().await;
    let peak = sampler.stop();
    if row.requirement == Requirement::Memory {
        sleep(RECOVERY).await;
    }
    let memory = Memory { base, peak, kept: program.memory_bytes() };
    let faults = faults_of(row.requirement, &memory, &good, &found);
    let found = format!("{memory}; good requests: {good}; {found}{}", list_of(&faults));
    verdict.require(&format!("{} {}", row.number, row.name), faults.is_empty(), &found);
}

/// Resident memory of the server around an attack, bytes.
struct Memory {
    base: u64,
    peak: u64,
    kept: u64,
}

impl std::fmt::Display for Memory {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let above = |bytes: u64| bytes.saturating_sub(self.base) >> 20;
        write!(formatter, "{} MiB, peak +{}, after +{}", self.base >> 20, above(self.peak), above(self.kept))
    }
}

fn faults_of(requirement: Requirement, memory: &Memory, good: &GoodTally, found: &Found) -> Vec<String> {
    let mut faults = found.faults.clone();
    let mut require = |is_met: bool, fault: &str| {
        if !is_met {
            faults.push(fault.to_owned());
        }
    };
    if requirement != Requirement::Nothing {
        require(good.failures() == 0, "good requests failed");
    }
    match requirement {
        Requirement::Memory => {
            require(memory.peak <= memory.base + MAX_PEAK_BYTES, "too much memory");
            require(memory.kept <= memory.base + MAX_KEPT_BYTES, "memory is not given back");
            require(good.quantile(0.99) < MAX_GOOD_P99, "good requests are slow");
        }
        Requirement::Newcomers => require(good.quantile(1.0) <= MAX_NEWCOMER, "good requests wait"),
        Requirement::Answers | Requirement::Nothing => {}
    }
    faults
}

fn list_of(faults: &[String]) -> String {
    if faults.is_empty() { String::new() } else { format!("; {}", faults.join(", ").to_uppercase()) }
}

/// Both ends of each connection are files; too few would let the bench fail in place of the server.
pub fn require_open_files() {
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap_or_default();
    let line = limits.lines().find_map(|line| line.strip_prefix("Max open files")).unwrap_or_default();
    let soft = line.split_whitespace().next().and_then(|soft| soft.parse::<u64>().ok());
    assert!(
        soft.is_none_or(|soft| soft >= MIN_OPEN_FILES),
        "{} open files are allowed, {MIN_OPEN_FILES} are needed: `ulimit -n {MIN_OPEN_FILES}`",
        soft.unwrap_or_default()
    );
}
