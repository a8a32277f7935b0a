//! The transports: REST and gRPC over the same jobs, and the connections that carry them.

mod access;
pub mod auth;
mod batch;
pub mod grpc;
mod open_line;
mod panic;
mod read_ahead;
mod receive;
pub mod rest;
pub mod server;
mod submit;
mod trace_context;

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use auth::ApiKeys;
use axum::http::HeaderValue;

use crate::contract::ErrorCode;
use crate::jobs::Jobs;
use crate::service::Service;

/// What the transports need beside the service.
#[derive(Debug, Clone)]
pub struct ApiSettings {
    /// Who may call.
    pub keys: ApiKeys,
    /// Items of one batch that may be unanswered at once.
    pub batch_window: NonZeroUsize,
    /// How long the body of a request, or the message of a call, may take to arrive.
    pub body_timeout: Duration,
    /// Where probes and metrics are answered.
    pub probes: Probes,
    /// Origins whose pages may call REST from a browser; none by default.
    pub cors_origins: Vec<HeaderValue>,
}

/// Where `/livez`, `/readyz` and `/metrics` are answered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Probes {
    /// Beside the API.
    #[default]
    WithApi,
    /// On a port of their own.
    Apart,
}

/// What a problem says whose cause is no matter of the caller.
const CAUSE_IS_LOGGED: &str = "the log of the server has the cause";

/// What every request needs, whichever way it came: one for all routers of a server.
#[derive(Clone)]
pub struct ApiState {
    service: Arc<Service>,
    jobs: Jobs,
    settings: Arc<ApiSettings>,
    documents: Arc<rest::Documents>,
}

impl ApiState {
    /// These jobs over this service.
    pub fn new(service: Arc<Service>, jobs: Jobs, settings: ApiSettings) -> Self {
        let codes = ErrorCode::ALL.into_iter().filter(|code| *code != ErrorCode::Cancelled);
        // One who left reads nothing: that code is never answered.
        service.metrics().expect_rejections(codes.map(|code| code.entry().code));
        settings.keys.callers().iter().for_each(|caller| service.metrics().expect_caller(caller));
        Self { service, jobs, settings: Arc::new(settings), documents: Arc::default() }
    }
}

impl Default for ApiSettings {
    fn default() -> Self {
        Self {
            keys: ApiKeys::default(),
            // Enough to keep the workers of a large machine busy, few enough to share them.
            batch_window: NonZeroUsize::new(16).unwrap_or(NonZeroUsize::MIN),
            // A caller that sends the largest body over the slowest mobile link needs less.
            body_timeout: Duration::from_secs(30),
            probes: Probes::default(),
            cors_origins: Vec::new(),
        }
    }
}
