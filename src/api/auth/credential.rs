//! Who sent a request, and by which key.

use std::future::pending;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::{ApiKeys, Hash};
use crate::api::access::Notes;
use crate::api::receive::RETRY;
use crate::api::server::Connection;
use crate::contract::{ErrorCode, Problem};
use crate::metrics::Metrics;
use crate::service::Share;

/// Stands for all callers whose keys have no name; no name has such characters.
const UNNAMED: &str = "(unnamed)";

/// One caller: all keys of one name, or all keys without a name.
pub(in crate::api) struct Principal {
    name: Option<Box<str>>,
    /// What it may have in flight; its label is what logs and metrics say.
    share: Arc<Share>,
    requests: AtomicUsize,
}

impl Principal {
    pub(super) fn new(name: Option<&str>) -> Self {
        let share = Arc::new(Share::of(name.unwrap_or(UNNAMED)));
        Self { name: name.map(Into::into), share, requests: AtomicUsize::new(0) }
    }

    /// Its name in the configuration.
    pub(super) fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// Its share of the queue.
    pub(super) fn share(&self) -> &Arc<Share> {
        &self.share
    }

    /// Counts a request as open until the result is dropped.
    fn open(self: &Arc<Self>) -> OpenRequest {
        OpenRequest { before: self.requests.fetch_add(1, Ordering::Relaxed), principal: Arc::clone(self) }
    }
}

/// A request of a caller, from its head to the last byte of its answer.
pub(in crate::api) struct OpenRequest {
    principal: Arc<Principal>,
    /// Others of this caller that were open when it came.
    before: usize,
}

impl OpenRequest {
    /// What logs and metrics call its caller: a word of the configuration, never of a caller.
    pub(in crate::api) fn caller(&self) -> &str {
        self.principal.share.label()
    }

    /// Whether it is one of the first `most`, or there are no other callers.
    fn is_within(&self, most: usize) -> bool {
        self.before < most || !self.principal.share.is_bounded()
    }
}

impl Drop for OpenRequest {
    fn drop(&mut self) {
        self.principal.requests.fetch_sub(1, Ordering::Relaxed);
    }
}

/// What a request was admitted by.
#[derive(Clone)]
pub(in crate::api) struct Credential(Option<Known>);

#[derive(Clone)]
struct Known {
    principal: Arc<Principal>,
    hash: Hash,
    keys: ApiKeys,
}

impl Credential {
    /// Of a server without keys.
    pub(in crate::api) fn anybody() -> Self {
        Self(None)
    }

    pub(super) fn new(principal: Arc<Principal>, hash: Hash, keys: ApiKeys) -> Self {
        Self(Some(Known { principal, hash, keys }))
    }

    #[cfg(test)]
    pub(super) fn principal(&self) -> Option<&Arc<Principal>> {
        self.0.as_ref().map(|known| &known.principal)
    }

    /// The share of its caller; none where no keys are configured.
    pub(in crate::api) fn share(&self) -> Option<&Arc<Share>> {
        self.0.as_ref().map(|known| known.principal.share())
    }

    /// Notes whose request it is, and counts it as open as long as the notes are kept.
    ///
    /// # Errors
    /// `queue_full` where there are other callers and this one has as many open as may come by half of all connections:
    /// the other half is left to those.
    pub(in crate::api) fn enter(
        &self,
        notes: &Notes,
        connection: &Connection,
        metrics: &Metrics,
    ) -> Result<(), Problem> {
        let Some(known) = &self.0 else { return Ok(()) };
        let (open, most) = (known.principal.open(), (connection.max_connections() / 2).max(1));
        let is_within = open.is_within(most);
        notes.opened(open);
        if is_within {
            return Ok(());
        }
        metrics.caller_refused(known.principal.share.label());
        let detail = format!("{most} requests of this caller are open, as many as may be beside those of others");
        Err(Problem::new(ErrorCode::QueueFull, detail).worth_retrying_after(Some(RETRY)))
    }

    /// Waits until it would not be admitted any more.
    pub(in crate::api) async fn revoked(&self) {
        match &self.0 {
            Some(known) => known.keys.revoked(&known.hash).await,
            None => pending().await,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_beside_those_of_others_are_bounded() {
        let principal = Arc::new(Principal::new(Some("fleet")));
        let alone: Vec<_> = (0..3).map(|_| principal.open()).collect();
        assert!(alone.iter().all(|open| open.is_within(1) && open.caller() == "fleet"));
        principal.share().set_bounded(true);
        assert!(principal.open().is_within(4) && !principal.open().is_within(3));
        drop(alone);
        assert!(principal.open().is_within(1));
    }
}
