//! Every row of the error table, provoked on both transports.

use std::fs;
use std::sync::Arc;
use std::time::Duration;

use prost::Message as _;
use serde_json::Value;
use slipdrive::api::ApiSettings;
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::grpc::pb;
use slipdrive::api::server::ServerSettings;
use slipdrive::contract::ErrorCode;
use slipdrive::solver::SolveInput;
use slipdrive::solver::{RunControl, StopReason};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::time::timeout;
use tonic::{Code, Request, Status};

use crate::stopping::impatient_server;
use crate::support::protobuf::{GRPC, SOLVE, code_of, framed, raw_call};
use crate::support::slow_simulation::slow_simulation;
use crate::support::{Answer, FakeSolver, Gate, HANG_BOUND, TestServer, instant_solver, small_solution};

/// What the solver does with a seed, beside answering at once.
const SEED_HOLD: u64 = 1;
const SEED_PANIC: u64 = 2;
const SEED_SPIN: u64 = 3;

/// A server with one worker and no line, and what the test holds of its solver.
struct Case {
    server: TestServer,
    gate: Arc<Gate>,
    has_started: UnboundedReceiver<u64>,
}

impl Case {
    async fn start(queue_length: usize, api: ApiSettings) -> Self {
        let gate = Arc::new(Gate::default());
        let held = Arc::clone(&gate);
        let (started, has_started) = unbounded_channel();
        let solver = FakeSolver(move |input: &SolveInput, control: &RunControl<'_>| {
            // Not every test listens.
            let _ = started.send(input.settings.seed);
            match input.settings.seed {
                SEED_HOLD => held.wait(),
                SEED_PANIC => panic!("injected secret"),
                SEED_SPIN => {
                    while !control.is_stopped() {
                        std::thread::yield_now();
                    }
                    return small_solution(StopReason::Stopped);
                }
                _ => {}
            }
            small_solution(StopReason::Finished)
        });
        let server = TestServer::start_with(queue_length, Arc::new(solver), api, ServerSettings::default()).await;
        Self { server, gate, has_started }
    }

    /// Occupies the only worker until the gate opens, with a search that seems to need so many rollouts.
    async fn hold_worker(&mut self, rollout_limit: u64) {
        let request = self.server.client.post(self.server.url("/solve")).header("content-type", "application/json");
        let body = format!(r#"{{"solver": {{"seed": {SEED_HOLD}, "rollout_limit": {rollout_limit}}}}}"#);
        tokio::spawn(request.body(body).send());
        assert_eq!(timeout(HANG_BOUND, self.has_started.recv()).await.unwrap(), Some(SEED_HOLD));
    }
}

/// The refusals of the same situation by both transports.
struct Refusals {
    rest: Answer,
    grpc: Status,
}

fn seeded(seed: u64) -> pb::SolveRequest {
    let solver = pb::Solver { seed, ..pb::Solver::default() };
    pb::SolveRequest { solver: Some(solver), ..pb::SolveRequest::default() }
}

