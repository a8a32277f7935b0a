//! Places, memory and streams are bounded: who takes more than a share is refused or ended, and others are served.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use prost::Message as _;
use slipdrive::api::ApiSettings;
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::grpc::pb;
use slipdrive::api::server::ServerSettings;
use slipdrive::jobs::ManeuverSolver;
use slipdrive::robot::State;
use slipdrive::simulation::Trajectory;
use slipdrive::solver::{RunControl, Solution, SolveInput, StopReason};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::timeout;

use crate::support::http2::{Connection, DATA, END_STREAM, GOAWAY, HEADERS, RST_STREAM, WINDOW_UPDATE};
use crate::support::protobuf::SOLVE;
use crate::support::{
    Answer, FakeSolver, HANG_BOUND, TestServer, held_solver, instant_solver, real_solver, small_solution,
};

const HEALTH: &str = "/grpc.health.v1.Health/Check";
const BATCH: &str = "/slipdrive.v1.ManeuverService/SolveBatch";

/// A server with these settings.
async fn server(settings: ServerSettings, solver: Arc<dyn ManeuverSolver>) -> TestServer {
    TestServer::start_with(64, solver, ApiSettings::default(), settings).await
}

/// A figure of the server's own counts.
fn level(server: &TestServer, name: &str) -> usize {
    let text = String::from_utf8(server.service.metrics_text()).unwrap();
    // Some families begin with their first event.
    let line = text.lines().find(|line| line.starts_with(name));
    line.map_or(0, |line| line.rsplit_once(' ').unwrap().1.parse().unwrap())
}

/// Asks over a connection of its own.
async fn fresh(server: &TestServer, path: &str) -> Answer {
    let client = reqwest::Client::builder().no_proxy().timeout(HANG_BOUND).build().unwrap();
    Answer::of(client.get(server.url(path))).await
}

#[tokio::test]
async fn guests_have_few_streams_and_short_messages() {
    let api = ApiSettings {
        keys: ApiKeys::parse("key").unwrap(),
        body_timeout: Duration::from_millis(100),
        ..ApiSettings::default()
    };
    let server = TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await;
    let mut connection = Connection::open(server.grpc_address, 0).await;
    for stream in (1..256).step_by(2) {
        connection.request(stream, HEALTH, 0).await;
        // Declares 4 MB, and sends none of it.
        connection.send(DATA, 0, stream, &[0, 0, 0x40, 0, 0]).await;
    }
    for _ in 4..128 {
        assert!(connection.reads_up_to(RST_STREAM).await, "only four are served at a time");
    }
    for _ in 0..4 {
        assert!(connection.reads_up_to(HEADERS).await, "those are refused when their time is over");
    }
    let mut connection = Connection::open(server.grpc_address, 0).await;
    connection.request(1, HEALTH, 0).await;
    connection.send(DATA, 0, 1, &[0; 2048]).await;
    assert!(connection.reads_up_to(HEADERS).await, "a long message is refused before it is complete");
}

#[tokio::test]
async fn long_heads_are_refused() {
    let server = server(ServerSettings::default(), instant_solver()).await;
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let head = format!("GET /livez HTTP/1.1\r\nhost: h\r\nx-filler: {}", "x".repeat(64 * 1024));
    let _ = stream.write_all(head.as_bytes()).await;
    let mut answer = Vec::new();
    // A reset closes as well.
    let _ = timeout(HANG_BOUND, stream.read_to_end(&mut answer)).await.expect("the connection is closed at once");
    assert!(answer.is_empty() || answer.starts_with(b"HTTP/1.1 431"), "{}", String::from_utf8_lossy(&answer));
}

#[tokio::test]
async fn newcomers_and_probes_get_in_where_idle_connections_take_all_places() {
    let settings = ServerSettings { max_connections: 20, ..ServerSettings::default() };
    let server = server(settings, instant_solver()).await;
    let mut idle = Vec::new();
    for _ in 0..20 {
        for _ in 0..5 {
            idle.push(TcpStream::connect(server.address).await.unwrap());
            idle.push(TcpStream::connect(server.grpc_address).await.unwrap());
        }
        assert_eq!(fresh(&server, "/limits").await.status, 200);
        assert_eq!(fresh(&server, "/livez").await.status, 200);
        server.grpc().await.get_limits(pb::GetLimitsRequest {}).await.unwrap();
    }
}

