//! Good callers, who must not notice an attack: each kind of request once a second over both doors.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use reqwest::Client;
use slipdrive::api::grpc::pb::GetLimitsRequest;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, timeout};
use tonic::transport::{Channel, Endpoint};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

use super::KEY;
use super::program::Program;
use crate::tally::Latencies;

const INTERVAL: Duration = Duration::from_secs(1);
/// How long a good caller waits for an answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// What is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Question {
    Validate,
    Livez,
    GetLimits,
    Check,
}

/// Whether a caller opens a connection for each question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Connections {
    Kept,
    Fresh,
}

/// The answers so far.
#[derive(Debug, Default)]
pub struct GoodTally {
    latencies: Latencies,
    failures: BTreeMap<String, u64>,
}

impl GoodTally {
    pub fn failures(&self) -> u64 {
        self.failures.values().sum()
    }

    pub fn quantile(&self, quantile: f64) -> Duration {
        Duration::from_secs_f64(self.latencies.quantile_ms(quantile) / 1e3)
    }
}

impl std::fmt::Display for GoodTally {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |quantile| self.latencies.quantile_ms(quantile);
        let (p50, p99, max) = (ms(0.5), ms(0.99), ms(1.0));
        write!(formatter, "p50 {p50:.1} / p99 {p99:.1} / max {max:.1} ms, ")?;
        write!(formatter, "{} of {} failed", self.failures(), self.latencies.count())?;
        for (failure, count) in &self.failures {
            write!(formatter, " ({failure}: {count})")?;
        }
        Ok(())
    }
}

/// All good callers of one server.
pub struct GoodCallers {
    tasks: JoinSet<()>,
    stop: watch::Sender<bool>,
    tally: Arc<Mutex<GoodTally>>,
}

impl GoodCallers {
    /// Returns once each has been answered, so that what a server keeps for its first callers is part of its memory at
    /// rest.
    pub async fn start(program: &Program) -> Self {
        let (stop, stopped) = watch::channel(false);
        let (mut tasks, tally) = (JoinSet::new(), Arc::new(Mutex::new(GoodTally::default())));
        for question in [Question::Validate, Question::Livez, Question::GetLimits, Question::Check] {
            for connections in [Connections::Kept, Connections::Fresh] {
                let caller = Caller::new(program, question, connections);
                caller.ask().await.expect("the server answers while nothing is wrong");
                tasks.spawn(caller.ask_until(stopped.clone(), Arc::clone(&tally)));
            }
        }
        Self { tasks, stop, tally }
    }

    /// Waits for the last answers.
    pub async fn stop(mut self) -> GoodTally {
        self.stop.send_replace(true);
        while self.tasks.join_next().await.transpose().unwrap().is_some() {}
        std::mem::take(&mut *self.tally.lock().unwrap())
    }
}

/// Asks one question over and over.
struct Caller {
    question: Question,
    connections: Connections,
    rest: String,
    client: Client,
    endpoint: Endpoint,
    channel: Channel,
}

impl Caller {
    fn new(program: &Program, question: Question, connections: Connections) -> Self {
        let endpoint = Endpoint::from_shared(format!("http://{}", program.grpc)).unwrap();
        let (rest, channel) = (format!("http://{}", program.rest), endpoint.connect_lazy());
        Self { question, connections, rest, client: client(), endpoint, channel }
    }

    async fn ask_until(self, mut stopped: watch::Receiver<bool>, tally: Arc<Mutex<GoodTally>>) {
        let mut ticks = interval(INTERVAL);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        while !*stopped.borrow() {
            tokio::select! {
                _ = stopped.changed() => return,
                _ = ticks.tick() => {}
            }
            let asked = Instant::now();
            let answered = timeout(PATIENCE, self.ask()).await.unwrap_or_else(|_| Err("no answer".to_owned()));
            let mut tally = tally.lock().unwrap();
            tally.latencies.record(asked.elapsed());
            if let Err(failure) = answered {
                let about = format!("{:?} {:?} {failure}", self.connections, self.question).to_lowercase();
                *tally.failures.entry(about).or_default() += 1;
            }
        }
    }

    async fn ask(&self) -> Result<(), String> {
        let (client, channel) = match self.connections {
            Connections::Kept => (self.client.clone(), self.channel.clone()),
            Connections::Fresh => (client(), self.endpoint.connect_lazy()),
        };
        match self.question {
            Question::Validate => {
                let request = client.post(format!("{}/validate", self.rest)).bearer_auth(KEY);
                ask_rest(request.header("content-type", "application/json").body("{}")).await
            }
            Question::Livez => ask_rest(client.get(format!("{}/livez", self.rest))).await,
            Question::GetLimits => {
                let mut request = tonic::Request::new(GetLimitsRequest {});
                request.metadata_mut().insert("authorization", format!("Bearer {KEY}").parse().unwrap());
                let answer = ManeuverServiceClient::new(channel).get_limits(request).await;
                answer.map(drop).map_err(|status| format!("{:?}", status.code()))
            }
            Question::Check => {
                let answer = HealthClient::new(channel).check(HealthCheckRequest::default()).await;
                answer.map(drop).map_err(|status| format!("{:?}", status.code()))
            }
        }
    }
}

/// With connections of its own.
pub fn client() -> Client {
    Client::builder().no_proxy().build().unwrap()
}

async fn ask_rest(request: reqwest::RequestBuilder) -> Result<(), String> {
    let failed = |error: reqwest::Error| if error.is_connect() { "not connected" } else { "cut" }.to_owned();
    let answer = request.send().await.map_err(failed)?;
    let status = answer.status();
    answer.bytes().await.map_err(failed)?;
    if status.is_success() { Ok(()) } else { Err(status.as_u16().to_string()) }
}
