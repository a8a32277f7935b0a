//! One server for a long time under mixed good and hostile load: nothing may be lost, and nothing may pile up.
//!
//! Good callers ask throughout, and every request of theirs is accounted for. Each minute one attack of the hostile
//! bench is played at full size, and then it is quiet for a while. What the server holds is read late in the quiet
//! time, when it has given back what the attack took.

mod callers;
mod grpc;
mod ledger;
mod question;
mod rest;
mod samples;

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use tokio::time::{Instant, interval, sleep, sleep_until, timeout_at};

use crate::hostile::program::{Log, Program};
use crate::hostile::{Requirement, Row, Target, require_open_files, rows};
use crate::verdict::Verdict;
use callers::SteadyCallers;
use ledger::Ledger;
use samples::{Sample, median_memory_bytes, most_open_files, most_threads, quarters};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The server under load.
    #[arg(long, default_value = env!("CARGO_BIN_EXE_slipdrive"))]
    program: PathBuf,
    /// Only the attacks of the hostile bench with these numbers, 1 to 8.
    #[arg(long = "row", value_parser = clap::value_parser!(u8).range(1..=8))]
    rows: Vec<u8>,
    /// How long all of it lasts; each minute has its attack.
    #[arg(long, default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..))]
    minutes: u32,
}

/// An attack and the quiet time after it.
const CYCLE: Duration = Duration::from_secs(60);
const ATTACK: Duration = Duration::from_secs(20);
/// Memory is read from here on: the server gives it back every 5 s, connections without a use for it end a bit later.
const SETTLED: Duration = Duration::from_secs(40);
const SAMPLES: Duration = Duration::from_secs(1);
/// An attack that ends by itself is played again after this.
const PAUSE: Duration = Duration::from_secs(1);
/// Attacks on deadlines watch the worker until it is idle, which under good load it never is for long.
const DEADLINE_ATTACK: Duration = Duration::from_secs(3);
/// What memory may differ by without being a trend.
const MEMORY_TOLERANCE: f64 = 0.05;
/// Connections that the fresh ones among the good callers may have open at once.
const FILE_SLACK: usize = 17;
/// Threads for blocking work come and go.
const THREAD_SLACK: usize = 2;

pub async fn run(arguments: &Arguments) -> Verdict {
    require_open_files();
    println!("soak: {} for {} minutes", arguments.program.display(), arguments.minutes);
    let attacks = Attacks::of(&arguments.rows);
    let program = Program::start(&arguments.program, &[], Log::Discarded).await;
    let callers = SteadyCallers::start(&program).await;
    let peak = program.sample_memory();
    let (begin, mut total, mut samples) = (Instant::now(), Ledger::default(), Vec::new());
    for cycle in 0..arguments.minutes {
        let attack = attacks.of_cycle(cycle as usize);
        let found = play(attack, &program, &callers, begin + cycle * CYCLE).await;
        let ledger = callers.take_ledger();
        let (time, memory) = (begin.elapsed().as_secs(), mebibytes(median_memory_bytes(&found)));
        println!("  {time:>5} s, {} {}: {memory:.1} MiB after; {ledger}", attack.number, attack.name);
        total.join(&ledger);
        samples.extend(found);
    }
    total.join(&callers.stop().await);
    let mut verdict = Verdict::default();
    judge_answers(&total, &mut verdict);
    judge_samples(&samples, peak.stop(), &mut verdict);
    verdict
}

/// The attacks, one number after the other. Those of the same number take turns in pairs, each pair twice, so that the quarters of
/// 32 minutes that are compared have the same attacks.
struct Attacks(Vec<Vec<Row>>);

impl Attacks {
    fn of(numbers: &[u8]) -> Self {
        let is_wanted = |number: &u8| numbers.is_empty() || numbers.contains(number);
        let of_number = |number: u8| rows().into_iter().filter(|row| row.number == number).collect::<Vec<_>>();
        let mut attacks: Vec<_> = (1..=8).filter(is_wanted).map(of_number).collect();
        for variants in &mut attacks {
            // Silent connections lose their places; those kept open by pings hold them.
            if variants[0].requirement == Requirement::Newcomers {
                variants.truncate(1);
            }
        }
        Self(attacks)
    }

    fn of_cycle(&self, cycle: usize) -> &Row {
        let variants = &self.0[cycle % self.0.len()];
        let rotation = cycle / self.0.len();
        &variants[(2 * (rotation / 4) + rotation % 2) % variants.len()]
    }
}

/// Plays one cycle and returns what the server holds at its end.
async fn play(attack: &Row, program: &Program, callers: &SteadyCallers, begin: Instant) -> Vec<Sample> {
    callers.set_crowded(attack.requirement == Requirement::Newcomers);
    play_attack(attack, program, begin + ATTACK).await;
    callers.set_crowded(false);
    sleep_until(begin + SETTLED).await;
    let (mut ticks, mut samples) = (interval(SAMPLES), Vec::new());
    while Instant::now() < begin + CYCLE {
        ticks.tick().await;
        samples.push(Sample::of(program.id()));
    }
    samples
}

/// Plays an attack over and over until `end`.
async fn play_attack(attack: &Row, program: &Program, end: Instant) {
    while Instant::now() < end {
        let is_short = attack.requirement == Requirement::Answers;
        let end_of_one = if is_short { end.min(Instant::now() + DEADLINE_ATTACK) } else { end };
        let target = Target { rest: program.rest, grpc: program.grpc, process: program.id(), end: end_of_one };
        // What it finds out is judged by the hostile bench.
        let _ = timeout_at(end, (attack.attack)(target)).await;
        sleep(PAUSE).await;
    }
}

fn judge_answers(total: &Ledger, verdict: &mut Verdict) {
    println!("  {total}");
    let found = format!("{} of {}", total.ended(), total.sent());
    verdict.require("every request is accounted for", total.ended() == total.sent(), &found);
    let found = format!("{}{}", total.unexpected(), total.list_of_unexpected());
    verdict.require("nothing unexpected", total.unexpected() == 0, &found);
}

/// Compares the last quarter with the second: the first is that of a server that warms up.
fn judge_samples(samples: &[Sample], peak_bytes: u64, verdict: &mut Verdict) {
    let quarters = quarters(samples);
    let medians = quarters.map(median_memory_bytes).map(mebibytes);
    let [first, second, third, last] = medians;
    verdict.require(
        "memory in quiet times stays",
        (last - second).abs() <= MEMORY_TOLERANCE * second,
        &format!(
            "{first:.2}, {second:.2}, {third:.2}, {last:.2} MiB (medians of the quarters), peak {:.1} MiB",
            mebibytes(peak_bytes)
        ),
    );
    let files = quarters.map(most_open_files);
    verdict.require("open files stay", files[3] <= files[1] + FILE_SLACK, &format!("at most {files:?} by quarters"));
    let threads = quarters.map(most_threads);
    verdict.require(
        "threads stay",
        threads[3] <= threads[1] + THREAD_SLACK,
        &format!("at most {threads:?} by quarters"),
    );
}

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}
