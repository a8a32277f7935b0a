//! The server under load: REST and gRPC, an echo of the same answers to compare with, and a meter of all requests.

use std::io::{Read as _, Write as _};
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::Response;
use axum::routing::post;
use clap::{Args, ValueEnum};
use http_body_util::{BodyExt as _, Full};
use prost::Message as _;
use serde_json::json;
use slipdrive::api::grpc::pb::{self, View};
use slipdrive::api::server::{Connections, ServerSettings, serve};
use slipdrive::api::{ApiSettings, ApiState, grpc, rest};
use slipdrive::jobs::{InProcessSolver, Jobs, Limits, ManeuverSolver};
use slipdrive::motion::{SimulateInput, Simulation};
use slipdrive::service::{Service, ServiceSettings};
use slipdrive::solver::RunControl;
use slipdrive::solver::{Solution, SolveInput};
use slipdrive::stop::{Stop, Stopped};
use tokio::net::TcpListener;

use crate::callers::{Addresses, Callers, Question, VIEW};
use crate::tally::Latencies;

#[derive(Debug, Args)]
pub struct Arguments {
    #[arg(long)]
    solver: SolverChoice,
    #[arg(long, default_value = "64")]
    queue_length: usize,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum SolverChoice {
    /// That of the crate.
    Real,
    /// Answers at once with a plan that was made before.
    Idle,
}

/// Answers every solve with the same plan.
struct IdleSolver(Solution);

impl ManeuverSolver for IdleSolver {
    fn solve(&self, _input: &SolveInput, _control: &RunControl<'_>) -> Result<Solution, Stopped> {
        Ok(self.0.clone())
    }

    fn simulate(&self, input: &SimulateInput, stop: Stop<'_>) -> Result<Simulation, Stopped> {
        InProcessSolver.simulate(input, stop)
    }
}

/// What the server itself counts, without the network and the load generator.
#[derive(Default)]
struct Meter {
    solves: u64,
    refusals: Latencies,
}

/// Serves until the standard input ends, then reports what the meter has counted.
pub async fn run(arguments: &Arguments) {
    let solver: Arc<dyn ManeuverSolver> = match arguments.solver {
        SolverChoice::Real => Arc::new(InProcessSolver),
        SolverChoice::Idle => {
            let plan = slipdrive::solver::solve(&SolveInput::forward_drive(), &RunControl::unattended());
            Arc::new(IdleSolver(plan.expect("nothing stops it")))
        }
    };
    let settings = ServiceSettings {
        workers: NonZeroUsize::MIN,
        queue_length: arguments.queue_length,
        ..ServiceSettings::default()
    };
    let service = Arc::new(Service::start(settings).unwrap());
    let jobs = Jobs::new(Limits::default(), solver, service.metrics());
    let state = ApiState::new(service, jobs, ApiSettings::default());
    let meter = Arc::new(Mutex::new(Meter::default()));
    let metered = |router: Router| router.layer(from_fn_with_state(Arc::clone(&meter), measure));
    let connections = Connections::of(&state, ServerSettings::default());
    let rest = listen(&connections, metered(rest::router(&state))).await;
    let (grpc_router, _health) = grpc::router(&state).await;
    let grpc = listen(&connections, metered(grpc_router)).await;
    let echo = listen(&connections, echo_of(&Addresses { rest: rest.clone(), grpc: grpc.clone() }).await).await;
    report(&json!({"rest": rest, "grpc": grpc, "echo": echo}));

    let wait = tokio::task::spawn_blocking(|| std::io::stdin().read_to_end(&mut Vec::new()));
    wait.await.unwrap().unwrap();
    let meter = meter.lock().unwrap();
    let milliseconds = |quantile| meter.refusals.quantile_ms(quantile);
    report(&json!({
        "solves": meter.solves,
        "refusals": meter.refusals.count(),
        "refusal_p50_ms": milliseconds(0.5),
        "refusal_p99_ms": milliseconds(0.99),
        "refusal_max_ms": milliseconds(1.0),
    }));
}

/// Prints one line for the process that started this one, at once.
fn report(line: &serde_json::Value) {
    println!("{line}");
    std::io::stdout().flush().unwrap();
}

/// Serves on a free port of this machine, and gives its address.
pub async fn listen(connections: &Arc<Connections>, router: Router) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(serve(listener, router, Arc::clone(connections), std::future::pending()));
    format!("http://{address}")
}

/// Counts solves, and records the time from the head of a request to its answer when that is a refusal.
async fn measure(State(meter): State<Arc<Mutex<Meter>>>, request: Request, next: Next) -> Response {
    let is_solve = request.uri().path().to_lowercase().ends_with("/solve");
    let begin = Instant::now();
    let response = next.run(request).await;
    // RESOURCE_EXHAUSTED is 8.
    let is_refusal = response.status().as_u16() == 429
        || response.headers().get("grpc-status").is_some_and(|status| status.as_bytes() == b"8");
    let mut meter = meter.lock().unwrap();
    meter.solves += u64::from(is_solve);
    if is_refusal {
        meter.refusals.record(begin.elapsed());
    }
    drop(meter);
    response
}

/// Repeats an earlier answer of the server byte for byte: the cost of the transport alone.
#[derive(Clone)]
struct Echo {
    json: [Bytes; 2],
    message: [Bytes; 2],
}

async fn echo_of(addresses: &Addresses) -> Router {
    let callers = Callers::connect(addresses).await;
    let (mut json, mut message) = (Vec::new(), Vec::new());
    for view in [View::Plan, View::Full] {
        let question = Question::new(5.0, view);
        json.push(callers.answer_of_rest(&question).await);
        let answer: pb::SolveResponse = callers.grpc(0).solve(question.message).await.unwrap().into_inner();
        let encoded = answer.encode_to_vec();
        let mut frame = vec![0];
        frame.extend(u32::try_from(encoded.len()).unwrap().to_be_bytes());
        frame.extend(encoded);
        message.push(Bytes::from(frame));
    }
    let echo = Echo { json: json.try_into().unwrap(), message: message.try_into().unwrap() };
    Router::new()
        .route("/solve", post(echo_rest))
        .route("/slipdrive.v1.ManeuverService/Solve", post(echo_grpc))
        .with_state(echo)
}

fn view_in(headers: &HeaderMap) -> usize {
    usize::from(headers.get(VIEW).is_some_and(|view| view.as_bytes() == b"full"))
}

async fn echo_rest(State(echo): State<Echo>, headers: HeaderMap, _body: Bytes) -> Response {
    Response::new(Body::from(echo.json[view_in(&headers)].clone()))
}

async fn echo_grpc(State(echo): State<Echo>, headers: HeaderMap, _body: Bytes) -> Response {
    let mut trailers = HeaderMap::new();
    trailers.insert("grpc-status", HeaderValue::from_static("0"));
    let body = Full::new(echo.message[view_in(&headers)].clone());
    let mut response = Response::new(Body::new(body.with_trailers(async { Some(Ok(trailers)) })));
    response.headers_mut().insert("content-type", HeaderValue::from_static("application/grpc"));
    response
}
