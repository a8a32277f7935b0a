//! Starts logs and spans: logs go to standard error, so that standard output carries answers only; spans go to a
//! collector, in builds with the feature `otel`.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::io::{self, IsTerminal as _};
use std::panic::{self, PanicHookInfo};
use std::thread;

use anyhow::Context as _;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer, Registry};

use crate::config::{LogFormat, LogSettings};

#[cfg(feature = "otel")]
mod export;

/// Exports the remaining spans when it is dropped.
pub(crate) struct Exporter {
    #[cfg(feature = "otel")]
    _provider: Option<export::Provider>,
}

type BoxedLayer = Box<dyn Layer<Registry> + Send + Sync>;

/// Starts logging and, where it is built in and configured, the export of spans.
///
/// # Errors
/// When the log filter is invalid, or the exporter cannot be built.
pub(crate) fn start(settings: &LogSettings) -> anyhow::Result<Exporter> {
    let filter = EnvFilter::try_new(&settings.log)
        .with_context(|| format!("the log filter `{}` cannot be understood", settings.log))?;
    let lines = tracing_subscriber::fmt::layer().with_writer(io::stderr).with_ansi(io::stderr().is_terminal());
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
    Ok(Exporter {
        #[cfg(feature = "otel")]
        _provider: provider,
    })
}

/// Logs a panic in the configured format; the default hook would write several lines in a format of its own.
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
