//! What is said of an endpoint: who may ask, what is asked, and what is answered.

use std::borrow::Cow;

use crate::contract::ErrorCode;

/// The name of a schema.
type Name = Cow<'static, str>;

/// What the document says of one endpoint.
pub(super) struct Operation {
    pub(super) id: String,
    pub(super) summary: String,
    pub(super) request: Option<Request>,
    pub(super) answer: Answer,
    /// Whether callers may ask for events in place of one answer.
    pub(super) has_events: bool,
    /// Errors of its own, beside those of its access and its request.
    pub(super) errors: Vec<ErrorCode>,
}

/// A body, and what becomes of it.
pub(super) enum Request {
    /// Answered at once.
    Immediate(Name),
    /// Waits for a worker.
    Queued(Name),
    /// Lines that ask for one job each.
    Lines(Vec<Job>),
}

/// A kind of job that lines ask for and that lines answer.
#[derive(Clone)]
pub(super) struct Job {
    pub(super) name: &'static str,
    pub(super) request: Name,
    pub(super) answer: Name,
}

/// What is answered with status 200.
pub(super) enum Answer {
    /// A message.
    Json(Name),
    /// Some object; what it means.
    Object(&'static str),
    /// Plain text; what it is.
    Text(&'static str),
    /// Server-sent events.
    Events { progress: Name, result: Name },
    /// Lines in answer to lines.
    Lines(Vec<Job>),
}

/// Who may ask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    /// Callers with a key, where keys are configured.
    WithKey,
    /// Everyone, since browsers load a page and what it shows without a key.
    Open,
    /// Everyone, since probes and scrapers have no keys; may have a port of its own.
    Probe,
}
