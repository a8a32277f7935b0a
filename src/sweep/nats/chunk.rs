//! The message of a chunk: all that a worker needs of it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::packed::{packed, unpacked};
use crate::contract::{Problem, json};
use crate::sweep::{Row, SOLVER_VERSION, Sweep};

/// A chunk on its way.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Chunk {
    /// The hash of the sweep.
    pub(super) sweep: String,
    /// Its number.
    #[serde(rename = "chunk")]
    pub(super) number: u64,
    /// The version that its results are to come from.
    pub(super) solver_version: String,
    /// The kind of job.
    pub(super) job: String,
    /// Whether a row may begin with the plan of the one before.
    pub(super) warm_start: bool,
    rows: Vec<RowOfChunk>,
}

#[derive(Debug, Serialize, Deserialize)]
struct RowOfChunk {
    row: u64,
    axes: Vec<(String, Value)>,
    request: Value,
}

impl Chunk {
    /// A chunk of a sweep below the count.
    ///
    /// # Errors
    /// Where a line of the file cannot be read any more.
    pub(super) fn of(sweep: &Sweep, number: u64) -> Result<Self, Problem> {
        let row = |number| {
            sweep.row(number).map(|Row { number: row, request, fields: axes }| RowOfChunk { row, axes, request })
        };
        Ok(Self {
            sweep: sweep.hash().to_owned(),
            number,
            solver_version: SOLVER_VERSION.to_owned(),
            job: sweep.definition.job.clone(),
            warm_start: sweep.is_warm(),
            rows: sweep.chunk(number).map(row).collect::<Result<_, _>>()?,
        })
    }

    pub(super) fn write(&self) -> Vec<u8> {
        packed(&json::write(self))
    }

    /// Reads a message.
    ///
    /// # Errors
    /// Why it is no chunk for this version.
    pub(super) fn read(message: &[u8]) -> Result<Self, String> {
        let content = unpacked(message).map_err(|error| format!("it is no chunk: {error}"))?;
        let chunk: Self = serde_json::from_slice(&content).map_err(|error| format!("it is no chunk: {error}"))?;
        if chunk.solver_version != SOLVER_VERSION {
            return Err(format!("it is for version {}, this is {SOLVER_VERSION}", chunk.solver_version));
        }
        let is_token = !chunk.sweep.is_empty() && chunk.sweep.bytes().all(|byte| byte.is_ascii_alphanumeric());
        if is_token { Ok(chunk) } else { Err("its sweep has no valid hash".to_owned()) }
    }

    /// The numbers of its rows, in order.
    pub(super) fn row_numbers(&self) -> impl Iterator<Item = u64> {
        self.rows.iter().map(|row| row.row)
    }

    /// The rows among these, in order.
    pub(super) fn into_rows(self, wanted: &BTreeMap<u64, bool>) -> Vec<Row> {
        let rows = self.rows.into_iter().filter(|row| wanted.get(&row.row) == Some(&true));
        rows.map(|RowOfChunk { row: number, axes: fields, request }| Row { number, request, fields }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(version: &str) -> Chunk {
        let row = |row| RowOfChunk { row, axes: vec![("a.b".to_owned(), Value::from(0.1))], request: Value::from(row) };
        Chunk {
            sweep: "ab01".to_owned(),
            number: 3,
            solver_version: version.to_owned(),
            job: "solve".to_owned(),
            warm_start: false,
            rows: vec![row(6), row(7)],
        }
    }

    #[test]
    fn chunks_are_read_as_they_were_written() {
        let read = Chunk::read(&chunk(SOLVER_VERSION).write()).unwrap();
        assert_eq!((read.number, read.row_numbers().collect::<Vec<_>>()), (3, vec![6, 7]));
        let rows = read.into_rows(&BTreeMap::from([(6, false), (7, true)]));
        let fields = vec![("a.b".to_owned(), Value::from(0.1))];
        assert_eq!(rows, [Row { number: 7, request: Value::from(7), fields }]);
    }

    #[test]
    fn what_is_no_chunk_of_this_version_is_refused() {
        let refusal = |message: &[u8]| Chunk::read(message).unwrap_err();
        assert!(refusal(b"chunk").starts_with("it is no chunk"));
        assert!(refusal(&packed(b"{}")).contains("missing field"));
        assert!(refusal(&chunk("99.0.0").write()).starts_with("it is for version 99.0.0"));
    }
}