#[tokio::test]
async fn last_places_serve_probes_while_all_others_work() {
    let settings = ServerSettings { max_connections: 16 + 2, ..ServerSettings::default() };
    let (gate, mut started, solver) = held_solver();
    let server = server(settings, solver).await;
    let mut busy = Vec::new();
    for _ in 0..2 {
        let mut connection = Connection::open(server.address, 65_535).await;
        connection.whole_request(1, "/solve").await;
        busy.push(connection);
    }
    timeout(HANG_BOUND, started.recv()).await.unwrap();
    while server.service.jobs_in_flight() < 2 {
        tokio::task::yield_now().await;
    }
    for _ in 0..20 {
        assert_eq!(fresh(&server, "/readyz").await.status, 200);
        let client = reqwest::Client::builder().no_proxy().build().unwrap();
        let refused = client.get(server.url("/limits")).send().await.unwrap();
        assert_eq!(refused.status(), 503);
        assert!(refused.text().await.unwrap().contains("\"unavailable\""));
    }
    gate.open();
    for connection in &mut busy {
        assert!(connection.reads_up_to(HEADERS).await, "those who work keep their places");
    }
}

/// Of it requests have three quarters, one connection a quarter of those, and large answers three quarters together.
const SMALL_BUDGET: usize = 1 << 20;

fn small_budget() -> ServerSettings {
    ServerSettings { memory_budget_bytes: SMALL_BUDGET, ..ServerSettings::default() }
}

