//! The file of a sweep: what is asked, without the rows.

use serde::Deserialize;
use serde_json::{Value, json};

use super::axis::{Axis, AxisForm};
use super::path::FieldPath;
use crate::contract::{Problem, StrictValue, json};
use crate::rules::{Checks, Rule};

/// Rows of a chunk, unless the file says it.
const DEFAULT_CHUNK_ROWS: u64 = 16;
const CHUNK_ROWS_RULE: Rule = Rule::between(1.0, 1e6, "");

/// The object of a file, and the first line of one with lines.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Form {
    job: String,
    request: StrictValue,
    #[serde(default, deserialize_with = "json::some_objects")]
    axes: Option<Vec<AxisForm>>,
    #[serde(default, deserialize_with = "json::some_long_count")]
    chunk_rows: Option<u64>,
    #[serde(default)]
    warm_start: bool,
    #[serde(default)]
    columns: Vec<String>,
}

/// What a sweep asks, apart from lines that follow.
#[derive(Debug)]
pub(super) struct Definition {
    /// The kind of job.
    pub(super) job: String,
    /// What all rows have in common.
    pub(super) base: Value,
    /// What differs; empty where lines follow.
    pub(super) axes: Vec<Axis>,
    /// Rows of a chunk.
    pub(super) chunk_rows: u64,
    /// Whether a row may begin with the plan of the one before.
    pub(super) warm_start: bool,
    /// Paths in the answer, for tables.
    pub(super) columns: Vec<String>,
    /// All that decides the rows, complete: what the hash of the sweep is made of.
    pub(super) canonical: Value,
}

/// Whether lines with a request each follow the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Followed {
    /// They do.
    ByLines,
    /// The axes make the rows.
    ByNothing,
}

impl Definition {
    /// Reads the object.
    ///
    /// # Errors
    /// `malformed_body` or `invalid_field` where it has another form, else all violated rules at once.
    pub(super) fn read(text: &[u8], followed: Followed) -> Result<Self, Problem> {
        // As it was written, for the hash: absent and default are told apart by completion below.
        let StrictValue(written) = json::read_object(text)?;
        let Form { job, request: StrictValue(base), axes, chunk_rows, warm_start, columns } = json::read_object(text)?;
        let mut checks = Checks::new();
        checks.require("request", "no object", base.is_object(), "an object", None);
        let chunk_rows = chunk_rows.unwrap_or(DEFAULT_CHUNK_ROWS);
        checks.bounds("chunk_rows", chunk_rows as f64, &CHUNK_ROWS_RULE);
        for (index, column) in columns.iter().enumerate() {
            let is_path = FieldPath::parse(column).is_some();
            let rule = "a path such as `report.rollouts`";
            checks.require(&format!("columns[{index}]"), format!("`{column}`"), is_path, rule, None);
        }
        let has_both = followed == Followed::ByLines && axes.is_some();
        checks.require("axes", "given", !has_both, "absent where lines with requests follow", None);
        let axes = checked_axes(axes.unwrap_or_default(), &base, &mut checks);
        checks.finish()?;
        let canonical = json!({
            "job": job,
            "request": base,
            "axes": written.get("axes").cloned().unwrap_or_else(|| json!([])),
            "chunk_rows": chunk_rows,
            "warm_start": warm_start,
        });
        Ok(Self { job, base, axes, chunk_rows, warm_start, columns, canonical })
    }
}

fn checked_axes(forms: Vec<AxisForm>, base: &Value, checks: &mut Checks) -> Vec<Axis> {
    let read = |(index, form), checks: &mut Checks| {
        checks.within(&format!("axes[{index}]"), |checks| Axis::of(form, checks)).map(|axis| (index, axis))
    };
    let axes: Vec<_> = forms.into_iter().enumerate().filter_map(|form| read(form, checks)).collect();
    let mut before: Vec<(&str, &FieldPath)> = Vec::new();
    for (index, axis) in &axes {
        checks.within(&format!("axes[{index}]"), |checks| {
            for (name, path) in axis.fields() {
                let other = before.iter().find(|(_, other)| other.overlaps(path));
                let rule = other.map_or(String::new(), |(other, _)| format!("apart from `{other}`, which is set too"));
                checks.require("field", format!("`{name}`"), other.is_none(), &rule, None);
                if let Err(fault) = path.put(&mut base.clone(), Value::Null) {
                    let rule = format!("a field of `request`, where {fault}");
                    checks.require("field", format!("`{name}`"), false, &rule, None);
                }
                before.push((name, path));
            }
        });
    }
    axes.into_iter().map(|(_, axis)| axis).collect()
}
