//! Reads the configuration once, from flags, environment variables and an optional TOML file, and reports all faults at
//! once.
//!
//! A flag overrides its variable, the variable the file, the file the default. API keys are secrets: they come from a
//! variable or a file of their own, never from a flag, and are never shown.

mod faults;
#[cfg(feature = "nats")]
mod nats;
mod settings;
mod sources;
mod tls;
mod value;

use std::ffi::OsString;
use std::net::SocketAddr;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::thread::available_parallelism;
use std::{env, fs};

use clap::{ArgMatches, Args, FromArgMatches as _, Parser, Subcommand};
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::server::{PROBE_PLACES, ServerSettings};
use slipdrive::api::{ApiSettings, Probes};
use slipdrive::service::ServiceSettings;
use slipdrive::sweep::{MapOf, Shard};

use crate::health::{Protocol, Target};
pub(crate) use faults::Faults;
#[cfg(feature = "nats")]
pub(crate) use nats::{NatsArguments, SweepOverNats, WorkerArguments};
pub(crate) use settings::{LogSettings, ServeSettings};
use sources::{Given, Shown, Sources};
pub(crate) use tls::for_probes;
use value::folder;
pub(crate) use value::{LogFormat, Threads};

/// What the exit codes mean.
const EXIT_CODES: &str = "\
Exit codes:
  0   there is what was asked for
  1   a job without an answer, or a file that cannot be read or written
  2   the answer of `solve` is not what was asked for: the goal is missed or impossible, or a limit exceeded
  75  a sweep that ended before its end: the same command goes on
  64  input that cannot be used: the command line, a request, or a setting";

/// Time-optimal maneuvers of a differential-drive robot whose wheels may slip.
#[derive(Debug, Parser)]
#[command(version, after_help = EXIT_CODES)]
pub(crate) struct Arguments {
    #[command(flatten)]
    log: Given<LogSettings>,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What to do beside running one job; the commands of jobs are added by the registry.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Serve REST and gRPC until a signal comes.
    Serve(ServeArguments),
    /// Run many jobs of one kind from a file; what is done once is not done again.
    Sweep(SweepArguments),
    /// Run chunks of sweeps that come over NATS, until a signal comes.
    #[cfg(feature = "nats")]
    Worker(WorkerArguments),
    /// Print an example of a request or of a sweep, by its name; without a name the first.
    Example(ExampleArguments),
    /// Print what completes commands and flags in a shell.
    Completions(CompletionsArguments),
    /// Ask a server of this configuration whether it is ready; the exit code says so.
    Health(HealthArguments),
}

/// How a server is configured.
#[derive(Debug, Args)]
pub(crate) struct ServerArguments {
    /// File with settings, in TOML; its keys are the names of the flags with underscores.
    // A text, since clap refuses an empty path before anything else is read.
    #[arg(long = "config", env = "SLIPDRIVE_CONFIG", value_name = "FILE")]
    file: Option<OsString>,
    #[command(flatten)]
    given: Given<ServeSettings>,
}

impl ServerArguments {
    /// The file, and with it the other sources; an empty name is none.
    fn sources(&self, faults: &mut Faults) -> Sources {
        Sources::new(self.file.as_deref().filter(|file| !file.is_empty()).map(Path::new), faults)
    }
}

/// A server to run.
#[derive(Debug, Args)]
pub(crate) struct ServeArguments {
    #[command(flatten)]
    server: ServerArguments,
    /// Prints the settings in force and where each comes from, and ends.
    #[arg(long)]
    pub(crate) print_config: bool,
}

/// A server to ask.
#[derive(Debug, Args)]
pub(crate) struct HealthArguments {
    #[command(flatten)]
    server: ServerArguments,
    /// Asks whether the process lives, in place of whether it takes work.
    #[arg(long)]
    pub(crate) live: bool,
}

/// An example to print.
#[derive(Debug, Args)]
pub(crate) struct ExampleArguments {
    /// Its name, such as `forward-drive`.
    pub(crate) name: Option<String>,
}

/// A shell to complete commands in.
#[derive(Debug, Args)]
pub(crate) struct CompletionsArguments {
    /// The shell.
    pub(crate) shell: clap_complete::Shell,
}

