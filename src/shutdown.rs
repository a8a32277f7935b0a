//! Runs a server from its listeners to its last answer, so that no solve in flight is lost on a stop signal.
//!
//! On the first signal the service reports that it is not ready (`/readyz` 503, gRPC health `NOT_SERVING`, `Connection:
//! close`) and still takes work for the drain delay, until load balancers have noticed. Then it takes none, which HTTP/2
//! is told at once (GOAWAY), while the listeners stay open for the probes; when the solves in flight have ended, the
//! listeners close and the last answers are written. Solves that outlast the drain timeout, or a second signal, are cut
//! off and answered as unavailable.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use axum::Router;
use slipdrive::api::ApiState;
use slipdrive::api::grpc::{self, Health};
use slipdrive::api::rest;
use slipdrive::api::server::{self, Connections};
use slipdrive::jobs::{InProcessSolver, Jobs, Limits};
use slipdrive::service::{Service, ServiceSettings};
use tokio::net::{TcpListener, TcpSocket};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use crate::config::{ServerConfig, for_probes};
use crate::heap;
use crate::reload::{Hangups, Reload};

/// How long callers may take to read their last answer: one that does not read must not keep the process alive.
const LAST_ANSWER_TIMEOUT: Duration = Duration::from_secs(5);

/// Connections that may wait to be accepted: where many crowd, those beyond would have to knock again after a second. The
/// system may have a lower limit.
const BACKLOG: u32 = 4096;

/// Serves until a signal comes and all work in flight has ended.
///
/// # Errors
/// When the address cannot be bound or the server fails.
pub(crate) fn serve_until_stopped(
    config: &ServerConfig,
    lost_lines: impl Fn() -> u64 + Send + Sync + 'static,
) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().thread_name("slipdrive-http").build()?;
    let result = runtime.block_on(serve(config, lost_lines));
    // Without waiting: connections that are still open have had their timeout.
    runtime.shutdown_background();
    result
}

async fn serve(config: &ServerConfig, lost_lines: impl Fn() -> u64 + Send + Sync + 'static) -> anyhow::Result<()> {
    let (mut signals, hangups) = (Signals::listen()?, Hangups::listen()?);
    let listeners = Listeners::bind(config)?;
    let settings = config.service_settings();
    let threads = || format!("the threads of {} workers cannot be started", settings.workers);
    let service = Arc::new(Service::start(settings).with_context(threads)?);
    service.metrics().follow_dropped_lines(lost_lines);
    listeners.report(&settings)?;
    tokio::spawn(heap::give_back_regularly());
    tokio::spawn(Reload::of(config, service.metrics()).run(hangups));
    let (mut servers, health) = start_servers(&service, listeners, config).await?;
    tokio::select! {
        _ = servers.tasks.join_next() => anyhow::bail!("a server ended by itself"),
        () = signals.next() => {}
    }
    drain(&service, &servers, &health, &mut signals, config).await;
    servers.close();
    if timeout(LAST_ANSWER_TIMEOUT, async { while servers.tasks.join_next().await.is_some() {} }).await.is_err() {
        tracing::warn!("some callers did not take their last answer in time");
    }
    tracing::info!("stopped");
    Ok(())
}

/// The bound listeners; gRPC and probes may share that of REST.
struct Listeners {
    http: TcpListener,
    grpc: Option<TcpListener>,
    admin: Option<TcpListener>,
}

impl Listeners {
    fn bind(config: &ServerConfig) -> anyhow::Result<Self> {
        let settings = &config.settings;
        let http = bind(settings.http)?;
        let grpc = if settings.one_port { None } else { Some(bind(settings.grpc)?) };
        let admin = match settings.admin {
            Some(address) => Some(bind(address)?),
            None => None,
        };
        Ok(Self { http, grpc, admin })
    }

    /// Logs the bound addresses: with port 0 only the system knows them.
    fn report(&self, settings: &ServiceSettings) -> io::Result<()> {
        tracing::info!(
            http.address = %self.http.local_addr()?,
            grpc.address = %self.grpc.as_ref().unwrap_or(&self.http).local_addr()?,
            admin.address = %self.admin.as_ref().unwrap_or(&self.http).local_addr()?,
            queue.workers = settings.workers,
            queue.length = settings.queue_length,
            "listening"
        );
        Ok(())
    }
}

fn bind(address: SocketAddr) -> anyhow::Result<TcpListener> {
    listen(address).with_context(|| format!("{address} cannot be bound"))
}

fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    #[cfg(unix)]
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// The running servers, their connections, and the way to close their listeners.
pub(crate) struct Servers {
    tasks: JoinSet<()>,
    connections: Arc<Connections>,
    closing: watch::Sender<bool>,
}

impl Servers {
    fn spawn(&mut self, listener: TcpListener, router: Router) {
        let serving = server::serve(listener, router, Arc::clone(&self.connections), self.closed());
        self.tasks.spawn(serving);
    }

