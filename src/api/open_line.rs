//! The line of a request until the last byte of its answer is taken: long after the head, which hands it over.

use std::sync::{Arc, Mutex, PoisonError};

use axum::http::HeaderMap;
use axum::response::Response;

use super::access::AccessLine;

/// Reads the outcome in the trailers of an answer into its line.
pub(super) type ReadTrailers = fn(&HeaderMap, &mut AccessLine);

/// Written when it is dropped.
pub(super) struct OpenLine {
    line: AccessLine,
    read_trailers: ReadTrailers,
}

/// What the head of an answer can bear, for whoever sends its body.
#[derive(Clone)]
struct HandedOver(Arc<Mutex<Option<OpenLine>>>);

impl OpenLine {
    /// The line of this answer.
    pub(super) fn of(response: &mut Response) -> Option<Self> {
        let HandedOver(line) = response.extensions_mut().remove()?;
        line.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Notes how the answer ended.
    pub(super) fn read(&mut self, trailers: &HeaderMap) {
        (self.read_trailers)(trailers, &mut self.line);
    }

    /// The caller left before the end of the answer.
    pub(super) fn abandon(&mut self) {
        self.line.abandon();
    }
}

/// Hands the line over to whoever sends the answer.
pub(super) fn hand_over(mut response: Response, line: AccessLine, read_trailers: ReadTrailers) -> Response {
    let line = OpenLine { line, read_trailers };
    response.extensions_mut().insert(HandedOver(Arc::new(Mutex::new(Some(line)))));
    response
}

/// Bodies without trailers.
pub(super) fn no_trailers(_: &HeaderMap, _: &mut AccessLine) {}