/// A sweep to run, to count or to show.
#[derive(Debug, Args)]
pub(crate) struct SweepArguments {
    /// The sweep: an object in JSON, or JSON Lines; `-` is standard input, `final-time-map` an example. Without it
    /// nothing runs: the results are shown.
    pub(crate) file: Option<PathBuf>,
    /// The folder of the results; to show those of several shards, all of their folders.
    #[arg(long, value_name = "DIR", value_parser = folder())]
    pub(crate) out: Vec<PathBuf>,
    /// Runs the chunks whose number leaves I when divided by N, from 0.
    #[arg(long, value_name = "I/N", default_value_t = Shard::WHOLE)]
    pub(crate) shard: Shard,
    /// Threads that work; the results do not depend on their number [default: cores].
    #[arg(long)]
    pub(crate) threads: Option<Threads>,
    /// Draws a map into the folder (`map.svg`): what the value is over the two fields. Fields that differ beside them are
    /// given one value each.
    #[arg(long, value_name = "X,Y,VALUE[,FIELD=VALUE]...")]
    pub(crate) figure: Option<MapOf>,
    /// Judges all rows, prints how many rows and chunks there are, and ends.
    #[arg(long)]
    pub(crate) count: bool,
    /// Prints how far it is, also while another process runs it, and ends.
    #[arg(long)]
    pub(crate) status: bool,
    #[cfg(feature = "nats")]
    #[command(flatten)]
    pub(crate) nats: SweepOverNats,
}

/// A job to run; the same arguments for every kind.
#[derive(Debug, Args)]
pub(crate) struct JobArguments {
    // Its help is made by the command, which knows the kind.
    #[arg(value_name = "FILE", required = true)]
    pub(crate) input: Vec<PathBuf>,
    /// Writes the JSON answer of the server here; `-` is standard output, in place of the table.
    #[arg(long, value_name = "OUT")]
    pub(crate) json: Option<PathBuf>,
    /// Keeps request and answer here, for `slipdrive present`, `export` and `assess`; `-` is standard output.
    #[arg(long, value_name = "OUT")]
    pub(crate) save: Option<PathBuf>,
    /// Writes a page with the answer in words and figures here, which needs nothing beside it; `-` is standard output.
    #[arg(long, value_name = "PAGE")]
    pub(crate) report: Option<PathBuf>,
    /// Writes the figures into this folder, one SVG file each.
    #[arg(long, value_name = "DIR", value_parser = folder())]
    pub(crate) svg: Option<PathBuf>,
    /// Writes the motion here, one row of numbers per node; `-` is standard output.
    #[arg(long, value_name = "OUT")]
    pub(crate) csv: Option<PathBuf>,
    /// Writes the files of the answer into this folder; without it they are listed only.
    #[arg(long, value_name = "DIR", value_parser = folder())]
    pub(crate) out: Option<PathBuf>,
    /// Threads that work; the answer does not depend on their number [default: cores].
    #[arg(long)]
    pub(crate) threads: Option<Threads>,
}

/// So much that three sixteenths of it, the share of a connection for what is large, hold the largest answer (4.5 MB).
const LEAST_MEMORY_BUDGET_MIB: usize = 24;

/// The variable of the API keys, which have no flag: it would show them to everyone who can list processes.
const API_KEYS_VARIABLE: &str = "SLIPDRIVE_API_KEYS";

/// What is logged where no server runs.
///
/// # Errors
/// Arguments that cannot be read, and all faults of the settings.
pub(crate) fn log_settings(matches: &ArgMatches) -> anyhow::Result<Result<LogSettings, Faults>> {
    let given = Given::<LogSettings>::from_arg_matches(matches)?;
    let mut faults = Faults::default();
    let log = read_log_settings(&Sources::new(None, &mut faults), &given, &mut faults);
    Ok(faults.into_result(log))
}

/// What is logged, and where traces go.
fn read_log_settings(sources: &Sources, given: &Given<LogSettings>, faults: &mut Faults) -> Option<LogSettings> {
    let log = sources.read(given, faults);
    #[cfg(feature = "otel")]
    crate::telemetry::check(faults);
    log
}

