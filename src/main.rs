//! The slipdrive program: serve over REST and gRPC, or solve and simulate in process.

mod cli;
mod config;
mod health;
mod shutdown;
mod telemetry;

use std::process::ExitCode;

use clap::Parser as _;
use config::{Arguments, Command, Faults};

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
    run(&arguments).unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::FAILURE
    })
}

fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match &arguments.command {
        Command::Serve(serve) => match arguments.server_config(serve) {
            Ok(config) if serve.print_config => {
                print!("{}", config.to_toml());
                Ok(ExitCode::SUCCESS)
            }
            Ok(config) => {
                let _exporter = telemetry::start(&config.log)?;
                shutdown::serve_until_stopped(&config).map(|()| ExitCode::SUCCESS)
            }
            Err(faults) => Ok(refuse(&faults)),
        },
        Command::Health(health) => Ok(match health.address() {
            Ok(address) => health::ask(address, health.live),
            Err(faults) => refuse(&faults),
        }),
        Command::Solve(solve) => logged(arguments, || cli::solve(solve)),
        Command::Simulate(simulate) => logged(arguments, || cli::simulate(simulate)),
    }
}

/// Runs a command that is no server.
fn logged(arguments: &Arguments, command: impl FnOnce() -> anyhow::Result<ExitCode>) -> anyhow::Result<ExitCode> {
    match arguments.log_settings() {
        Ok(log) => {
            let _exporter = telemetry::start(&log)?;
            command()
        }
        Err(faults) => Ok(refuse(&faults)),
    }
}

fn refuse(faults: &Faults) -> ExitCode {
    eprintln!("error: {faults}");
    ExitCode::from(EXIT_BAD_INPUT)
}
