//! What is counted of assessments.

use prometheus::IntCounterVec;

use crate::assessment::Assessment;
use crate::metrics::Registration;
use crate::metrics::catalogue::{Family, counter};

const SAMPLES: Family = counter(
    "slipdrive_assess_samples_total",
    &["outcome"],
    "Samples of plans that were assessed: success, failure, or refused by the rules.",
);

/// All families.
pub(super) const FAMILIES: &[Family] = &[SAMPLES];

/// The counters of one server.
pub(super) struct AssessMetrics {
    samples: IntCounterVec,
}

impl AssessMetrics {
    pub(super) fn new(registration: Registration<'_>) -> Self {
        Self { samples: registration.counters(&SAMPLES) }
    }

    /// Counts the samples of one assessment.
    pub(super) fn count(&self, assessment: &Assessment) {
        let Assessment { sample_count, success_count, refused_count, .. } = *assessment;
        let failures = sample_count - success_count - refused_count;
        for (outcome, count) in [("success", success_count), ("failure", failures), ("refused", refused_count)] {
            self.samples.with_label_values(&[outcome]).inc_by(count as u64);
        }
    }
}
