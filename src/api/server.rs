//! Accepts connections, bounds their number and age, applies timeouts to them, and ends them gracefully.
//!
//! `axum::serve` keeps connections with half-sent heads and without requests open for ever, so each connection is
//! driven here: HTTP/1 and HTTP/2 on the same port, distinguished by their first bytes.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::Request;
use axum::http::Version;
use http_body_util::BodyExt as _;
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior, interval_at, sleep};
use tower::ServiceExt as _;

mod activity;
mod answer_body;
#[cfg(feature = "tls")]
pub mod tls;
mod write_timeout;

use activity::Activity;
use answer_body::AnswerBody;
use write_timeout::WriteTimeout;

/// Limits and timeouts of a server's connections.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerSettings {
    /// Connections that may be open at once; more wait in the listen backlog of the operating system.
    pub max_connections: usize,
    /// Requests of one HTTP/2 connection that may be open at once.
    pub max_streams: u32,
    /// How long a caller may take to send the head of a request, counted from the connection or from the end of the
    /// request before (HTTP/1), and for the TLS handshake before that.
    pub head_timeout: Duration,
    /// How long a caller may leave an answer unread; an HTTP/2 connection then takes no new requests, and is cut after
    /// the same time again.
    pub write_timeout: Duration,
    /// How often an HTTP/2 connection without traffic is pinged, and how long the reply may take.
    pub ping_interval: Duration,
    /// How long an HTTP/2 connection may stay without a request.
    pub idle_timeout: Duration,
    /// Age at which a connection takes no new requests, so that load spreads over replicas.
    pub max_age: Duration,
    /// How long the requests of an aged connection may take to end.
    pub age_grace: Duration,
    /// Certificate and key of the server; with them it speaks TLS only, without them plain text only.
    #[cfg(feature = "tls")]
    pub identity: Option<tls::Identity>,
}

impl Default for ServerSettings {
    fn default() -> Self {
        Self {
            max_connections: 1024,
            max_streams: 128,
            head_timeout: Duration::from_secs(30),
            write_timeout: Duration::from_secs(30),
            ping_interval: Duration::from_secs(20),
            idle_timeout: Duration::from_secs(5 * 60),
            max_age: Duration::from_secs(30 * 60),
            age_grace: Duration::from_secs(2 * 60),
            #[cfg(feature = "tls")]
            identity: None,
        }
    }
}

/// Flow-control window of one HTTP/2 stream for requests, bytes.
const STREAM_WINDOW_BYTES: u32 = 64 * 1024;
/// Flow-control window of a whole connection for requests, bytes: several times that of a stream, so that a batch that
/// the server has stopped reading blocks no other call.
const CONNECTION_WINDOW_BYTES: u32 = 1024 * 1024;

/// How long to wait after the system refused a connection because too many files are open, until some are closed.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Serves until `shutdown` is ready, then closes the listener, shuts the connections down gracefully, and returns when
/// the last answer is written.
pub async fn serve(
    listener: TcpListener,
    router: Router,
    settings: ServerSettings,
    shutdown: impl Future<Output = ()> + Send,
) {
    let (closing, is_closing) = watch::channel(false);
    let mut connections = JoinSet::new();
    let permits = Arc::new(Semaphore::new(settings.max_connections));
    tokio::pin!(shutdown);
    loop {
        let accepted = async {
            let permit = Arc::clone(&permits).acquire_owned().await;
            (permit, listener.accept().await)
        };
        tokio::select! {
            () = &mut shutdown => break,
            // Removes connections that have ended, which the set would keep otherwise.
            Some(_) = connections.join_next(), if !connections.is_empty() => {}
            (permit, accepted) = accepted => match accepted {
                Ok((stream, _)) => {
                    let (router, settings, is_closing) = (router.clone(), settings.clone(), is_closing.clone());
                    connections.spawn(async move {
                        let _permit = permit;
                        receive(stream, router, &settings, is_closing).await;
                    });
                }
                Err(error) => pause_after(&error).await,
            },
        }
    }
    drop(listener);
    closing.send_replace(true);
    while connections.join_next().await.is_some() {}
}

async fn pause_after(error: &io::Error) {
    let is_of_one_connection = matches!(
        error.kind(),
        io::ErrorKind::ConnectionAborted | io::ErrorKind::ConnectionReset | io::ErrorKind::ConnectionRefused
    );
    if !is_of_one_connection {
        tracing::error!(error = %error, "a connection cannot be accepted");
        sleep(ACCEPT_PAUSE).await;
    }
}

