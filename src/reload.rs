//! Reads keys and certificate again while the server runs, so that they are rotated without a restart.
//!
//! Contents are compared, not times or places: a mounted secret is a link that is swapped, and its files bear the times of
//! their making. What cannot be used leaves what was read before in force, and the log and the metrics say so.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use sha2::{Digest as _, Sha256};
use slipdrive::api::auth::ApiKeys;
#[cfg(feature = "tls")]
use slipdrive::api::server::tls::Identity;
use slipdrive::metrics::{Metrics, SecretFile};
use tokio::task::spawn_blocking;
use tokio::time::{MissedTickBehavior, interval};

use crate::config::ServerConfig;

/// How often the files are looked at: a key that is withdrawn is refused in less than ten seconds.
const LOOK_INTERVAL: Duration = Duration::from_secs(5);

/// The files of a server that are read again.
pub(crate) struct Reload {
    secrets: Vec<Watched>,
    metrics: Arc<Metrics>,
}

/// What is read of files, and whom it is given to.
enum Secret {
    ApiKeys {
        file: PathBuf,
        keys: ApiKeys,
    },
    #[cfg(feature = "tls")]
    Certificate {
        certificate: PathBuf,
        key: PathBuf,
        identity: Identity,
    },
}

/// A secret, and what was seen of its files last.
struct Watched {
    secret: Secret,
    seen: Option<Fingerprint>,
}

/// Says of contents, or of why they cannot be read, whether they are the same as before.
type Fingerprint = [u8; 32];

/// What was read, ready to be used.
struct Read<'a> {
    fingerprint: Fingerprint,
    /// Puts it in the place of what was read before, or gives all faults.
    put: Box<dyn FnOnce() -> Result<(), Vec<String>> + 'a>,
}

/// Why a secret is read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Occasion {
    /// It may have changed since the configuration was read.
    Start,
    /// It is looked at every few seconds.
    Look,
    /// Somebody asked by a signal.
    Signal,
}

impl Reload {
    /// Those of this configuration.
    pub(crate) fn of(config: &ServerConfig, metrics: &Arc<Metrics>) -> Self {
        let settings = &config.settings;
        let mut secrets = Vec::new();
        if let Some(file) = settings.api_keys_file.clone() {
            secrets.push(Secret::ApiKeys { file, keys: config.keys.clone() });
        }
        #[cfg(feature = "tls")]
        if let (Some(certificate), Some(key)) = (settings.tls_certificate.clone(), settings.tls_key.clone())
            && let Some(identity) = config.server.identity.clone()
        {
            secrets.push(Secret::Certificate { certificate, key, identity });
        }
        let secrets: Vec<_> = secrets.into_iter().map(|secret| Watched { secret, seen: None }).collect();
        for watched in &secrets {
            metrics.expect_file(watched.secret.file());
        }
        Self { secrets, metrics: Arc::clone(metrics) }
    }

    /// Looks at them until the process ends, at intervals and at each signal.
    pub(crate) async fn run(mut self, mut hangups: Hangups) {
        let mut looks = interval(LOOK_INTERVAL);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut occasion = Occasion::Start;
        loop {
            // Files may be on a disk that answers late.
            match spawn_blocking(move || self.look(occasion)).await {
                Ok(this) => self = this,
                Err(error) => return tracing::error!(error = %error, "keys and certificate are read no more"),
            }
            occasion = tokio::select! {
                _ = looks.tick() => Occasion::Look,
                () = hangups.next() => Occasion::Signal,
            };
        }
    }

    fn look(mut self, occasion: Occasion) -> Self {
        if occasion == Occasion::Signal && self.secrets.is_empty() {
            tracing::info!("SIGHUP changes nothing: there are no files with keys or certificates");
        }
        for watched in &mut self.secrets {
            watched.look(occasion, &self.metrics);
        }
        self
    }
}

impl Watched {
    /// Uses the files where they have changed, or where somebody asks for it.
    fn look(&mut self, occasion: Occasion, metrics: &Metrics) {
        let Read { fingerprint, put } = self.secret.read(metrics);
        let is_same = self.seen.replace(fingerprint) == Some(fingerprint);
        if is_same && occasion != Occasion::Signal {
            return;
        }
        let used = put();
        let file = self.secret.file();
        // That is what the server has started with.
        if occasion == Occasion::Start && used.is_ok() {
            return;
        }
        // First, since who reads the log may look at the metrics next.
        metrics.file_read(file, used.is_ok());
        match used {
            Ok(()) => tracing::info!(file = file.as_str(), "read again"),
            Err(faults) => {
                let faults = faults.join("; ");
                tracing::error!(file = file.as_str(), faults, "cannot be used, what was read before stays in force");
            }
        }
    }
}

impl Secret {
    fn file(&self) -> SecretFile {
        match self {
            Self::ApiKeys { .. } => SecretFile::ApiKeys,
            #[cfg(feature = "tls")]
            Self::Certificate { .. } => SecretFile::Certificate,
        }
    }

    fn read<'a>(&'a self, metrics: &'a Metrics) -> Read<'a> {
        match self {
            Self::ApiKeys { file, keys } => {
                let content = std::fs::read(file);
                let fingerprint = fingerprint(&[&content]);
                Read { fingerprint, put: Box::new(move || put_keys((file, content), keys, metrics)) }
            }
            #[cfg(feature = "tls")]
            Self::Certificate { certificate, key, identity } => {
                let (chain, of_key) = (std::fs::read(certificate), std::fs::read(key));
                let fingerprint = fingerprint(&[&chain, &of_key]);
                let put = move || identity.replace((certificate, chain), (key, of_key)).map_err(|found| found.faults);
                Read { fingerprint, put: Box::new(put) }
            }
        }
    }
}

fn put_keys(
    (file, content): (&Path, io::Result<Vec<u8>>),
    keys: &ApiKeys,
    metrics: &Metrics,
) -> Result<(), Vec<String>> {
    let content = content.map_err(|error| vec![format!("{} cannot be read: {error}", file.display())])?;
    let text = String::from_utf8(content).map_err(|_| vec![format!("{} is no text in UTF-8", file.display())])?;
    keys.replace(&text).map_err(|found| found.faults)?;
    keys.callers().iter().for_each(|caller| metrics.expect_caller(caller));
    Ok(())
}

fn fingerprint(contents: &[&io::Result<Vec<u8>>]) -> Fingerprint {
    let mut all = Sha256::new();
    for content in contents {
        let each = match content {
            Ok(bytes) => Sha256::new().chain_update([0]).chain_update(bytes),
            Err(error) => Sha256::new().chain_update([1]).chain_update(error.to_string()),
        };
        all.update(each.finalize());
    }
    all.finalize().into()
}

/// The signals that ask for it; elsewhere than on Unix there are none.
pub(crate) struct Hangups {
    #[cfg(unix)]
    signal: tokio::signal::unix::Signal,
}

impl Hangups {
    /// From now on such a signal does not end the process.
    ///
    /// # Errors
    /// When the system refuses.
    pub(crate) fn listen() -> io::Result<Self> {
        Ok(Self {
            #[cfg(unix)]
            signal: tokio::signal::unix::signal(tokio::signal::unix::SignalKind::hangup())?,
        })
    }

    #[cfg(unix)]
    async fn next(&mut self) {
        if self.signal.recv().await.is_none() {
            std::future::pending::<()>().await;
        }
    }

    #[cfg(not(unix))]
    async fn next(&mut self) {
        std::future::pending::<()>().await;
    }
}
