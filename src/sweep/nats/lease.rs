//! The lease that a worker has of a chunk.

use std::time::Duration;

use async_nats::jetstream::AckKind;
use async_nats::jetstream::message::Acker;
use tokio::time::{Instant, MissedTickBehavior, interval_at, sleep};

use super::RETRY_PAUSE;
use super::metrics::WorkerMetrics;

/// How long a chunk is a worker's without a sign of life.
pub(super) const DEFAULT_LEASE: Duration = Duration::from_secs(30);
/// Signs of life in each lease: two may be lost.
const SIGNS: u32 = 3;

/// Holds a chunk for as long as it is polled.
pub(super) async fn held(lease: Duration, acker: &Acker, metrics: &WorkerMetrics) -> std::convert::Infallible {
    let mut ticks = interval_at(Instant::now() + lease / SIGNS, lease / SIGNS);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        match acker.ack_with(AckKind::Progress).await {
            Ok(()) => metrics.leases_extended.inc(),
            Err(error) => tracing::debug!(error = %error, "a lease cannot be extended"),
        }
    }
}

/// Ends a lease and waits until the server knows it, however long that takes.
pub(super) async fn ended(acker: &Acker, how: AckKind) {
    while let Err(error) = acker.double_ack_with(how).await {
        tracing::debug!(error = %error, "the end of a lease cannot be told");
        sleep(RETRY_PAUSE).await;
    }
}
