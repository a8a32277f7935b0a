//! A server on a free port with a solver that the test controls.

pub(crate) mod cdr;
pub(crate) mod conformance;
pub(crate) mod folder;
pub(crate) mod http2;
pub(crate) mod lines;
pub(crate) mod manifests;
#[cfg(unix)]
pub(crate) mod mounted;
pub(crate) mod process;
pub(crate) mod protobuf;
pub(crate) mod readers;
pub(crate) mod slow_simulation;
pub(crate) mod sweeps;

use std::net::SocketAddr;
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use nalgebra::SVector;
use serde_json::Value;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use slipdrive::api::grpc::{self, Health};
use slipdrive::api::server::{self, Connections, ServerSettings};
use slipdrive::api::{ApiSettings, ApiState, rest};
use slipdrive::jobs::{InProcessSolver, Jobs, Limits, ManeuverSolver};
use slipdrive::motion::{SimulateInput, Simulation};
use slipdrive::robot::State;
use slipdrive::service::{Service, ServiceSettings};
use slipdrive::simulation::{TorqueSchedule, Trajectory};
use slipdrive::solver::{
    LowerBoundAssumption, Method, RefinementOutcome, Replay, Report, Solution, SolveInput, Status,
};
use slipdrive::solver::{RunControl, StopReason};
use slipdrive::stop::{Stop, Stopped};
use tokio::net::TcpListener;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::task::JoinHandle;
use tonic::transport::{Channel, Endpoint};

/// Far beyond anything that these tests wait for: passing it means that something hangs.
pub(crate) const HANG_BOUND: Duration = Duration::from_secs(60);

/// A solution that nothing was computed for.
pub(crate) fn small_solution(stop_reason: StopReason) -> Solution {
    Solution {
        status: Status::Converged,
        stop_reason,
        replay_confirmed: true,
        reason: None,
        schedule: TorqueSchedule { final_time: 1.5, left: vec![1.0, -1.0], right: vec![1.0, -1.0] },
        goal_error: SVector::zeros(),
        trajectory: Trajectory { time: vec![0.0], state: vec![State::default()], ..Trajectory::default() },
        report: small_report(),
    }
}

fn small_report() -> Report {
    Report {
        method: Method::SequentialLinear,
        step_count: 200,
        refinement: RefinementOutcome::Fixed,
        iterations: 1,
        rollouts: 2,
        starts_tried: 1,
        distinct_optima: Vec::new(),
        predicted_decrease: 0.0,
        lower_bound: Some(1.0),
        lower_bound_assumption: Some(LowerBoundAssumption::Friction),
        indeterminate_steps: 0,
        switching_sign_violations: 0,
        replay: Some(Replay {
            step_count: 3200,
            miss_position: 0.0,
            miss_heading: 0.0,
            miss_speed: 0.0,
            miss_yaw_rate: 0.0,
            miss_wheel_speed: 0.0,
            separations: 0,
            limit_excess: 0.0,
            within_tolerance: true,
        }),
        limits: Vec::new(),
        sensitivity: Vec::new(),
    }
}

/// A solver made of one function; simulations are empty.
pub(crate) struct FakeSolver<F>(pub(crate) F);

impl<F: Fn(&SolveInput, &RunControl<'_>) -> Solution + Send + Sync> ManeuverSolver for FakeSolver<F> {
    fn solve(&self, input: &SolveInput, control: &RunControl<'_>) -> Result<Solution, Stopped> {
        Ok((self.0)(input, control))
    }

    fn simulate(&self, _input: &SimulateInput, _stop: Stop<'_>) -> Result<Simulation, Stopped> {
        let trajectory = Trajectory { time: vec![0.0], state: vec![State::default()], ..Trajectory::default() };
        Ok(Simulation { trajectory, indeterminate_steps: 0, limits: Vec::new() })
    }
}