/// A checked configuration of a server.
#[derive(Debug)]
pub(crate) struct ServerConfig {
    pub(crate) settings: ServeSettings,
    pub(crate) log: LogSettings,
    pub(crate) keys: ApiKeys,
    /// Limits and timeouts of connections, and the TLS identity.
    pub(crate) server: ServerSettings,
    shown: Vec<Shown>,
}

impl ServeArguments {
    /// The configuration in force.
    ///
    /// # Errors
    /// All faults: values that cannot be read, unknown keys of the file, settings that contradict each other.
    pub(crate) fn config(&self, log: &Given<LogSettings>) -> Result<ServerConfig, Faults> {
        let mut faults = Faults::default();
        let sources = self.server.sources(&mut faults);
        sources.check_keys(&[ServeSettings::TABLE, LogSettings::TABLE], &mut faults);
        let settings: Option<ServeSettings> = sources.read(&self.server.given, &mut faults);
        let log_settings = read_log_settings(&sources, log, &mut faults);
        let checked = settings.as_ref().and_then(|settings| {
            settings.check(&mut faults);
            let keys = settings.keys(env::var_os(API_KEYS_VARIABLE), &mut faults);
            let server = tls::with_identity(settings, settings.server(), &mut faults);
            Some((keys?, server))
        });
        let shown = sources.shown(&self.server.given).chain(sources.shown(log)).collect();
        let all = settings.zip(log_settings).zip(checked);
        faults.into_result(all.map(|((settings, log), (keys, server))| ServerConfig {
            settings,
            log,
            keys,
            server,
            shown,
        }))
    }
}

impl HealthArguments {
    /// Where the server answers probes.
    ///
    /// # Errors
    /// All faults of the settings.
    pub(crate) fn target(&self) -> Result<Target, Faults> {
        let mut faults = Faults::default();
        let sources = self.server.sources(&mut faults);
        let settings: Option<ServeSettings> = sources.read(&self.server.given, &mut faults);
        faults.into_result(settings.map(|settings| match (settings.admin, &settings.tls_certificate) {
            (Some(bound), _) => Target { bound, protocol: Protocol::Plain },
            (None, None) => Target { bound: settings.http, protocol: Protocol::Plain },
            (None, Some(_)) => Target { bound: settings.http, protocol: Protocol::Tls },
        }))
    }
}

impl Arguments {
    /// The configuration of the server to run.
    ///
    /// # Errors
    /// As [`ServeArguments::config`].
    pub(crate) fn server_config(&self, arguments: &ServeArguments) -> Result<ServerConfig, Faults> {
        arguments.config(&self.log)
    }
}

impl ServerConfig {
    /// The settings as TOML that `--config` takes, each with its source; of secrets only how many there are.
    pub(crate) fn to_toml(&self) -> String {
        let secrets = self.keys.count().map(|count| format!("# {count} API keys, which are not shown\n"));
        self.shown.iter().map(ToString::to_string).chain(secrets).collect()
    }

    pub(crate) fn service_settings(&self) -> ServiceSettings {
        let ServeSettings { workers, queue_length, queue_work_s: queue_work, .. } = self.settings;
        let workers = workers.map_or_else(default_workers, |Threads(count)| count);
        ServiceSettings { workers, queue_length, queue_work, ..ServiceSettings::default() }
    }

    pub(crate) fn api_settings(&self) -> ApiSettings {
        let settings = &self.settings;
        let probes = if settings.admin.is_some() { Probes::Apart } else { Probes::WithApi };
        let (keys, cors_origins) = (self.keys.clone(), settings.cors_origins.0.clone());
        ApiSettings { keys, batch_window: settings.batch_window, probes, cors_origins, ..ApiSettings::default() }
    }
}

impl ServeSettings {
    /// The addresses that serve the API, with their keys.
    fn api_addresses(&self) -> impl Iterator<Item = (&'static str, SocketAddr)> {
        let grpc = (!self.one_port).then_some(("grpc", self.grpc));
        std::iter::once(("http", self.http)).chain(grpc)
    }

    fn server(&self) -> ServerSettings {
        ServerSettings {
            max_connections: self.max_connections.get(),
            max_connections_per_address: self.max_connections_per_address.map(NonZeroUsize::get),
            memory_budget_bytes: self.memory_budget_mib.get().saturating_mul(1 << 20),
            max_streams: self.max_streams,
            head_timeout: self.head_timeout_s,
            idle_timeout: self.idle_timeout_s,
            max_age: self.max_connection_age_s,
            ..ServerSettings::default()
        }
    }

