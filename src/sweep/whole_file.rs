//! Files that are there whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

/// Writes a file in place of the one that is there. Meanwhile it has `.new` behind its name, and what a process that was
/// killed has left there is written over; two must not write one file at the same time.
///
/// # Errors
/// When it cannot be written; nothing is left of it then.
pub fn write_whole<T, E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<T, E>,
) -> Result<T, E> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let beside = Path::new(&beside);
    let written = write_synced(beside, write).and_then(|written| {
        fs::rename(beside, path)?;
        sync_folder(folder)?;
        Ok(written)
    });
    if written.is_err() {
        // What is told is why it was not written.
        let _ = fs::remove_file(beside);
    }
    written
}

fn write_synced<T, E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<T, E>,
) -> Result<T, E> {
    let file = File::create(path)?;
    let mut output = BufWriter::new(&file);
    let written = write(&mut output)?;
    output.flush()?;
    drop(output);
    file.sync_all()?;
    Ok(written)
}

/// Brings the names in a folder to the disk, where the system can.
pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    #[test]
    fn files_are_whole_for_whoever_reads_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        let text = "row\n".repeat(10_000);
        let write = || write_whole(&path, |output| output.write_all(text.as_bytes()));
        fs::write(folder.path().join("rows.csv.new"), "of a process that was killed").unwrap();
        write().unwrap();
        thread::scope(|scope| {
            let writer = scope.spawn(|| (0..20).try_for_each(|_| write()));
            while !writer.is_finished() {
                assert_eq!(fs::read_to_string(&path).unwrap().len(), text.len());
            }
            writer.join().unwrap().unwrap();
        });
        let unwritten = write_whole(&path, |output| {
            output.write_all(b"half")?;
            Err::<(), _>(io::Error::other("the disk is full"))
        });
        assert_eq!(unwritten.unwrap_err().to_string(), "the disk is full");
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
    }
}