/// Receives one connection, plain or under TLS.
async fn receive(stream: TcpStream, router: Router, settings: &ServerSettings, is_closing: watch::Receiver<bool>) {
    // Answers are written in one piece: Nagle's wait for more to send only adds delay.
    if let Err(error) = stream.set_nodelay(true) {
        tracing::debug!(error = %error, "a connection keeps its send delay");
    }
    #[cfg(feature = "tls")]
    if let Some(identity) = &settings.identity {
        if let Some(stream) = identity.shake_hands(stream, settings.head_timeout, is_closing.clone()).await {
            drive(stream, router, settings, is_closing).await;
        }
        return;
    }
    drive(stream, router, settings, is_closing).await;
}

/// Drives one connection to its end.
async fn drive<S: AsyncRead + AsyncWrite + Unpin + Send + 'static>(
    stream: S,
    router: Router,
    settings: &ServerSettings,
    mut is_closing: watch::Receiver<bool>,
) {
    let activity = Arc::new(Activity::default());
    let io = TokioIo::new(WriteTimeout::new(stream, settings.write_timeout, Arc::clone(&activity)));
    let builder = builder(settings);
    let connection = builder.serve_connection(io, service(router, Arc::clone(&activity)));
    tokio::pin!(connection);

    let silent = sleep(settings.head_timeout);
    let aged = sleep(settings.max_age);
    let expired = sleep(settings.max_age + settings.age_grace);
    tokio::pin!(silent, aged, expired);
    let mut idle = interval_at(Instant::now() + settings.idle_timeout, settings.idle_timeout);
    // Beside the write timeout of the connection: an answer that waits for the window of its HTTP/2 stream is not yet
    // written to the connection.
    let mut unread = interval_at(Instant::now() + settings.write_timeout, settings.write_timeout);
    unread.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut is_watched, mut is_ending, mut seen, mut unread_until) = (true, false, 0, None);
    loop {
        let must_end = tokio::select! {
            ended = &mut connection => {
                if let Err(error) = ended {
                    tracing::debug!(error = %error, "a connection failed");
                }
                return;
            }
            // Until the first bytes show which protocol it is, hyper runs no timer of its own.
            () = &mut silent, if is_watched => {
                if !activity.has_sent_preface() {
                    return;
                }
                is_watched = false;
                false
            }
            _ = is_closing.wait_for(|closing| *closing), if !is_ending => true,
            () = &mut aged, if !is_ending => true,
            () = &mut expired => return,
            _ = idle.tick() => activity.is_idle_since(&mut seen),
            now = unread.tick() => match unread_until {
                _ if !activity.is_unread_for(settings.write_timeout) => {
                    unread_until = None;
                    false
                }
                None => {
                    unread_until = Some(now + settings.write_timeout);
                    true
                }
                Some(end) if now >= end => return,
                Some(_) => false,
            },
        };
        if must_end && !is_ending {
            is_ending = true;
            connection.as_mut().graceful_shutdown();
        }
    }
}

fn builder(settings: &ServerSettings) -> auto::Builder<TokioExecutor> {
    let mut builder = auto::Builder::new(TokioExecutor::new());
    builder.http1().timer(TokioTimer::new()).header_read_timeout(settings.head_timeout);
    builder
        .http2()
        .timer(TokioTimer::new())
        .keep_alive_interval(settings.ping_interval)
        .keep_alive_timeout(settings.ping_interval)
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .max_concurrent_streams(settings.max_streams);
    builder
}

fn service(
    router: Router,
    activity: Arc<Activity>,
) -> impl hyper::service::Service<
    Request<Incoming>,
    Response = axum::response::Response,
    Error = std::convert::Infallible,
    Future: Send + 'static,
> {
    service_fn(move |request: Request<Incoming>| {
        let (router, under_way) = (router.clone(), Activity::enter(&activity));
        async move {
            let version = request.version();
            let response = router.oneshot(request.map(Body::new)).await?;
            // The body holds `under_way`, so that the request counts until its answer is written or dropped.
            Ok(response.map(|body| match version {
                Version::HTTP_2 => Body::new(AnswerBody::new(body, under_way)),
                _ => Body::new(body.map_frame(move |frame| {
                    let _ = &under_way;
                    frame
                })),
            }))
        }
    })
}