/// A solver that answers at once.
pub(crate) fn instant_solver() -> Arc<dyn ManeuverSolver> {
    Arc::new(FakeSolver(|_: &SolveInput, _: &RunControl<'_>| small_solution(StopReason::Finished)))
}

/// The solver of the crate.
pub(crate) fn real_solver() -> Arc<dyn ManeuverSolver> {
    Arc::new(InProcessSolver)
}

/// Holds whoever waits at it until it is opened.
#[derive(Default)]
pub(crate) struct Gate {
    is_open: Mutex<bool>,
    opened: Condvar,
}

impl Gate {
    pub(crate) fn open(&self) {
        *self.is_open.lock().unwrap() = true;
        self.opened.notify_all();
    }

    pub(crate) fn wait(&self) {
        let is_open = self.is_open.lock().unwrap();
        drop(self.opened.wait_while(is_open, |is_open| !*is_open).unwrap());
    }
}

/// A solver that tells of each start and then waits at the gate, whatever its stop flag says.
pub(crate) fn held_solver() -> (Arc<Gate>, UnboundedReceiver<()>, Arc<dyn ManeuverSolver>) {
    let gate = Arc::new(Gate::default());
    let held = Arc::clone(&gate);
    let (started, has_started) = unbounded_channel();
    let solver = FakeSolver(move |_: &SolveInput, _: &RunControl<'_>| {
        started.send(()).unwrap();
        held.wait();
        small_solution(StopReason::Finished)
    });
    (gate, has_started, Arc::new(solver))
}

/// A running server.
pub(crate) struct TestServer {
    pub(crate) address: SocketAddr,
    pub(crate) service: Arc<Service>,
    pub(crate) state: ApiState,
    pub(crate) client: reqwest::Client,
    /// Address of the gRPC server.
    pub(crate) grpc_address: SocketAddr,
    pub(crate) health: Health,
    pub(crate) connections: Arc<Connections>,
    tasks: Vec<JoinHandle<()>>,
}

impl TestServer {
    /// Starts a server with one worker.
    pub(crate) async fn start(queue_length: usize, solver: Arc<dyn ManeuverSolver>) -> Self {
        Self::start_with(queue_length, solver, ApiSettings::default(), ServerSettings::default()).await
    }

    /// Starts a server with one worker, REST and gRPC on a port each.
    pub(crate) async fn start_with(
        queue_length: usize,
        solver: Arc<dyn ManeuverSolver>,
        api: ApiSettings,
        server: ServerSettings,
    ) -> Self {
        let settings = ServiceSettings { queue_length, ..ServiceSettings::default() };
        Self::start_sized(settings, solver, api, server).await
    }

    /// Starts a server of any size.
    pub(crate) async fn start_sized(
        settings: ServiceSettings,
        solver: Arc<dyn ManeuverSolver>,
        api: ApiSettings,
        server: ServerSettings,
    ) -> Self {
        Self::start_limited(Limits::default(), settings, solver, api, server).await
    }

    /// Starts a server of any size that accepts no more than these limits.
    pub(crate) async fn start_limited(
        limits: Limits,
        settings: ServiceSettings,
        solver: Arc<dyn ManeuverSolver>,
        api: ApiSettings,
        server: ServerSettings,
    ) -> Self {
        let service = Arc::new(Service::start(settings).unwrap());
        let jobs = Jobs::new(limits, solver, service.metrics());
        let state = ApiState::new(Arc::clone(&service), jobs, api);
        let (grpc_router, health) = grpc::router(&state).await;
        let (mut addresses, mut tasks) = (Vec::new(), Vec::new());
        let connections = Connections::of(&state, server);
        for router in [rest::router(&state), grpc_router] {
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            addresses.push(listener.local_addr().unwrap());
            tasks.push(tokio::spawn(server::serve(listener, router, Arc::clone(&connections), std::future::pending())));
        }
        let client = reqwest::Client::builder().timeout(HANG_BOUND).no_proxy().build().unwrap();
        Self { connections, address: addresses[0], grpc_address: addresses[1], service, state, client, health, tasks }
    }

    /// A gRPC client with a connection of its own.
    pub(crate) async fn grpc(&self) -> ManeuverServiceClient<Channel> {
        ManeuverServiceClient::new(self.channel().await).max_decoding_message_size(16 * 1024 * 1024)
    }

    pub(crate) async fn channel(&self) -> Channel {
        let endpoint = Endpoint::from_shared(format!("http://{}", self.grpc_address)).unwrap();
        endpoint.connect().await.unwrap()
    }

    pub(crate) fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    /// Posts bytes as JSON.
    pub(crate) async fn post(&self, path: &str, body: impl Into<reqwest::Body>) -> Answer {
        let request = self.client.post(self.url(path)).header("content-type", "application/json").body(body);
        Answer::of(request).await
    }

    pub(crate) async fn get(&self, path: &str) -> Answer {
        Answer::of(self.client.get(self.url(path))).await
    }
}

impl Drop for TestServer {
    fn drop(&mut self) {
        for task in &self.tasks {
            task.abort();
        }
        self.service.cancel_all();
    }
}

/// An answer, read to its end.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) headers: reqwest::header::HeaderMap,
    pub(crate) bytes: Vec<u8>,
}

impl Answer {
    /// Sends a request, and holds its answer against the OpenAPI document.
    pub(crate) async fn of(request: reqwest::RequestBuilder) -> Self {
        let (client, request) = request.build_split();
        let request = request.expect("the request is complete");
        let (method, path) = (request.method().clone(), request.url().path().to_owned());
        let response = client.execute(request).await.expect("the server answers");
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        let bytes = response.bytes().await.expect("the answer is complete").to_vec();
        let answer = Self { status, headers, bytes };
        conformance::document().await.check(
            method.as_str(),
            &path,
            status,
            answer.header("content-type"),
            &answer.bytes,
        );
        answer
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.bytes).unwrap_or_else(|error| panic!("{error}: {}", self.text()))
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes).into_owned()
    }

    /// The body, after checking that it is a complete problem of this status.
    pub(crate) fn problem(&self) -> Value {
        assert_eq!(self.header("content-type"), "application/problem+json", "{}", self.text());
        let problem = self.json();
        assert_eq!(problem["status"], self.status, "{problem}");
        for field in ["type", "title", "detail", "instance", "code", "request_id"] {
            assert!(problem[field].as_str().is_some_and(|text| !text.is_empty()), "{field}: {problem}");
        }
        assert_eq!(problem["request_id"], self.header("x-request-id"));
        assert!(problem["retryable"].is_boolean() && problem["errors"].is_array(), "{problem}");
        problem
    }
}