/// Waits until nothing is reserved any more.
async fn is_released(server: &TestServer) {
    let released = async {
        while level(server, "slipdrive_held_bytes") > 0 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    timeout(HANG_BOUND, released).await.expect("all memory is released");
}

#[tokio::test]
async fn unread_answers_stay_within_the_budget() {
    let server = server(small_budget(), real_solver()).await;
    // 160 kB as JSON.
    let body =
        br#"{"grid": {"steps": 340}, "torque_schedule": {"interval_s": 1, "left_n_m": [0.1], "right_n_m": [0.1]}}"#;
    let mut unread = Vec::new();
    for _ in 0..12 {
        let mut connection = Connection::open(server.address, 0).await;
        for stream in (1..8).step_by(2) {
            connection.request(stream, "/simulate", 0).await;
            connection.send(DATA, END_STREAM, stream, body).await;
        }
        for _ in 0..4 {
            assert!(connection.reads_up_to(HEADERS).await, "one is answered, the others are refused");
        }
        assert!(level(&server, "slipdrive_held_bytes") <= SMALL_BUDGET);
        unread.push(connection);
        assert_eq!(server.post("/validate", "{}").await.status, 200);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(level(&server, "slipdrive_connections_ended_total{cause=\"unread\"}") > 0);
    drop(unread);
    is_released(&server).await;
    // Refusals, too, are over when they are taken or their callers have left.
    assert!(level(&server, "slipdrive_rejected_total{code=\"memory_full\"}") >= 3 * 12);
}

#[tokio::test]
async fn slow_readers_without_a_key_have_half_of_the_memory_and_starve_nobody() {
    let api = ApiSettings { keys: ApiKeys::parse("key").unwrap(), ..ApiSettings::default() };
    let server = TestServer::start_with(64, instant_solver(), api, small_budget()).await;
    let callers = [reqwest::Client::builder(), reqwest::Client::builder().http2_prior_knowledge()]
        .map(|builder| builder.no_proxy().timeout(HANG_BOUND).build().unwrap());
    let (mut unread, mut most) = (Vec::new(), 0);
    for path in ["/openapi.json", "/page/docs.js", "/limits", "/", "/page/nothing"].into_iter().cycle().take(30) {
        let mut connection = Connection::open(server.address, 0).await;
        for stream in (1..128).step_by(2) {
            connection.get(stream, path).await;
        }
        assert!(connection.reads_up_to(RST_STREAM).await, "one connection has a share only");
        most = most.max(level(&server, "slipdrive_held_bytes"));
        unread.push(connection);
        for caller in &callers {
            let solve = caller.post(server.url("/solve")).bearer_auth("key").header("content-type", "application/json");
            assert_eq!(Answer::of(solve.body("{}")).await.status, 200, "beside {path}");
        }
    }
    assert!((SMALL_BUDGET / 8..=SMALL_BUDGET / 8 * 3).contains(&most), "{most} bytes were held");
    drop(unread);
    is_released(&server).await;
    assert_eq!(fresh(&server, "/openapi.json").await.status, 200);
}

#[tokio::test]
async fn page_is_loaded_over_one_connection_at_once() {
    let api = ApiSettings { keys: ApiKeys::parse("key").unwrap(), ..ApiSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await;
    let mut connection = Connection::open(server.address, 1 << 20).await;
    // More files than the page has: a browser asks for all of them together.
    for stream in (1..128).step_by(2) {
        connection.get(stream, "/page/main.js").await;
    }
    for _ in 0..64 {
        assert!(connection.answer().await.is_some_and(|head| head.is_ok()), "none is refused");
    }
}

#[tokio::test]
async fn answers_that_are_larger_than_expected_make_room_for_themselves() {
    let solver = FakeSolver(|_: &SolveInput, _: &RunControl<'_>| {
        let state = vec![State::default(); 4_000];
        let trajectory = Trajectory { time: vec![0.1; state.len()], state, ..Trajectory::default() };
        Solution { trajectory, ..small_solution(StopReason::Finished) }
    });
    let answer_bytes = 4_000 * 11 * 8;
    let server = server(small_budget(), Arc::new(solver)).await;
    let mut unread = Vec::new();
    for number in 1..=8 {
        let mut connection = Connection::open(server.grpc_address, 0).await;
        connection.whole_request(1, SOLVE).await;
        unread.push(connection);
        let is_written = async {
            while level(&server, "slipdrive_solves_total{method=\"sequential_linear\",status=\"converged\"") < number {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        timeout(HANG_BOUND, is_written).await.unwrap();
        // Until the next one it has kept the server waiting for longer than a healthy peer does.
        tokio::time::sleep(Duration::from_millis(150)).await;
        let held = level(&server, "slipdrive_held_bytes");
        assert!((answer_bytes..SMALL_BUDGET + answer_bytes).contains(&held), "{held} bytes after {number}");
    }
    assert!(level(&server, "slipdrive_connections_ended_total{cause=\"unread\"}") > 0);
    drop(unread);
    is_released(&server).await;
}

#[tokio::test]
async fn longest_message_of_a_batch_is_held_until_its_end() {
    let server = server(ServerSettings::default(), instant_solver()).await;
    let bytes = 8 * 10_000;
    let guess = pb::InitialGuess { torque_left_n_m: vec![0.5; bytes / 8], ..pb::InitialGuess::default() };
    let request = pb::SolveRequest { initial_guess: Some(guess), ..pb::SolveRequest::default() };
    let item = |request_id: &str, request: &pb::SolveRequest| pb::BatchRequest {
        request_id: request_id.to_owned(),
        timeout_ms: None,
        request: Some(pb::batch_request::Request::Solve(request.clone())),
    };
    let (sender, sent) = tokio::sync::mpsc::unbounded_channel();
    let sent = futures_util::stream::unfold(sent, async |mut sent| sent.recv().await.map(|item| (item, sent)));
    let mut answers = server.grpc().await.batch(sent).await.unwrap().into_inner();
    for (id, request) in [("long", &request), ("short", &pb::SolveRequest::default())] {
        sender.send(item(id, request)).unwrap();
        assert_eq!(answers.message().await.unwrap().unwrap().request_id, id);
    }
    // Its reader keeps room for it.
    let held = level(&server, "slipdrive_held_bytes");
    assert!((bytes..2 * bytes).contains(&held), "{held}");
    drop(sender);
    assert!(answers.message().await.unwrap().is_none());
    is_released(&server).await;
}

#[tokio::test]
async fn far_too_many_plans_are_refused_before_they_are_read() {
    let server = server(ServerSettings::default(), instant_solver()).await;
    let request = pb::PresentRequest { plans: vec![pb::PresentedPlan::default(); 5_000], report: false };
    let refused = server.grpc().await.present(request.clone()).await.unwrap_err();
    let says = "`plans` is 5000 items long, must be between 1 and 4 items";
    assert_eq!((refused.code(), refused.message()), (tonic::Code::InvalidArgument, says));
    let item = |request_id: &str, request| pb::BatchRequest {
        request_id: request_id.to_owned(),
        timeout_ms: None,
        request: Some(request),
    };
    let few = pb::batch_request::Request::Solve(pb::SolveRequest::default());
    let items = [item("many", pb::batch_request::Request::Present(request)), item("few", few)];
    let mut answers = server.grpc().await.batch(futures_util::stream::iter(items)).await.unwrap().into_inner();
    let refused = answers.message().await.unwrap().unwrap();
    let Some(pb::batch_response::Answer::Error(error)) = refused.answer else { panic!("{refused:?}") };
    assert_eq!((&*refused.request_id, &*error.message), ("many", says));
    let next = answers.message().await.unwrap().unwrap();
    assert!(matches!(next.answer, Some(pb::batch_response::Answer::Solve(_))), "the others go on");
    let in_json = format!("{{\"plans\": [{}]}}", vec!["{}"; 5_000].join(","));
    let answer = server.post("/present", in_json).await;
    assert!(answer.status == 422 && answer.text().contains(says), "{}", answer.text());
}

#[tokio::test]
async fn half_sent_bodies_stay_within_the_budget() {
    let server = server(small_budget(), instant_solver()).await;
    let (spaces, message) = (vec![b' '; 16_000], vec![0; 16_000]);
    let mut half_sent = Vec::new();
    for _ in 0..8 {
        for (address, path, part) in [(server.address, "/solve", &spaces), (server.grpc_address, SOLVE, &message)] {
            let mut connection = Connection::open(address, 65_535).await;
            for stream in (1..32).step_by(2) {
                connection.request(stream, path, 0).await;
            }
            for stream in (1..32).step_by(2) {
                connection.send(DATA, 0, stream, part).await;
                connection.send(DATA, 0, stream, part).await;
            }
            half_sent.push(connection);
            assert!(level(&server, "slipdrive_held_bytes") <= SMALL_BUDGET);
            assert_eq!(server.post("/validate", "{}").await.status, 200);
        }
    }
    drop(half_sent);
    is_released(&server).await;
}

/// One message of a batch, in a frame of its own.
fn item(number: usize) -> Vec<u8> {
    let message = pb::SolveBatchRequest { request_id: format!("item-{number}"), ..pb::SolveBatchRequest::default() };
    let message = message.encode_to_vec();
    let mut framed = vec![0];
    framed.extend(u32::try_from(message.len()).unwrap().to_be_bytes());
    framed.extend(message);
    framed
}

#[tokio::test]
async fn batches_of_many_small_frames_share_one_connection() {
    const ITEMS: usize = 2_000;
    let server = server(ServerSettings::default(), instant_solver()).await;
    let mut connection = Connection::open(server.grpc_address, 1 << 30).await;
    connection.send(WINDOW_UPDATE, 0, 0, &(1_u32 << 30).to_be_bytes()).await;
    let streams = [1, 3, 5];
    for stream in streams {
        connection.request(stream, BATCH, 0).await;
    }
    for number in 0..ITEMS {
        let flags = if number + 1 == ITEMS { END_STREAM } else { 0 };
        for stream in streams {
            connection.send(DATA, flags, stream, &item(number)).await;
        }
    }
    for _ in 0..2 * streams.len() {
        assert!(connection.reads_up_to(HEADERS).await, "each has a head and trailers");
    }
    let metrics = String::from_utf8(server.service.metrics_text()).unwrap();
    assert!(metrics.contains("slipdrive_grpc_request_duration_seconds_count{code=\"OK\",method=\"SolveBatch\"} 3"));
}

#[tokio::test]
async fn end_of_the_server_is_told_before_its_last_solve_ends() {
    let (gate, mut started, solver) = held_solver();
    let server = server(ServerSettings::default(), solver).await;
    let transports: [(SocketAddr, &str); 2] = [(server.address, "/solve"), (server.grpc_address, SOLVE)];
    let mut connections = Vec::new();
    for (address, path) in transports {
        let mut connection = Connection::open(address, 65_535).await;
        connection.whole_request(1, path).await;
        connections.push(connection);
    }
    timeout(HANG_BOUND, started.recv()).await.unwrap();
    assert_eq!(server.get("/livez").await.header("connection"), "");
    server.connections.announce_end();
    assert_eq!(server.get("/livez").await.header("connection"), "close");
    server.connections.close();
    for connection in &mut connections {
        assert!(connection.reads_up_to(GOAWAY).await);
    }
    assert_eq!(fresh(&server, "/livez").await.status, 200, "probes are still answered");
    gate.open();
    for connection in &mut connections {
        assert!(connection.reads_up_to(HEADERS).await);
    }
}
