//! Files that are there whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

/// Writes a file in place of the one that is there, also where others write it at the same time.
///
/// # Errors
/// When it cannot be written; nothing is left of it then.
pub fn write_whole<T, E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<T, E>,
) -> Result<T, E> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // As any file is made: what is temporary is for its owner alone otherwise.
    let beside = tempfile::Builder::new().suffix(".new").make_in(folder, |beside| File::create_new(beside))?;
    let mut output = BufWriter::new(beside.as_file());
    let written = write(&mut output)?;
    output.flush()?;
    drop(output);
    beside.as_file().sync_all()?;
    beside.persist(path).map_err(|failed| failed.error)?;
    sync_folder(folder)?;
    Ok(written)
}

/// Brings the names in a folder to the disk, where the system can.
pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::thread;

    use super::*;

    #[test]
    fn files_are_whole_whoever_else_writes_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        let text = "row\n".repeat(10_000);
        let write = || write_whole(&path, |output| output.write_all(text.as_bytes()));
        write().unwrap();
        thread::scope(|scope| {
            let writers: Vec<_> = (0..4).map(|_| scope.spawn(|| (0..20).try_for_each(|_| write()))).collect();
            while writers.iter().any(|writer| !writer.is_finished()) {
                assert_eq!(fs::read_to_string(&path).unwrap().len(), text.len());
            }
            for writer in writers {
                writer.join().unwrap().unwrap();
            }
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
