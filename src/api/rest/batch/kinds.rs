//! The kinds of jobs by the names that lines ask for them.

use std::sync::Arc;

use futures_util::future::BoxFuture;

use crate::api::ApiState;
use crate::api::batch::ItemResult;
use crate::api::rest::handlers::NUMBER_BYTES;
use crate::api::submit::{Caller, Entry, Written, answer_of_item};
use crate::contract::{BodyLimit, json};
use crate::jobs::{Jobs, Kind, Limits, Visitor};

/// What a line has beside what it asks, bytes: names, its id, white space.
const ENVELOPE_BYTES: usize = 1024;

/// A line of an answer.
pub(super) struct Line {
    pub(super) bytes: Vec<u8>,
    pub(super) is_problem: bool,
}

/// What a line asks.
pub(super) struct Asked {
    pub(super) kind: Arc<dyn AnyKind>,
    /// The request as it was written.
    pub(super) body: Vec<u8>,
}

/// A kind of job, whichever.
pub(super) trait AnyKind: Send + Sync {
    /// The line that answers an item, and the memory that it holds.
    fn answer<'a>(
        &'a self,
        state: &'a ApiState,
        request_id: &'a str,
        body: Vec<u8>,
        caller: (&'a Caller, Entry<'a>),
    ) -> BoxFuture<'a, ItemResult<Line>>;
}

/// All kinds.
pub(in crate::api::rest) struct Kinds {
    limits: Limits,
    by_name: Vec<(&'static str, Arc<dyn AnyKind>)>,
    longest_body: BodyLimit,
}

impl Kinds {
    /// Those of a server.
    pub(in crate::api::rest) fn of(jobs: &Jobs) -> Self {
        let mut kinds = Self { limits: *jobs.limits(), by_name: Vec::new(), longest_body: BodyLimit::of(0) };
        jobs.each(&mut kinds);
        kinds
    }

    /// Longest line that may ask for anything.
    pub(super) fn longest_line(&self) -> BodyLimit {
        BodyLimit { bytes: self.longest_body.bytes + ENVELOPE_BYTES, ..self.longest_body }
    }

    pub(super) fn find(&self, name: &str) -> Option<&Arc<dyn AnyKind>> {
        self.by_name.iter().find(|(of, _)| *of == name).map(|(_, kind)| kind)
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &'static str> {
        self.by_name.iter().map(|(name, _)| *name)
    }
}

impl Visitor for Kinds {
    fn visit<K: Kind>(&mut self, kind: &Arc<K>) {
        self.longest_body = self.longest_body.max(K::body_limit(&self.limits));
        self.by_name.push((K::NAME, Arc::new(OfKind(Arc::clone(kind)))));
    }
}

struct OfKind<K>(Arc<K>);

impl<K: Kind> AnyKind for OfKind<K> {
    fn answer<'a>(
        &'a self,
        state: &'a ApiState,
        request_id: &'a str,
        body: Vec<u8>,
        (caller, entry): (&'a Caller, Entry<'a>),
    ) -> BoxFuture<'a, ItemResult<Line>> {
        Box::pin(async move {
            let input = (K::read(&body, state.jobs.limits())?, body.len());
            drop(body);
            let begin =
                format!("{{\"request_id\":{},\"{}\":", String::from_utf8_lossy(&json::write(&request_id)), K::NAME);
            let write = move |answer: K::Answer| {
                let bytes = [begin.as_bytes(), &json::write(&answer), b"}\n"].concat();
                Written { bytes: bytes.len(), answer: Line { bytes, is_problem: false } }
            };
            answer_of_item(&self.0, state, input, (caller, entry, NUMBER_BYTES), write).await
        })
    }
}
