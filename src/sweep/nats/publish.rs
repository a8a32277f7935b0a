//! The chunks of a sweep on their way into the queue.

use std::cell::RefCell;

use async_nats::jetstream::context::PublishError;
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::publish::PublishAck;
use futures_util::stream::{self, TryStreamExt as _};
use tokio::time::{MissedTickBehavior, interval, sleep};

use super::broker::{Broker, NatsError};
use super::chunk::Chunk;
use super::{RETRY_PAUSE, cancel, subjects};
use crate::sweep::Sweep;
use crate::sweep::results::{Results, RowSet};
use crate::sweep::runner::SYNC_INTERVAL;

/// What is to be run.
#[derive(Clone, Copy)]
pub struct Wanted<'a> {
    /// The sweep; its rows must have been judged.
    pub sweep: &'a Sweep,
    /// The folder that the results are for, if there is one: what it has is not run again.
    pub results: Option<&'a Results>,
}

/// Chunks that are sent before the first of them is confirmed.
const SENT_AHEAD: usize = 64;

/// Whether chunks that were sent a moment ago are sent again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sending {
    /// They are not: the server knows them by their ids.
    Once,
    /// They are, for the server has lost them.
    Again,
}

/// How far the publishing of a sweep is.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Published {
    /// Chunks of the sweep.
    pub chunks: u64,
    /// Chunks that are in the queue or were, without the following.
    pub published: u64,
    /// Chunks that were sent a moment ago too.
    pub duplicates: u64,
    /// Chunks whose rows all have results.
    pub finished: u64,
    /// Why it waits, if it does: the queue is full, or the server is away.
    pub waits_for: Option<String>,
}

impl Published {
    /// Counts a chunk that was sent; whether the server has it.
    fn count(&mut self, sent: &Result<PublishAck, PublishError>) -> bool {
        self.waits_for = sent.as_ref().err().map(|error| why(error));
        match sent {
            Ok(PublishAck { duplicate: true, .. }) => self.duplicates += 1,
            Ok(_) => self.published += 1,
            Err(_) => return false,
        }
        true
    }

    /// Whether all chunks are dealt with.
    pub fn is_complete(&self) -> bool {
        self.published + self.duplicates + self.finished == self.chunks
    }
}

impl std::fmt::Display for Published {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { chunks, published, duplicates, finished, waits_for } = self;
        write!(formatter, "{published} of {chunks} chunks published, {finished} have results")?;
        if *duplicates > 0 {
            write!(formatter, ", {duplicates} were sent before")?;
        }
        waits_for.as_ref().map_or(Ok(()), |why| write!(formatter, "; waits: {why}"))
    }
}

/// Publishes the chunks of a sweep that are not finished, until all are there or `stop` comes. Chunks that are published
/// again are run again only as far as rows have no results.
///
/// # Errors
/// When the servers refuse, and where a chunk is too large for a message. A full queue and a lost connection are waited
/// for.
pub async fn publish(
    wanted: Wanted<'_>,
    broker: &Broker,
    sending: Sending,
    mut show: impl FnMut(&Published),
    stop: impl Future<Output = ()>,
) -> Result<Published, NatsError> {
    let sweep = wanted.sweep;
    // Before the chunks, so that what scales the workers finds it.
    broker.consumer(None).await?;
    let generation = cancel::resume(sweep.hash(), sending, broker).await?;
    let done = rows_with_results(wanted, broker).await?;
    let published = RefCell::new(Published { chunks: sweep.chunk_count(), ..Published::default() });
    let chunks = stream::iter((0..sweep.chunk_count()).map(Ok::<_, NatsError>));
    let send = |chunk| publish_chunk(sweep, chunk, generation, (&done, broker, &published));
    let mut all = std::pin::pin!(chunks.try_for_each_concurrent(SENT_AHEAD, send));
    let mut stop = std::pin::pin!(stop);
    let mut ticks = interval(SYNC_INTERVAL);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            biased;
            () = &mut stop => break,
            sent = &mut all => {
                sent?;
                break;
            }
            _ = ticks.tick() => show(&published.borrow()),
        }
    }
    let published = published.borrow().clone();
    show(&published);
    Ok(published)
}

async fn publish_chunk(
    sweep: &Sweep,
    chunk: u64,
    generation: u64,
    (done, broker, published): (&RowSet, &Broker, &RefCell<Published>),
) -> Result<(), NatsError> {
    if sweep.chunk(chunk).all(|row| done.contains(row)) {
        published.borrow_mut().finished += 1;
        return Ok(());
    }
    let content = Chunk::of(sweep, chunk).map_err(|problem| std::io::Error::other(problem.to_string()))?.write();
    let (bytes, most) = (content.len(), broker.most_bytes());
    if bytes > most {
        return Err(NatsError::ChunkTooLarge { chunk, bytes, most });
    }
    let subject = subjects::chunk(sweep.hash(), chunk);
    let message = PublishMessage::build().payload(content.into()).message_id(format!("{subject}-{generation}"));
    loop {
        let sent = broker.send(subject.clone(), message.clone()).await;
        if published.borrow_mut().count(&sent) {
            return Ok(());
        }
        sleep(RETRY_PAUSE).await;
    }
}

/// An error with its causes.
pub(super) fn why(error: &(dyn std::error::Error + 'static)) -> String {
    let causes = std::iter::successors(error.source(), |cause| cause.source());
    let mut words = error.to_string();
    for cause in causes.map(ToString::to_string) {
        if !words.contains(&cause) {
            words = format!("{words}: {cause}");
        }
    }
    words
}

async fn rows_with_results(Wanted { sweep, results }: Wanted<'_>, broker: &Broker) -> Result<RowSet, NatsError> {
    let failed = NatsError::failed("the results cannot be listed");
    let subjects = broker.results.info_with_subjects(subjects::results_of_sweep(sweep.hash())).await;
    let mut subjects = subjects.map_err(|error| failed(&error))?;
    let mut done = results.map_or_else(|| RowSet::of(sweep.row_count()), |results| results.done().clone());
    while let Some((subject, _)) = subjects.try_next().await.map_err(|error| failed(&error))? {
        if let Some(row) = subjects::row_of(&subject).filter(|row| *row < sweep.row_count()) {
            done.insert(row);
        }
    }
    Ok(done)
}
