//! The families of a worker of sweeps, beside those of its service.

use super::{Family, counter, gauge};

/// Chunks by their ends.
pub const CHUNKS: Family = counter(
    "slipdrive_sweep_chunks_total",
    &["outcome"],
    "Chunks that a worker took, by how they ended there: complete, given back, cancelled, refused.",
);
/// Rows by what was done.
pub const ROWS: Family =
    counter("slipdrive_sweep_rows_total", &["outcome"], "Rows by what a worker did: answered, failed, lost, skipped.");
/// Signs of life.
pub const LEASES_EXTENDED: Family =
    counter("slipdrive_sweep_leases_extended_total", &[], "Signs of life for chunks that run.");
/// Chunks that came again.
pub const REDELIVERIES: Family =
    counter("slipdrive_sweep_redeliveries_total", &[], "Chunks that a worker took which had been delivered before.");
/// Silent stalls.
pub const STALLS: Family = counter(
    "slipdrive_sweep_stalls_total",
    &[],
    "Times that chunks waited and none came until the worker connected again.",
);
/// Queues that were restored.
pub const QUEUES_RESTORED: Family = counter(
    "slipdrive_sweep_queues_restored_total",
    &[],
    "Times that the server had chunks which it would not have given to anybody any more.",
);
/// Results that were sent again.
pub const PUBLISH_RETRIES: Family =
    counter("slipdrive_sweep_publish_retries_total", &[], "Times that a result had to be sent again.");
/// Chunks on lease.
pub const IN_FLIGHT: Family = gauge("slipdrive_sweep_chunks_in_flight", &[], "Chunks that a worker has on lease.");
/// The connection.
pub const CONNECTED: Family = gauge("slipdrive_sweep_connected", &[], "Whether a worker is connected to NATS: 1 or 0.");

/// All of them.
pub const ALL: &[Family] =
    &[CHUNKS, ROWS, LEASES_EXTENDED, REDELIVERIES, STALLS, QUEUES_RESTORED, PUBLISH_RETRIES, IN_FLIGHT, CONNECTED];
