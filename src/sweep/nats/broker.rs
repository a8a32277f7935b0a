//! A connection to the servers, and the streams that sweeps need there.

use std::fmt::Display;
use std::path::PathBuf;
use std::time::Duration;

use async_nats::jetstream::consumer::pull;
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer};
use async_nats::jetstream::context::PublishError;
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::publish::PublishAck;
use async_nats::jetstream::stream::{Config, DirectGetErrorKind, DiscardPolicy, RetentionPolicy, Stream};
use async_nats::jetstream::{self, Context};
use async_nats::{Client, ConnectOptions, Event, ServerAddr};
use futures_util::TryStreamExt as _;
use tokio::time::sleep;

use super::{RETRY_PAUSE, subjects};

/// Chunks that may be on lease at once: more than workers of any cluster take.
const MOST_LEASES: i64 = 100_000;
/// Pull requests that may be open at once: one for each idle thread of all workers.
const MOST_PULLS: i64 = 16_384;
/// What is told apart of messages beside their content, bytes.
const HEADER_BYTES: usize = 1024;
/// How often a stream is asked for that the server refuses.
const STREAM_ATTEMPTS: u32 = 5;

/// Why something is not done over NATS.
#[derive(Debug, thiserror::Error)]
pub enum NatsError {
    /// An address or a file with credentials cannot be used.
    #[error("{0}")]
    Unusable(String),
    /// The servers do not do what is asked of them.
    #[error("{what}: {fault}")]
    Failed {
        /// What was asked.
        what: &'static str,
        /// Why it is not done.
        fault: String,
    },
    /// A chunk has too many bytes for a message.
    #[error(
        "chunk {chunk} has {bytes} bytes in a message, the server takes at most {most}: make `chunk_rows` smaller, or \
         raise `max_payload` there"
    )]
    ChunkTooLarge {
        /// The chunk.
        chunk: u64,
        /// Its size, compressed.
        bytes: usize,
        /// The limit of the server.
        most: usize,
    },
    /// A row cannot be read any more, or results cannot be written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

impl NatsError {
    pub(super) fn failed(what: &'static str) -> impl Fn(&dyn Display) -> Self {
        move |error| Self::Failed { what, fault: error.to_string() }
    }
}

/// How the servers are reached.
#[derive(Debug, Clone, Default)]
pub struct Access {
    /// One address or several with commas between, such as `nats://host:4222`; they may hold a user with a password, or a
    /// token.
    pub url: String,
    /// A file with a JWT and its key.
    pub credentials: Option<PathBuf>,
    /// Certificates to trust beside those of the system.
    pub ca: Option<PathBuf>,
}

/// What the streams may hold, where they are made.
#[derive(Debug, Clone, Copy)]
pub struct StreamLimits {
    /// Chunks, bytes; a publisher waits while there are as many.
    pub chunk_bytes: i64,
    /// Results, bytes; workers wait while there are as many.
    pub result_bytes: i64,
    /// Servers that have a copy.
    pub replicas: usize,
}

impl Default for StreamLimits {
    fn default() -> Self {
        // What is not limited here ends at the store of the server.
        Self { chunk_bytes: 256 << 20, result_bytes: -1, replicas: 1 }
    }
}

/// A connection, and the streams.
#[derive(Debug, Clone)]
pub struct Broker {
    context: Context,
    pub(super) chunks: Stream<()>,
    pub(super) results: Stream<()>,
    pub(super) marks: Stream<()>,
    pub(super) states: Stream<()>,
    limits: StreamLimits,
}

impl Broker {
    /// Connects and makes the streams that are not there; lost connections come back by themselves.
    ///
    /// # Errors
    /// What of the access cannot be used, and when the servers do not answer or have no `JetStream`.
    pub async fn connect(access: &Access, limits: StreamLimits) -> Result<Self, NatsError> {
        let client = connected(access).await?;
        let context = jetstream::new(client);
        let stream = |name: &'static str| opened(&context, name, limits);
        stream(subjects::DEAD_LETTERS).await?;
        Ok(Self {
            chunks: stream(subjects::CHUNKS).await?,
            results: stream(subjects::RESULTS).await?,
            marks: stream(subjects::MARKS).await?,
            states: stream(subjects::STATES).await?,
            context: context.clone(),
            limits,
        })
    }

    pub(super) fn client(&self) -> Client {
        self.context.client()
    }

    /// Sends a message and waits until the server says that its stream has it.
    ///
    /// # Errors
    /// When the server refuses it or does not answer.
    pub(super) async fn send(&self, subject: String, message: PublishMessage) -> Result<PublishAck, PublishError> {
        self.context.send_publish(subject, message).await?.await
    }

    /// Largest content of a message, bytes.
    pub(super) fn most_bytes(&self) -> usize {
        self.client().max_payload().saturating_sub(HEADER_BYTES)
    }

    /// Makes the streams again that somebody has taken away.
    pub(super) async fn restore(&self) -> Result<(), NatsError> {
        for name in [subjects::CHUNKS, subjects::RESULTS, subjects::MARKS, subjects::DEAD_LETTERS, subjects::STATES] {
            opened(&self.context, name, self.limits).await?;
        }
        Ok(())
    }

