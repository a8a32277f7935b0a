//! Where the results of some folders are, in the order of the rows.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::parts::{self, Place};
use super::stored::Head;
use super::{Header, Progress, ResultsError, StoredRow};

/// The results of one sweep in one folder or in those of several shards; another process may still write to them.
#[derive(Debug)]
pub struct Index {
    /// What they are of; the shard is that of the first folder.
    pub header: Header,
    /// How far they are, all folders together.
    pub progress: Progress,
    folders: Vec<PathBuf>,
    /// Row, folder and place, by row.
    places: Vec<(u64, usize, Place)>,
}

impl Index {
    /// Finds all rows of the folders.
    ///
    /// # Errors
    /// Where one of them has no results, or not of the same sweep, or the rows of another one, or cannot be read.
    pub fn of(folders: &[PathBuf]) -> Result<Self, ResultsError> {
        let headers: Result<Vec<_>, _> = folders.iter().map(|folder| known_header(folder)).collect();
        let headers = headers?;
        let Some(header) = headers.first().cloned() else {
            return Err(ResultsError::Empty { folder: PathBuf::new() });
        };
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
        Ok(Self { header, progress, folders: folders.to_vec(), places })
    }

    /// The rows in order.
    ///
    /// # Errors
    /// Of each row: where it cannot be read any more.
    pub fn rows(&self) -> impl Iterator<Item = Result<StoredRow, ResultsError>> {
        self.places.iter().map(|(_, folder, place)| {
            let folder = &self.folders[*folder];
            let line = parts::line_at(folder, *place).map_err(|error| ResultsError::cannot_read(folder, &error))?;
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

fn known_header(folder: &Path) -> Result<Header, ResultsError> {
    Header::read(folder)?.ok_or_else(|| ResultsError::Empty { folder: folder.to_owned() })
}
