//! `slipdrive sweep`: many jobs of one kind on this machine, with results in a folder.

use std::fs::{self, File};
use std::io::{self, Cursor, Read, Write as _};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::thread;

use anyhow::Context as _;
use slipdrive::jobs::Jobs;
use slipdrive::metrics::Metrics;
use slipdrive::service::Service;
use slipdrive::sweep::{
    self, Ended, Header, Index, MapError, MapOf, Progress, Results, ResultsError, RowFaults, Sweep, SweepError,
    TableError, write_whole,
};
use tokio::sync::oneshot;

use super::progress_of_rows::ProgressOfRows;
use super::{is_standard_stream, refused, say, tell_faults};
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
                    let what = if is_standard_stream(file) { "standard input".into() } else { file.to_string_lossy() };
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
    if is_standard_stream(file) {
        return Sweep::read(Cursor::new(whole(io::stdin())?), jobs);
    }
    let source = File::open(file)?;
    // A pipe has no places to come back to.
    if source.metadata()?.is_file() {
        Sweep::read(source, jobs)
    } else {
        Sweep::read(Cursor::new(whole(source)?), jobs)
    }
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
        tell_faults(problem);
    }
    let others = faults.count - faults.first.len() as u64;
    if others > 0 {
        tell(&format_args!("error: {others} more rows break rules"));
    }
    ExitCode::from(EXIT_BAD_INPUT)
}

/// Runs what is missing.
fn run(sweep: &Sweep, folder: &Path, arguments: &SweepArguments) -> anyhow::Result<ExitCode> {
    // The folder of the same sweep says that its rows were judged.
    if let Ok(None) = Results::header_of(folder)
        && let Err(faults) = sweep.check(arguments.shard, workers(arguments))
    {
        return Ok(refused_rows(&faults));
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let mut signals = Signals::listen()?;
        let mut results = match opened(folder, sweep.header(arguments.shard), &mut signals).await? {
            Ok(results) => results,
            Err(code) => return Ok(code),
        };
        let service = Arc::new(Service::start(sweep::service_settings(workers(arguments)))?);
        let mut shown = ProgressOfRows::of(results.progress());
        let show = |progress: &Progress| shown.show(progress);
        let ended = sweep::run(sweep, &mut results, &service, show, signals.next()).await;
        shown.finish();
        let why = match ended {
            Ok(Ended::Complete) => return complete(results, folder, arguments, &mut signals).await,
            Ok(Ended::Stopped) => "stopped".to_owned(),
            Err(error) => error.to_string(),
        };
        tell_progress(&results, folder);
        Ok(to_be_continued(&why))
    })
}

/// Opens a folder; gives the exit code where it cannot be used, or a signal comes.
pub(super) async fn opened(
    folder: &Path,
    header: Header,
    signals: &mut Signals,
) -> anyhow::Result<Result<Results, ExitCode>> {
    let folder = folder.to_owned();
    match unless_stopped(signals, move || Results::open(&folder, header)).await? {
        Some(Ok(results)) => Ok(Ok(results)),
        Some(Err(error)) => refused_folder(error).map(Err),
        None => Ok(Err(to_be_continued("stopped"))),
    }
}

/// Shows what is complete; the exit code says whether all rows have answers.
pub(super) async fn complete(
    results: Results,
    folder: &Path,
    arguments: &SweepArguments,
    signals: &mut Signals,
) -> anyhow::Result<ExitCode> {
    tell_progress(&results, folder);
    let code = code_of(results.progress());
    drop(results);
    let (folder, figure) = (folder.to_owned(), arguments.figure.clone());
    let write = move || write_shown(&Index::of(std::slice::from_ref(&folder))?, &folder, figure.as_ref());
    match unless_stopped(signals, write).await? {
        Some(written) => Ok(written?.unwrap_or(code)),
        None => Ok(to_be_continued("stopped")),
    }
}

/// What comes of something that takes long and hears no signals; none where one comes before. It ends with the process
/// then, as if that were killed.
async fn unless_stopped<T: Send + 'static>(
    signals: &mut Signals,
    work: impl FnOnce() -> T + Send + 'static,
) -> anyhow::Result<Option<T>> {
    let (tell, outcome) = oneshot::channel();
    // Nobody may be told any more.
    thread::Builder::new().spawn(move || drop(tell.send(work())))?;
    tokio::select! {
        outcome = outcome => Ok(Some(outcome?)),
        () = signals.next() => Ok(None),
    }
}

pub(super) fn tell_progress(results: &Results, folder: &Path) {
    tell(&format_args!("{}: {}", folder.display(), results.progress()));
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

fn refused_folder(error: ResultsError) -> anyhow::Result<ExitCode> {
    match error {
        ResultsError::Unwritable { error: ref fault, .. } if is_full(fault) => Ok(to_be_continued(&error.to_string())),
        // A pod that takes the place of another may come while that one ends.
        ResultsError::Locked { .. } => Ok(to_be_continued(&error.to_string())),
        ResultsError::Foreign { .. } | ResultsError::Empty { .. } | ResultsError::Overlapping { .. } => {
            Ok(refused(&error.to_string()))
        }
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
    // One shard may be looked at alone.
    let elsewhere = if folders.len() > 1 { header.rows - progress.rows } else { 0 };
    if elsewhere > 0 {
        say(format!("{elsewhere} rows belong to shards that are not here\n").as_bytes())?;
    }
    let code = if elsewhere > 0 { ExitCode::from(EXIT_TO_BE_CONTINUED) } else { code_of(progress) };
    Ok(write_shown(&status.index, &folders[0], arguments.figure.as_ref())?.unwrap_or(code))
}

/// The table where columns were chosen and the map that is asked for, beside the results of the first folder; gives the
/// exit code where there is no such map, or no room for it.
fn write_shown(index: &Index, folder: &Path, figure: Option<&MapOf>) -> anyhow::Result<Option<ExitCode>> {
    if !index.header.columns.is_empty() {
        let path = folder.join(CSV_FILE);
        match write_whole(&path, |output| sweep::write_csv(index, output)) {
            Ok(empty_columns) => empty_columns.iter().for_each(|empty| tell(empty)),
            Err(TableError::Io(error)) => return unwritten(&path, error).map(Some),
            Err(error @ TableError::Results(_)) => return Err(error.into()),
        }
    }
    let Some(of) = figure else { return Ok(None) };
    let svg = match sweep::map(index, of) {
        Ok(svg) => svg,
        Err(unfit @ MapError::Unfit(_)) => return Ok(Some(refused(&unfit.to_string()))),
        Err(unfit @ MapError::NoValue { .. }) => {
            tell(&unfit);
            // One of other values would be taken for it.
            return match fs::remove_file(folder.join(MAP_FILE)) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error.into()),
                Ok(()) | Err(_) => Ok(None),
            };
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
    if is_full(&error) { Ok(to_be_continued(&format!("{what}: {error}"))) } else { Err(error).context(what) }
}

/// Whether there may be room again.
fn is_full(error: &io::Error) -> bool {
    [io::ErrorKind::StorageFull, io::ErrorKind::QuotaExceeded, io::ErrorKind::FileTooLarge].contains(&error.kind())
}
