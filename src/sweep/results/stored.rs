//! A row as a line.

use std::borrow::Cow;

use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Map, Value};

use super::Header;
use crate::contract::{Problem, json};
use crate::sweep::outcome::Outcome;
use crate::sweep::{Finished, Row};

/// A row that was read back.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct StoredRow {
    /// What names it.
    pub key: String,
    /// Its number.
    pub row: u64,
    /// What is its own: values of the fields of the axes.
    pub axes: Map<String, Value>,
    /// The key of the row whose plan it began with.
    #[serde(default)]
    pub warm_start_from: Option<String>,
    /// The answer, unless there is none.
    #[serde(default)]
    pub answer: Option<Value>,
    /// Why there is no answer.
    #[serde(default)]
    pub problem: Option<Value>,
}

impl StoredRow {
    /// Reads a line.
    pub(in crate::sweep) fn read(line: &[u8]) -> Option<Self> {
        serde_json::from_slice(line).ok()
    }
}

/// What is counted of a line.
#[derive(Debug, Deserialize)]
pub(super) struct Head<'a> {
    #[serde(borrow)]
    key: Cow<'a, str>,
    pub(super) row: u64,
    /// None of a failed row.
    #[serde(default)]
    pub(super) answer: Option<Outcome>,
    #[serde(default)]
    problem: Option<IgnoredAny>,
}

impl<'a> Head<'a> {
    /// Reads a line, where it is a row of this shard of the sweep.
    pub(super) fn read(line: &'a [u8], header: &Header) -> Option<Self> {
        let head: Self = serde_json::from_slice(line).ok()?;
        let (sweep, number) = head.key.rsplit_once('-')?;
        let is_of_sweep = sweep == header.sweep && number.parse() == Ok(head.row) && header.has(head.row);
        (is_of_sweep && head.answer.is_some() != head.problem.is_some()).then_some(head)
    }
}

/// The line of a row, with its end.
pub(in crate::sweep) fn line(key: &str, finished: &Finished) -> Vec<u8> {
    let Finished { row, warm_start_from, answer } = finished;
    match answer {
        Ok(answer) => line_with(key, row, warm_start_from.as_deref(), ("answer", answer)),
        Err(problem) => failed_line(key, row, &problem_object(problem)),
    }
}

/// The line of a row that has no answer.
pub(in crate::sweep) fn failed_line(key: &str, row: &Row, problem: &Value) -> Vec<u8> {
    line_with(key, row, None, ("problem", &json::write(problem)))
}

fn line_with(key: &str, row: &Row, warm_start_from: Option<&str>, (name, value): (&str, &[u8])) -> Vec<u8> {
    let mut line = format!("{{\"key\":\"{key}\",\"row\":{},\"axes\":{{", row.number).into_bytes();
    for (index, (name, value)) in row.fields.iter().enumerate() {
        if index > 0 {
            line.push(b',');
        }
        line.extend(json::write(name));
        line.push(b':');
        line.extend(json::write(value));
    }
    line.push(b'}');
    if let Some(from) = warm_start_from {
        line.extend_from_slice(b",\"warm_start_from\":");
        line.extend(json::write(&from));
    }
    line.extend_from_slice(format!(",\"{name}\":").as_bytes());
    line.extend_from_slice(value);
    line.extend_from_slice(b"}\n");
    line
}

fn problem_object(problem: &Problem) -> Value {
    let errors = problem.errors();
    serde_json::json!({"code": problem.code().entry().code, "detail": problem.detail(), "errors": errors})
}
