//! What a worker counts about itself.

use prometheus::{IntCounter, IntCounterVec, IntGauge};

use crate::metrics::Metrics;
use crate::metrics::catalogue::{Family, counter, gauge};

const CHUNKS: Family = counter(
    "slipdrive_sweep_chunks_total",
    &["outcome"],
    "Chunks that a worker took, by how they ended there: complete, given back, cancelled, refused.",
);
const ROWS: Family =
    counter("slipdrive_sweep_rows_total", &["outcome"], "Rows by what a worker did: answered, failed, lost, skipped.");
const LEASES_EXTENDED: Family =
    counter("slipdrive_sweep_leases_extended_total", &[], "Signs of life for chunks that run.");
const REDELIVERIES: Family =
    counter("slipdrive_sweep_redeliveries_total", &[], "Chunks that a worker took which had been delivered before.");
const STALLS: Family = counter(
    "slipdrive_sweep_stalls_total",
    &[],
    "Times that chunks waited and none came until the worker connected again.",
);
const QUEUES_RESTORED: Family = counter(
    "slipdrive_sweep_queues_restored_total",
    &[],
    "Times that the server had chunks which it would not have given to anybody any more.",
);
const PUBLISH_RETRIES: Family =
    counter("slipdrive_sweep_publish_retries_total", &[], "Times that a result had to be sent again.");
const IN_FLIGHT: Family = gauge("slipdrive_sweep_chunks_in_flight", &[], "Chunks that a worker has on lease.");
const CONNECTED: Family = gauge("slipdrive_sweep_connected", &[], "Whether a worker is connected to NATS: 1 or 0.");

/// All families of a worker beside those of its service.
pub const FAMILIES: &[Family] =
    &[CHUNKS, ROWS, LEASES_EXTENDED, REDELIVERIES, STALLS, QUEUES_RESTORED, PUBLISH_RETRIES, IN_FLIGHT, CONNECTED];

/// The counters of a worker.
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
    /// Counters at zero, among those of a service.
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
