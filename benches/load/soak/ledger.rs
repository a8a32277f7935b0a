//! The account of all requests of good callers.

use std::collections::BTreeMap;
use std::fmt;

/// How a request ended.
#[derive(Debug)]
pub enum Outcome {
    /// As expected.
    Answered,
    /// Its caller has left.
    Left,
    /// With a code that asks to try again.
    Refused(String),
    /// In words.
    Unexpected(String),
}

/// Requests and their ends.
#[derive(Debug, Default)]
pub struct Ledger {
    sent: u64,
    answered: u64,
    left: u64,
    refused: BTreeMap<String, u64>,
    /// Second attempts by callers; the first are no part of those sent.
    retried: BTreeMap<String, u64>,
    unexpected: BTreeMap<String, u64>,
}

impl Ledger {
    pub fn send(&mut self) {
        self.sent += 1;
    }

    pub fn retry(&mut self, caller: String) {
        *self.retried.entry(caller).or_default() += 1;
    }

    pub fn record(&mut self, outcome: Outcome) {
        match outcome {
            Outcome::Answered => self.answered += 1,
            Outcome::Left => self.left += 1,
            Outcome::Refused(code) => *self.refused.entry(code).or_default() += 1,
            Outcome::Unexpected(words) => *self.unexpected.entry(words).or_default() += 1,
        }
    }

    /// Adds the account of another time.
    pub fn join(&mut self, other: &Self) {
        self.sent += other.sent;
        self.answered += other.answered;
        self.left += other.left;
        for (own, others) in [
            (&mut self.refused, &other.refused),
            (&mut self.retried, &other.retried),
            (&mut self.unexpected, &other.unexpected),
        ] {
            for (kind, count) in others {
                *own.entry(kind.clone()).or_default() += count;
            }
        }
    }

    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// Requests that have ended in any way.
    pub fn ended(&self) -> u64 {
        self.answered + self.left + sum(&self.refused) + sum(&self.unexpected)
    }

    pub fn unexpected(&self) -> u64 {
        sum(&self.unexpected)
    }

    /// What was not expected, by kind.
    pub fn list_of_unexpected(&self) -> String {
        list(&self.unexpected)
    }
}

impl fmt::Display for Ledger {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sent, answered, left, refused, retried, unexpected } = self;
        write!(formatter, "{sent} sent, {answered} answered, {left} left, {} refused{}", sum(refused), list(refused))?;
        write!(formatter, ", {} retried{}, {} unexpected", sum(retried), list(retried), sum(unexpected))
    }
}

fn sum(counts: &BTreeMap<String, u64>) -> u64 {
    counts.values().sum()
}

fn list(counts: &BTreeMap<String, u64>) -> String {
    counts.iter().map(|(kind, count)| format!(" ({kind}: {count})")).collect::<Vec<_>>().concat()
}