    /// The consumer that all workers of this version share, made where it is not there.
    pub(super) async fn consumer(&self, lease: Option<Duration>) -> Result<PullConsumer, NatsError> {
        let name = subjects::consumer();
        let config = pull::Config {
            durable_name: Some(name.clone()),
            filter_subject: subjects::all_chunks(),
            ack_policy: AckPolicy::Explicit,
            ack_wait: lease.unwrap_or(super::lease::DEFAULT_LEASE),
            // Without a limit: what was delivered that often would stay in the queue for ever.
            max_deliver: -1,
            max_ack_pending: MOST_LEASES,
            max_waiting: MOST_PULLS,
            ..pull::Config::default()
        };
        let failed = NatsError::failed("the consumer of the workers cannot be made");
        match lease {
            // The lease is what a worker says, whatever the consumer had before.
            Some(_) => self.chunks.create_consumer(config).await.map_err(|error| failed(&error)),
            None => self.chunks.get_or_create_consumer(&name, config).await.map_err(|error| failed(&error)),
        }
    }

    /// Chunks for this version that are in the stream, whether or not anybody gets them.
    pub(super) async fn chunks_of_version(&self) -> Result<u64, NatsError> {
        self.count(&self.chunks, &subjects::all_chunks()).await
    }

    /// How many messages are under the subjects of a filter.
    pub(super) async fn count(&self, stream: &Stream<()>, filter: &str) -> Result<u64, NatsError> {
        let failed = NatsError::failed("a stream cannot be counted");
        let subjects = stream.info_with_subjects(filter).await.map_err(|error| failed(&error))?;
        let count = subjects.try_fold(0, |count, (_, messages)| async move { Ok(count + messages as u64) });
        count.await.map_err(|error| failed(&error))
    }
}

/// The last message under a subject with its place in the stream, if there is any.
///
/// # Errors
/// When the server does not say.
pub(super) async fn last(stream: &Stream<()>, subject: String) -> Result<Option<(u64, Vec<u8>)>, NatsError> {
    match stream.direct_get_last_for_subject(subject).await {
        Ok(message) => Ok(Some((message.sequence, message.payload.to_vec()))),
        Err(error) if error.kind() == DirectGetErrorKind::NotFound => Ok(None),
        Err(error) => Err(NatsError::failed("a message cannot be read")(&error)),
    }
}

async fn connected(access: &Access) -> Result<Client, NatsError> {
    let addresses: Result<Vec<ServerAddr>, _> = access.url.split(',').map(|url| url.trim().parse()).collect();
    // Without the address itself: it may hold a password.
    let addresses = addresses.map_err(|error| NatsError::Unusable(format!("the URL of NATS is invalid: {error}")))?;
    let mut options = ConnectOptions::new().name("slipdrive").event_callback(log);
    // The client leaves them in the URL.
    let named = addresses.iter().find_map(|address| Some((decoded(address.username()?), address.password())));
    options = match named {
        Some((user, Some(password))) => options.user_and_password(user, decoded(password)),
        Some((token, None)) => options.token(token),
        None => options,
    };
    if let Some(file) = &access.credentials {
        let unusable = |error| NatsError::Unusable(format!("{} cannot be used: {error}", file.display()));
        options = options.credentials_file(file).await.map_err(unusable)?;
    }
    if let Some(file) = &access.ca {
        options = options.add_root_certificates(file.clone()).require_tls(true);
    }
    options.connect(addresses).await.map_err(|error| NatsError::failed("NATS cannot be reached")(&error))
}

/// A part of a URL without its percent signs.
fn decoded(part: &str) -> String {
    percent_encoding::percent_decode_str(part).decode_utf8_lossy().into_owned()
}

async fn log(event: Event) {
    match event {
        Event::Connected => tracing::info!("connected to NATS"),
        Event::Disconnected => tracing::warn!("NATS cannot be reached; connecting again"),
        other @ (Event::LameDuckMode
        | Event::Draining
        | Event::Closed
        | Event::SlowConsumer(_)
        | Event::ServerError(_)
        | Event::ClientError(_)) => tracing::debug!(event = %other, "NATS"),
    }
}

/// The stream of this name, made where it is not there. The server may refuse one that another process makes at the same
/// moment, so a refusal counts only when it is repeated.
async fn opened(context: &Context, name: &'static str, limits: StreamLimits) -> Result<Stream<()>, NatsError> {
    let failed = NatsError::failed("a stream cannot be made");
    let mut attempts = 1;
    while let Err(error) = context.get_or_create_stream(config(name, limits)).await {
        if attempts == STREAM_ATTEMPTS {
            return Err(failed(&error));
        }
        attempts += 1;
        sleep(RETRY_PAUSE).await;
    }
    context.get_stream_no_info(name).await.map_err(|error| failed(&error))
}

fn config(name: &'static str, limits: StreamLimits) -> Config {
    let common = Config {
        name: name.to_owned(),
        subjects: vec![subjects::all_of(name)],
        num_replicas: limits.replicas,
        allow_direct: true,
        ..Config::default()
    };
    match name {
        subjects::CHUNKS => Config {
            retention: RetentionPolicy::WorkQueue,
            discard: DiscardPolicy::New,
            max_bytes: limits.chunk_bytes,
            ..common
        },
        // The first result of a row stays.
        subjects::RESULTS => Config {
            discard: DiscardPolicy::New,
            discard_new_per_subject: true,
            max_messages_per_subject: 1,
            max_bytes: limits.result_bytes,
            ..common
        },
        _ => Config { max_messages_per_subject: 1, ..common },
    }
}
