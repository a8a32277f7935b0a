//! The result of a row in its stream: the line that a folder has of it, compressed.

use async_nats::jetstream::context::PublishErrorKind;
use async_nats::jetstream::message::PublishMessage;
use serde_json::json;

use super::broker::{Broker, NatsError, last};
use super::packed::{packed, unpacked};
use super::publish::why;
use super::subjects;
use crate::contract::ErrorCode;
use crate::sweep::results::{StoredRow, failed_line, line};
use crate::sweep::{Finished, Row, key};

/// A row that is to be published.
#[derive(Debug)]
pub(super) struct RowResult {
    pub(super) row: u64,
    /// How it is counted: answered, failed or lost.
    pub(super) outcome: &'static str,
    message: Vec<u8>,
}

impl RowResult {
    /// Of a row that ran. None where it was cut off: it has to run again.
    pub(super) fn of(sweep: &str, finished: &Finished, most_bytes: usize) -> Option<Self> {
        let row = finished.row.number;
        let problem = finished.answer.as_ref().err().map(crate::contract::Problem::code);
        if matches!(problem, Some(ErrorCode::Unavailable | ErrorCode::Cancelled | ErrorCode::QueueFull)) {
            return None;
        }
        let message = packed(&line(&key(sweep, row), finished));
        if message.len() <= most_bytes {
            return Some(Self { row, outcome: if problem.is_some() { "failed" } else { "answered" }, message });
        }
        let detail = format!(
            "the answer has {} bytes in a message, the server takes at most {most_bytes}: ask for less of it, or raise \
             `max_payload` there",
            message.len()
        );
        Some(Self::unanswered(sweep, &finished.row, ("answer_too_large", "failed"), &detail))
    }

    /// Of a row whose workers did not survive it.
    pub(super) fn lost(sweep: &str, row: &Row, detail: &str) -> Self {
        Self::unanswered(sweep, row, ("worker_lost", "lost"), detail)
    }

    fn unanswered(sweep: &str, row: &Row, (code, outcome): (&str, &'static str), detail: &str) -> Self {
        let problem = json!({"code": code, "detail": detail, "errors": []});
        let message = packed(&failed_line(&key(sweep, row.number), row, &problem));
        Self { row: row.number, outcome, message }
    }

    /// Publishes it, unless the row has a result.
    ///
    /// # Errors
    /// Why it is not there, as far as is known.
    pub(super) async fn publish(&self, sweep: &str, broker: &Broker) -> Result<(), String> {
        // Nothing may be there yet: the first result stays.
        let message = PublishMessage::build().payload(self.message.clone().into()).expected_last_subject_sequence(0);
        match broker.send(subjects::result(sweep, self.row), message).await {
            Ok(_) => Ok(()),
            Err(error) if error.kind() == PublishErrorKind::WrongLastSequence => Ok(()),
            Err(error) => Err(why(&error)),
        }
    }
}

/// The result of a row, if there is one that can be read.
///
/// # Errors
/// When the server does not say.
pub(super) async fn stored(sweep: &str, row: u64, broker: &Broker) -> Result<Option<Option<StoredRow>>, NatsError> {
    let message = last(&broker.results, subjects::result(sweep, row)).await?;
    Ok(message.map(|(_, message)| StoredRow::read(&unpacked(&message).ok()?)))
}
