//! What a command writes: checked before it runs, and all of it tried after.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;

use crate::config::JobArguments;
use crate::tell;

/// The files that are asked for, by their flags, each of which may be standard output.
fn files(arguments: &JobArguments) -> impl Iterator<Item = (&'static str, &Path)> {
    let JobArguments { json, save, report, csv, .. } = arguments;
    let files = [("--json", json), ("--save", save), ("--report", report), ("--csv", csv)];
    files.into_iter().filter_map(|(flag, path)| Some((flag, path.as_deref()?)))
}

/// Whether standard output is for none of them.
pub(super) fn leave_standard_output(arguments: &JobArguments) -> bool {
    files(arguments).all(|(_, path)| !is_standard_stream(path))
}

/// What would be lost: outputs that are one file, or an input.
pub(super) fn collisions(arguments: &JobArguments) -> Vec<String> {
    let inputs: Vec<_> = arguments.input.iter().filter(|path| path.is_file()).filter_map(|path| place(path)).collect();
    let outputs: Vec<_> = files(arguments).filter_map(|(flag, path)| Some((flag, path, place(path)?))).collect();
    let of_inputs = outputs.iter().filter(|(.., place)| inputs.contains(place));
    let of_inputs =
        of_inputs.map(|(flag, path, _)| format!("{flag} {} is an input too, must be another file", path.display()));
    let of_outputs = outputs.iter().enumerate().filter_map(|(index, (flag, path, place))| {
        let (other, ..) = outputs[..index].iter().find(|(.., known)| known == place)?;
        Some(format!("{other} and {flag} are both {}, must be different files", path.display()))
    });
    let to_output = files(arguments).filter(|(_, path)| is_standard_stream(path)).count();
    let of_streams = (to_output > 1).then(|| format!("{to_output} outputs are `-`, must be at most one"));
    of_inputs.chain(of_outputs).chain(of_streams).collect()
}

/// Where a file is, or will be; none of devices and pipes, which keep nothing.
fn place(path: &Path) -> Option<PathBuf> {
    if is_standard_stream(path) || path.exists() && !path.is_file() {
        return None;
    }
    fs::canonicalize(path).or_else(|_| std::path::absolute(path)).ok()
}

/// Writes what was computed, which is not lost with the first place that cannot be written: that is told, and the others are tried.
#[derive(Default)]
pub(super) struct Writer {
    pub(super) has_failed: bool,
}

impl Writer {
    pub(super) fn file(&mut self, path: &Path, content: &[u8]) {
        let written = if is_standard_stream(path) { say(content) } else { write(path, content) };
        self.tell(written);
    }

    /// Files into a folder, which is made where it is not there.
    pub(super) fn folder<'a>(&mut self, folder: &Path, files: impl Iterator<Item = (String, &'a [u8])>) {
        let written = fs::create_dir_all(folder).with_context(|| format!("{} cannot be made", folder.display()));
        if written.is_ok() {
            files.for_each(|(name, content)| self.file(&folder.join(name), content));
        }
        self.tell(written);
    }

    /// What did not succeed.
    pub(super) fn tell(&mut self, outcome: anyhow::Result<()>) {
        if let Err(error) = outcome {
            tell(&format_args!("error: {error:#}"));
            self.has_failed = true;
        }
    }
}

fn write(path: &Path, content: &[u8]) -> anyhow::Result<()> {
    fs::write(path, content).with_context(|| format!("{} cannot be written", path.display()))
}

/// Whether this is `-`: standard input where it is read, standard output where it is written.
pub(super) fn is_standard_stream(path: &Path) -> bool {
    path == Path::new("-")
}

/// Writes to standard output; where its reader has left, nobody is to be told.
pub(crate) fn say(words: &[u8]) -> anyhow::Result<()> {
    let mut output = io::stdout().lock();
    let written = output.write_all(words).and_then(|()| output.flush());
    let has_left = |error: &io::Error| error.kind() == io::ErrorKind::BrokenPipe;
    written
        .or_else(|error| if has_left(&error) { Ok(()) } else { Err(error) })
        .context("standard output cannot be written")
}
