//! The parts of a folder: files of lines that are only appended to.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};

use super::ResultsError;
use crate::sweep::whole_file::sync_folder;

/// Where a line begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) part: u32,
    pub(super) offset: u64,
}

/// The part that is appended to.
#[derive(Debug)]
pub(super) struct Part {
    number: u32,
    path: PathBuf,
    file: File,
    length: u64,
    has_unsynced: bool,
}

impl Part {
    /// Opens a part at its end, or makes it.
    pub(super) fn open(folder: &Path, number: u32) -> io::Result<Self> {
        let path = path_of(folder, number);
        let file = OpenOptions::new().create(true).append(true).open(&path)?;
        sync_folder(folder)?;
        let length = file.metadata()?.len();
        Ok(Self { number, path, file, length, has_unsynced: false })
    }

    /// The one after this, which is complete.
    pub(super) fn next(&mut self, folder: &Path) -> io::Result<Self> {
        self.sync()?;
        Self::open(folder, self.number + 1)
    }

    /// Its bytes.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Appends a line whole or not at all.
    pub(super) fn append(&mut self, line: &[u8]) -> io::Result<()> {
        if let Err(error) = self.file.write_all(line) {
            // Where even this fails, the rest of the line is cut when the folder is opened again.
            let _ = self.file.set_len(self.length);
            return Err(named(&self.path, &error));
        }
        self.length += line.len() as u64;
        self.has_unsynced = true;
        Ok(())
    }

    /// Brings what was appended to the disk.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        if self.has_unsynced {
            self.file.sync_data().map_err(|error| named(&self.path, &error))?;
            self.has_unsynced = false;
        }
        Ok(())
    }
}

fn named(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{} cannot be written: {error}", path.display()))
}

fn path_of(folder: &Path, number: u32) -> PathBuf {
    folder.join(format!("rows-{number:04}.jsonl"))
}

/// The parts of a folder in order.
pub(super) fn numbers(folder: &Path) -> io::Result<Vec<u32>> {
    let mut numbers = Vec::new();
    for entry in fs::read_dir(folder)? {
        let name = entry?.file_name();
        let digits = name.to_str().and_then(|name| name.strip_prefix("rows-")?.strip_suffix(".jsonl"));
        numbers.extend(digits.and_then(|digits| digits.parse::<u32>().ok()));
    }
    numbers.sort_unstable();
    Ok(numbers)
}

/// Shows all lines; at the end of the last part what has no end of its own is cut off. Gives the part to append to.
///
/// # Errors
/// Where a line is no row, as `is_row` says, or an earlier part is torn.
pub(super) fn repaired(folder: &Path, mut is_row: impl FnMut(Place, &[u8]) -> bool) -> Result<u32, ResultsError> {
    let parts = numbers(folder).map_err(|error| ResultsError::cannot_read(folder, &error))?;
    let Some(&last) = parts.last() else { return Ok(0) };
    for &part in &parts {
        let path = path_of(folder, part);
        let cannot_read = |error: io::Error| ResultsError::cannot_read(&path, &error);
        let whole = scan(folder, part, &mut is_row)?;
        let length = fs::metadata(&path).map_err(cannot_read)?.len();
        if whole < length && part < last {
            return Err(no_row(path, whole));
        }
        if whole < length {
            tracing::warn!(file = %path.display(), bytes = length - whole, "cut a torn end; its row is done again");
            let file = OpenOptions::new().write(true).open(&path).map_err(cannot_read)?;
            let cut = file.set_len(whole).and_then(|()| file.sync_all());
            cut.map_err(|error| ResultsError::cannot_write(&path, &error))?;
        }
    }
    Ok(last)
}

/// Shows the lines of a part; gives where they end. What follows the last line feed is none: its writing was cut short, or
/// goes on.
///
/// # Errors
/// Where a line is no row, as `is_row` says.
pub(super) fn scan(
    folder: &Path,
    part: u32,
    mut is_row: impl FnMut(Place, &[u8]) -> bool,
) -> Result<u64, ResultsError> {
    let path = path_of(folder, part);
    let cannot_read = |error: io::Error| ResultsError::cannot_read(&path, &error);
    let mut reader = BufReader::with_capacity(1 << 18, File::open(&path).map_err(cannot_read)?);
    let (mut line, mut offset) = (Vec::new(), 0);
    loop {
        line.clear();
        let length = reader.read_until(b'\n', &mut line).map_err(cannot_read)? as u64;
        if line.pop() != Some(b'\n') {
            return Ok(offset);
        }
        if !is_row(Place { part, offset }, &line) {
            return Err(no_row(path, offset));
        }
        offset += length;
    }
}

fn no_row(file: PathBuf, offset: u64) -> ResultsError {
    let fault =
        format!("what begins at byte {offset} is no row of this sweep and shard; without it, its row is done again");
    ResultsError::Damaged { file, fault }
}

/// Reads lines at their places; the part of the last one stays open.
#[derive(Debug, Default)]
pub(super) struct LineReader {
    open: Option<(PathBuf, BufReader<File>)>,
    /// Where it is in that part.
    offset: u64,
}

impl LineReader {
    /// The line at a place, with its end.
    pub(super) fn read(&mut self, folder: &Path, place: Place) -> io::Result<Vec<u8>> {
        let path = path_of(folder, place.part);
        // Taken away while it reads: after a fault nobody knows where it is.
        let mut reader = match self.open.take() {
            Some((open, reader)) if open == path => reader,
            Some(_) | None => {
                self.offset = 0;
                BufReader::new(File::open(&path)?)
            }
        };
        reader.seek_relative(place.offset.wrapping_sub(self.offset).cast_signed())?;
        let mut line = Vec::new();
        reader.read_until(b'\n', &mut line)?;
        self.offset = place.offset + line.len() as u64;
        self.open = Some((path, reader));
        Ok(line)
    }
}
