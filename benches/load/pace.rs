//! More deadlines than one worker can keep: it must serve about as many as it can, and refuse the others at once.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use prost::Message as _;
use serde_json::{Value, json};
use slipdrive::api::grpc::pb;
use slipdrive::api::server::{Connections, ServerSettings};
use slipdrive::api::{ApiSettings, ApiState, grpc, rest};
use slipdrive::jobs::{InProcessSolver, Jobs, Limits};
use slipdrive::service::{Service, ServiceSettings};
use tokio::task::JoinSet;

use crate::callers::{Addresses, Transport};
use crate::server::listen;
use crate::verdict::Verdict;

/// Solves whose robot stands at its goal.
const STANDSTILLS: usize = 50;
const CALLERS: u64 = 40;
const TIMEOUT: Duration = Duration::from_secs(2);
/// Share of what one worker can do alone that must be served.
const SERVED_SHARE: f64 = 0.8;
/// Refusals take less than this.
const AT_ONCE: Duration = Duration::from_millis(200);
/// No answer comes later after its deadline.
const LATEST: Duration = Duration::from_millis(200);
/// Solves of the finest grid, one after the other.
const FINE_SOLVES: u64 = 20;
const FINE_TIMEOUT: Duration = Duration::from_millis(700);
/// No answer of these comes later after its deadline.
const LATEST_FINE: Duration = Duration::from_millis(50);

/// What is asked, for both transports.
struct Question {
    y_m: f64,
    steps: u32,
    starts: u32,
}

impl Question {
    /// A search of some tenths of a second; the goals differ.
    fn heavy(number: u64) -> Self {
        Self { y_m: 2.0 + 3.0 * (number % 10) as f64 / 10.0, steps: 200, starts: 6 }
    }

    fn json(&self) -> Value {
        let Self { y_m, steps, starts } = self;
        json!({"maneuver": {"goal": {"y_m": y_m}}, "grid": {"steps": steps}, "solver": {"starts": starts}})
    }

    /// A frame of gRPC.
    fn frame(&self) -> Vec<u8> {
        let goal = pb::Goal { y_m: Some(self.y_m), ..pb::Goal::default() };
        let message = pb::SolveRequest {
            maneuver: Some(pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() }),
            grid: Some(pb::SolveGrid { steps: Some(self.steps), ..pb::SolveGrid::default() }),
            solver: Some(pb::Solver { starts: Some(self.starts), ..pb::Solver::default() }),
            ..pb::SolveRequest::default()
        };
        let length = u32::try_from(message.encoded_len()).unwrap().to_be_bytes();
        [&[0], &length[..], &message.encode_to_vec()].concat()
    }
}

/// One worker behind both transports, which has done nothing so far.
#[derive(Clone)]
struct Worker {
    addresses: Addresses,
    http: reqwest::Client,
    /// Unlike the client of tonic it waits for answers that are late.
    http2: reqwest::Client,
}

/// How a request ended, and when.
struct Ended {
    is_served: bool,
    /// Of the problem.
    code: String,
    duration: Duration,
}

impl Worker {
    async fn start() -> Self {
        let service = Arc::new(Service::start(ServiceSettings::default()).unwrap());
        let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
        let state = ApiState::new(service, jobs, ApiSettings::default());
        let connections = Connections::of(&state, ServerSettings::default());
        let rest = listen(&connections, rest::router(&state)).await;
        let (grpc_router, _health) = grpc::router(&state).await;
        let addresses = Addresses { rest, grpc: listen(&connections, grpc_router).await };
        let http = reqwest::Client::builder().no_proxy().build().unwrap();
        let http2 = reqwest::Client::builder().no_proxy().http2_prior_knowledge().build().unwrap();
        Self { addresses, http, http2 }
    }

    async fn ask(&self, transport: Transport, question: &Question, timeout: Option<Duration>) -> Ended {
        match transport {
            Transport::Rest => self.ask_rest(&question.json(), timeout).await,
            Transport::Grpc => self.ask_grpc(question.frame(), timeout).await,
        }
    }

    async fn ask_rest(&self, question: &Value, timeout: Option<Duration>) -> Ended {
        let begin = Instant::now();
        let request = self.http.post(format!("{}/solve", self.addresses.rest)).json(question);
        let request = match timeout {
            Some(timeout) => request.header("request-timeout-ms", timeout.as_millis().to_string()),
            None => request,
        };
        let response = request.send().await.unwrap();
        let is_served = response.status().is_success();
        let body: Bytes = response.bytes().await.unwrap();
        let duration = begin.elapsed();
        let answer: Value = serde_json::from_slice(&body).unwrap();
        Ended { is_served, code: answer["code"].as_str().unwrap_or_default().to_owned(), duration }
    }

