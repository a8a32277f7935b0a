//! Load on a whole server over REST and gRPC, offered on a fixed schedule.
//!
//! ```text
//! cargo bench --bench load                                  all of the following
//! cargo bench --bench load -- overload [--seconds 60]       ten times what one worker can do: goodput, refusals, memory
//! cargo bench --bench load -- overhead                      the service around a solver that does nothing
//! cargo bench --bench load -- pace                          deadlines that one worker can keep, and those it cannot
//! cargo bench --bench load -- departures                    callers who leave long solves in every way there is
//! cargo bench --bench load -- hostile [--program PATH] [--row N] [--seconds S]    callers who mean no good
//! cargo bench --bench load -- soak [--minutes 30] [--program PATH] [--row N]    good callers and attacks
//! cargo bench --bench load -- offer --rate 100 --seconds 10 --rest http://HOST:PORT --grpc http://HOST:PORT
//! ```
//!
//! The loop is open: requests leave when the schedule says so, whatever has become of those before, and latencies count
//! from the schedule, so that a stalled server shows in all requests that it kept waiting. Servers under load run in a
//! process of their own. The exit code is 0 when all requirements were met.

#![allow(clippy::unwrap_used, reason = "a bench fails by panicking")]
#![allow(unreachable_pub, reason = "the modules are one program")]

mod callers;
mod departures;
mod hostile;
mod offer;
mod overhead;
mod overload;
mod pace;
mod process;
mod server;
mod soak;
mod tally;
mod verdict;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use verdict::Verdict;

#[derive(Debug, Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Offers ten times the capacity of one worker.
    Overload(overload::Arguments),
    /// Measures what the service adds to a solve.
    Overhead(overhead::Arguments),
    /// Lets callers leave.
    Departures,
    /// Plays attacks on the program; not among those that run by default, for it takes half an hour.
    Hostile(hostile::Arguments),
    /// Mixes good load with attacks; not among those that run by default, for it takes half an hour.
    Soak(soak::Arguments),
    /// Asks for more than one worker can do by the deadlines.
    Pace,
    /// Offers load to a running server.
    Offer(offer::Arguments),
    /// The server of the others, in a process of its own.
    #[command(hide = true)]
    Serve(server::Arguments),
}

fn main() -> ExitCode {
    // Cargo passes `--bench` to every bench.
    let arguments = Arguments::parse_from(std::env::args().filter(|argument| argument != "--bench"));
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let verdict = runtime.block_on(async {
        match arguments.command {
            Some(Command::Overload(arguments)) => overload::run(&arguments).await,
            Some(Command::Overhead(arguments)) => overhead::run(&arguments).await,
            Some(Command::Departures) => departures::run().await,
            Some(Command::Hostile(arguments)) => hostile::run(&arguments).await,
            Some(Command::Soak(arguments)) => soak::run(&arguments).await,
            Some(Command::Pace) => pace::run().await,
            Some(Command::Offer(arguments)) => offer::run(&arguments).await,
            Some(Command::Serve(arguments)) => {
                server::run(&arguments).await;
                Verdict::default()
            }
            None => {
                let mut verdict = overhead::run(&overhead::Arguments::default()).await;
                verdict.join(&departures::run().await);
                verdict.join(&pace::run().await);
                verdict.join(&overload::run(&overload::Arguments::default()).await);
                verdict
            }
        }
    });
    runtime.shutdown_background();
    if verdict.is_met() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
