//! What the command line says of sweeps over NATS.

use std::env;
use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches};
use slipdrive::sweep::nats::{Access, StreamLimits};

use super::value::Threads;

/// The name of a variable, unless it is empty, such as one that a template leaves so: that is the default.
fn unless_empty(variable: &'static str) -> Option<&'static str> {
    env::var_os(variable).is_none_or(|value| !value.is_empty()).then_some(variable)
}

/// How the servers are reached.
#[derive(Debug, Args)]
pub(crate) struct NatsArguments {
    // The first: those that follow take their values away from it.
    #[command(flatten)]
    _access: FlagsOfAccess,
    /// Servers of NATS with `JetStream`, with commas between, such as `nats://host:4222`; `tls://` encrypts. A user with a
    /// password, or a token, may stand before the host: better in the variable than on the command line.
    #[arg(long = "nats", env = unless_empty("SLIPDRIVE_NATS_URL"), hide_env_values = true, value_name = "URL")]
    url: Option<String>,
    /// File with credentials (a JWT and its key).
    #[arg(long = "nats-credentials", env = unless_empty("SLIPDRIVE_NATS_CREDENTIALS"), value_name = "FILE")]
    credentials: Option<PathBuf>,
    /// File with certificates to trust beside those of the system; the connection is encrypted then.
    #[arg(long = "nats-ca", env = unless_empty("SLIPDRIVE_NATS_CA"), value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Most MiB of chunks that wait, where their stream is made; a publisher waits beyond.
    #[arg(long, env = unless_empty("SLIPDRIVE_NATS_CHUNKS_MIB"), value_name = "MIB", default_value = "256")]
    nats_chunks_mib: NonZeroU32,
    /// Most MiB of results, where their stream is made; workers wait beyond [default: what the server has].
    #[arg(long, env = unless_empty("SLIPDRIVE_NATS_RESULTS_MIB"), value_name = "MIB")]
    nats_results_mib: Option<NonZeroU32>,
    /// Servers that have a copy of all that is kept, where streams are made: 3 in a cluster.
    #[arg(long, env = unless_empty("SLIPDRIVE_NATS_REPLICAS"), value_name = "N", default_value = "1")]
    nats_replicas: NonZeroUsize,
}

/// Flags that need an address. Their variables do not: they may be there for other commands.
#[derive(Debug)]
struct FlagsOfAccess;

impl Args for FlagsOfAccess {
    fn augment_args(command: Command) -> Command {
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        command
    }
}

impl FromArgMatches for FlagsOfAccess {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let is_flag = |name| matches.value_source(name) == Some(ValueSource::CommandLine);
        match ["credentials", "ca"].into_iter().find(|name| is_flag(name)) {
            Some(name) if !matches.contains_id("url") => {
                let fault = format!("`--nats-{name}` needs `--nats`, or the variable SLIPDRIVE_NATS_URL\n");
                Err(clap::Error::raw(ErrorKind::MissingRequiredArgument, fault))
            }
            Some(_) | None => Ok(Self),
        }
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl NatsArguments {
    /// The access, where there is an address.
    pub(crate) fn access(&self) -> Option<Access> {
        let url = self.url.clone()?;
        Some(Access { url, credentials: self.credentials.clone(), ca: self.ca.clone() })
    }

    pub(crate) fn limits(&self) -> StreamLimits {
        let bytes = |mib: NonZeroU32| i64::from(mib.get()) << 20;
        StreamLimits {
            chunk_bytes: bytes(self.nats_chunks_mib),
            result_bytes: self.nats_results_mib.map_or(-1, bytes),
            replicas: self.nats_replicas.get(),
        }
    }
}

/// A sweep for workers elsewhere.
#[derive(Debug, Args)]
pub(crate) struct SweepOverNats {
    #[command(flatten)]
    pub(crate) nats: NatsArguments,
    /// Publishes nothing: brings the results that are there, and that come, into the folder.
    #[arg(long, requires_all = ["url", "out"])]
    pub(crate) collect: bool,
    /// Takes the chunks of the sweep back; its results stay.
    #[arg(long, requires = "url", conflicts_with = "collect")]
    pub(crate) cancel: bool,
}

impl SweepOverNats {
    /// Whether workers elsewhere run the sweep.
    pub(crate) fn is_asked_for(&self) -> bool {
        self.nats.url.is_some()
    }
}

/// A worker to run.
#[derive(Debug, Args)]
pub(crate) struct WorkerArguments {
    #[command(flatten)]
    pub(crate) nats: NatsArguments,
    /// Threads that work, and chunks that are taken at once [default: cores].
    #[arg(long, env = unless_empty("SLIPDRIVE_THREADS"))]
    pub(crate) threads: Option<Threads>,
    /// Address of probes and metrics: /livez, /readyz and /metrics [default: none].
    #[arg(long, env = unless_empty("SLIPDRIVE_ADMIN"), value_name = "ADDRESS")]
    pub(crate) admin: Option<SocketAddr>,
    /// Seconds without a sign of life after which a chunk is given to another worker; the last worker that starts decides
    /// for all.
    #[arg(long, env = unless_empty("SLIPDRIVE_LEASE_S"), value_name = "SECONDS", default_value = "30", value_parser = lease)]
    pub(crate) lease_s: NonZeroU32,
}

/// Signs of life are a third of it apart.
fn lease(text: &str) -> Result<NonZeroU32, String> {
    let seconds = text.parse().ok().filter(|seconds: &NonZeroU32| seconds.get() <= 3600);
    seconds.ok_or_else(|| "must be a whole number between 1 and 3600".to_owned())
}
