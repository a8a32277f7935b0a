//! Flags and environment variables.

mod tls;

use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::thread::available_parallelism;
use std::time::Duration;
use std::{env, fs, iter};

use anyhow::Context as _;
use axum::http::HeaderValue;
use clap::{Args, Parser, Subcommand, ValueEnum};
use slipdrive::api::ApiSettings;
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::server::ServerSettings;
use slipdrive::service::{DEFAULT_QUEUE_WORK, ServiceSettings};
use tls::TlsArguments;

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
    /// Serve REST and gRPC until a signal comes.
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
    /// Address of the gRPC server.
    #[arg(long, env = "SLIPDRIVE_GRPC", default_value = "127.0.0.1:50051")]
    pub(crate) grpc: SocketAddr,
    /// Serves gRPC on the address of REST too, in place of its own.
    #[arg(long, env = "SLIPDRIVE_ONE_PORT")]
    pub(crate) one_port: bool,
    /// Threads that solve, one request each; idle ones help the others [default: cores - 1, at least 1].
    #[arg(long, env = "SLIPDRIVE_WORKERS")]
    pub(crate) workers: Option<NonZeroUsize>,
    /// Requests that may wait for a worker; more are refused with 429.
    #[arg(long, env = "SLIPDRIVE_QUEUE_LENGTH", default_value_t = 64)]
    pub(crate) queue_length: usize,
    /// Seconds of expected work per worker that may be in flight; more is refused with 429.
    #[arg(long, env = "SLIPDRIVE_QUEUE_WORK_S", default_value_t = DEFAULT_QUEUE_WORK.as_secs())]
    pub(crate) queue_work_s: u64,
    /// Items of one gRPC batch that may be unanswered at once; the server reads no further meanwhile.
    #[arg(long, env = "SLIPDRIVE_BATCH_WINDOW", default_value = "16")]
    pub(crate) batch_window: NonZeroUsize,
    /// Seconds that work is still taken after a stop signal, while probes already tell that the server is not ready.
    #[arg(long, env = "SLIPDRIVE_DRAIN_DELAY_S", default_value_t = 0)]
    pub(crate) drain_delay_s: u64,
    /// Seconds that solves in flight may take after that before they are cut off.
    #[arg(long, env = "SLIPDRIVE_DRAIN_TIMEOUT_S", default_value_t = 30)]
    pub(crate) drain_timeout_s: u64,
    #[command(flatten)]
    pub(crate) access: AccessArguments,
    #[command(flatten)]
    pub(crate) connections: ConnectionArguments,
    #[command(flatten)]
    pub(crate) tls: TlsArguments,
}

/// Who may call. Keys come from the variable `SLIPDRIVE_API_KEYS`, separated by commas, or from a file.
#[derive(Debug, Args)]
pub(crate) struct AccessArguments {
    /// File with API keys, one per line.
    #[arg(long, env = "SLIPDRIVE_API_KEYS_FILE", value_name = "FILE")]
    pub(crate) api_keys_file: Option<PathBuf>,
    /// Lets a server without keys listen where others can reach it.
    #[arg(long, env = "SLIPDRIVE_ALLOW_UNAUTHENTICATED")]
    pub(crate) allow_unauthenticated: bool,
    /// Origins whose pages may call REST from a browser, such as `https://fleet.example`, separated by commas.
    #[arg(long, env = "SLIPDRIVE_CORS_ORIGINS", value_delimiter = ',', value_name = "ORIGIN", value_parser = origin)]
    pub(crate) cors_origins: Vec<HeaderValue>,
}

/// Scheme and host, and a port where it is not the usual one; browsers send nothing else.
fn origin(text: &str) -> Result<HeaderValue, String> {
    let host = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let is_origin = host.is_some_and(|host| !host.is_empty() && !host.contains(['/', '*', ' ']));
    match HeaderValue::from_str(text) {
        Ok(value) if is_origin => Ok(value),
        _ => Err("must be like https://host or http://host:port, without a path".to_owned()),
    }
}

/// Patience with connections.
#[derive(Debug, Args)]
pub(crate) struct ConnectionArguments {
    /// Connections per port that may be open at once.
    #[arg(long, env = "SLIPDRIVE_MAX_CONNECTIONS", default_value = "1024")]
    pub(crate) max_connections: NonZeroUsize,
    /// Requests of one HTTP/2 connection that may be open at once.
    #[arg(long, env = "SLIPDRIVE_MAX_STREAMS", default_value_t = 128)]
    pub(crate) max_streams: u32,
    /// Seconds that a caller may take to send the head of a request.
    #[arg(long, env = "SLIPDRIVE_HEAD_TIMEOUT_S", default_value_t = 30)]
    pub(crate) head_timeout_s: u64,
    /// Seconds that an HTTP/2 connection may stay without a request.
    #[arg(long, env = "SLIPDRIVE_IDLE_TIMEOUT_S", default_value_t = 300)]
    pub(crate) idle_timeout_s: u64,
    /// Seconds after which a connection takes no new requests.
    #[arg(long, env = "SLIPDRIVE_MAX_CONNECTION_AGE_S", default_value_t = 1800)]
    pub(crate) max_connection_age_s: u64,
}

/// Keys are secrets: a flag would show them to everyone who can list processes.
const API_KEYS_VARIABLE: &str = "SLIPDRIVE_API_KEYS";

