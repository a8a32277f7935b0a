//! Results on their way from the stream into a folder.

use std::time::Duration;

use async_nats::jetstream::consumer::{AckPolicy, DeliverPolicy, PullConsumer, pull};
use futures_util::StreamExt as _;
use tokio::time::{Instant, interval, sleep, timeout};

use super::broker::{Broker, NatsError};
use super::packed::unpacked;
use super::publish::why;
use super::{RETRY_PAUSE, cancel, subjects};
use crate::sweep::results::{Progress, Results};
use crate::sweep::runner::SYNC_INTERVAL;

/// Results that are asked for at once.
const BATCH: usize = 500;
/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// How often it is looked whether there are still chunks.
const LOOK_INTERVAL: Duration = Duration::from_secs(5);
/// How long the server keeps the place of a reader that is gone.
const READER_KEPT: Duration = Duration::from_secs(60);

/// How collecting ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Collected {
    /// All rows have results.
    Complete,
    /// It was stopped; the rest can be collected later.
    Stopped,
    /// The sweep is cancelled.
    Cancelled,
    /// Rows have no results, and no chunk is there that would bring them.
    Unpublished,
}

/// Brings the first result of each row into a folder until all rows have one, or `stop` comes, or nothing more can come.
/// Rows that the folder has are kept.
///
/// # Errors
/// When results cannot be written. Servers that are away are waited for.
pub async fn collect(
    sweep: &str,
    results: &mut Results,
    broker: &Broker,
    mut show: impl FnMut(&Progress),
    stop: impl Future<Output = ()>,
) -> Result<Collected, NatsError> {
    let mut reader = Reader { sweep, broker, next: 1, consumer: None };
    let mut stop = std::pin::pin!(stop);
    let mut ticks = interval(SYNC_INTERVAL);
    let mut look = Instant::now();
    let mut nothing_pends = None;
    let ended = loop {
        if results.progress().is_complete() {
            break Collected::Complete;
        }
        tokio::select! {
            biased;
            () = &mut stop => break Collected::Stopped,
            _ = ticks.tick() => {
                results.sync()?;
                show(results.progress());
            }
            read = reader.read() => match read {
                Ok(messages) if messages.is_empty() => {
                    // All that was published before the chunks were gone has been read.
                    if let Some(ended) = nothing_pends.take() {
                        break ended;
                    }
                    if look.elapsed() >= LOOK_INTERVAL {
                        nothing_pends = what_pends(sweep, broker).await;
                        look = Instant::now();
                    } else {
                        sleep(RETRY_PAUSE).await;
                    }
                }
                Ok(messages) => messages.iter().try_for_each(|message| take(results, message))?,
                Err(error) => {
                    tracing::warn!(error, "results cannot be read; trying again");
                    nothing_pends = None;
                    sleep(RETRY_PAUSE).await;
                }
            }
        }
    };
    results.sync()?;
    show(results.progress());
    Ok(ended)
}

/// How it ends where no chunk is left that would bring results; none while there are chunks, or nobody says.
async fn what_pends(sweep: &str, broker: &Broker) -> Option<Collected> {
    match broker.count(&broker.chunks, &subjects::chunks_of_sweep(sweep)).await {
        Ok(0) => {}
        Ok(_) | Err(_) => return None,
    }
    match cancel::is_cancelled(sweep, broker).await {
        Ok(true) => Some(Collected::Cancelled),
        Ok(false) => Some(Collected::Unpublished),
        Err(_) => None,
    }
}

fn take(results: &mut Results, message: &[u8]) -> std::io::Result<()> {
    let taken = unpacked(message).and_then(|line| results.take(&line));
    match taken {
        Ok(true) => Ok(()),
        Ok(false) => {
            tracing::warn!("a message is no result of this sweep");
            Ok(())
        }
        Err(error) if error.kind() == std::io::ErrorKind::InvalidData => {
            tracing::warn!(error = %error, "a message is no result");
            Ok(())
        }
        Err(error) => Err(error),
    }
}

/// Reads results in the order in which they came; it goes on where it was after any fault.
struct Reader<'a> {
    sweep: &'a str,
    broker: &'a Broker,
    /// The place in the stream after the last that was read.
    next: u64,
    /// What reads there, with the number of its next message.
    consumer: Option<(PullConsumer, u64)>,
}

impl Reader<'_> {
    /// The next results; none where there are no more.
    async fn read(&mut self) -> Result<Vec<Vec<u8>>, String> {
        let read = match timeout(PATIENCE, self.fetch()).await {
            Ok(read) => read,
            Err(_) => Err("the server does not answer".to_owned()),
        };
        if read.is_err() {
            self.consumer = None;
        }
        let (messages, next) = read?;
        self.next = next;
        Ok(messages)
    }

    async fn fetch(&mut self) -> Result<(Vec<Vec<u8>>, u64), String> {
        // Taken away while it reads: one that was interrupted would go on behind what was lost.
        let (consumer, mut number) = match self.consumer.take() {
            Some(consumer) => consumer,
            None => (self.opened().await?, 1),
        };
        let mut batch = consumer.fetch().max_messages(BATCH).messages().await.map_err(|error| why(&error))?;
        let (mut messages, mut next) = (Vec::new(), self.next);
        while let Some(message) = batch.next().await {
            let message = message.map_err(|error| error.to_string())?;
            let info = message.info().map_err(|error| error.to_string())?;
            if info.consumer_sequence != number {
                return Err("a result was lost on its way".to_owned());
            }
            (number, next) = (number + 1, info.stream_sequence + 1);
            messages.push(message.payload.to_vec());
        }
        self.consumer = Some((consumer, number));
        Ok((messages, next))
    }

    async fn opened(&self) -> Result<PullConsumer, String> {
        let config = pull::Config {
            deliver_policy: DeliverPolicy::ByStartSequence { start_sequence: self.next },
            ack_policy: AckPolicy::None,
            filter_subject: subjects::results_of_sweep(self.sweep),
            inactive_threshold: READER_KEPT,
            memory_storage: true,
            num_replicas: 1,
            ..pull::Config::default()
        };
        self.broker.results.create_consumer(config).await.map_err(|error| why(&error))
    }
}
