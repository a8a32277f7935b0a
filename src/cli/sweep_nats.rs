//! `slipdrive sweep --nats`: a sweep that workers elsewhere run.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use slipdrive::sweep::nats::{self, Broker, Collected, NatsError, Sending, Wanted};
use slipdrive::sweep::{Results, Shard, Sweep};
use tokio::time::sleep;

use super::progress_of_rows::{ProgressLine, ProgressOfRows};
use super::sweep::{complete, opened, refused_rows, tell_progress, to_be_continued, workers};
use super::{refused, say};
use crate::config::{NatsArguments, SweepArguments};
use crate::shutdown::Signals;
use crate::tell;

/// How long to wait until something is tried again.
const RETRY_PAUSE: Duration = Duration::from_secs(2);

/// Publishes a sweep, collects it, or takes it back.
///
/// # Errors
/// What cannot be read or written, and servers that do not do what they should.
pub(super) fn sweep(sweep: &Sweep, folders: &[PathBuf], arguments: &SweepArguments) -> anyhow::Result<ExitCode> {
    let over = &arguments.nats;
    if arguments.shard != Shard::WHOLE {
        return Ok(refused("`--shard` does not go with `--nats`: the workers share the chunks"));
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    if over.cancel {
        return runtime.block_on(cancel(sweep, &over.nats));
    }
    if let Err(faults) = sweep.check(Shard::WHOLE, workers(arguments)) {
        return Ok(refused_rows(&faults));
    }
    match folders {
        [] => runtime.block_on(async {
            let (broker, mut signals) = (connected(&over.nats).await?, Signals::listen()?);
            let wanted = Wanted { sweep, results: None };
            let published = publish(wanted, Sending::Once, &broker, &mut signals).await?;
            Ok(published.unwrap_or(ExitCode::SUCCESS))
        }),
        [folder] => runtime.block_on(run(sweep, folder, arguments)),
        _ => Ok(refused("there must be one `--out` for the results")),
    }
}

async fn connected(arguments: &NatsArguments) -> Result<Broker, NatsError> {
    let access = arguments.access().unwrap_or_default();
    Broker::connect(&access, arguments.limits()).await
}

/// Publishes what is missing; gives the exit code where not all is published.
async fn publish(
    wanted: Wanted<'_>,
    sending: Sending,
    broker: &Broker,
    signals: &mut Signals,
) -> anyhow::Result<Option<ExitCode>> {
    let mut line = ProgressLine::new(wanted.sweep.chunk_count());
    let show = |published: &nats::Published| line.show(published.published, || published.to_string());
    let published = nats::publish(wanted, broker, sending, show, signals.next()).await?;
    line.finish();
    tell(&published);
    Ok(if published.is_complete() { None } else { Some(to_be_continued("stopped")) })
}

/// Publishes again what the server has lost, however long it is away.
async fn publish_again(wanted: Wanted<'_>, broker: &Broker, signals: &mut Signals) -> anyhow::Result<Option<ExitCode>> {
    loop {
        match publish(wanted, Sending::Again, broker, signals).await {
            Ok(published) => return Ok(published),
            Err(error) => tell(&format_args!("{error}; trying again")),
        }
        tokio::select! {
            () = signals.next() => return Ok(Some(to_be_continued("stopped"))),
            () = sleep(RETRY_PAUSE) => {}
        }
    }
}

/// Publishes and collects until all rows are there.
async fn run(sweep: &Sweep, folder: &Path, arguments: &SweepArguments) -> anyhow::Result<ExitCode> {
    let mut signals = Signals::listen()?;
    // A folder that cannot be written to is refused before anything is published.
    let mut results = match opened(folder, sweep.header(Shard::WHOLE), &mut signals).await? {
        Ok(results) => results,
        Err(code) => return Ok(code),
    };
    if results.progress().is_complete() {
        return complete(results, folder, arguments, &mut signals).await;
    }
    let is_publisher = !arguments.nats.collect;
    let broker = tokio::select! {
        broker = connected(&arguments.nats.nats) => broker?,
        () = signals.next() => return Ok(to_be_continued("stopped")),
    };
    let mut unfinished = None;
    if is_publisher {
        let wanted = Wanted { sweep, results: Some(&results) };
        unfinished = publish(wanted, Sending::Once, &broker, &mut signals).await?;
    }
    loop {
        if let Some(code) = unfinished {
            return Ok(code);
        }
        let ended = match collect(sweep, &mut results, &broker, &mut signals).await {
            Ok(ended) => ended,
            Err(NatsError::Io(error)) => return Ok(to_be_continued(&error.to_string())),
            Err(error) => return Err(error.into()),
        };
        let why = match ended {
            Collected::Complete => return complete(results, folder, arguments, &mut signals).await,
            Collected::Stopped => "stopped",
            Collected::Cancelled => "the sweep is cancelled; without `--collect`",
            Collected::Unpublished if is_publisher => {
                tell(&"rows without results have no chunks; these are published again");
                let wanted = Wanted { sweep, results: Some(&results) };
                unfinished = publish_again(wanted, &broker, &mut signals).await?;
                continue;
            }
            Collected::Unpublished => "rows without results have no chunks; without `--collect`",
        };
        tell_progress(&results, folder);
        return Ok(to_be_continued(why));
    }
}

async fn collect(
    sweep: &Sweep,
    results: &mut Results,
    broker: &Broker,
    signals: &mut Signals,
) -> Result<Collected, NatsError> {
    let mut shown = ProgressOfRows::of(results.progress());
    let ended = nats::collect(sweep.hash(), results, broker, |progress| shown.show(progress), signals.next()).await;
    shown.finish();
    ended
}

async fn cancel(sweep: &Sweep, arguments: &NatsArguments) -> anyhow::Result<ExitCode> {
    let taken = nats::cancel(sweep.hash(), &connected(arguments).await?).await?;
    say(format!("{taken} chunks are taken back; the results stay\n").as_bytes())?;
    Ok(ExitCode::SUCCESS)
}
