//! Whether a rule holds.

use std::fmt;

use serde::Serialize;

/// A rule and whether it holds.
#[derive(Debug, Serialize)]
pub(crate) struct Verdict {
    pub(crate) rule: String,
    pub(crate) holds: bool,
    /// What was measured.
    pub(crate) measured: String,
}

impl fmt::Display for Verdict {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = if self.holds { "holds " } else { "BROKEN" };
        write!(formatter, "{verdict} {}: {}", self.rule, self.measured)
    }
}
