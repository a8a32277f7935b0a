//! Sweeps over NATS `JetStream`: chunks in a work queue, workers on any number of machines, results in a stream.
//!
//! - [`publish`] brings the chunks of a sweep into the queue. A full queue makes it wait.
//! - A [`Worker`] takes a chunk on lease, runs its rows, publishes each as it ends, and acknowledges the chunk after the
//!   last. What a killed worker had is delivered again, to whoever has time; rows with results are not run again.
//! - [`collect`] brings the first result of each row into a folder, in the form of a sweep on one machine.
//! - [`cancel`] takes the chunks back.
//!
//! The results are what counts, and the file of the sweep: chunks that a server loses are published again by whoever
//! collects with the file at hand, and a worker that finds chunks nobody would get has them delivered anew.
//!
//! Each row is published under a subject of its own, on the condition that nothing is there yet: so the first result
//! stays whoever else comes. Chunks, results and marks name the version of the solver and their sweep by its hash, so any
//! number of sweeps share the streams, and none has rows of two versions.

mod broker;
mod cancel;
mod chunk;
mod collect;
mod lease;
mod marks;
mod metrics;
mod packed;
mod publish;
mod result;
mod subjects;
mod watchdog;
mod worker;

use std::time::Duration;

pub use broker::{Access, Broker, NatsError, StreamLimits};
pub use cancel::cancel;
pub use collect::{Collected, collect};
pub use metrics::WorkerMetrics;
pub use publish::{Published, Sending, Wanted, publish};
pub use worker::Worker;

/// How long to wait until something is tried again, a full queue for instance.
const RETRY_PAUSE: Duration = Duration::from_millis(500);
