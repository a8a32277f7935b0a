//! A worker: chunks on lease, row by row into results.

mod run;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_nats::connection::State;
use async_nats::jetstream::AckKind;
use async_nats::jetstream::Message;
use async_nats::jetstream::consumer::PullConsumer;
use async_nats::jetstream::message::PublishMessage;
use futures_util::StreamExt as _;
use futures_util::future::join_all;
use tokio::sync::{broadcast, watch};
use tokio::time::{sleep, timeout};

use self::run::Outcome;
use super::broker::{Broker, NatsError};
use super::chunk::Chunk;
use super::metrics::WorkerMetrics;
use super::watchdog::{LastSign, PULL_EXPIRY};
use super::{RETRY_PAUSE, cancel, lease, subjects};
use crate::jobs::Jobs;
use crate::service::Service;

/// Cancelled sweeps that may be told before they are heard.
const CANCELS_AHEAD: usize = 64;
/// How much later than it should a request for a chunk may end.
const PULL_GRACE: Duration = Duration::from_secs(5);
/// How long what is finished may take to be published when the worker ends.
const LAST_RESULTS: Duration = Duration::from_secs(10);
/// How long the server may take to hear how a chunk ended; then it comes again, which costs little.
const LAST_WORD: Duration = Duration::from_secs(5);
/// How long a chunk waits that could not be run here although the worker goes on.
const LATER: Duration = Duration::from_secs(5);

/// Takes chunks and runs them on the workers of a service.
pub struct Worker {
    broker: Broker,
    service: Arc<Service>,
    jobs: Jobs,
    metrics: WorkerMetrics,
    lease: Duration,
    consumer: Mutex<PullConsumer>,
    /// Hashes of sweeps that are cancelled while they run.
    cancelled: broadcast::Sender<String>,
    /// One row of suspect chunks runs at a time.
    suspect: tokio::sync::Mutex<()>,
    last_sign: LastSign,
}

impl Worker {
    /// A worker of this version on a connection; a chunk is its own for as long as `lease` without a sign of life.
    ///
    /// # Errors
    /// When the servers do not give it a place to take chunks from.
    pub async fn start(
        broker: Broker,
        service: Arc<Service>,
        jobs: Jobs,
        metrics: WorkerMetrics,
        lease: Duration,
    ) -> Result<Self, NatsError> {
        let consumer = Mutex::new(broker.consumer(Some(lease)).await?);
        Ok(Self {
            broker,
            service,
            jobs,
            metrics,
            lease,
            consumer,
            cancelled: broadcast::Sender::new(CANCELS_AHEAD),
            suspect: tokio::sync::Mutex::new(()),
            last_sign: LastSign::now(),
        })
    }

    /// Works until `stop` comes; then what is finished is published and the rest given back.
    pub async fn run(&self, stop: impl Future<Output = ()>) {
        let stopped = watch::Sender::new(false);
        let slots = (0..self.service.settings().workers.get()).map(|_| self.take_chunks(stopped.subscribe()));
        let ended = async {
            stop.await;
            tracing::info!("taking no more chunks");
            stopped.send_replace(true);
            std::future::pending::<()>().await;
        };
        tokio::select! {
            _ = join_all(slots) => {}
            () = ended => {}
            () = self.hear_cancels() => {}
            () = self.watch_over(stopped.subscribe()) => {}
        }
    }

    /// Takes one chunk after the other.
    async fn take_chunks(&self, mut stopped: watch::Receiver<bool>) {
        while !*stopped.borrow() {
            let pulled = tokio::select! {
                _ = stopped.wait_for(|stopped| *stopped) => return,
                pulled = self.pull() => pulled,
            };
            match pulled {
                Ok(Some(message)) => self.serve(message, &stopped).await,
                Ok(None) => {}
                Err(fault) => {
                    tracing::debug!(error = fault, "no chunk can be asked for");
                    self.reopen().await;
                    tokio::select! {
                        _ = stopped.wait_for(|stopped| *stopped) => return,
                        () = sleep(RETRY_PAUSE) => {}
                    }
                }
            }
        }
    }

    /// Asks for a chunk; none where none comes for a while.
    async fn pull(&self) -> Result<Option<Message>, String> {
        let consumer = self.consumer.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let asked = consumer.batch().max_messages(1).expires(PULL_EXPIRY).messages();
        let mut batch = asked.await.map_err(|error| error.to_string())?;
        match timeout(PULL_EXPIRY + PULL_GRACE, batch.next()).await {
            Ok(Some(message)) => {
                self.last_sign.renew();
                message.map(Some).map_err(|error| error.to_string())
            }
            Ok(None) | Err(_) => Ok(None),
        }
    }

    /// Makes streams and consumer again, where they are gone.
    async fn reopen(&self) {
        if self.broker.client().connection_state() != State::Connected {
            return;
        }
        let made = match self.broker.restore().await {
            Ok(()) => self.broker.consumer(Some(self.lease)).await,
            Err(error) => Err(error),
        };
        match made {
            Ok(consumer) => *self.consumer.lock().unwrap_or_else(PoisonError::into_inner) = consumer,
            Err(error) => tracing::warn!(error = %error, "chunks cannot be asked for; trying again"),
        }
    }

