//! Logs: to standard error, so that standard output carries answers only.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::io::{self, IsTerminal as _};
use std::panic::{self, PanicHookInfo};
use std::thread;

use anyhow::Context as _;
use tracing_subscriber::EnvFilter;

use crate::config::{LogArguments, LogFormat};

/// Starts logging.
///
/// # Errors
/// When the filter cannot be understood.
pub(crate) fn start(arguments: &LogArguments) -> anyhow::Result<()> {
    let filter = EnvFilter::try_new(&arguments.filter)
        .with_context(|| format!("the log filter `{}` cannot be understood", arguments.filter))?;
    let lines =
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(io::stderr).with_ansi(io::stderr().is_terminal());
    match arguments.format {
        LogFormat::Text => lines.init(),
        LogFormat::Json => lines.json().flatten_event(true).init(),
    }
    panic::set_hook(Box::new(log_panic));
    Ok(())
}

/// Panics are lines of the log like all others; the default hook writes several lines, in its own form.
fn log_panic(panic: &PanicHookInfo<'_>) {
    let backtrace = Backtrace::capture();
    let payload = panic.payload();
    let message = payload.downcast_ref::<&str>().copied().or_else(|| payload.downcast_ref().map(String::as_str));
    tracing::error!(
        panic.message = message,
        panic.location = panic.location().map(tracing::field::display),
        panic.backtrace =
            (backtrace.status() == BacktraceStatus::Captured).then(|| tracing::field::display(&backtrace)),
        thread.name = thread::current().name(),
        "a thread panicked"
    );
}
