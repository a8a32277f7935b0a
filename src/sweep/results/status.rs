//! What can be said of a folder while another process writes to it.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use super::{Index, LOCK_FILE, ResultsError};

/// How far some folders are, and who works on them.
#[derive(Debug)]
pub struct Status {
    /// Their rows.
    pub index: Index,
    /// Those that another process writes to.
    pub in_use: Vec<PathBuf>,
}

/// Reads folders.
///
/// # Errors
/// As [`Index::of`].
pub fn status(folders: &[PathBuf]) -> Result<Status, ResultsError> {
    let index = Index::of(folders)?;
    let in_use = folders.iter().filter(|folder| is_in_use(folder)).cloned().collect();
    Ok(Status { index, in_use })
}

fn is_in_use(folder: &Path) -> bool {
    // Given back at once; who wants to write then waits for a moment.
    File::open(folder.join(LOCK_FILE)).is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
}
