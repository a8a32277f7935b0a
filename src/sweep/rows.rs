//! The rows of a sweep: each a request, made when it is needed.

use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::sync::{Mutex, PoisonError};

use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::axis::Axis;
use super::definition::Definition;
use super::{MOST_FAULTS, MOST_ROWS, SweepError, warm};
use crate::contract::{ErrorCode, Problem, StrictValue, json};

/// Longest line of a file, bytes: a request with the longest arrays fits.
const LONGEST_LINE: u64 = 4 << 20;

/// One row.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Its number, from 0.
    pub number: u64,
    /// The whole request.
    pub request: Value,
    /// What is its own: fields with their values, in the order of the axes.
    pub fields: Vec<(String, Value)>,
}

/// What differs from row to row.
#[derive(Debug)]
pub(super) enum Rows {
    /// All combinations of the values of some axes; the last axis runs fastest.
    Crossed(Vec<Axis>),
    /// Lines that are merged over the base.
    Lines(Lines),
}

/// A file that is read at any place.
pub(super) trait Source: Read + Seek + Send {}

impl<T: Read + Seek + Send> Source for T {}

/// Lines of a file: the places are kept, the lines are not.
pub(super) struct Lines {
    source: Mutex<Box<dyn Source>>,
    /// Where each line begins and, after the last, where it ends.
    starts: Vec<u64>,
}

impl std::fmt::Debug for Lines {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} lines", self.len())
    }
}

impl Rows {
    /// All combinations.
    ///
    /// # Errors
    /// `invalid_value` where there are too many.
    pub(super) fn crossed(axes: Vec<Axis>) -> Result<Self, Problem> {
        let count = axes.iter().try_fold(1_u64, |count, axis| count.checked_mul(axis.len()));
        if count.is_none_or(|count| count > MOST_ROWS) {
            let text = format!("`axes` have too many combinations, must be at most {MOST_ROWS} rows");
            return Err(Problem::at_field(ErrorCode::InvalidValue, "#/axes".to_owned(), text));
        }
        Ok(Self::Crossed(axes))
    }

    /// How many there are.
    pub(super) fn count(&self) -> u64 {
        match self {
            Self::Crossed(axes) => axes.iter().map(Axis::len).product(),
            Self::Lines(lines) => lines.len(),
        }
    }

    /// A row below the count, over the base of all.
    ///
    /// # Errors
    /// Where a line cannot be read or is no object.
    pub(super) fn row(&self, number: u64, base: &Value) -> Result<Row, Problem> {
        match self {
            Self::Crossed(axes) => Ok(crossed_row(axes, number, base)),
            Self::Lines(lines) => {
                let patch = lines.line(number)?;
                let mut fields = Vec::new();
                leaves(&patch, "", &mut fields);
                let mut request = base.clone();
                merge(&mut request, patch);
                Ok(Row { number, request, fields })
            }
        }
    }

    /// The axes that make them, if axes do.
    pub(super) fn axes(&self) -> Option<&[Axis]> {
        match self {
            Self::Crossed(axes) => Some(axes),
            Self::Lines(_) => None,
        }
    }

    /// The names of the fields that differ, where they are known before the rows.
    pub(super) fn field_names(&self) -> Vec<String> {
        match self {
            Self::Crossed(axes) => axes.iter().flat_map(Axis::fields).map(|(name, _)| name.to_owned()).collect(),
            Self::Lines(_) => Vec::new(),
        }
    }
}

fn crossed_row(axes: &[Axis], number: u64, base: &Value) -> Row {
    let (mut request, mut fields) = (base.clone(), Vec::new());
    let mut rest = number;
    let places = axes.iter().rev().map(|axis| {
        let place = rest % axis.len();
        rest /= axis.len();
        place
    });
    let places: Vec<_> = places.collect();
    for (axis, place) in axes.iter().zip(places.into_iter().rev()) {
        for (name, path, value) in axis.at(place) {
            fields.push((name.to_owned(), value.clone()));
            // Each path was tried on the base.
            let _ = path.put(&mut request, value);
        }
    }
    Row { number, request, fields }
}

impl Lines {
    /// Finds the lines of a source from `start` on, up to its end, and adds each of them in its canonical form to `hash`.
    /// Blank lines are none.
    ///
    /// # Errors
    /// Lines that are no JSON objects or have a plan where the row before gives one, by their numbers in the file: the first
    /// [`MOST_FAULTS`], and how many others there are; a source that cannot be read.
    pub(super) fn find(
        mut source: Box<dyn Source>,
        start: u64,
        definition: &Definition,
        hash: &mut Sha256,
    ) -> Result<Self, SweepError> {
        source.seek(SeekFrom::Start(start))?;
        let (mut starts, mut at, mut in_file) = (Vec::new(), start, 1_u64);
        let mut reader = BufReader::with_capacity(1 << 16, &mut source);
        let (mut line, mut faults) = (Vec::new(), LineFaults::default());
        loop {
            line.clear();
            let mut length = reader.by_ref().take(LONGEST_LINE + 1).read_until(b'\n', &mut line)?;
            if length == 0 {
                break;
            }
            if length as u64 > LONGEST_LINE && !line.ends_with(b"\n") {
                length += reader.skip_until(b'\n')?;
            }
            in_file += 1;
            if !line.trim_ascii().is_empty() {
                let text = line.strip_suffix(b"\n").unwrap_or(&line);
                let read = object_of(text).and_then(|value| warm::check_line(definition, &value).map(|()| value));
                match read {
                    Ok(value) => {
                        hash.update(b"\n");
                        hash.update(json::write(&value));
                    }
                    Err(problem) => faults.add(in_file, &problem),
                }
                starts.push(at);
                if starts.len() as u64 > MOST_ROWS {
                    let text = format!("there are more lines than {MOST_ROWS}");
                    return Err(Problem::new(ErrorCode::InvalidValue, text).into());
                }
            }
            at += length as u64;
        }
        faults.finish()?;
        starts.push(at);
        drop(reader);
        Ok(Self { source: Mutex::new(source), starts })
    }

