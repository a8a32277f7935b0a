//! A server of the crate with both transports on loopback sockets.

use std::num::NonZeroUsize;
use std::sync::Arc;

use anyhow::Result;
use axum::Router;
use slipdrive::api::server::{Connections, ServerSettings, serve};
use slipdrive::api::{ApiSettings, ApiState, grpc, rest};
use slipdrive::jobs::{InProcessSolver, Jobs, Limits};
use slipdrive::service::{Service, ServiceSettings};
use tokio::net::TcpListener;

use super::grpc::GrpcCaller;
use super::rest::RestCaller;

/// One for each transport.
const WORKERS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(1);

/// A caller over each transport of a running server.
pub(super) struct Server {
    pub(super) rest: RestCaller,
    pub(super) grpc: GrpcCaller,
}

impl Server {
    /// Starts a server, which runs as long as the runtime.
    pub(super) async fn start() -> Result<Self> {
        let settings = ServiceSettings { workers: WORKERS, ..ServiceSettings::default() };
        let service = Arc::new(Service::start(settings)?);
        let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
        let state = ApiState::new(service, jobs, ApiSettings::default());
        let (router, _health) = grpc::router(&state).await;
        let grpc = GrpcCaller::connect(listen(&state, router).await?).await?;
        let rest = RestCaller::new(listen(&state, rest::router(&state)).await?)?;
        Ok(Self { rest, grpc })
    }
}

async fn listen(state: &ApiState, router: Router) -> Result<String> {
    let listener = TcpListener::bind("127.0.0.1:0").await?;
    let address = listener.local_addr()?;
    tokio::spawn(serve(listener, router, Connections::of(state, ServerSettings::default()), std::future::pending()));
    Ok(format!("http://{address}"))
}