/// A solve by both transports, with a timeout in ms where there is one.
async fn solve_both(server: &TestServer, seed: u64, timeout_ms: Option<u32>) -> Refusals {
    let request = server.client.post(server.url("/solve")).header("content-type", "application/json");
    let mut request = request.body(format!(r#"{{"solver": {{"seed": {seed}}}}}"#));
    let grpc_timeout = timeout_ms.map(|timeout_ms| format!("{timeout_ms}m"));
    if let Some(timeout_ms) = timeout_ms {
        request = request.header("request-timeout-ms", timeout_ms);
    }
    let headers: Vec<_> =
        [GRPC].into_iter().chain(grpc_timeout.iter().map(|given| ("grpc-timeout", &**given))).collect();
    let rest = Answer::of(request).await;
    Refusals { rest, grpc: raw_call(server, SOLVE, &headers, framed(0, &seeded(seed).encode_to_vec())).await }
}

/// The JSON over one transport, the message over the other.
async fn refuse(server: &TestServer, body: &str, message: pb::SolveRequest) -> Refusals {
    let rest = server.post("/solve", body.to_owned()).await;
    Refusals { rest, grpc: server.grpc().await.solve(message).await.unwrap_err() }
}

/// The situation of a row; none where no caller can meet it over a socket.
async fn provoke(code: ErrorCode) -> Option<Refusals> {
    let mut case = Case::start(0, ApiSettings::default()).await;
    let server = &case.server;
    let refusals = match code {
        ErrorCode::QueueFull => {
            case.hold_worker(1).await;
            let refusals = solve_both(&case.server, 0, None).await;
            case.gate.open();
            refusals
        }
        ErrorCode::MemoryFull => {
            // One connection has a quarter of it: less than a full answer of 200 steps.
            let settings = ServerSettings { memory_budget_bytes: 128 * 1024, ..ServerSettings::default() };
            let server = TestServer::start_with(0, instant_solver(), ApiSettings::default(), settings).await;
            solve_both(&server, 0, None).await
        }
        ErrorCode::DeadlineUnreachable => unreachable_deadline().await,
        ErrorCode::DeadlineExceeded => {
            let mut case = Case::start(1, ApiSettings::default()).await;
            case.hold_worker(1).await;
            let refusals = solve_both(&case.server, 0, Some(50)).await;
            case.gate.open();
            assert!(case.has_started.try_recv().is_err(), "nothing was started");
            refusals
        }
        ErrorCode::TimeLimitExceeded => too_long_simulation().await,
        ErrorCode::Unavailable => {
            server.service.close();
            solve_both(server, 0, None).await
        }
        ErrorCode::MalformedBody => {
            let rest = server.post("/solve", "{").await;
            Refusals { rest, grpc: raw_call(server, SOLVE, &[GRPC], framed(0, b"\xff\xff\xff")).await }
        }
        ErrorCode::InvalidField => {
            let message = pb::SolveRequest { view: 9, ..pb::SolveRequest::default() };
            refuse(server, r#"{"view": "nine"}"#, message).await
        }
        ErrorCode::InvalidValue => {
            let robot = pb::Robot { wheel_radius_m: Some(0.0), ..pb::Robot::default() };
            let message = pb::SolveRequest { robot: Some(robot), ..pb::SolveRequest::default() };
            refuse(server, r#"{"robot": {"wheel_radius_m": 0}}"#, message).await
        }
        ErrorCode::ProblemTooLarge => {
            let grid = pb::SolveGrid { steps: Some(10_001), control_intervals: None };
            let message = pb::SolveRequest { grid: Some(grid), ..pb::SolveRequest::default() };
            refuse(server, r#"{"grid": {"steps": 10001}}"#, message).await
        }
        ErrorCode::BodyTooLarge => {
            let guess = pb::InitialGuess { torque_left_n_m: vec![0.5; 100_000], ..pb::InitialGuess::default() };
            let message = pb::SolveRequest { initial_guess: Some(guess), ..pb::SolveRequest::default() };
            refuse(server, &" ".repeat(300_000), message).await
        }
        ErrorCode::BodyTimeout => slow_bodies().await,
        ErrorCode::UnsupportedMedia => {
            let request = server.client.post(server.url("/solve")).header("content-type", "text/plain");
            let rest = Answer::of(request.body("{}")).await;
            Refusals { rest, grpc: raw_call(server, SOLVE, &[GRPC, ("grpc-encoding", "gzip")], framed(1, b"")).await }
        }
        ErrorCode::NotFound => {
            let unknown = "/slipdrive.v1.ManeuverService/Fly";
            Refusals { rest: server.get("/fly").await, grpc: raw_call(server, unknown, &[GRPC], framed(0, b"")).await }
        }
        ErrorCode::MethodNotAllowed => {
            let grpc = raw_call(server, SOLVE, &[(":method", "PUT"), GRPC], framed(0, b"")).await;
            Refusals { rest: server.get("/solve").await, grpc }
        }
        ErrorCode::SolverPanic => solve_both(server, SEED_PANIC, None).await,
        ErrorCode::Unauthenticated => {
            let api = ApiSettings { keys: ApiKeys::parse("secret-key").unwrap(), ..ApiSettings::default() };
            solve_both(&Case::start(0, api).await.server, 0, None).await
        }
        // Nobody is left to read the first: see `grpc_contract` and `http_overload` for what happens then. The second is
        // a fault of a handler, and there is none to call: see the unit tests of `api::rest`.
        ErrorCode::Cancelled | ErrorCode::Internal => return None,
    };
    Some(refusals)
}

/// The average solve takes longer than the deadline, and the worker is taken.
async fn unreachable_deadline() -> Refusals {
    let mut case = Case::start(4, ApiSettings::default()).await;
    let body = format!(r#"{{"solver": {{"seed": {SEED_SPIN}, "time_limit_s": 0.5}}}}"#);
    assert_eq!(case.server.post("/solve", body).await.status, 200);
    assert_eq!(case.has_started.recv().await, Some(SEED_SPIN));
    case.hold_worker(1_000_000).await;
    let refusals = solve_both(&case.server, 0, Some(300)).await;
    case.gate.open();
    refusals
}

/// A simulation that takes longer than the server allows.
async fn too_long_simulation() -> Refusals {
    let server = impatient_server().await;
    let body = slow_simulation().to_string();
    let message: pb::SimulateRequest = serde_json::from_str(&body).unwrap();
    let rest = server.post("/simulate", body).await;
    Refusals { rest, grpc: server.grpc().await.simulate(message).await.unwrap_err() }
}

/// Bodies that never end, on a server that has little patience.
async fn slow_bodies() -> Refusals {
    let api = ApiSettings { body_timeout: Duration::from_millis(50), ..ApiSettings::default() };
    let server = Case::start(0, api).await.server;
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let head = "POST /solve HTTP/1.1\r\nhost: h\r\nconnection: close\r\ncontent-type: application/json\r\n\
                content-length: 100\r\n\r\n{";
    stream.write_all(head.as_bytes()).await.unwrap();
    let mut text = String::new();
    timeout(HANG_BOUND, stream.read_to_string(&mut text)).await.unwrap().unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap();
    let headers = head.lines().skip(1).filter_map(|line| line.split_once(": "));
    let headers = headers.map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap())).collect();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    let rest = Answer { status, headers, bytes: body.as_bytes().to_vec() };

    let never = futures_util::stream::pending::<pb::SolveBatchRequest>();
    // A unary call whose message never comes: a batch sent to the path of a solve.
    let mut grpc = tonic::client::Grpc::new(server.channel().await);
    grpc.ready().await.unwrap();
    let codec = tonic_prost::ProstCodec::<pb::SolveBatchRequest, pb::SolveResponse>::default();
    let call = grpc.streaming(Request::new(never), SOLVE.parse().unwrap(), codec);
    let grpc = match timeout(HANG_BOUND, call).await.unwrap() {
        Err(status) => status,
        Ok(response) => response.into_inner().message().await.unwrap_err(),
    };
    Refusals { rest, grpc }
}

#[tokio::test]
async fn every_row_is_met_on_both_transports() {
    for code in ErrorCode::ALL {
        let Some(Refusals { rest, grpc }) = provoke(code).await else { continue };
        let entry = code.entry();
        let problem = rest.problem();
        assert_eq!(problem["code"], entry.code, "{problem}");
        assert_eq!((rest.status, &problem["retryable"]), (entry.http_status, &Value::from(entry.retryable)));
        assert_eq!(
            (code_of(&grpc).as_str(), grpc.code()),
            (entry.code, Code::from(entry.grpc_code as i32)),
            "{grpc:?}"
        );
        let has_retry_after = rest.header("retry-after").parse::<u64>().is_ok_and(|seconds| seconds >= 1);
        assert_eq!(has_retry_after, matches!(entry.http_status, 429 | 503), "{}", entry.code);
        assert!(!rest.text().contains("secret") && !grpc.message().contains("secret"), "no internals");
    }
}

#[tokio::test]
async fn what_follows_a_code_on_its_transport_is_there() {
    let refusals = provoke(ErrorCode::Unauthenticated).await.unwrap();
    assert_eq!(refusals.rest.header("www-authenticate"), "Bearer");
    let refusals = provoke(ErrorCode::MethodNotAllowed).await.unwrap();
    assert_eq!(refusals.rest.header("allow"), "POST");
    let refusals = provoke(ErrorCode::BodyTooLarge).await.unwrap();
    assert_eq!(refusals.grpc.metadata().get("grpc-retry-pushback-ms").unwrap(), "-1");
}

#[tokio::test]
async fn keys_are_asked_for_on_both_transports_except_for_health() {
    let api = ApiSettings { keys: ApiKeys::parse("key-1,key-2").unwrap(), ..ApiSettings::default() };
    let server = Case::start(0, api).await.server;
    for path in ["/livez", "/readyz"] {
        assert_eq!(server.get(path).await.status, 200, "{path}");
    }
    assert_eq!(server.get("/examples/forward-drive").await.status, 401);
    assert_eq!(server.get("/nowhere").await.status, 401, "keys come before paths");
    let example = server.client.get(server.url("/examples/forward-drive"));
    assert_eq!(Answer::of(example.header("authorization", "Bearer key-2")).await.status, 200);

    let mut health = tonic_health::pb::health_client::HealthClient::new(server.channel().await);
    assert!(health.check(tonic_health::pb::HealthCheckRequest::default()).await.is_ok());
    let mut call = Request::new(pb::SolveRequest::default());
    call.metadata_mut().insert("authorization", "Bearer key-1".parse().unwrap());
    let mut client = server.grpc().await;
    assert!(client.solve(call).await.is_ok());
    let refused = client.get_limits(pb::GetLimitsRequest {}).await.unwrap_err();
    assert_eq!((refused.code(), code_of(&refused).as_str()), (Code::Unauthenticated, "unauthenticated"));
}

#[test]
fn documented_codes_are_those_of_the_table() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/fleet_planner.md");
    let guide = fs::read_to_string(path).unwrap();
    // The document writes `RESOURCE_EXHAUSTED`, the table `ResourceExhausted`.
    let plain = |row: &str| row.replace('_', "").to_lowercase();
    let (_, section) = guide.split_once("\n## Errors\n").expect("a section of errors");
    let (section, _) = section.split_once("\n## ").expect("a section behind it");
    let rows = section.lines().filter(|line| line.starts_with("| `"));
    let documented: Vec<_> = rows.map(|row| plain(&row.split(" | ").take(4).collect::<Vec<_>>().join(" | "))).collect();
    let entries = ErrorCode::ALL.map(|code| {
        let entry = code.entry();
        plain(&format!("| `{}` | {} | `{:?}` | {}", entry.code, entry.http_status, entry.grpc_code, entry.retryable))
    });
    assert_eq!(documented, entries, "the codes in {path}");
}

#[tokio::test]
async fn first_check_that_fails_speaks() {
    let mut case = Case::start(0, ApiSettings { keys: ApiKeys::parse("key").unwrap(), ..ApiSettings::default() }).await;
    let request = case.server.client.post(case.server.url("/solve")).bearer_auth("key");
    tokio::spawn(request.header("content-type", "application/json").body(r#"{"solver": {"seed": 1}}"#).send());
    assert_eq!(timeout(HANG_BOUND, case.has_started.recv()).await.unwrap(), Some(SEED_HOLD));
    let code = async |key: &str, path: &str, media_type: &str, body: String| {
        let request = case.server.client.post(case.server.url(path)).bearer_auth(key);
        let rest = Answer::of(request.header("content-type", media_type).body(body)).await;
        rest.problem()["code"].as_str().unwrap().to_owned()
    };
    let (json, large) = ("application/json", " ".repeat(300_000));
    // Each request has all faults of those after it.
    assert_eq!(code("wrong", "/nowhere", "text/plain", large.clone()).await, "unauthenticated");
    assert_eq!(code("key", "/nowhere", "text/plain", large.clone()).await, "not_found");
    assert_eq!(code("key", "/solve", "text/plain", large).await, "body_too_large");
    assert_eq!(code("key", "/solve", "text/plain", "{".to_owned()).await, "unsupported_media");
    assert_eq!(code("key", "/solve", json, "{".to_owned()).await, "queue_full");
    let authorization = ("authorization", "Bearer key");
    let grpc = async |headers: &[(&str, &str)], path: &str, body: Vec<u8>| {
        code_of(&raw_call(&case.server, path, headers, body).await)
    };
    let (plain, malformed) = (("content-type", "application/json"), framed(0, b"\xff\xff\xff"));
    assert_eq!(grpc(&[plain], "/nowhere", malformed.clone()).await, "unauthenticated");
    assert_eq!(grpc(&[authorization, plain], SOLVE, malformed.clone()).await, "unsupported_media");
    assert_eq!(grpc(&[authorization, GRPC], SOLVE, framed(0, &vec![0; 300_000])).await, "body_too_large");
    let large = raw_call(&case.server, SOLVE, &[authorization, GRPC], framed(0, &vec![0; 300_000])).await;
    assert!(large.message().contains("larger than 262144 bytes"), "{large}");
    assert_eq!(grpc(&[authorization, GRPC], SOLVE, malformed.clone()).await, "queue_full");
    case.gate.open();
    while case.server.service.jobs_in_flight() > 0 {
        tokio::task::yield_now().await;
    }
    let body = r#"{"robot": {"wheel_radius_m": 0}, "view": 3}"#;
    assert_eq!(code("key", "/solve", json, body.to_owned()).await, "invalid_field");
    assert_eq!(grpc(&[authorization, GRPC], SOLVE, malformed.clone()).await, "malformed_body");
    case.server.service.close();
    assert_eq!(code("key", "/solve", "text/plain", String::new()).await, "unavailable", "readiness comes first");
    assert_eq!(grpc(&[authorization, plain], SOLVE, malformed).await, "unavailable");
}