    async fn ask_grpc(&self, frame: Vec<u8>, timeout: Option<Duration>) -> Ended {
        let begin = Instant::now();
        let request = self.http2.post(format!("{}/slipdrive.v1.ManeuverService/Solve", self.addresses.grpc));
        let request = request.header("content-type", "application/grpc").header("te", "trailers").body(frame);
        let request = match timeout {
            Some(timeout) => request.header("grpc-timeout", format!("{}m", timeout.as_millis())),
            None => request,
        };
        let response = request.send().await.unwrap();
        // A problem comes without a message, in the head: RESOURCE_EXHAUSTED is 8.
        let status = response.headers().get("grpc-status").map(|status| status.to_str().unwrap().to_owned());
        response.bytes().await.unwrap();
        let code = match status.as_deref() {
            None => String::new(),
            Some("8") => "deadline_unreachable".to_owned(),
            Some(status) => format!("gRPC status {status}"),
        };
        Ended { is_served: status.is_none(), code, duration: begin.elapsed() }
    }
}

pub async fn run() -> Verdict {
    println!("pace: {CALLERS} searches at once on one worker, each with a deadline of {} s", TIMEOUT.as_secs());
    let mut verdict = Verdict::default();
    let alone = time_alone().await;
    let capacity = (TIMEOUT.as_secs_f64() / alone.as_secs_f64()).floor();
    println!("  alone one takes {:.0} ms: {capacity} by the deadline", alone.as_secs_f64() * 1e3);
    let worker = Worker::start().await;
    let standstill = json!({"maneuver": {"goal": {"x_m": 0, "y_m": 0}}});
    for _ in 0..STANDSTILLS {
        assert!(worker.ask_rest(&standstill, None).await.is_served);
    }
    let first = format!("after {STANDSTILLS} solves without a search");
    for what in [first.as_str(), "after the searches before"] {
        crowd(&worker, what, capacity, &mut verdict).await;
    }
    ask_finest(&worker, &mut verdict).await;
    verdict
}

/// The mean of some searches, by a worker that the others do not use.
async fn time_alone() -> Duration {
    let worker = Worker::start().await;
    let begin = Instant::now();
    for number in 0..10 {
        assert!(worker.ask(Transport::Rest, &Question::heavy(number), None).await.is_served);
    }
    begin.elapsed() / 10
}

/// All callers ask at once.
async fn crowd(worker: &Worker, what: &str, capacity: f64, verdict: &mut Verdict) {
    let mut asked = JoinSet::new();
    for number in 0..CALLERS {
        let worker = worker.clone();
        let ask = async move { worker.ask(Transport::of(number), &Question::heavy(number), Some(TIMEOUT)).await };
        asked.spawn(ask);
    }
    let ended = asked.join_all().await;
    let (served, others): (Vec<_>, Vec<_>) = ended.into_iter().partition(|ended| ended.is_served);
    let (refused, missed): (Vec<_>, Vec<_>) =
        others.into_iter().partition(|ended| ended.code == "deadline_unreachable");
    let slowest = |ended: &[Ended]| ended.iter().map(|ended| ended.duration).max().unwrap_or_default();
    let late = slowest(&served).max(slowest(&missed)).saturating_sub(TIMEOUT);
    println!(
        "  {what}: {} served, {} refused, {} missed, worst lateness {late:.1?}",
        served.len(),
        refused.len(),
        missed.len()
    );
    let found = format!("{} of {capacity}", served.len());
    verdict.require(
        "at least 80 % of what it can do are served",
        served.len() as f64 >= SERVED_SHARE * capacity,
        &found,
    );
    let codes: Vec<_> = missed.iter().map(|ended| ended.code.as_str()).collect();
    verdict.require("nobody waits in vain", missed.is_empty(), &format!("{codes:?}"));
    let slowest_refusal = slowest(&refused);
    verdict.require("refusals come at once", slowest_refusal <= AT_ONCE, &format!("{slowest_refusal:.1?}"));
    verdict.require("no answer is over 200 ms late", late <= LATEST, &format!("{late:.1?}"));
}

/// The finest grid takes longest to certify and to write.
async fn ask_finest(worker: &Worker, verdict: &mut Verdict) {
    let question = Question { y_m: 5.0, steps: 10_000, starts: 24 };
    for transport in [Transport::Rest, Transport::Grpc] {
        let mut longest = Duration::ZERO;
        for _ in 0..FINE_SOLVES / 2 {
            let ended = worker.ask(transport, &question, Some(FINE_TIMEOUT)).await;
            assert!(ended.is_served, "{}", ended.code);
            longest = longest.max(ended.duration);
        }
        let requirement =
            format!("{transport:?}: 10,000 steps are answered {LATEST_FINE:?} after the deadline at most");
        let found = format!("{longest:.1?} of {FINE_TIMEOUT:?}");
        verdict.require(&requirement, longest <= FINE_TIMEOUT + LATEST_FINE, &found);
    }
}
