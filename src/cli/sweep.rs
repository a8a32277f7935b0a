//! `slipdrive sweep`: many jobs of one kind on this machine, with results in a folder.

use std::fs::File;
use std::io::{self, Cursor, Read, Write as _};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context as _;
use slipdrive::jobs::Jobs;
use slipdrive::metrics::Metrics;
use slipdrive::service::Service;
use slipdrive::sweep::{
    self, Ended, Index, MapError, Progress, Results, ResultsError, RowFaults, Sweep, SweepError, TableError, write_whole,
};

use super::progress_of_rows::ProgressOfRows;
use super::{refused, say};
use crate::config::{SweepArguments, thread_count};
use crate::shutdown::Signals;
use crate::{EXIT_BAD_INPUT, tell};

/// For a sweep that ended before its end and can be run again (`EX_TEMPFAIL` of sysexits).
const EXIT_TO_BE_CONTINUED: u8 = 75;
const CSV_FILE: &str = "rows.csv";
const MAP_FILE: &str = "map.svg";

/// Runs the command.
///
/// # Errors
/// What cannot be read or written.
pub(crate) fn sweep(arguments: &SweepArguments) -> anyhow::Result<ExitCode> {
    match (&arguments.file, arguments.out.as_slice()) {
        (None, []) => Ok(refused("there is neither a file nor `--out`, must be one of them at least")),
        (None, folders) => shown(arguments, folders),
        (Some(_), _) if arguments.status => Ok(refused("`--status` takes no file: the folder knows its sweep")),
        (Some(file), folders) => {
            let metrics = Metrics::new();
            let jobs = super::jobs(&metrics);
            let sweep = match read(file, &jobs) {
                Ok(sweep) => sweep,
                Err(SweepError::Refused(problem)) => return Ok(super::refuse(&problem)),
                Err(SweepError::Unreadable(error)) => {
                    let is_input = file == Path::new("-");
                    let what = if is_input { "standard input".into() } else { file.to_string_lossy() };
                    return Err(error).context(format!("{what} cannot be read"));
                }
            };
            if let Some(Err(unfit)) = arguments.figure.as_ref().map(|of| sweep.check_map(of)) {
                return Ok(refused(&unfit.to_string()));
            }
            #[cfg(feature = "nats")]
            if arguments.nats.is_asked_for() && !arguments.count {
                return super::sweep_nats::sweep(&sweep, folders, arguments);
            }
            match folders {
                _ if arguments.count => counted(&sweep, arguments),
                [folder] => run(&sweep, folder, arguments),
                _ => Ok(refused("there must be one `--out` for the results, or `--count`")),
            }
        }
    }
}

fn read(file: &Path, jobs: &Jobs) -> Result<Sweep, SweepError> {
    if let Some((_, text)) = sweep::EXAMPLES.iter().find(|(name, _)| file == Path::new(name)) {
        return Sweep::read(Cursor::new(*text), jobs);
    }
    if file == Path::new("-") {
        return Sweep::read(Cursor::new(whole(io::stdin())?), jobs);
    }
    let source = File::open(file)?;
    // A pipe has no places to come back to.
    if source.metadata()?.is_file() { Sweep::read(source, jobs) } else { Sweep::read(Cursor::new(whole(source)?), jobs) }
}

fn whole(mut source: impl Read) -> io::Result<Vec<u8>> {
    let mut text = Vec::new();
    source.read_to_end(&mut text)?;
    Ok(text)
}

/// Says how much there is, and judges all of it.
fn counted(sweep: &Sweep, arguments: &SweepArguments) -> anyhow::Result<ExitCode> {
    let (rows, chunks, hash) = (sweep.row_count(), sweep.chunk_count(), sweep.hash());
    say(format!("rows    {rows}\nchunks  {chunks}\nhash    {hash}\n").as_bytes())?;
    Ok(match sweep.check(arguments.shard, workers(arguments)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(faults) => refused_rows(&faults),
    })
}

pub(super) fn refused_rows(faults: &RowFaults) -> ExitCode {
    for (row, problem) in &faults.first {
        tell(&format_args!("error: row {row}: {problem}"));
        for error in problem.errors() {
            tell(&format_args!("  {}: {}", error.pointer, error.message));
        }
    }
    let others = faults.count - faults.first.len() as u64;
    if others > 0 {
        tell(&format_args!("error: {others} more rows break rules"));
    }
    ExitCode::from(EXIT_BAD_INPUT)
}

