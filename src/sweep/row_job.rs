//! Rows as jobs of the kind that a sweep names.

use std::sync::Arc;

use futures_util::future::BoxFuture;
use serde_json::Value;

use crate::contract::{Problem, json};
use crate::jobs::{Jobs, Kind, Limits, Visitor};
use crate::service::{Class, Service};

/// A kind of job whose requests and answers are JSON.
pub(super) trait RowJob: Send + Sync {
    /// Checks a request without running it.
    ///
    /// # Errors
    /// As [`Kind::read`].
    fn check(&self, request: &Value) -> Result<(), Problem>;

    /// Waits for room in the service and runs a request there; gives the answer in JSON.
    ///
    /// # Errors
    /// As [`Kind::read`], and when the job has no answer.
    fn run<'a>(&self, request: &Value, service: &'a Service) -> BoxFuture<'a, Result<Vec<u8>, Problem>>;
}

/// The kind of this name, or else the names of all kinds.
///
/// # Errors
/// The names, where there is none of this name.
pub(super) fn named(name: &str, jobs: &Jobs) -> Result<Arc<dyn RowJob>, Vec<&'static str>> {
    let mut search = Search { name, limits: jobs.limits().without_clock(), found: None, names: Vec::new() };
    jobs.each(&mut search);
    search.found.ok_or(search.names)
}

struct Search<'a> {
    name: &'a str,
    limits: Limits,
    found: Option<Arc<dyn RowJob>>,
    names: Vec<&'static str>,
}

impl Visitor for Search<'_> {
    fn visit<K: Kind>(&mut self, kind: &Arc<K>) {
        self.names.push(K::NAME);
        if K::NAME == self.name {
            self.found = Some(Arc::new(OfKind { kind: Arc::clone(kind), limits: self.limits }));
        }
    }
}

struct OfKind<K> {
    kind: Arc<K>,
    limits: Limits,
}

impl<K: Kind> RowJob for OfKind<K> {
    fn check(&self, request: &Value) -> Result<(), Problem> {
        K::read(&json::write(request), &self.limits).map(drop)
    }

    fn run<'a>(&self, request: &Value, service: &'a Service) -> BoxFuture<'a, Result<Vec<u8>, Problem>> {
        let (read, kind) = (K::read(&json::write(request), &self.limits), Arc::clone(&self.kind));
        Box::pin(async move {
            let input = read?;
            // Nobody waits for light jobs here: all workers take them.
            let permit = service.reserve_for_batch(None, Class::Heavy).await?;
            let running = permit.submit(kind, input, None, |input, done| json::write(&K::answer(input, done)))?;
            Ok(running.outcome().await?)
        })
    }
}
