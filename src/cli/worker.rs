//! `slipdrive worker`: chunks of sweeps that come over NATS.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use slipdrive::jobs::{InProcessSolver, Jobs, Limits};
use slipdrive::service::Service;
use slipdrive::sweep;
use slipdrive::sweep::nats::{Broker, Worker, WorkerSettings};

use super::sweep::refused;
use crate::config::{WorkerArguments, cores};
use crate::shutdown::{Servers, Signals, serve_probes};

/// Works until a signal comes.
///
/// # Errors
/// When NATS cannot be reached at the start, or an address cannot be bound.
pub(crate) fn worker(arguments: &WorkerArguments) -> anyhow::Result<ExitCode> {
    let Some(access) = arguments.nats.access() else {
        return Ok(refused("there is no URL of NATS, must be `--nats` or the variable SLIPDRIVE_NATS_URL"));
    };
    let threads = arguments.threads.unwrap_or_else(cores);
    let service = Arc::new(Service::start(sweep::service_settings(threads))?);
    let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let mut signals = Signals::listen()?;
        let broker = Broker::connect(&access, arguments.nats.limits()).await?;
        let servers = match arguments.admin {
            Some(address) => Some(serve_probes(address, &service, jobs.clone())?),
            None => None,
        };
        let lease = Duration::from_secs(arguments.lease_s.get().into());
        let worker = Worker::start(broker, Arc::clone(&service), jobs, WorkerSettings { lease }).await?;
        tracing::info!(queue.workers = threads, "taking chunks");
        worker.run(signals.next()).await;
        servers.iter().for_each(Servers::close);
        anyhow::Ok(())
    })?;
    tracing::info!("stopped");
    Ok(ExitCode::SUCCESS)
}
