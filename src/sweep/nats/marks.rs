//! Rows that may kill their workers: each is marked before it runs, and one that was begun too often is given up.
//!
//! A chunk that comes for the third time is suspect. Its rows run one after the other, and a worker runs one row of
//! suspect chunks at a time, so what kills it twice more is most likely the row that is marked.

use async_nats::jetstream::context::PublishErrorKind;
use async_nats::jetstream::message::PublishMessage;

use super::broker::{Broker, NatsError, last};
use super::publish::why;
use super::subjects;
use crate::contract::json;
use crate::sweep::{Row, key};

/// From this delivery on a chunk is suspect.
pub(super) const FIRST_SUSPECT_DELIVERY: i64 = 3;
/// A row that was begun so often without a result is given up.
pub(super) const MOST_BEGINNINGS: u64 = 3;

/// A mark that a worker has set.
#[derive(Debug, Clone)]
pub(super) struct Mark {
    sweep: String,
    row: u64,
    /// How often the row was begun, this time included.
    pub(super) beginnings: u64,
    place: u64,
}

impl Mark {
    /// Marks a row as begun; none where it was begun too often before.
    ///
    /// # Errors
    /// When the server does not take it.
    pub(super) async fn set(sweep: &str, row: u64, broker: &Broker) -> Result<Option<Self>, NatsError> {
        loop {
            let known = last(&broker.marks, subjects::mark(sweep, row)).await?;
            let (place, beginnings) = known.map_or((0, 0), |(place, text)| (place, number(&text)));
            if beginnings >= MOST_BEGINNINGS {
                return Ok(None);
            }
            let mark = Self { sweep: sweep.to_owned(), row, beginnings: beginnings + 1, place };
            match mark.put(broker).await {
                Ok(place) => return Ok(Some(Self { place, ..mark })),
                // Another worker has marked it meanwhile.
                Err((PublishErrorKind::WrongLastSequence, _)) => {}
                Err((_, fault)) => return Err(NatsError::failed("a row cannot be marked")(&fault)),
            }
        }
    }

    /// Takes the mark back: the row was not what ended the work on it.
    pub(super) async fn take_back(self, broker: &Broker) {
        let before = Self { beginnings: self.beginnings - 1, ..self };
        if let Err((_, fault)) = before.put(broker).await {
            tracing::warn!(row = before.row, error = fault, "the mark of a row cannot be taken back");
        }
    }

    /// Puts it in the place of the mark that is known; gives its own place.
    async fn put(&self, broker: &Broker) -> Result<u64, (PublishErrorKind, String)> {
        let message = PublishMessage::build()
            .payload(self.beginnings.to_string().into())
            .expected_last_subject_sequence(self.place);
        let sent = broker.send(subjects::mark(&self.sweep, self.row), message).await;
        sent.map(|stored| stored.sequence).map_err(|error| (error.kind(), why(&error)))
    }
}

/// Keeps a row with its request where people find it.
///
/// # Errors
/// When the server does not take it.
pub(super) async fn bury(sweep: &str, row: &Row, broker: &Broker) -> Result<(), NatsError> {
    let failed = NatsError::failed("a dead letter cannot be written");
    let content = serde_json::json!({"key": key(sweep, row.number), "row": row.number, "request": row.request});
    let message = PublishMessage::build().payload(json::write(&content).into());
    broker.send(subjects::dead_row(sweep, row.number), message).await.map_err(|error| failed(&error))?;
    Ok(())
}

fn number(text: &[u8]) -> u64 {
    std::str::from_utf8(text).ok().and_then(|text| text.parse().ok()).unwrap_or_default()
}
