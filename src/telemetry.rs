//! Starts logs and spans: logs go to standard error, so that standard output carries answers only; spans go to a
//! collector, in builds with the feature `otel`.
//!
//! A thread of its own writes the log: whoever does not read it blocks that thread alone. Lines that find no room are
//! dropped, and counted with those that cannot be written.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::io::{self, IsTerminal as _, Write};
use std::panic::{self, PanicHookInfo};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use slipdrive::service::words_of_panic;
use tracing_appender::non_blocking::{ErrorCounter, NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer, Registry};

use crate::config::{LogFormat, LogSettings};

#[cfg(feature = "otel")]
mod export;
#[cfg(feature = "otel")]
pub(crate) use export::check;

/// Lines that wait to be written: those of a second under full load, less than a MB.
const WAITING_LINES: usize = 1024;
/// How long the last lines may take to be written; longer than the writer's own time for that, 1.1 s.
const LAST_LINES_TIMEOUT: Duration = Duration::from_secs(2);

/// Exports the remaining spans and writes the remaining lines when it is dropped.
pub(crate) struct Telemetry {
    // In this order: the exporter may have a last line to write.
    #[cfg(feature = "otel")]
    _provider: Option<export::Provider>,
    lines: Lines,
}

impl Telemetry {
    /// Gives the number of lines that were lost so far: those that found no room, and those that could not be written.
    pub(crate) fn lost_lines(&self) -> impl Fn() -> u64 + Send + Sync + use<> {
        let (dropped, failed) = (self.lines.dropped.clone(), Arc::clone(&self.lines.failed));
        move || dropped.dropped_lines() as u64 + failed.load(Ordering::Relaxed)
    }
}

/// The writer of the log; writes what is left when it is dropped.
struct Lines {
    dropped: ErrorCounter,
    failed: Arc<AtomicU64>,
    writer: Option<WorkerGuard>,
}

/// Standard error, with the number of lines that it did not take: it may be a full disk, or a pipe whose reader has gone.
#[derive(Default)]
struct StandardError {
    failed: Arc<AtomicU64>,
}

impl Write for StandardError {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        io::stderr().write(bytes)
    }

    fn write_all(&mut self, line: &[u8]) -> io::Result<()> {
        let written = io::stderr().write_all(line);
        self.failed.fetch_add(u64::from(written.is_err()), Ordering::Relaxed);
        written
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        let (done, is_done) = channel();
        let writer = self.writer.take();
        // On a thread of its own, because a writer that nobody reads complains on standard output, which may be blocked too.
        // When the system refuses the thread, the writer is dropped here.
        let _ = thread::Builder::new().spawn(move || {
            drop(writer);
            // Sending fails when nobody waits any more.
            let _ = done.send(());
        });
        // An error means that the time is over: the lines are lost.
        let _ = is_done.recv_timeout(LAST_LINES_TIMEOUT);
    }
}

type BoxedLayer = Box<dyn Layer<Registry> + Send + Sync>;

/// Starts logging and, where it is built in and configured, the export of spans.
///
/// # Errors
/// When the log filter is invalid, or the exporter cannot be built.
pub(crate) fn start(settings: &LogSettings) -> anyhow::Result<Telemetry> {
    let filter = EnvFilter::try_new(&settings.log)
        .with_context(|| format!("the log filter `{}` cannot be understood", settings.log))?;
    let writer = NonBlockingBuilder::default().lossy(true).buffered_lines_limit(WAITING_LINES);
    let output = StandardError::default();
    let failed = Arc::clone(&output.failed);
    let (writer, guard) = writer.thread_name("slipdrive-log").finish(output);
    let written = Lines { dropped: writer.error_counter(), failed, writer: Some(guard) };
    let lines = tracing_subscriber::fmt::layer().with_writer(writer).with_ansi(has_colors());
    let lines: BoxedLayer = match settings.log_format {
        LogFormat::Text => lines.with_filter(filter).boxed(),
        LogFormat::Json => lines.json().flatten_event(true).with_filter(filter).boxed(),
    };
    #[cfg_attr(not(feature = "otel"), expect(unused_mut, reason = "the exporter adds its own"))]
    let mut layers = vec![lines];
    #[cfg(feature = "otel")]
    let provider = export::provider()?;
    #[cfg(feature = "otel")]
    layers.extend(provider.as_ref().map(|provider| provider.layer().boxed()));
    tracing_subscriber::registry().with(layers).init();
    panic::set_hook(Box::new(log_panic));
    Ok(Telemetry {
        #[cfg(feature = "otel")]
        _provider: provider,
        lines: written,
    })
}

/// Logs a panic in the configured format; the default hook would write several lines in a format of its own.
fn log_panic(panic: &PanicHookInfo<'_>) {
    let backtrace = Backtrace::capture();
    tracing::error!(
        panic.message = words_of_panic(panic.payload()),
        panic.location = panic.location().map(tracing::field::display),
        panic.backtrace =
            (backtrace.status() == BacktraceStatus::Captured).then(|| tracing::field::display(&backtrace)),
        thread.name = thread::current().name(),
        "a thread panicked"
    );
}

/// Whether lines may have colours: on a terminal, unless `NO_COLOR` is set to anything.
fn has_colors() -> bool {
    io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|given| given.is_empty())
}
