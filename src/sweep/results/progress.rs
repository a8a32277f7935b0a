//! How far a sweep is.

use std::collections::BTreeMap;
use std::fmt;

use super::Header;
use super::stored::Head;
use crate::contract::Problem;
use crate::sweep::outcome::Outcome;

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
        self.add(answer.as_ref().ok().map(|answer| Outcome::of(answer)).as_ref());
    }

    pub(super) fn count_stored(&mut self, head: &Head<'_>) {
        self.add(head.answer.as_ref());
    }

    /// Adds a row; without an outcome it failed.
    fn add(&mut self, outcome: Option<&Outcome>) {
        self.done += 1;
        match outcome {
            None => self.failed += 1,
            Some(outcome) => {
                if let Some(status) = outcome.status() {
                    *self.statuses.entry(status.to_owned()).or_default() += 1;
                }
            }
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
