//! What a worker counts about itself.

use prometheus::{IntCounter, IntCounterVec, IntGauge};

use crate::metrics::Metrics;
use crate::metrics::catalogue::sweep_workers::{
    CHUNKS, CONNECTED, IN_FLIGHT, LEASES_EXTENDED, PUBLISH_RETRIES, QUEUES_RESTORED, REDELIVERIES, ROWS, STALLS,
};

/// The counters of a worker, which are there as soon as it waits for a connection.
pub struct WorkerMetrics {
    pub(super) chunks: IntCounterVec,
    pub(super) rows: IntCounterVec,
    pub(super) leases_extended: IntCounter,
    pub(super) redeliveries: IntCounter,
    pub(super) stalls: IntCounter,
    pub(super) queues_restored: IntCounter,
    pub(super) publish_retries: IntCounter,
    pub(super) in_flight: IntGauge,
    pub(super) connected: IntGauge,
}

impl WorkerMetrics {
    /// Counters at zero, among those of a service, of which it has one set.
    ///
    /// # Panics
    /// When the service has them already.
    pub fn new(metrics: &Metrics) -> Self {
        let registration = metrics.registration();
        let (chunks, rows) = (registration.counters(&CHUNKS), registration.counters(&ROWS));
        for outcome in ["complete", "given_back", "cancelled", "refused"] {
            chunks.with_label_values(&[outcome]);
        }
        for outcome in ["answered", "failed", "lost", "skipped"] {
            rows.with_label_values(&[outcome]);
        }
        Self {
            chunks,
            rows,
            leases_extended: registration.counter(&LEASES_EXTENDED),
            redeliveries: registration.counter(&REDELIVERIES),
            stalls: registration.counter(&STALLS),
            queues_restored: registration.counter(&QUEUES_RESTORED),
            publish_retries: registration.counter(&PUBLISH_RETRIES),
            in_flight: registration.gauge(&IN_FLIGHT),
            connected: registration.gauge(&CONNECTED),
        }
    }

    pub(super) fn chunk(&self, outcome: &'static str) {
        self.chunks.with_label_values(&[outcome]).inc();
    }

    pub(super) fn row(&self, outcome: &'static str) {
        self.rows.with_label_values(&[outcome]).inc();
    }
}
