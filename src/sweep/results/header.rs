//! What a folder says of its results.

use std::fs;
use std::io::{self, Write as _};
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{ResultsError, parts};
use crate::contract::indented;
use crate::sweep::{Shard, write_whole};

/// The file that says what the results are of.
pub(super) const HEADER_FILE: &str = "sweep.json";

/// What the results in a folder are of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// The hash of the sweep.
    pub sweep: String,
    /// The version that made the results.
    pub solver_version: String,
    /// The kind of job.
    pub job: String,
    /// Rows of the whole sweep.
    pub rows: u64,
    /// Rows of a chunk.
    pub chunk_rows: u64,
    /// Whether rows began with plans of the row before.
    pub warm_start: bool,
    /// The share of the chunks that is here.
    pub shard: Shard,
    /// The fields of the axes in their order; empty where lines made the rows.
    pub fields: Vec<String>,
    /// Paths in the answer, for tables.
    pub columns: Vec<String>,
    /// The object of the file, as it was hashed.
    pub definition: Value,
}

impl Header {
    /// Reads that of a folder; none where it has no results yet.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, ResultsError> {
        let path = folder.join(HEADER_FILE);
        match fs::read(&path) {
            Ok(text) => serde_json::from_slice(&text)
                .map(Some)
                .map_err(|error| ResultsError::Damaged { file: path, fault: error.to_string() }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => match parts::numbers(folder) {
                Ok(parts) if !parts.is_empty() => {
                    Err(ResultsError::Damaged { file: path, fault: "it is missing beside rows".to_owned() })
                }
                Ok(_) | Err(_) => Ok(None),
            },
            Err(error) => Err(ResultsError::cannot_read(&path, &error)),
        }
    }

    pub(super) fn write(&self, folder: &Path) -> io::Result<()> {
        write_whole(&folder.join(HEADER_FILE), |output| output.write_all(indented(self).as_bytes()))
    }

    /// Whether more results of `given` belong beside those that are there. Columns may differ: they change no row.
    pub(super) fn check_same(&self, given: &Self, folder: &Path) -> Result<(), ResultsError> {
        let pairs = [
            ("hash", self.sweep.clone(), given.sweep.clone()),
            ("solver version", self.solver_version.clone(), given.solver_version.clone()),
            ("shard", self.shard.to_string(), given.shard.to_string()),
        ];
        match pairs.into_iter().find(|(_, known, given)| known != given) {
            None => Ok(()),
            Some((what, known, given)) => Err(ResultsError::Foreign { folder: folder.to_owned(), what, known, given }),
        }
    }

    /// Whether a row belongs to this shard.
    pub(super) fn has(&self, row: u64) -> bool {
        row < self.rows && self.shard.has(row / self.chunk_rows)
    }

    /// Whether the shard of another folder has rows of this one.
    pub(super) fn overlaps(&self, other: &Self) -> bool {
        self.shard.overlaps(other.shard, self.rows.div_ceil(self.chunk_rows))
    }

    /// Rows that this shard has in the end.
    pub fn rows_of_shard(&self) -> u64 {
        let chunks = self.rows.div_ceil(self.chunk_rows);
        let all = |chunk: u64| self.chunk_rows.min(self.rows - chunk * self.chunk_rows);
        self.shard.chunks(chunks).map(all).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_belongs_to_one_shard() {
        // Chunks of four, the last one with two.
        let of = |index| Header {
            sweep: String::new(),
            solver_version: String::new(),
            job: "solve".to_owned(),
            rows: 10,
            chunk_rows: 4,
            warm_start: false,
            shard: Shard { index, of: 2 },
            fields: Vec::new(),
            columns: Vec::new(),
            definition: Value::Null,
        };
        let rows_of = |index| (0..20).filter(|row| of(index).has(*row)).collect::<Vec<_>>();
        assert_eq!([rows_of(0), rows_of(1)], [vec![0, 1, 2, 3, 8, 9], vec![4, 5, 6, 7]]);
        assert_eq!([0, 1].map(|index| of(index).rows_of_shard()), [6, 4]);
    }
}
