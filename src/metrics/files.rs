//! What is counted of the files that are read again while the server runs.

use prometheus::{IntCounterVec, IntGaugeVec};

use super::{Metrics, Registration, catalogue};

/// What is read again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SecretFile {
    /// The file with API keys.
    ApiKeys,
    /// Certificate and private key.
    Certificate,
}

impl SecretFile {
    /// The label.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::ApiKeys => "api_keys",
            Self::Certificate => "certificate",
        }
    }
}

/// The families of such files.
pub(super) struct Files {
    reads: IntCounterVec,
    stale: IntGaugeVec,
}

impl Files {
    pub(super) fn of(registration: Registration<'_>) -> Self {
        let (reads, stale) = (&catalogue::FILE_READS, &catalogue::FILE_STALE);
        Self { reads: registration.counters(reads), stale: registration.gauges(stale) }
    }
}

const USED: &str = "used";
const REFUSED: &str = "refused";

impl Metrics {
    /// Reports a file as 0 until it changes.
    pub fn expect_file(&self, file: SecretFile) {
        for outcome in [USED, REFUSED] {
            self.files.reads.with_label_values(&[file.as_str(), outcome]);
        }
        self.files.stale.with_label_values(&[file.as_str()]);
    }

    /// Counts that a file was read again, and whether it can be used.
    pub fn file_read(&self, file: SecretFile, is_used: bool) {
        let outcome = if is_used { USED } else { REFUSED };
        self.files.reads.with_label_values(&[file.as_str(), outcome]).inc();
        self.files.stale.with_label_values(&[file.as_str()]).set(i64::from(!is_used));
    }
}
