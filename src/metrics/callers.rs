//! What is counted by caller.

use prometheus::{IntCounterVec, IntGaugeVec};

use super::{Metrics, Registration, catalogue};

/// The families whose label is the name of a caller.
pub(super) struct Callers {
    requests: IntCounterVec,
    jobs: IntGaugeVec,
    refused: IntCounterVec,
}

impl Callers {
    pub(super) fn of(registration: Registration<'_>) -> Self {
        Self {
            requests: registration.counters(&catalogue::CALLER_REQUESTS),
            jobs: registration.gauges(&catalogue::CALLER_JOBS),
            refused: registration.counters(&catalogue::CALLER_REFUSED),
        }
    }
}

/// Callers are called by their names in the configuration.
impl Metrics {
    /// Reports a caller as 0 until it comes.
    pub fn expect_caller(&self, caller: &str) {
        self.callers.requests.with_label_values(&[caller]);
        self.callers.jobs.with_label_values(&[caller]);
        self.callers.refused.with_label_values(&[caller]);
    }

    /// Counts a request of a caller.
    pub fn caller_asked(&self, caller: &str) {
        self.callers.requests.with_label_values(&[caller]).inc();
    }

    /// A caller has so many jobs more in flight than before.
    pub fn caller_jobs_changed(&self, caller: &str, difference: i64) {
        self.callers.jobs.with_label_values(&[caller]).add(difference);
    }

    /// Counts a request that was beyond the share of its caller.
    pub fn caller_refused(&self, caller: &str) {
        self.callers.refused.with_label_values(&[caller]).inc();
    }
}
