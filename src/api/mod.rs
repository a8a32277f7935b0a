//! The transports: they turn wire types into domain types and back, and errors into one table of codes.

mod access;
pub mod auth;
pub mod error_table;
pub mod grpc;
mod message;
mod problem;
pub mod rest;
pub mod server;

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use auth::ApiKeys;
use axum::http::HeaderValue;

use crate::service::Service;

/// What the transports need beside the service.
#[derive(Debug, Clone)]
pub struct ApiSettings {
    /// Who may call.
    pub keys: ApiKeys,
    /// Items of one gRPC batch that may be unanswered at once.
    pub batch_window: NonZeroUsize,
    /// How long the body of a request, or the message of a call, may take to arrive.
    pub body_timeout: Duration,
    /// Origins whose pages may call REST from a browser; none by default.
    pub cors_origins: Vec<HeaderValue>,
}

/// What every request needs, whichever way it came.
#[derive(Clone)]
struct Door {
    service: Arc<Service>,
    settings: Arc<ApiSettings>,
}

impl Default for ApiSettings {
    fn default() -> Self {
        Self {
            keys: ApiKeys::default(),
            // Enough to keep the workers of a large machine busy, few enough to share them.
            batch_window: NonZeroUsize::new(16).unwrap_or(NonZeroUsize::MIN),
            // A caller that sends the largest body over the slowest mobile link needs less.
            body_timeout: Duration::from_secs(30),
            cors_origins: Vec::new(),
        }
    }
}
