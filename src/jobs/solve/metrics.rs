//! What is counted of solves.

use prometheus::{HistogramVec, IntCounter, IntCounterVec};

use super::Solved;
use crate::metrics::Registration;
use crate::metrics::catalogue::{Family, JOB_BUCKETS, counter, histogram};
use crate::service::Done;

const DURATION: Family = histogram(
    "slipdrive_solve_duration_seconds",
    &["method", "status"],
    JOB_BUCKETS,
    "How long solves ran on their worker, by optimiser and outcome.",
);
const SOLVES: Family = counter(
    "slipdrive_solves_total",
    &["method", "status", "stop_reason"],
    "Solves that ended with an answer, by optimiser, outcome and why the search ended.",
);
const ROLLOUTS: Family =
    counter("slipdrive_rollouts_total", &[], "Simulations of a whole maneuver that finished solves took.");

/// All families.
pub(super) const FAMILIES: &[Family] = &[DURATION, SOLVES, ROLLOUTS];

/// The counters of one server.
pub(super) struct SolveMetrics {
    duration: HistogramVec,
    solves: IntCounterVec,
    rollouts: IntCounter,
}

impl SolveMetrics {
    pub(super) fn new(registration: Registration<'_>) -> Self {
        Self {
            duration: registration.histograms(&DURATION),
            solves: registration.counters(&SOLVES),
            rollouts: registration.counter(&ROLLOUTS),
        }
    }

    /// Counts a solve that ended with an answer.
    pub(super) fn count(&self, done: &Done<Solved>) {
        let Solved { solution, stop_reason, .. } = &done.output;
        let (method, status) = (solution.report.method.as_str(), solution.status.as_str());
        self.duration.with_label_values(&[method, status]).observe(done.duration.as_secs_f64());
        self.solves.with_label_values(&[method, status, stop_reason.as_str()]).inc();
        self.rollouts.inc_by(solution.report.rollouts);
        tracing::debug!(
            solution.status = status,
            solve.stop_reason = stop_reason.as_str(),
            solve.rollouts = solution.report.rollouts,
            solve.duration_ms = done.duration.as_secs_f64() * 1e3,
            "solved"
        );
    }
}
