//! `slipdrive worker`: chunks of sweeps that come over NATS.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use slipdrive::jobs::{InProcessSolver, Jobs, Limits};
use slipdrive::service::Service;
use slipdrive::sweep;
use slipdrive::sweep::nats::{Access, Broker, NatsError, StreamLimits, Worker, WorkerMetrics};
use tokio::time::sleep;

use super::refused;
use crate::config::{WorkerArguments, thread_count};
use crate::shutdown::{Signals, serve_probes};

/// How long to wait until the servers are asked again.
const RETRY_PAUSE: Duration = Duration::from_secs(2);

/// Works until a signal comes.
///
/// # Errors
/// What of the access cannot be used, and an address that cannot be bound. Servers that are away are waited for.
pub(crate) fn worker(arguments: &WorkerArguments) -> anyhow::Result<ExitCode> {
    let Some(access) = arguments.nats.access() else {
        return Ok(refused("there is no URL of NATS, must be `--nats` or the variable SLIPDRIVE_NATS_URL"));
    };
    let threads = thread_count(arguments.threads);
    let service = Arc::new(Service::start(sweep::service_settings(threads))?);
    let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let mut signals = Signals::listen()?;
        let metrics = WorkerMetrics::new(service.metrics());
        // Dropped, it closes its listener.
        let _probes = match arguments.admin {
            Some(address) => Some(serve_probes(address, &service, jobs.clone())?),
            None => None,
        };
        let broker = tokio::select! {
            broker = connected(&access, arguments.nats.limits(), &service) => broker?,
            () = signals.next() => return Ok(()),
        };
        let lease = Duration::from_secs(arguments.lease_s.get().into());
        let worker = Worker::start(broker, Arc::clone(&service), jobs, metrics, lease).await?;
        tracing::info!(queue.workers = threads, "taking chunks");
        worker.run(signals.next()).await;
        anyhow::Ok(())
    })?;
    tracing::info!("stopped");
    Ok(ExitCode::SUCCESS)
}

/// Connects, however long that takes: where all starts at once, workers may be first.
async fn connected(access: &Access, limits: StreamLimits, service: &Service) -> Result<Broker, NatsError> {
    loop {
        service.announce_end();
        match Broker::connect(access, limits).await {
            Err(error @ NatsError::Failed { .. }) => tracing::warn!(error = %error, "trying again"),
            connected_or_unusable => return connected_or_unusable,
        }
        sleep(RETRY_PAUSE).await;
    }
}
