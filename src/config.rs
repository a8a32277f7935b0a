//! Flags and environment variables.

use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::thread::available_parallelism;

use clap::{Args, Parser, Subcommand, ValueEnum};
use slipdrive::service::{Limits, ServiceSettings};

/// Time-optimal maneuvers of a differential-drive robot whose wheels may slip.
#[derive(Debug, Parser)]
#[command(version)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) log: LogArguments,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What is logged to standard error, and how.
#[derive(Debug, Args)]
pub(crate) struct LogArguments {
    /// Log filter, such as `info` or `slipdrive=debug`.
    #[arg(long = "log", env = "SLIPDRIVE_LOG", default_value = "info", global = true)]
    pub(crate) filter: String,
    /// Form of the log lines.
    #[arg(long = "log-format", env = "SLIPDRIVE_LOG_FORMAT", default_value = "text", global = true)]
    pub(crate) format: LogFormat,
}

/// Form of the log lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// For people.
    Text,
    /// One JSON object per line.
    Json,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Serve REST until a signal comes.
    Serve(ServeArguments),
    /// Solve one maneuver and print what came out.
    Solve(SolveArguments),
    /// Integrate one torque schedule and print what came out.
    Simulate(SimulateArguments),
}

/// Size and address of a server.
#[derive(Debug, Args)]
pub(crate) struct ServeArguments {
    /// Address of the REST server; port 0 takes a free one, which the log tells.
    #[arg(long, env = "SLIPDRIVE_HTTP", default_value = "127.0.0.1:8080")]
    pub(crate) http: SocketAddr,
    /// Worker threads, each running one solve at a time [default: cores - 1, at least 1].
    #[arg(long, env = "SLIPDRIVE_WORKERS")]
    pub(crate) workers: Option<NonZeroUsize>,
    /// Requests that may wait for a worker; more are refused with 429.
    #[arg(long, env = "SLIPDRIVE_QUEUE_LENGTH", default_value_t = 64)]
    pub(crate) queue_length: usize,
    /// Seconds that solves in flight may take after a stop signal before they are cut off.
    #[arg(long, env = "SLIPDRIVE_DRAIN_TIMEOUT_S", default_value_t = 30)]
    pub(crate) drain_timeout_s: u64,
}

impl ServeArguments {
    pub(crate) fn service_settings(&self) -> ServiceSettings {
        let workers = self.workers.unwrap_or_else(default_workers);
        ServiceSettings { workers, queue_length: self.queue_length, limits: Limits::default() }
    }
}

/// One core is left to the threads that talk to callers.
fn default_workers() -> NonZeroUsize {
    let cores = available_parallelism().map_or(1, NonZeroUsize::get);
    NonZeroUsize::new(cores - 1).unwrap_or(NonZeroUsize::MIN)
}

/// A maneuver to solve.
#[derive(Debug, Args)]
pub(crate) struct SolveArguments {
    /// File with the JSON body of `POST /solve`; `-` is standard input, `forward-drive` the paper's case.
    #[arg(default_value = "forward-drive", value_name = "FILE|forward-drive|-")]
    pub(crate) input: PathBuf,
    /// Writes the JSON answer of `POST /solve` here; `-` is standard output, in place of the table.
    #[arg(long, value_name = "OUT")]
    pub(crate) json: Option<PathBuf>,
    /// Writes diagrams of the plan here, as an HTML page.
    #[arg(long, value_name = "PAGE")]
    pub(crate) plot: Option<PathBuf>,
}

/// A torque schedule to integrate.
#[derive(Debug, Args)]
pub(crate) struct SimulateArguments {
    /// File with the JSON body of `POST /simulate`; `-` is standard input.
    #[arg(value_name = "FILE|-")]
    pub(crate) input: PathBuf,
    /// Writes the JSON answer of `POST /simulate` here; `-` is standard output, in place of the table.
    #[arg(long, value_name = "OUT")]
    pub(crate) json: Option<PathBuf>,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn arguments_are_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn flags_set_the_service() {
        let arguments = Arguments::parse_from([
            "slipdrive",
            "serve",
            "--http",
            "127.0.0.1:0",
            "--workers",
            "3",
            "--queue-length",
            "4",
        ]);
        let Command::Serve(serve) = arguments.command else { panic!("serve was asked") };
        let settings = serve.service_settings();
        assert_eq!((settings.workers.get(), settings.queue_length), (3, 4));
    }

    #[test]
    fn every_flag_of_the_server_has_a_variable() {
        let command = Arguments::command();
        let serve = command.find_subcommand("serve").unwrap();
        for argument in serve.get_arguments().filter(|argument| argument.get_id() != "help") {
            let flag = argument.get_long().unwrap();
            let expected = format!("SLIPDRIVE_{}", flag.replace('-', "_").to_uppercase());
            assert_eq!(argument.get_env().and_then(|name| name.to_str()), Some(expected.as_str()), "--{flag}");
        }
    }
}
