//! The life of a server: from the listener to the last answer.
//!
//! On the first signal the service takes no more work (`/readyz` 503) while the listener stays open for the probes;
//! when the solves in flight have ended, the listener closes and the last answers are written. Solves that outlast the
//! drain timeout, or a second signal, are cut off and answered as unavailable.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use slipdrive::api::rest;
use slipdrive::service::{InProcessSolver, Service};
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::time::{sleep, timeout};

use crate::config::ServeArguments;

/// How long callers may take to read their last answer: a silent one must not hold the process.
const LAST_ANSWER_TIMEOUT: Duration = Duration::from_secs(5);

/// Serves until a signal comes and all work in flight has ended.
///
/// # Errors
/// When the address cannot be bound or the server fails.
pub(crate) fn serve_until_stopped(arguments: &ServeArguments) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().thread_name("slipdrive-http").build()?;
    let result = runtime.block_on(serve(arguments));
    // Without waiting: what is still open has had its time.
    runtime.shutdown_background();
    result
}

async fn serve(arguments: &ServeArguments) -> anyhow::Result<()> {
    let mut signals = Signals::listen()?;
    let listener =
        TcpListener::bind(arguments.http).await.with_context(|| format!("{} cannot be bound", arguments.http))?;
    let address = listener.local_addr()?;
    let settings = arguments.service_settings();
    let service = Arc::new(Service::start(settings, Arc::new(InProcessSolver))?);
    let (close_listener, listener_closed) = oneshot::channel::<()>();
    let closed = async {
        // A dropped sender closes it too.
        let _ = listener_closed.await;
    };
    let mut server = tokio::spawn(rest::serve(listener, Arc::clone(&service), closed));
    tracing::info!(
        http.address = %address,
        queue.workers = settings.workers,
        queue.length = settings.queue_length,
        "listening"
    );

    tokio::select! {
        ended = &mut server => return ended?.context("the server ended by itself"),
        () = signals.next() => {}
    }
    drain(&service, &mut signals, Duration::from_secs(arguments.drain_timeout_s)).await;
    drop(close_listener);
    if let Ok(ended) = timeout(LAST_ANSWER_TIMEOUT, server).await {
        ended??;
    } else {
        tracing::warn!("some callers did not take their last answer in time");
    }
    tracing::info!("stopped");
    Ok(())
}

async fn drain(service: &Arc<Service>, signals: &mut Signals, limit: Duration) {
    service.close();
    tracing::info!(queue.in_flight = service.jobs_in_flight(), "draining");
    let mut ended = {
        let service = Arc::clone(service);
        tokio::task::spawn_blocking(move || service.join())
    };
    tokio::select! {
        _ = &mut ended => return,
        () = sleep(limit) => {}
        () = signals.next() => {}
    }
    tracing::warn!(queue.in_flight = service.jobs_in_flight(), "cutting off the solves in flight");
    service.cancel_all();
    if timeout(LAST_ANSWER_TIMEOUT, ended).await.is_err() {
        tracing::error!("a solve does not heed its stop flag");
    }
}

/// Ctrl-C and, where there is one, the terminate signal.
struct Signals {
    #[cfg(unix)]
    interrupt: tokio::signal::unix::Signal,
    #[cfg(unix)]
    terminate: tokio::signal::unix::Signal,
}

impl Signals {
    #[cfg(unix)]
    fn listen() -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self { interrupt: signal(SignalKind::interrupt())?, terminate: signal(SignalKind::terminate())? })
    }

    #[cfg(not(unix))]
    fn listen() -> io::Result<Self> {
        Ok(Self {})
    }

    #[cfg(unix)]
    async fn next(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }

    #[cfg(not(unix))]
    async fn next(&mut self) {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}