impl ServeArguments {
    pub(crate) fn service_settings(&self) -> ServiceSettings {
        let workers = self.workers.unwrap_or_else(default_workers);
        let queue_work = Duration::from_secs(self.queue_work_s);
        ServiceSettings { workers, queue_length: self.queue_length, queue_work, ..ServiceSettings::default() }
    }

    /// Who may call.
    ///
    /// # Errors
    /// When the file of keys cannot be read, or a server without keys would listen where others can reach it.
    pub(crate) fn api_settings(&self) -> anyhow::Result<ApiSettings> {
        let keys = self.access.keys(env::var(API_KEYS_VARIABLE).ok())?;
        let grpc = (!self.one_port).then_some(("--grpc", self.grpc));
        for (flag, address) in iter::once(("--http", self.http)).chain(grpc) {
            if keys.is_empty() && !self.access.allow_unauthenticated && !address.ip().is_loopback() {
                anyhow::bail!(
                    "`{flag}` is {address}, which others can reach: set {API_KEYS_VARIABLE}, or \
                     SLIPDRIVE_ALLOW_UNAUTHENTICATED=true where something in front of this server checks its callers"
                );
            }
        }
        let cors_origins = self.access.cors_origins.clone();
        Ok(ApiSettings { keys, batch_window: self.batch_window, cors_origins, ..ApiSettings::default() })
    }

    /// Patience with connections, and who the server is to them.
    ///
    /// # Errors
    /// When TLS is asked for and cannot be set up.
    pub(crate) fn server_settings(&self) -> anyhow::Result<ServerSettings> {
        let ConnectionArguments { max_connections, max_streams, head_timeout_s, idle_timeout_s, max_connection_age_s } =
            self.connections;
        self.tls.applied_to(ServerSettings {
            max_connections: max_connections.get(),
            max_streams,
            head_timeout: Duration::from_secs(head_timeout_s),
            idle_timeout: Duration::from_secs(idle_timeout_s.max(1)),
            max_age: Duration::from_secs(max_connection_age_s),
            ..ServerSettings::default()
        })
    }
}

impl AccessArguments {
    /// Configured, but empty, is a fault: it would open the server that was meant to be closed.
    fn keys(&self, variable: Option<String>) -> anyhow::Result<ApiKeys> {
        let text = match (&self.api_keys_file, variable) {
            (Some(_), Some(_)) => {
                anyhow::bail!("both {API_KEYS_VARIABLE} and SLIPDRIVE_API_KEYS_FILE are set, must be one of them")
            }
            (Some(file), None) => {
                fs::read_to_string(file).with_context(|| format!("{} cannot be read", file.display()))?
            }
            (None, Some(text)) => text,
            (None, None) => return Ok(ApiKeys::default()),
        };
        let keys = ApiKeys::parse(&text);
        anyhow::ensure!(!keys.is_empty(), "API keys are configured, but there is none among them");
        Ok(keys)
    }
}

/// One core is left to the threads that talk to callers.
fn default_workers() -> NonZeroUsize {
    NonZeroUsize::new(cores().get() - 1).unwrap_or(NonZeroUsize::MIN)
}

/// The cores that this process may use.
pub(crate) fn cores() -> NonZeroUsize {
    available_parallelism().unwrap_or(NonZeroUsize::MIN)
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
    /// Threads that search; the plan does not depend on their number [default: cores].
    #[arg(long)]
    pub(crate) threads: Option<NonZeroUsize>,
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

    fn serve(flags: &[&str]) -> ServeArguments {
        let arguments = Arguments::parse_from(["slipdrive", "serve"].iter().chain(flags));
        let Command::Serve(serve) = arguments.command else { panic!("serve was asked") };
        serve
    }

    #[test]
    fn public_server_without_keys_is_refused() {
        for flags in [["--http", "0.0.0.0:0"], ["--grpc", "[::]:0"], ["--http", "192.0.2.1:80"]] {
            let error = serve(&flags).api_settings().unwrap_err().to_string();
            assert!(error.contains(flags[0]) && error.contains("SLIPDRIVE_API_KEYS"), "{error}");
            let allowed = serve(&[flags[0], flags[1], "--allow-unauthenticated"]);
            assert!(allowed.api_settings().is_ok());
        }
        assert!(serve(&[]).api_settings().is_ok());
        assert!(serve(&["--grpc", "0.0.0.0:0", "--one-port"]).api_settings().is_ok(), "it is not bound");
    }

    #[test]
    fn origins_are_whole_origins() {
        let given = serve(&["--cors-origins", "https://a.example,http://b.example:8000"]).access.cors_origins;
        assert_eq!(given, ["https://a.example", "http://b.example:8000"]);
        for odd in ["*", "a.example", "https://", "https://a.example/", "https://a b"] {
            assert!(Arguments::try_parse_from(["slipdrive", "serve", "--cors-origins", odd]).is_err(), "{odd}");
        }
    }

    #[test]
    fn configured_keys_that_are_none_are_refused() {
        let access = serve(&[]).access;
        assert!(access.keys(Some(" ,\n".to_owned())).is_err());
        assert!(!access.keys(Some("key".to_owned())).unwrap().is_empty());
        assert!(access.keys(None).unwrap().is_empty());
        let file = serve(&["--api-keys-file", "/nonexistent"]).access;
        assert!(file.keys(None).is_err() && file.keys(Some("key".to_owned())).is_err());
    }
}
