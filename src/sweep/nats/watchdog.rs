//! Finds workers to which nothing comes although chunks wait: requests can be lost without a word on either side.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::Duration;

use tokio::time::Instant;

/// How long a request for a chunk is open on the server; then it is sent again.
pub(super) const PULL_EXPIRY: Duration = Duration::from_secs(10);
/// Requests in a row that may end without a chunk while chunks wait.
const PATIENT_PULLS: u32 = 3;

/// When something came last.
#[derive(Debug)]
pub(super) struct LastSign(Mutex<Instant>);

impl LastSign {
    pub(super) fn now() -> Self {
        Self(Mutex::new(Instant::now()))
    }

    /// Something came, or there was nothing to come.
    pub(super) fn renew(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Whether as many requests have ended since that chunks which wait mean a stall.
    pub(super) fn is_old(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).elapsed() > PULL_EXPIRY * PATIENT_PULLS
    }
}
