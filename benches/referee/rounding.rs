//! Numbers as people send them. They are also the same on every machine, whatever its logarithm does to the last bit.

use serde_json::{Value, json};

/// A number to six decimals; below one to six significant digits, which keeps what is small.
pub(crate) fn rounded(value: f64) -> f64 {
    let text = if value.abs() < 1.0 { format!("{value:.5e}") } else { format!("{value:.6}") };
    text.parse().expect("what was printed is a number")
}

/// A number to six decimals.
pub(crate) fn to_six_decimals(value: f64) -> f64 {
    format!("{value:.6}").parse().expect("what was printed is a number")
}

/// A document with all its numbers rounded but whole ones.
pub(crate) fn with_rounded_numbers(document: Value) -> Value {
    match document {
        Value::Number(number) if number.is_f64() => json!(rounded(number.as_f64().unwrap_or_default())),
        Value::Array(items) => items.into_iter().map(with_rounded_numbers).collect(),
        Value::Object(fields) => fields.into_iter().map(|(name, field)| (name, with_rounded_numbers(field))).collect(),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => document,
    }
}
