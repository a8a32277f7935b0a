//! Sends one request over REST or gRPC and measures it.

use std::time::{Duration, Instant};

use clap::Args;
use serde_json::Value;
use slipdrive::api::grpc::pb;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use tonic::transport::{Channel, Endpoint};
use tonic_types::StatusExt as _;

/// The header that selects the answer of the echo.
pub const VIEW: &str = "x-view";

/// Connections that gRPC calls are spread over: one HTTP/2 connection takes 128 calls at once.
const CHANNELS: usize = 8;

/// Where a server listens.
#[derive(Debug, Clone, Args)]
pub struct Addresses {
    #[arg(long, default_value = "http://127.0.0.1:8080")]
    pub rest: String,
    #[arg(long, default_value = "http://127.0.0.1:50051")]
    pub grpc: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Transport {
    Rest,
    Grpc,
}

impl Transport {
    /// REST for even numbers, gRPC for odd ones, so that load alternates.
    pub fn of(number: u64) -> Self {
        if number.is_multiple_of(2) { Self::Rest } else { Self::Grpc }
    }
}

/// The outcome of one request.
#[derive(Debug)]
pub struct Outcome {
    pub number: u64,
    pub transport: Transport,
    /// `ok`, the code of a problem, or what failed on the way.
    pub code: String,
    /// From the scheduled time to the end of the answer.
    pub latency: Duration,
    /// From the scheduled time to the sending.
    pub lateness: Duration,
    /// Whether the answer bears the id of this request.
    pub is_own: bool,
}

/// The request to send: the straight forward drive from one start.
#[derive(Debug, Clone)]
pub struct Question {
    pub json: String,
    pub message: pb::SolveRequest,
    pub view: String,
}

impl Question {
    /// The goal lies `y_m` ahead; `view` selects the whole answer or the plan alone.
    pub fn new(y_m: f64, view: pb::View) -> Self {
        let name = view.as_str_name().trim_start_matches("VIEW_").to_lowercase();
        let json = serde_json::json!({
            "maneuver": {"goal": {"y_m": y_m}}, "grid": {"steps": 200}, "solver": {"starts": 1}, "view": name,
        });
        let goal = pb::Goal { y_m: Some(y_m), ..pb::Goal::default() };
        let message = pb::SolveRequest {
            maneuver: Some(pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() }),
            grid: Some(pb::SolveGrid { steps: Some(200), ..pb::SolveGrid::default() }),
            solver: Some(pb::Solver { starts: Some(1), ..pb::Solver::default() }),
            view: view.into(),
            ..pb::SolveRequest::default()
        };
        Self { json: json.to_string(), message, view: name }
    }
}

/// Connections to one server.
#[derive(Clone)]
pub struct Callers {
    addresses: Addresses,
    client: reqwest::Client,
    channels: Vec<Channel>,
}

impl Callers {
    pub async fn connect(addresses: &Addresses) -> Self {
        let client = reqwest::Client::builder().no_proxy().build().unwrap();
        let endpoint = Endpoint::from_shared(addresses.grpc.clone()).unwrap();
        let mut channels = Vec::new();
        for _ in 0..CHANNELS {
            channels.push(endpoint.connect().await.unwrap());
        }
        Self { addresses: addresses.clone(), client, channels }
    }

    pub fn addresses(&self) -> &Addresses {
        &self.addresses
    }

    pub fn grpc(&self, number: u64) -> ManeuverServiceClient<Channel> {
        let channel = usize::try_from(number / 2).unwrap() % self.channels.len();
        ManeuverServiceClient::new(self.channels[channel].clone())
    }

    /// A solve over REST, to be sent.
    pub fn post(&self, json: String) -> reqwest::RequestBuilder {
        let request = self.client.post(format!("{}/solve", self.addresses.rest));
        request.header("content-type", "application/json").body(json)
    }

    /// Sends at once; the latency counts from the scheduled time.
    pub async fn ask(&self, number: u64, transport: Transport, question: &Question, scheduled: Instant) -> Outcome {
        let lateness = scheduled.elapsed();
        let (code, is_own) = match transport {
            Transport::Rest => self.ask_rest(number, question).await,
            Transport::Grpc => self.ask_grpc(number, question).await,
        };
        Outcome { number, transport, code, latency: scheduled.elapsed(), lateness, is_own }
    }

    async fn ask_rest(&self, number: u64, question: &Question) -> (String, bool) {
        let request = self.post(question.json.clone()).header("x-request-id", number.to_string());
        let response = match request.header(VIEW, &question.view).send().await {
            Ok(response) => response,
            Err(error) => return (format!("not sent: {error:?}"), true),
        };
        let id = response.headers().get("x-request-id").and_then(|id| id.to_str().ok()?.parse().ok());
        let (status, body) = (response.status(), response.bytes().await);
        let code = match body {
            Err(error) => format!("cut: {error:?}"),
            Ok(_) if status.is_success() => "ok".to_owned(),
            Ok(body) => {
                let problem: Value = serde_json::from_slice(&body).unwrap_or_default();
                problem["code"].as_str().unwrap_or("no problem").to_owned()
            }
        };
        (code, id == Some(number))
    }

    async fn ask_grpc(&self, number: u64, question: &Question) -> (String, bool) {
        let mut request = tonic::Request::new(question.message.clone());
        request.metadata_mut().insert("x-request-id", number.to_string().parse().unwrap());
        request.metadata_mut().insert(VIEW, question.view.parse().unwrap());
        let id_in = |metadata: &tonic::metadata::MetadataMap| {
            metadata.get("x-request-id").and_then(|id| id.to_str().ok()?.parse().ok()) == Some(number)
        };
        match self.grpc(number).solve(request).await {
            Ok(response) => ("ok".to_owned(), id_in(response.metadata())),
            Err(status) => {
                let reason = status.get_details_error_info().map(|info| info.reason.to_lowercase());
                (reason.unwrap_or_else(|| format!("{status:?}")), id_in(status.metadata()))
            }
        }
    }

    /// The bytes of an answer.
    pub async fn answer_of_rest(&self, question: &Question) -> axum::body::Bytes {
        self.post(question.json.clone()).send().await.unwrap().error_for_status().unwrap().bytes().await.unwrap()
    }

    /// Whether both transports report that they are ready.
    pub async fn are_ready(&self) -> bool {
        let rest = self.client.get(format!("{}/readyz", self.addresses.rest)).send().await;
        let mut health = tonic_health::pb::health_client::HealthClient::new(self.channels[0].clone());
        let grpc = health.check(tonic_health::pb::HealthCheckRequest::default()).await;
        let serving = tonic_health::pb::health_check_response::ServingStatus::Serving;
        rest.is_ok_and(|response| response.status().is_success())
            && grpc.is_ok_and(|response| response.get_ref().status() == serving)
    }
}
