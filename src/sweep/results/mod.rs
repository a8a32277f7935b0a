//! Results of a sweep in a folder: what it is (`sweep.json`), a lock, and parts with one line per row that is done.
//!
//! Parts are only ever appended to. A line is written with one call, so a process that is killed leaves whole lines; what
//! a machine leaves that loses its power is cut after the last line that is whole. Rows are named by their keys, so no row is
//! ever done twice.

mod error;
mod header;
mod index;
mod parts;
mod progress;
mod row_set;
mod status;
mod stored;

use std::collections::HashMap;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub use error::ResultsError;
pub use header::Header;
pub use index::Index;
use parts::{LineReader, Part, Place};
pub use progress::Progress;
pub(super) use row_set::RowSet;
pub use status::{Status, status};
pub use stored::StoredRow;
#[cfg(feature = "nats")]
pub(super) use stored::{failed_line, line};

use super::runner::Guesses;
use super::warm::Guess;
use super::{Finished, Shard, Sweep};

const LOCK_FILE: &str = "lock";
/// A part that is as large is followed by another, bytes: small enough for any editor, few files at any size.
const LARGEST_PART: u64 = 64 << 20;
/// How long a lock is waited for: somebody may ask for the status just then.
const LOCK_PATIENCE: Duration = Duration::from_millis(500);

/// A folder that this process writes to; nobody else does meanwhile.
#[derive(Debug)]
pub struct Results {
    folder: PathBuf,
    header: Header,
    done: RowSet,
    progress: Progress,
    /// Rows that were done before while the next one of their chunk was not, which begins with their plan. Empty for cold sweeps.
    open_ends: HashMap<u64, Place>,
    part: Part,
    _lock: File,
}

impl Results {
    /// Opens a folder to go on with, or makes it; cuts a line without an end.
    ///
    /// # Errors
    /// Where somebody else writes to it, where it has the results of another sweep, version or shard, where its rows are
    /// damaged, and where it cannot be written.
    pub fn open(folder: &Path, header: Header) -> Result<Self, ResultsError> {
        let failed = |error: io::Error| ResultsError::cannot_write(folder, &error);
        fs::create_dir_all(folder).map_err(failed)?;
        let lock = locked(folder)?;
        match Header::read(folder)? {
            Some(known) => {
                known.check_same(&header, folder)?;
                if known != header {
                    header.write(folder).map_err(failed)?;
                }
            }
            None => header.write(folder).map_err(failed)?,
        }
        let mut found = Found::new(&header);
        let last = parts::repaired(folder, |place, line| found.take(&header, place, line))?;
        let Found { done, progress, open_ends } = found;
        let part = Part::open(folder, last).map_err(failed)?;
        Ok(Self { folder: folder.to_owned(), header, done, progress, open_ends, part, _lock: lock })
    }

    /// What is known of a folder before it is opened; none where there is none yet.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn header_of(folder: &Path) -> Result<Option<Header>, ResultsError> {
        Header::read(folder)
    }

    /// How far it is.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// The share of the sweep that it is for.
    pub fn shard(&self) -> Shard {
        self.header.shard
    }

    pub(super) fn done(&self) -> &RowSet {
        &self.done
    }

    /// Appends a row.
    ///
    /// # Errors
    /// When it cannot be written whole; what was written of it is taken back.
    pub(super) fn append(&mut self, sweep: &Sweep, finished: &Finished) -> io::Result<()> {
        self.append_line(&stored::line(&sweep.key(finished.row.number), finished))?;
        self.done.insert(finished.row.number);
        self.progress.count(&finished.answer);
        Ok(())
    }

    /// Appends a line that was written elsewhere, unless its row is there; false where it is no row of this sweep.
    ///
    /// # Errors
    /// As [`Results::append`].
    #[cfg(feature = "nats")]
    pub(super) fn take(&mut self, line: &[u8]) -> io::Result<bool> {
        let Some(head) = line.strip_suffix(b"\n").and_then(|line| stored::Head::read(line, &self.header)) else {
            return Ok(false);
        };
        if !self.done.contains(head.row) {
            self.append_line(line)?;
            self.done.insert(head.row);
            self.progress.count_stored(&head);
        }
        Ok(true)
    }

    fn append_line(&mut self, line: &[u8]) -> io::Result<()> {
        if self.part.length() >= LARGEST_PART {
            self.part = self.part.next(&self.folder)?;
        }
        self.part.append(line)
    }

    /// Brings what was appended to the disk.
    ///
    /// # Errors
    /// When the disk does not take it.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        self.part.sync()
    }

    /// The plans that rows begin with whose predecessor was done before, by the number of the row.
    pub(super) fn guesses(&self) -> io::Result<Guesses> {
        let (mut guesses, mut reader) = (Guesses::new(), LineReader::default());
        for (row, place) in &self.open_ends {
            let line = reader.read(&self.folder, *place)?;
            let guess = StoredRow::read(&line).and_then(|stored| Guess::of_value(stored.key, &stored.answer?));
            guesses.extend(guess.map(|guess| (row + 1, guess)));
        }
        Ok(guesses)
    }
}

/// What the parts of a folder have.
struct Found {
    done: RowSet,
    progress: Progress,
    open_ends: HashMap<u64, Place>,
}

impl Found {
    fn new(header: &Header) -> Self {
        Self { done: RowSet::of(header.rows), progress: Progress::of(header), open_ends: HashMap::new() }
    }

    /// Takes a line; whether it is a row of the sweep.
    fn take(&mut self, header: &Header, place: Place, line: &[u8]) -> bool {
        let Some(head) = stored::Head::read(line, header) else { return false };
        if self.done.insert(head.row) {
            self.progress.count_stored(&head);
        }
        if header.warm_start {
            self.open_ends.remove(&head.row.wrapping_sub(1));
            let next = head.row + 1;
            // The first row of a chunk begins with nobody's plan.
            if next % header.chunk_rows != 0 && !self.done.contains(next) {
                self.open_ends.insert(head.row, place);
            }
        }
        true
    }
}

fn locked(folder: &Path) -> Result<File, ResultsError> {
    let path = folder.join(LOCK_FILE);
    let failed = |error: io::Error| ResultsError::cannot_write(&path, &error);
    let lock = OpenOptions::new().create(true).truncate(false).write(true).open(&path).map_err(failed)?;
    let patience_ends = Instant::now() + LOCK_PATIENCE;
    loop {
        match lock.try_lock() {
            Ok(()) => return Ok(lock),
            Err(TryLockError::Error(error)) => return Err(failed(error)),
            Err(TryLockError::WouldBlock) if Instant::now() < patience_ends => {
                std::thread::sleep(LOCK_PATIENCE / 20);
            }
            Err(TryLockError::WouldBlock) => return Err(ResultsError::Locked { folder: folder.to_owned() }),
        }
    }
}