    fn len(&self) -> u64 {
        self.starts.len() as u64 - 1
    }

    fn line(&self, number: u64) -> Result<Value, Problem> {
        let place = usize::try_from(number).unwrap_or(usize::MAX);
        let (Some(&start), Some(&end)) = (self.starts.get(place), self.starts.get(place.saturating_add(1))) else {
            return Err(Problem::new(ErrorCode::Internal, format!("there is no row {number}")));
        };
        let mut line = vec![0; usize::try_from(end - start).unwrap_or_default()];
        let mut source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        let read = source.seek(SeekFrom::Start(start)).and_then(|_| source.read_exact(&mut line));
        drop(source);
        read.map_err(|error| Problem::new(ErrorCode::MalformedBody, format!("the line of row {number}: {error}")))?;
        // Blank lines may follow it.
        let end = line.iter().position(|&byte| byte == b'\n').unwrap_or(line.len());
        object_of(&line[..end])
    }
}

fn object_of(line: &[u8]) -> Result<Value, Problem> {
    if line.len() as u64 > LONGEST_LINE {
        return Err(Problem::new(ErrorCode::BodyTooLarge, format!("it is longer than {LONGEST_LINE} bytes")));
    }
    let StrictValue(value) = json::read_object(line)?;
    Ok(value)
}

/// Lines that are no rows.
#[derive(Default)]
struct LineFaults {
    /// The first of them.
    first: Option<Problem>,
    count: usize,
}

impl LineFaults {
    fn add(&mut self, in_file: u64, problem: &Problem) {
        self.count += 1;
        if self.count <= MOST_FAULTS {
            self.put(
                problem.code(),
                format!("line {in_file}: {}", problem.detail().replace(" at line 1 column ", " at column ")),
            );
        }
    }

    fn put(&mut self, code: ErrorCode, text: String) {
        let problem = Problem::at_field(code, "#".to_owned(), text);
        self.first = Some(match self.first.take() {
            Some(first) => first.and(problem),
            None => problem,
        });
    }

    fn finish(mut self) -> Result<(), Problem> {
        if let Some(others) = self.count.checked_sub(MOST_FAULTS).filter(|others| *others > 0) {
            self.put(ErrorCode::MalformedBody, format!("{others} more lines are no rows"));
        }
        self.first.map_or(Ok(()), Err)
    }
}

/// Merges a patch over a value, by RFC 7396: objects are merged, null removes, all else replaces.
fn merge(target: &mut Value, patch: Value) {
    let Value::Object(patch) = patch else {
        *target = patch;
        return;
    };
    if !target.is_object() {
        *target = Value::Object(Map::new());
    }
    if let Value::Object(target) = target {
        for (name, value) in patch {
            if value.is_null() {
                target.remove(&name);
            } else {
                merge(target.entry(name).or_insert(Value::Null), value);
            }
        }
    }
}

/// The fields of an object that are no objects themselves, by their paths.
fn leaves(value: &Value, path: &str, fields: &mut Vec<(String, Value)>) {
    if let Some(object) = value.as_object().filter(|object| !object.is_empty()) {
        for (name, value) in object {
            let below = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            leaves(value, &below, fields);
        }
    } else if !path.is_empty() {
        fields.push((path.to_owned(), value.clone()));
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn merging_follows_the_examples_of_rfc_7396() {
        // Its appendix A.
        for (mut target, patch, result) in [
            (json!({"a": "b"}), json!({"a": "c"}), json!({"a": "c"})),
            (json!({"a": "b"}), json!({"b": "c"}), json!({"a": "b", "b": "c"})),
            (json!({"a": "b"}), json!({"a": null}), json!({})),
            (json!({"a": ["b"]}), json!({"a": "c"}), json!({"a": "c"})),
            (json!({"a": {"b": "c"}}), json!({"a": {"b": "d", "c": null}}), json!({"a": {"b": "d"}})),
            (json!({"a": [{"b": "c"}]}), json!({"a": [1]}), json!({"a": [1]})),
            (json!({"e": null}), json!({"a": 1}), json!({"e": null, "a": 1})),
            (json!({}), json!({"a": {"bb": {"ccc": null}}}), json!({"a": {"bb": {}}})),
        ] {
            merge(&mut target, patch);
            assert_eq!(target, result);
        }
    }

    #[test]
    fn leaves_are_named_by_their_paths() {
        let mut fields = Vec::new();
        leaves(&json!({"a": {"b": 1, "c": [2]}, "d": {}}), "", &mut fields);
        let expected = [("a.b", json!(1)), ("a.c", json!([2])), ("d", json!({}))];
        assert_eq!(fields, expected.map(|(name, value)| (name.to_owned(), value)));
    }
}
