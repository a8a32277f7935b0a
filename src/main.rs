//! The slipdrive program: serve over REST and gRPC, or run one job in process.

// Both panic where nobody reads them or no space is left, which must not end what is under way.
#![deny(clippy::print_stderr, clippy::print_stdout)]

mod cli;
mod config;
mod health;
mod heap;
mod reload;
mod shutdown;
mod telemetry;

use std::fmt::Display;
use std::io::{self, Write as _};
use std::process::ExitCode;

use clap::{ArgMatches, CommandFactory as _, FromArgMatches as _, Subcommand as _};
use config::{Arguments, Command, log_settings};

/// For input that cannot be used, usage errors included (`EX_USAGE` of sysexits).
const EXIT_BAD_INPUT: u8 = 64;

fn main() -> ExitCode {
    let parsed = cli::with_jobs(Arguments::command()).try_get_matches();
    let outcome = parsed.map_err(anyhow::Error::from).and_then(|matches| run(&matches));
    outcome.unwrap_or_else(|error| failure(&error))
}

fn failure(error: &anyhow::Error) -> ExitCode {
    let Some(usage) = error.downcast_ref::<clap::Error>() else {
        tell(&format_args!("error: {error:#}"));
        return ExitCode::FAILURE;
    };
    // Nothing is left to do when the terminal is gone.
    let _ = usage.print();
    if cfg!(not(feature = "nats")) && is_of_nats(usage) {
        tell(&"\nthis program was built without the feature `nats`");
    }
    if usage.use_stderr() { ExitCode::from(EXIT_BAD_INPUT) } else { ExitCode::SUCCESS }
}

/// Whether a command or argument was not known that the feature `nats` adds.
fn is_of_nats(usage: &clap::Error) -> bool {
    use clap::error::{ContextKind, ContextValue};
    usage.context().any(|(kind, value)| match (kind, value) {
        (ContextKind::InvalidSubcommand, ContextValue::String(name)) => name == "worker",
        (ContextKind::InvalidArg, ContextValue::String(name)) => name.starts_with("--nats"),
        _ => false,
    })
}

/// Writes a line to standard error; where that fails, nobody is to be told.
fn tell(line: &dyn Display) {
    let _ = writeln!(io::stderr(), "{line}");
}

fn run(matches: &ArgMatches) -> anyhow::Result<ExitCode> {
    if let Some((name, job)) = matches.subcommand()
        && !Command::has_subcommand(name)
    {
        return logged(matches, || cli::run(name, job));
    }
    let arguments = Arguments::from_arg_matches(matches)?;
    match &arguments.command {
        Command::Serve(serve) => match arguments.server_config(serve) {
            Ok(config) if serve.print_config => {
                cli::say(config.to_toml().as_bytes())?;
                Ok(ExitCode::SUCCESS)
            }
            Ok(config) => {
                let telemetry = telemetry::start(&config.log)?;
                shutdown::serve_until_stopped(&config, telemetry.lost_lines()).map(|()| ExitCode::SUCCESS)
            }
            Err(faults) => Ok(cli::refused(&faults.to_string())),
        },
        Command::Sweep(sweep) => logged(matches, || cli::sweep(sweep)),
        #[cfg(feature = "nats")]
        Command::Worker(worker) => logged(matches, || cli::worker(worker)),
        Command::Example(example) => cli::example(example.name.as_deref()),
        Command::Completions(completions) => cli::completions(completions.shell, cli::with_jobs(Arguments::command())),
        Command::Health(health) => Ok(match health.target() {
            Ok(target) => health::ask(target, health.live),
            Err(faults) => cli::refused(&faults.to_string()),
        }),
    }
}

/// Runs a command that runs jobs.
fn logged(matches: &ArgMatches, command: impl FnOnce() -> anyhow::Result<ExitCode>) -> anyhow::Result<ExitCode> {
    match log_settings(matches)? {
        Ok(log) => {
            let _telemetry = telemetry::start(&log)?;
            command()
        }
        Err(faults) => Ok(cli::refused(&faults.to_string())),
    }
}