    /// Adds settings that contradict each other or are out of range.
    fn check(&self, faults: &mut Faults) {
        let admin = self.admin.map(|admin| ("admin", admin));
        let addresses: Vec<_> = self.api_addresses().chain(admin).collect();
        for (index, (key, address)) in addresses.iter().enumerate() {
            for (other_key, other) in &addresses[..index] {
                if address.port() != 0 && address == other {
                    faults.add(format!("`{other_key}` and `{key}` are both {address}, must differ"));
                }
            }
        }
        for (key, duration) in [("head_timeout_s", self.head_timeout_s), ("idle_timeout_s", self.idle_timeout_s)] {
            if duration.is_zero() {
                faults.add(format!("`{key}` is 0, must be > 0 s"));
            }
        }
        let places = self.max_connections.get();
        if admin.is_none() && places <= PROBE_PLACES {
            faults.add(format!(
                "`max_connections` is {places}, must be > {PROBE_PLACES}, which are kept for probes where `admin` is not set"
            ));
        }
        let budget = self.memory_budget_mib.get();
        if budget < LEAST_MEMORY_BUDGET_MIB {
            faults.add(format!(
                "`memory_budget_mib` is {budget}, must be >= {LEAST_MEMORY_BUDGET_MIB}, or the largest answer never fits"
            ));
        }
    }

    /// The API keys. A source without a key is a fault: it would open a server that was meant to be closed.
    fn keys(&self, variable: Option<OsString>, faults: &mut Faults) -> Option<ApiKeys> {
        let text = match (&self.api_keys_file, variable) {
            (Some(_), Some(_)) => {
                faults.add(format!("both {API_KEYS_VARIABLE} and `api_keys_file` are set, must be one of them"));
                return None;
            }
            (Some(file), None) => match fs::read_to_string(file) {
                Ok(text) => Some(text),
                Err(error) => {
                    faults.add(format!("`api_keys_file` is {}, which cannot be read: {error}", file.display()));
                    return None;
                }
            },
            (None, Some(variable)) => {
                let Ok(text) = variable.into_string() else {
                    faults.add(format!("{API_KEYS_VARIABLE} is no UTF-8 text"));
                    return None;
                };
                Some(text)
            }
            (None, None) => None,
        };
        let keys = match ApiKeys::parse(text.as_deref().unwrap_or_default()) {
            Ok(keys) => keys,
            Err(found) => {
                let source = self.api_keys_file.as_ref().map_or(API_KEYS_VARIABLE, |_| "`api_keys_file`");
                found.faults.iter().for_each(|fault| faults.add(format!("{source}: {fault}")));
                return None;
            }
        };
        if text.is_some() && keys.is_empty() {
            faults.add("API keys are configured, but there is none among them".to_owned());
        }
        self.check_exposure(&keys, text.is_some(), faults);
        Some(keys)
    }

    /// Adds a fault when a server without keys would listen on an address that others can reach.
    fn check_exposure(&self, keys: &ApiKeys, is_configured: bool, faults: &mut Faults) {
        if is_configured || !keys.is_empty() || self.allow_unauthenticated {
            return;
        }
        for (key, address) in self.api_addresses().filter(|(_, address)| !address.ip().is_loopback()) {
            faults.add(format!(
                "`{key}` is {address}, which others can reach: set {API_KEYS_VARIABLE} or `api_keys_file`, or \
                 `allow_unauthenticated` where something in front of this server checks its callers"
            ));
        }
    }
}

/// One core is left to the threads that handle connections.
fn default_workers() -> NonZeroUsize {
    NonZeroUsize::new(cores().get() - 1).unwrap_or(NonZeroUsize::MIN)
}

/// As many threads as are asked for, or else as cores may be used.
pub(crate) fn thread_count(given: Option<Threads>) -> NonZeroUsize {
    given.map_or_else(cores, |Threads(count)| count)
}

/// The cores that this process may use.
fn cores() -> NonZeroUsize {
    available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

#[cfg(test)]
mod tests;
