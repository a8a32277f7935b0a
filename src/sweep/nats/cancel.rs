//! Sweeps that are taken back.

use async_nats::jetstream::message::PublishMessage;

use super::broker::{Broker, NatsError, last};
use super::publish::Sending;
use super::subjects;

const CANCELLED: &[u8] = b"cancelled";
const RESUMED: &[u8] = b"resumed";

/// Takes the chunks of a sweep out of the queue, whichever version they are for, and tells the workers, which drop what
/// they have of it. Results stay; publishing the sweep again goes on from there. Gives how many chunks were taken out.
///
/// # Errors
/// When the servers do not do it.
pub async fn cancel(sweep: &str, broker: &Broker) -> Result<u64, NatsError> {
    // First the state: a worker that begins a chunk meanwhile sees it.
    put(sweep, CANCELLED, broker).await?;
    let failed = NatsError::failed("chunks cannot be taken back");
    let purged =
        broker.chunks.purge().filter(subjects::chunks_of_any_version(sweep)).await.map_err(|error| failed(&error))?;
    broker.marks.purge().filter(subjects::marks_of_any_version(sweep)).await.map_err(|error| failed(&error))?;
    Ok(purged.purged)
}

/// Whether this is what workers are told of a sweep that was taken back.
pub(super) fn says_cancelled(message: &[u8]) -> bool {
    message == CANCELLED
}

/// Whether a sweep was taken back.
pub(super) async fn is_cancelled(sweep: &str, broker: &Broker) -> Result<bool, NatsError> {
    let state = last(&broker.states, subjects::state(sweep)).await?;
    Ok(state.is_some_and(|(_, state)| says_cancelled(&state)))
}

/// Lets a sweep go on that was taken back. Gives a number that grows with each time: messages of chunks are told apart by
/// it, else the server would take those that come again for duplicates.
pub(super) async fn resume(sweep: &str, sending: Sending, broker: &Broker) -> Result<u64, NatsError> {
    let state = last(&broker.states, subjects::state(sweep)).await?;
    let must_tell = sending == Sending::Again || state.as_ref().is_some_and(|(_, state)| says_cancelled(state));
    if must_tell { put(sweep, RESUMED, broker).await } else { Ok(state.map_or(0, |(sequence, _)| sequence)) }
}

async fn put(sweep: &str, state: &'static [u8], broker: &Broker) -> Result<u64, NatsError> {
    let message = PublishMessage::build().payload(state.into());
    let failed = NatsError::failed("the state of the sweep cannot be set");
    let sent = broker.send(subjects::state(sweep), message).await;
    Ok(sent.map_err(|error| failed(&error))?.sequence)
}
