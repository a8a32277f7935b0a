//! Where the results of some folders are, in the order of the rows.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use super::parts::{self, LineReader, Place};
use super::stored::Head;
use super::{Header, Progress, ResultsError, StoredRow};

/// Held by whoever has an index of the folder.
const LOCK_FILE: &str = "table.lock";

/// The results of one sweep in one folder or in those of several shards; another process may still write to them.
///
/// Of all who may write to the first folder one at a time has an index of it, as far as the file system has locks: what is
/// written of an index is never older than what is there.
#[derive(Debug)]
pub struct Index {
    /// What they are of; the shard is that of the first folder.
    pub header: Header,
    /// How far they are, all folders together.
    pub progress: Progress,
    folders: Vec<PathBuf>,
    /// Row, folder and place, by row.
    places: Vec<(u64, usize, Place)>,
    _lock: Option<File>,
}

impl Index {
    /// Finds all rows of the folders, once nobody else has an index of the first.
    ///
    /// # Errors
    /// Where one of them has no results, or not of the same sweep, or the rows of another one, or cannot be read.
    pub fn of(folders: &[PathBuf]) -> Result<Self, ResultsError> {
        let headers: Result<Vec<_>, _> = folders.iter().map(|folder| known_header(folder)).collect();
        let headers = headers?;
        let Some(header) = headers.first().cloned() else {
            return Err(ResultsError::Empty { folder: PathBuf::new() });
        };
        let lock = locked(&folders[0]);
        let mut progress = Progress::default();
        let (mut places, mut counted) = (Vec::new(), super::RowSet::of(header.rows));
        for (folder, (path, of_folder)) in folders.iter().zip(&headers).enumerate() {
            Header { shard: of_folder.shard, ..header.clone() }.check_same(of_folder, path)?;
            if let Some(other) = headers[..folder].iter().position(|other| other.overlaps(of_folder)) {
                let (one, other) = (folders[other].clone(), path.clone());
                return Err(ResultsError::Overlapping { one, other });
            }
            progress.rows += of_folder.rows_of_shard();
            let cannot_read = |error| ResultsError::cannot_read(path, &error);
            for part in parts::numbers(path).map_err(cannot_read)? {
                let take = |place: Place, line: &[u8]| {
                    let Some(head) = Head::read(line, of_folder) else { return false };
                    if counted.insert(head.row) {
                        progress.count_stored(&head);
                        places.push((head.row, folder, place));
                    }
                    true
                };
                parts::scan(path, part, take)?;
            }
        }
        places.sort_unstable_by_key(|(row, ..)| *row);
        Ok(Self { header, progress, folders: folders.to_vec(), places, _lock: lock })
    }

    /// The rows in order.
    ///
    /// # Errors
    /// Of each row: where it cannot be read any more.
    pub fn rows(&self) -> impl Iterator<Item = Result<StoredRow, ResultsError>> {
        let mut reader = LineReader::default();
        self.places.iter().map(move |(_, folder, place)| {
            let folder = &self.folders[*folder];
            let line = reader.read(folder, *place).map_err(|error| ResultsError::cannot_read(folder, &error))?;
            let damaged = || ResultsError::Damaged { file: folder.clone(), fault: "a row has changed".to_owned() };
            StoredRow::read(&line).ok_or_else(damaged)
        })
    }

    /// The fields that differ from row to row: in the order of the axes, or else by name.
    ///
    /// # Errors
    /// Where a row cannot be read any more.
    pub fn fields(&self) -> Result<Vec<String>, ResultsError> {
        if !self.header.fields.is_empty() {
            return Ok(self.header.fields.clone());
        }
        let mut names = BTreeSet::new();
        for row in self.rows() {
            names.extend(row?.axes.into_iter().map(|(name, _)| name));
        }
        Ok(names.into_iter().collect())
    }
}

/// Who cannot write there is nobody to wait for, and needs no lock.
fn locked(folder: &Path) -> Option<File> {
    let lock = OpenOptions::new().create(true).truncate(false).write(true).open(folder.join(LOCK_FILE)).ok()?;
    lock.lock().is_ok().then_some(lock)
}

fn known_header(folder: &Path) -> Result<Header, ResultsError> {
    Header::read(folder)?.ok_or_else(|| ResultsError::Empty { folder: folder.to_owned() })
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread;
    use std::time::Duration;

    use super::*;
    use crate::sweep::Shard;

    #[test]
    fn one_at_a_time_has_an_index() {
        let folder = tempfile::tempdir().unwrap();
        let header = Header {
            sweep: "ab01".to_owned(),
            solver_version: "0.1.0".to_owned(),
            job: "solve".to_owned(),
            rows: 1,
            chunk_rows: 1,
            warm_start: false,
            shard: Shard::WHOLE,
            fields: Vec::new(),
            columns: Vec::new(),
            definition: serde_json::json!({}),
        };
        header.write(folder.path()).unwrap();
        let folders = [folder.path().to_owned()];
        let (older, is_given_back) = (Index::of(&folders).unwrap(), AtomicBool::new(false));
        thread::scope(|scope| {
            let newer = scope.spawn(|| {
                let newer = Index::of(&folders).unwrap();
                assert!(is_given_back.load(Ordering::Acquire), "while somebody else has one");
                newer.progress.done
            });
            // Time for a fault to show itself.
            thread::sleep(Duration::from_millis(50));
            let line = "{\"key\":\"ab01-0\",\"row\":0,\"axes\":{},\"answer\":{\"status\":\"converged\"}}\n";
            fs::write(folder.path().join("rows-0000.jsonl"), line).unwrap();
            is_given_back.store(true, Ordering::Release);
            drop(older);
            assert_eq!(newer.join().unwrap(), 1, "what came meanwhile is in it");
        });
    }
}
