//! The slipdrive program: serve over HTTP, or solve and simulate in process.

mod cli;
mod config;
mod shutdown;
mod telemetry;

use std::process::ExitCode;

use clap::Parser as _;
use config::{Arguments, Command};

/// For input that cannot be used, usage errors included (`EX_USAGE` of sysexits).
const EXIT_BAD_INPUT: u8 = 64;

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            // Nothing is left to tell when the terminal is gone.
            let _ = error.print();
            return if error.use_stderr() { ExitCode::from(EXIT_BAD_INPUT) } else { ExitCode::SUCCESS };
        }
    };
    run(arguments).unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::FAILURE
    })
}

fn run(Arguments { log, command }: Arguments) -> anyhow::Result<ExitCode> {
    telemetry::start(&log)?;
    match command {
        Command::Serve(arguments) => shutdown::serve_until_stopped(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Solve(arguments) => cli::solve(&arguments),
        Command::Simulate(arguments) => cli::simulate(&arguments),
    }
}
