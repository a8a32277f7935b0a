//! What an answer says of itself, whatever its kind.

use serde::Deserialize;
use serde_json::Value;

/// The part of an answer that is counted.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Outcome {
    #[serde(default)]
    status: Option<Value>,
}

impl Outcome {
    /// Reads it from an answer in JSON.
    pub(super) fn of(answer: &[u8]) -> Self {
        serde_json::from_slice(answer).unwrap_or_default()
    }

    /// Its status, where its kind has one.
    pub(super) fn status(&self) -> Option<&str> {
        self.status.as_ref().and_then(Value::as_str)
    }
}
