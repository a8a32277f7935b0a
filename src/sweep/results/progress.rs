//! How far a sweep is.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde_json::Value;

use super::Header;
use super::stored::Head;
use crate::contract::Problem;

/// How far a sweep, or a shard of it, is.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Progress {
    /// Rows that there are in the end.
    pub rows: u64,
    /// Rows with results.
    pub done: u64,
    /// Those of them without an answer.
    pub failed: u64,
    /// The others by the `status` of their answers; those without one are left out.
    pub statuses: BTreeMap<String, u64>,
}

impl Progress {
    pub(super) fn of(header: &Header) -> Self {
        Self { rows: header.rows_of_shard(), ..Self::default() }
    }

    /// Whether every row has a result.
    pub fn is_complete(&self) -> bool {
        self.done == self.rows
    }

    pub(super) fn count(&mut self, answer: &Result<Vec<u8>, Problem>) {
        #[derive(Deserialize)]
        struct Outcome {
            #[serde(default)]
            status: Option<Value>,
        }
        let read = |answer: &Vec<u8>| serde_json::from_slice::<Outcome>(answer).ok().and_then(|outcome| outcome.status);
        let status = answer.as_ref().ok().map(|answer| match read(answer) {
            Some(Value::String(status)) => status,
            _ => String::new(),
        });
        self.add(status.as_deref());
    }

    pub(super) fn count_stored(&mut self, head: &Head<'_>) {
        self.add(head.status());
    }

    fn add(&mut self, status: Option<&str>) {
        self.done += 1;
        match status {
            None => self.failed += 1,
            Some("") => {}
            Some(status) => *self.statuses.entry(status.to_owned()).or_default() += 1,
        }
    }
}

impl fmt::Display for Progress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} of {} rows", self.done, self.rows)?;
        for (status, count) in &self.statuses {
            write!(formatter, ", {count} {status}")?;
        }
        if self.failed > 0 { write!(formatter, ", {} failed", self.failed) } else { Ok(()) }
    }
}
