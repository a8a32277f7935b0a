//! Counts and latencies of the answers.

use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

use hdrhistogram::Histogram;

use crate::callers::{Outcome, Transport};

/// A histogram from a microsecond to a minute, three digits.
#[derive(Debug, Clone)]
pub struct Latencies(Histogram<u64>);

impl Default for Latencies {
    fn default() -> Self {
        Self(Histogram::new_with_bounds(1, 60_000_000, 3).unwrap())
    }
}

impl Latencies {
    pub fn record(&mut self, latency: Duration) {
        self.0.saturating_record(u64::try_from(latency.as_micros()).unwrap_or(u64::MAX));
    }

    /// In ms; zero when there are none.
    pub fn quantile_ms(&self, quantile: f64) -> f64 {
        if self.0.is_empty() { 0.0 } else { self.0.value_at_quantile(quantile) as f64 / 1e3 }
    }

    pub fn count(&self) -> u64 {
        self.0.len()
    }
}

impl std::fmt::Display for Latencies {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |quantile| self.quantile_ms(quantile);
        write!(formatter, "p50 {:.3} ms, p99 {:.3} ms, max {:.3} ms", ms(0.5), ms(0.99), ms(1.0))
    }
}

/// The outcomes of all requests.
#[derive(Debug, Default)]
pub struct Tally {
    /// Answers by number of the request; more than one is a fault.
    answers: HashMap<u64, u32>,
    by_code: BTreeMap<(Transport, String), Latencies>,
    /// How late requests were sent: when this is large, the generator itself is the bottleneck.
    pub lateness: Latencies,
    /// Answers that bear the number of another request.
    strays: u64,
}

impl Tally {
    pub fn record(&mut self, outcome: Outcome) {
        let Outcome { number, transport, code, latency, lateness, is_own } = outcome;
        *self.answers.entry(number).or_default() += 1;
        self.by_code.entry((transport, code)).or_default().record(latency);
        self.lateness.record(lateness);
        self.strays += u64::from(!is_own);
    }

    /// Whether each of so many requests has one answer, its own.
    pub fn is_complete(&self, sent: u64) -> bool {
        let is_answered = |number: u64| self.answers.get(&number) == Some(&1);
        self.strays == 0 && self.answers.len() as u64 == sent && (0..sent).all(is_answered)
    }

    /// Answers with this code, over both transports.
    pub fn count(&self, code: &str) -> u64 {
        self.by_code.iter().filter(|((_, known), _)| known == code).map(|(_, latencies)| latencies.count()).sum()
    }

    /// Answers with any code.
    pub fn total(&self) -> u64 {
        self.by_code.values().map(Latencies::count).sum()
    }

    pub fn print(&self) {
        for ((transport, code), latencies) in &self.by_code {
            println!("    {transport:?} {code}: {} answers, {latencies}", latencies.count());
        }
        println!("    the generator itself was late by {}", self.lateness);
    }
}