    /// Runs a chunk that came, holds it meanwhile, and says how it ended.
    async fn serve(&self, message: Message, stopped: &watch::Receiver<bool>) {
        let Ok(info) = message.info() else { return };
        let (delivery, place) = (info.delivered, info.stream_sequence);
        let (message, acker) = message.split();
        if delivery > 1 {
            self.metrics.redeliveries.inc();
        }
        let chunk = match Chunk::read(&message.payload) {
            Ok(chunk) => chunk,
            Err(fault) => {
                tracing::error!(chunk.subject = %message.subject, error = fault, "a message is refused");
                self.metrics.chunk("refused");
                self.bury(place, message.payload.to_vec()).await;
                let _ = timeout(LAST_WORD, lease::ended(&acker, AckKind::Term)).await;
                return;
            }
        };
        self.metrics.in_flight.inc();
        let (sweep, number, cancels) = (chunk.sweep.clone(), chunk.number, self.cancelled.subscribe());
        let outcome = tokio::select! {
            outcome = self.run_chunk(chunk, delivery, stopped) => outcome,
            never = lease::held(self.lease, &acker, &self.metrics) => match never {},
            () = told(&sweep, cancels) => Outcome::Cancelled,
        };
        tracing::debug!(sweep.hash = sweep, chunk.number = number, chunk.delivery = delivery, outcome = ?outcome, "chunk");
        let (word, how) = match outcome {
            Outcome::Complete => ("complete", AckKind::Ack),
            Outcome::GivenBack => ("given_back", AckKind::Nak((!*stopped.borrow()).then_some(LATER))),
            Outcome::Cancelled => ("cancelled", AckKind::Term),
        };
        self.metrics.chunk(word);
        let _ = timeout(LAST_WORD, lease::ended(&acker, how)).await;
        self.metrics.in_flight.dec();
        self.last_sign.renew();
    }

    /// Keeps a message that is no chunk.
    async fn bury(&self, place: u64, content: Vec<u8>) {
        let message = PublishMessage::build().payload(content.into());
        if let Err(error) = self.broker.send(subjects::dead_message(place), message).await {
            tracing::error!(error = %error, "a dead letter cannot be written");
        }
    }

    /// Passes on which sweeps are cancelled.
    async fn hear_cancels(&self) {
        loop {
            if let Ok(mut states) = self.broker.client().subscribe(subjects::ALL_STATES).await {
                while let Some(state) = states.next().await {
                    if cancel::says_cancelled(&state.payload) {
                        let sweep = state.subject.rsplit('.').next().unwrap_or_default().to_owned();
                        // Nobody may run any.
                        let _ = self.cancelled.send(sweep);
                    }
                }
            }
            sleep(RETRY_PAUSE).await;
        }
    }

    /// Reports whether the worker is connected, and looks after the queue where chunks wait but none comes.
    async fn watch_over(&self, stopped: watch::Receiver<bool>) {
        loop {
            let is_connected = self.broker.client().connection_state() == State::Connected;
            self.metrics.connected.set(is_connected.into());
            if is_connected && !*stopped.borrow() {
                self.service.revoke_end();
            } else {
                self.service.announce_end();
            }
            sleep(RETRY_PAUSE).await;
            let has_idle = self.metrics.in_flight.get() < as_gauge(self.service.settings().workers.get());
            if !has_idle || !is_connected {
                self.last_sign.renew();
            } else if self.last_sign.is_old() {
                if let Err(error) = self.look_after_queue().await {
                    tracing::warn!(error = %error, "the queue cannot be looked after");
                }
                self.last_sign.renew();
            }
        }
    }

    /// Connects again where chunks wait, and has them delivered anew where the server has lost whom they are for: after a
    /// crash it may have chunks that its consumer counts as done.
    async fn look_after_queue(&self) -> Result<(), NatsError> {
        let failed = NatsError::failed("the consumer cannot be asked");
        let consumer = self.consumer.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let info = consumer.get_info().await.map_err(|error| failed(&error))?;
        if info.num_pending > 0 {
            self.metrics.stalls.inc();
            tracing::warn!("chunks wait, but none comes; connecting again");
            return self.broker.client().force_reconnect().await.map_err(|error| failed(&error));
        }
        if info.num_ack_pending == 0 && self.broker.chunks_of_version().await? > 0 {
            self.metrics.queues_restored.inc();
            tracing::warn!("chunks are there that nobody would get; they are delivered anew");
            self.broker.chunks.delete_consumer(&info.name).await.map_err(|error| failed(&error))?;
            self.reopen().await;
        }
        Ok(())
    }
}

/// Waits until this sweep is cancelled.
async fn told(sweep: &str, mut cancels: broadcast::Receiver<String>) {
    loop {
        match cancels.recv().await {
            Ok(cancelled) if cancelled == sweep => return,
            // Where too many came at once, what was missed runs to its end.
            Ok(_) | Err(broadcast::error::RecvError::Lagged(_)) => {}
            Err(broadcast::error::RecvError::Closed) => std::future::pending().await,
        }
    }
}

fn as_gauge(count: usize) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}