/// Runs what is missing.
fn run(sweep: &Sweep, folder: &PathBuf, arguments: &SweepArguments) -> anyhow::Result<ExitCode> {
    // The folder of the same sweep says that its rows were judged.
    if let Ok(None) = Results::header_of(folder)
        && let Err(faults) = sweep.check(arguments.shard, workers(arguments))
    {
        return Ok(refused_rows(&faults));
    }
    let mut results = match Results::open(folder, sweep.header(arguments.shard)) {
        Ok(results) => results,
        Err(error) => return refused_folder(error),
    };
    let service = Arc::new(Service::start(sweep::service_settings(workers(arguments)))?);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let mut shown = ProgressOfRows::of(results.progress());
    let ended = runtime.block_on(async {
        let mut signals = Signals::listen()?;
        let stop = signals.next();
        sweep::run(sweep, &mut results, &service, |progress| shown.show(progress), stop).await
    });
    shown.finish();
    let progress = results.progress().clone();
    drop(results);
    tell(&format_args!("{}: {progress}", folder.display()));
    match ended {
        Ok(Ended::Complete) => {}
        Ok(Ended::Stopped) => return Ok(to_be_continued("stopped")),
        Err(error) => return Ok(to_be_continued(&error.to_string())),
    }
    complete(&progress, folder, arguments)
}

/// Shows what is complete; the exit code says whether all rows have answers.
pub(super) fn complete(progress: &Progress, folder: &PathBuf, arguments: &SweepArguments) -> anyhow::Result<ExitCode> {
    let index = Index::of(std::slice::from_ref(folder))?;
    Ok(write_shown(&index, folder, arguments)?.unwrap_or_else(|| code_of(progress)))
}

fn code_of(progress: &Progress) -> ExitCode {
    match progress {
        _ if !progress.is_complete() => ExitCode::from(EXIT_TO_BE_CONTINUED),
        Progress { failed: 0, .. } => ExitCode::SUCCESS,
        Progress { .. } => ExitCode::FAILURE,
    }
}

pub(super) fn workers(arguments: &SweepArguments) -> NonZeroUsize {
    thread_count(arguments.threads)
}

pub(super) fn to_be_continued(why: &str) -> ExitCode {
    tell(&format_args!("{why}; the same command goes on from here"));
    ExitCode::from(EXIT_TO_BE_CONTINUED)
}

pub(super) fn refused_folder(error: ResultsError) -> anyhow::Result<ExitCode> {
    match error {
        ResultsError::Locked { .. }
        | ResultsError::Foreign { .. }
        | ResultsError::Empty { .. }
        | ResultsError::Overlapping { .. } => Ok(refused(&error.to_string())),
        ResultsError::Damaged { .. } | ResultsError::Unreadable { .. } | ResultsError::Unwritable { .. } => {
            Err(error.into())
        }
    }
}

/// Says how far some folders are, and writes what is asked for; nothing runs.
fn shown(arguments: &SweepArguments, folders: &[PathBuf]) -> anyhow::Result<ExitCode> {
    let status = match sweep::status(folders) {
        Ok(status) => status,
        Err(error) => return refused_folder(error),
    };
    let (header, progress) = (&status.index.header, &status.index.progress);
    let (job, hash, version) = (&header.job, &header.sweep, &header.solver_version);
    say(format!("{progress}\njob     {job}\nhash    {hash}\nsolver  {version}\n").as_bytes())?;
    for folder in &status.in_use {
        say(format!("{} is written to by another process\n", folder.display()).as_bytes())?;
    }
    Ok(write_shown(&status.index, &folders[0], arguments)?.unwrap_or_else(|| code_of(progress)))
}

/// The table where columns were chosen and the map that is asked for, beside the results of the first folder; gives the
/// exit code where there is no such map, or no room for it.
fn write_shown(index: &Index, folder: &Path, arguments: &SweepArguments) -> anyhow::Result<Option<ExitCode>> {
    if !index.header.columns.is_empty() {
        let path = folder.join(CSV_FILE);
        match write_whole(&path, |output| sweep::write_csv(index, output)) {
            Ok(empty_columns) => empty_columns.iter().for_each(|empty| tell(empty)),
            Err(TableError::Io(error)) => return unwritten(&path, error).map(Some),
            Err(error @ TableError::Results(_)) => return Err(error.into()),
        }
    }
    let Some(of) = &arguments.figure else { return Ok(None) };
    let svg = match sweep::map(index, of) {
        Ok(svg) => svg,
        Err(unfit @ MapError::Unfit(_)) => return Ok(Some(refused(&unfit.to_string()))),
        Err(unfit @ MapError::NoValue { .. }) => {
            tell(&unfit);
            return Ok(None);
        }
        Err(error @ MapError::Results(_)) => return Err(error.into()),
    };
    let path = folder.join(MAP_FILE);
    match write_whole(&path, |output| output.write_all(svg.as_bytes())) {
        Ok(()) => Ok(None),
        Err(error) => unwritten(&path, error).map(Some),
    }
}

/// The rows are there: once there is room again, the same command writes what shows them.
fn unwritten(path: &Path, error: io::Error) -> anyhow::Result<ExitCode> {
    let what = format!("{} cannot be written", path.display());
    let full = [io::ErrorKind::StorageFull, io::ErrorKind::QuotaExceeded, io::ErrorKind::FileTooLarge];
    if full.contains(&error.kind()) {
        Ok(to_be_continued(&format!("{what}: {error}")))
    } else {
        Err(error).context(what)
    }
}