    /// Probes have threads and connections of their own, so that no load on the others delays them.
    fn spawn_apart(&mut self, listener: TcpListener, router: Router, connections: Arc<Connections>) -> io::Result<()> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (listener, closed) = (listener.into_std()?, self.closed());
        self.tasks.spawn_blocking(move || {
            runtime.block_on(async {
                match TcpListener::from_std(listener) {
                    Ok(listener) => server::serve(listener, router, connections, closed).await,
                    Err(error) => tracing::error!(error = %error, "the admin port cannot be served"),
                }
            });
        });
        Ok(())
    }

    /// Waits until the listeners are to be closed.
    fn closed(&self) -> impl Future<Output = ()> + Send + use<> {
        let mut closing = self.closing.subscribe();
        async move {
            // An error means that the sender was dropped, which closes the listeners too.
            let _ = closing.wait_for(|closing| *closing).await;
        }
    }

    fn close(&self) {
        self.closing.send_replace(true);
    }
}

/// Serves probes and metrics alone, on a thread of their own until what it gives is dropped.
///
/// # Errors
/// When the address cannot be bound.
#[cfg(feature = "nats")]
pub(crate) fn serve_probes(address: SocketAddr, service: &Arc<Service>, jobs: Jobs) -> anyhow::Result<Servers> {
    use slipdrive::api::server::ServerSettings;
    use slipdrive::api::{ApiSettings, Probes};

    let settings = ApiSettings { probes: Probes::Apart, ..ApiSettings::default() };
    let state = ApiState::new(Arc::clone(service), jobs, settings);
    let connections = Connections::of(&state, for_probes(&ServerSettings::default()));
    let closing = watch::Sender::new(false);
    let mut servers = Servers { tasks: JoinSet::new(), connections: Arc::clone(&connections), closing };
    let listener = bind(address)?;
    tracing::info!(admin.address = %listener.local_addr()?, "listening");
    servers.spawn_apart(listener, rest::admin_router(&state), connections)?;
    Ok(servers)
}

/// Starts REST and gRPC, on a listener each or on one together; probes are served with REST, or on a listener of their
/// own.
async fn start_servers(
    service: &Arc<Service>,
    listeners: Listeners,
    config: &ServerConfig,
) -> io::Result<(Servers, Health)> {
    let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
    let state = ApiState::new(Arc::clone(service), jobs, config.api_settings());
    let connections = Connections::of(&state, config.server.clone());
    let mut servers = Servers { tasks: JoinSet::new(), connections, closing: watch::Sender::new(false) };
    let rest_router = rest::router(&state);
    if let Some(admin) = listeners.admin {
        let connections = Connections::of(&state, for_probes(&config.server));
        servers.spawn_apart(admin, rest::admin_router(&state), connections)?;
    }
    let (grpc_router, health) = grpc::router(&state).await;
    match listeners.grpc {
        Some(grpc) => {
            servers.spawn(listeners.http, rest_router);
            servers.spawn(grpc, grpc_router);
        }
        // Routers with two fallbacks cannot be merged, and of two that have none of their own the later one answers: that of REST.
        None => servers.spawn(listeners.http, grpc_router.reset_fallback().merge(rest_router)),
    }
    Ok((servers, health))
}

async fn drain(
    service: &Arc<Service>,
    servers: &Servers,
    health: &Health,
    signals: &mut Signals,
    config: &ServerConfig,
) {
    health.announce_end().await;
    service.announce_end();
    servers.connections.announce_end();
    tracing::info!(queue.in_flight = service.jobs_in_flight(), "draining");
    let has_time = tokio::select! {
        () = sleep(config.settings.drain_delay_s) => true,
        () = signals.next() => false,
    };
    service.close();
    servers.connections.close();
    tracing::info!(queue.in_flight = service.jobs_in_flight(), "taking no more work");
    let mut ended = {
        let service = Arc::clone(service);
        tokio::task::spawn_blocking(move || service.join())
    };
    if has_time {
        tokio::select! {
            _ = &mut ended => return,
            () = sleep(config.settings.drain_timeout_s) => {}
            () = signals.next() => {}
        }
    }
    tracing::warn!(queue.in_flight = service.jobs_in_flight(), "cutting off the solves in flight");
    service.cancel_all();
    if timeout(LAST_ANSWER_TIMEOUT, ended).await.is_err() {
        tracing::error!("a solve does not obey its stop flag");
    }
}

/// Ctrl-C and, where there is such, the terminate signal.
pub(crate) struct Signals {
    #[cfg(unix)]
    interrupt: tokio::signal::unix::Signal,
    #[cfg(unix)]
    terminate: tokio::signal::unix::Signal,
}

impl Signals {
    #[cfg(unix)]
    pub(crate) fn listen() -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        // Once it is taken it ends nothing: a file that may not grow is an error of its write.
        let _ = signal(SignalKind::from_raw(libc::SIGXFSZ))?;
        Ok(Self { interrupt: signal(SignalKind::interrupt())?, terminate: signal(SignalKind::terminate())? })
    }

    #[cfg(not(unix))]
    pub(crate) fn listen() -> io::Result<Self> {
        Ok(Self {})
    }

    #[cfg(unix)]
    pub(crate) async fn next(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }

    #[cfg(not(unix))]
    pub(crate) async fn next(&mut self) {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}
