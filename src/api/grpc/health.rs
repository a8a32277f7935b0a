//! What gRPC probes are answered.

use std::sync::{Arc, Weak};
use std::time::Duration;

use tokio::sync::Mutex;
use tokio::time::sleep;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

use super::pb::maneuver_service_server::SERVICE_NAME;
use crate::service::Service;

/// How often the workers are looked after: probes come no more often.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);

/// The health that is reported to probes, for the whole server and for the service.
#[derive(Clone)]
pub struct Health {
    reporter: HealthReporter,
    /// Held while a status is reported: after the end nothing else is.
    has_ended: Arc<Mutex<bool>>,
}

impl Health {
    /// Reports to probes that the service serves as long as it has workers.
    pub(super) async fn begin(reporter: HealthReporter, service: &Arc<Service>) -> Self {
        let health = Self { reporter, has_ended: Arc::default() };
        health.report(ServingStatus::Serving).await;
        tokio::spawn(health.clone().follow(Arc::downgrade(service)));
        health
    }

    /// Asks probes to send nobody here any more.
    pub async fn announce_end(&self) {
        let mut has_ended = self.has_ended.lock().await;
        *has_ended = true;
        self.report(ServingStatus::NotServing).await;
    }

    /// Reports when the service loses its workers, and when it has them again, until it ends.
    async fn follow(self, service: Weak<Service>) {
        let mut was_alive = true;
        loop {
            sleep(LOOK_INTERVAL).await;
            let Some(is_alive) = service.upgrade().map(|service| service.is_alive()) else { return };
            let has_ended = self.has_ended.lock().await;
            if *has_ended {
                return;
            }
            if is_alive != was_alive {
                was_alive = is_alive;
                let status = if is_alive { ServingStatus::Serving } else { ServingStatus::NotServing };
                tracing::error!(workers.alive = is_alive, "all workers are stuck, or no longer");
                self.report(status).await;
            }
        }
    }

    async fn report(&self, status: ServingStatus) {
        for name in ["", SERVICE_NAME] {
            self.reporter.set_service_status(name, status).await;
        }
    }
}
