//! Why a folder cannot be used.

use std::io;
use std::path::{Path, PathBuf};

/// Why a folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ResultsError {
    /// Another process writes to it.
    #[error("{} is in use: another process writes its results there", folder.display())]
    Locked {
        /// The folder.
        folder: PathBuf,
    },
    /// It has other results.
    #[error("{} has results of another sweep: its {what} is {known}, this one's is {given}", folder.display())]
    Foreign {
        /// The folder.
        folder: PathBuf,
        /// What differs.
        what: &'static str,
        /// What it has.
        known: String,
        /// What was to be added.
        given: String,
    },
    /// Two folders are for the same rows.
    #[error("{} and {} are for the same rows, must be of different shards", one.display(), other.display())]
    Overlapping {
        /// One of them.
        one: PathBuf,
        /// The other one.
        other: PathBuf,
    },
    /// There are no results.
    #[error("{} has no results of a sweep", folder.display())]
    Empty {
        /// The folder.
        folder: PathBuf,
    },
    /// A file is not as it was written.
    #[error("{} is damaged: {fault}", file.display())]
    Damaged {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        fault: String,
    },
    /// A file cannot be read.
    #[error("{} cannot be read: {error}", path.display())]
    Unreadable {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A file cannot be written.
    #[error("{} cannot be written: {error}", path.display())]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
}

impl ResultsError {
    pub(super) fn cannot_write(path: &Path, error: &io::Error) -> Self {
        Self::Unwritable { path: path.to_owned(), error: copied(error) }
    }

    pub(super) fn cannot_read(path: &Path, error: &io::Error) -> Self {
        Self::Unreadable { path: path.to_owned(), error: copied(error) }
    }
}

/// Errors of the system have no copies of their own.
fn copied(error: &io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(code) => io::Error::from_raw_os_error(code),
        None => io::Error::new(error.kind(), error.to_string()),
    }
}
