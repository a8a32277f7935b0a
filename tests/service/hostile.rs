//! Callers who mean no good: each is refused or closed, and nobody else notices.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use futures_util::StreamExt as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::api::ApiSettings;
use slipdrive::api::grpc::pb;
use slipdrive::api::server::ServerSettings;
use slipdrive::jobs::ManeuverSolver;
use slipdrive::robot::State;
use slipdrive::simulation::Trajectory;
use slipdrive::solver::SolveInput;
use slipdrive::solver::{RunControl, StopReason};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::timeout;

use crate::support::http2::{Connection, GOAWAY, HEADERS};
use crate::support::protobuf::{GRPC, code_of, framed, raw_call};
use crate::support::{FakeSolver, Gate, HANG_BOUND, TestServer, instant_solver, small_solution};

const SEED: u64 = 11;

/// A server that loses patience soon.
async fn impatient() -> TestServer {
    let soon = Duration::from_millis(100);
    let server = ServerSettings {
        head_timeout: soon,
        write_timeout: soon,
        ping_interval: soon,
        idle_timeout: soon,
        ..ServerSettings::default()
    };
    TestServer::start_with(4, instant_solver(), ApiSettings::default(), server).await
}

/// Sends the bytes and waits for the server to close.
async fn is_closed_after(address: SocketAddr, bytes: &[u8]) -> Vec<u8> {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(bytes).await.unwrap();
    let mut answer = Vec::new();
    // A reset closes as well.
    let _ = timeout(HANG_BOUND, stream.read_to_end(&mut answer)).await.expect("the server closes the connection");
    answer
}

/// Waits until so many connections have counted as too slow.
async fn slow_ones_are(server: &TestServer, count: usize) {
    let line = format!("slipdrive_connections_ended_total{{cause=\"slow\"}} {count}");
    let counted = async {
        while !String::from_utf8(server.service.metrics_text()).unwrap().lines().any(|found| found == line) {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    timeout(HANG_BOUND, counted).await.unwrap_or_else(|_| panic!("never {line}"));
}

#[tokio::test]
async fn silent_and_half_spoken_connections_are_closed() {
    let settings = ServerSettings { head_timeout: Duration::from_millis(100), ..ServerSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), ApiSettings::default(), settings).await;
    let half_spoken: [&[u8]; 5] = [
        b"",
        b"P",
        b"PRI * HTTP/2.0\r\n\r\nSM",
        b"POST /solve HTTP/1.1\r\nhost: h\r\ncontent-ty",
        b"GET /livez HTTP/1.1\r\n",
    ];
    for bytes in half_spoken {
        for address in [server.address, server.grpc_address] {
            let answer = is_closed_after(address, bytes).await;
            assert!(answer.len() < 1000, "{}", String::from_utf8_lossy(&answer));
        }
    }
    slow_ones_are(&server, 2 * half_spoken.len()).await;
    assert_eq!(server.get("/livez").await.status, 200);
}

#[tokio::test]
async fn idle_connections_are_closed() {
    let server = impatient().await;
    let answer = is_closed_after(server.address, b"GET /livez HTTP/1.1\r\nhost: h\r\n\r\n").await;
    assert!(answer.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&answer));
    // It may be silent between requests.
    slow_ones_are(&server, 0).await;
    // The preface and empty settings, then nothing: pings stay unanswered.
    let preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\x00\x00\x00\x04\x00\x00\x00\x00\x00";
    is_closed_after(server.grpc_address, preface).await;
}

#[tokio::test]
async fn caller_who_does_not_read_is_dropped() {
    let solver = FakeSolver(|_: &SolveInput, _: &RunControl<'_>| {
        let state = vec![State::default(); 200_000];
        let trajectory = Trajectory { time: vec![0.1; state.len()], state, ..Trajectory::default() };
        slipdrive::solver::Solution { trajectory, ..small_solution(StopReason::Finished) }
    });
    let settings = ServerSettings { write_timeout: Duration::from_millis(100), ..ServerSettings::default() };
    let server = TestServer::start_with(4, Arc::new(solver), ApiSettings::default(), settings).await;
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let request = "POST /solve HTTP/1.1\r\nhost: h\r\ncontent-type: application/json\r\ncontent-length: 2\r\n\r\n{}";
    // More answers than the buffers of both sides hold.
    stream.write_all(request.repeat(10).as_bytes()).await.unwrap();
    let closed = async {
        // Writing fails once the server has gone; what it sent is never read.
        while stream.write_all(b"POST").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    timeout(HANG_BOUND, closed).await.expect("the server gives up");
    assert_eq!(server.get("/livez").await.status, 200);
    slow_ones_are(&server, 1).await;
}

const SOLVE: [&str; 2] = ["/solve", "/slipdrive.v1.ManeuverService/Solve"];

/// A server with these settings, and its two transports with the path of a solve.
async fn with_timeouts(
    solver: Arc<dyn ManeuverSolver>,
    settings: ServerSettings,
) -> (TestServer, [(SocketAddr, &'static str); 2]) {
    let server = TestServer::start_with(4, solver, ApiSettings::default(), settings).await;
    let transports = [(server.address, SOLVE[0]), (server.grpc_address, SOLVE[1])];
    (server, transports)
}

#[tokio::test]
async fn answer_that_waits_for_a_window_is_dropped_with_its_connection() {
    let settings = ServerSettings { write_timeout: Duration::from_millis(100), ..ServerSettings::default() };
    let (server, transports) = with_timeouts(instant_solver(), settings).await;
    for (address, path) in transports {
        // Room for nothing, and room for the beginning.
        for window_bytes in [0, 10] {
            let begin = std::time::Instant::now();
            let mut connection = Connection::open(address, window_bytes).await;
            connection.whole_request(1, path).await;
            assert!(connection.reads_up_to(GOAWAY).await, "callers are told to go elsewhere first");
            connection.reads_to_the_end().await;
            // Unanswered pings would end it later.
            assert!(begin.elapsed() < ServerSettings::default().ping_interval, "{path}, room for {window_bytes} bytes");
        }
    }
    assert_eq!(server.get("/livez").await.status, 200);
}

#[tokio::test]
async fn stream_that_never_sends_its_body_is_answered_with_a_refusal() {
    let api = ApiSettings { body_timeout: Duration::from_millis(50), ..ApiSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await;
    for (address, path) in [(server.address, SOLVE[0]), (server.grpc_address, SOLVE[1])] {
        let mut connection = Connection::open(address, 65_535).await;
        for stream in [1, 3, 5] {
            connection.request(stream, path, 0).await;
        }
        for _ in 0..3 {
            assert!(connection.reads_up_to(HEADERS).await);
        }
    }
    assert_eq!(server.service.jobs_in_flight(), 0, "none of them holds a place");
}

#[tokio::test]
async fn aged_connection_says_so_and_finishes_what_it_has() {
    let settings = ServerSettings { max_age: Duration::from_millis(100), ..ServerSettings::default() };
    let gate = Arc::new(Gate::default());
    let held = Arc::clone(&gate);
    let solver = FakeSolver(move |_: &SolveInput, _: &RunControl<'_>| {
        held.wait();
        small_solution(StopReason::Finished)
    });
    let (_server, transports) = with_timeouts(Arc::new(solver), settings).await;
    let mut connections = Vec::new();
    for (address, path) in transports {
        let mut connection = Connection::open(address, 65_535).await;
        connection.whole_request(1, path).await;
        assert!(connection.reads_up_to(GOAWAY).await);
        connections.push(connection);
    }
    gate.open();
    for mut connection in connections {
        assert!(connection.reads_up_to(HEADERS).await, "its grace has not passed");
    }
}

#[tokio::test]
async fn aged_connection_of_http1_says_so_with_its_next_answer() {
    let settings = ServerSettings { max_age: Duration::from_millis(100), ..ServerSettings::default() };
    let (server, _) = with_timeouts(instant_solver(), settings).await;
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let mut answers = 0;
    loop {
        // A connection that ends while a request is on its way would fail here.
        stream.write_all(b"GET /livez HTTP/1.1\r\nhost: h\r\n\r\n").await.unwrap();
        let mut answer = [0; 1024];
        let length = timeout(HANG_BOUND, stream.read(&mut answer)).await.unwrap().unwrap();
        let text = String::from_utf8_lossy(&answer[..length]).to_ascii_lowercase();
        assert!(text.starts_with("http/1.1 200"), "{text}");
        answers += 1;
        if text.contains("connection: close") {
            break;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(answers > 1);
    let mut rest = Vec::new();
    assert_eq!(timeout(HANG_BOUND, stream.read_to_end(&mut rest)).await.unwrap().unwrap(), 0, "then it is closed");
}

#[tokio::test]
async fn aged_connection_is_cut_when_its_grace_has_passed() {
    let soon = Duration::from_millis(100);
    let settings = ServerSettings { max_age: soon, age_grace: soon, ..ServerSettings::default() };
    let (server, _) = with_timeouts(instant_solver(), settings).await;
    // Work has limits of its own; this never ends.
    let mut connection = Connection::open(server.grpc_address, 65_535).await;
    connection.whole_request(1, "/grpc.health.v1.Health/Watch").await;
    connection.reads_to_the_end().await;
}

#[tokio::test]
async fn endless_chunks_are_refused_at_the_limit() {
    let server = TestServer::start(4, instant_solver()).await;
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let head =
        "POST /solve HTTP/1.1\r\nhost: h\r\ncontent-type: application/json\r\ntransfer-encoding: chunked\r\n\r\n";
    stream.write_all(head.as_bytes()).await.unwrap();
    let (mut reader, mut writer) = stream.into_split();
    let sender = tokio::spawn(async move {
        let chunk = format!("{:x}\r\n{}\r\n", 65_536, " ".repeat(65_536));
        while writer.write_all(chunk.as_bytes()).await.is_ok() {}
    });
    let mut answer = [0; 12];
    timeout(HANG_BOUND, reader.read_exact(&mut answer)).await.unwrap().unwrap();
    assert_eq!(&answer, b"HTTP/1.1 413");
    drop(reader);
    timeout(HANG_BOUND, sender).await.expect("the server stops reading").unwrap();
}

#[tokio::test]
async fn batch_whose_caller_does_not_read_ends_with_its_share_of_the_memory() {
    let server = TestServer::start(4, instant_solver()).await;
    let sent = Arc::new(std::sync::atomic::AtomicUsize::new(0));
    let count = Arc::clone(&sent);
    let torques = vec![0.5; 1000];
    let item_bytes = 2 * 8 * torques.len();
    let items = futures_util::stream::iter(0..20_000).map(move |index| {
        count.fetch_add(item_bytes, Ordering::Relaxed);
        let guess = pb::InitialGuess {
            final_time_s: Some(1.0),
            torque_left_n_m: torques.clone(),
            torque_right_n_m: torques.clone(),
        };
        pb::SolveBatchRequest {
            request_id: format!("item-{index}"),
            initial_guess: Some(guess),
            ..pb::SolveBatchRequest::default()
        }
    });
    let mut client = server.grpc().await;
    let mut answers = client.solve_batch(items).await.unwrap().into_inner();
    // Others are served meanwhile, many times over, until no more is sent.
    let mut other = server.grpc().await;
    let mut before = usize::MAX;
    while before != sent.load(Ordering::Relaxed) {
        before = sent.load(Ordering::Relaxed);
        for _ in 0..200 {
            other.get_limits(pb::GetLimitsRequest {}).await.unwrap();
        }
    }
    let mut answered = 0;
    let end = loop {
        match timeout(HANG_BOUND, answers.message()).await.unwrap() {
            Ok(answer) => {
                assert!(answer.is_some(), "the batch was not ended by its caller");
                answered += item_bytes;
            }
            Err(status) => break status,
        }
    };
    // Its share, and the windows and buffers of both sides.
    let (share, buffers) = (4 << 20, 4 << 20);
    assert!(before <= answered + share + buffers, "{before} bytes were sent, {answered} answered");
    assert_eq!((end.code(), code_of(&end).as_str()), (tonic::Code::ResourceExhausted, "memory_full"));
}

#[tokio::test]
async fn messages_after_the_one_that_a_method_takes_are_refused_undecoded() {
    let server = TestServer::start(4, instant_solver()).await;
    // Plans whose many points nobody has counted; they are malformed where they are decoded.
    let second = [b"\x0a\x06\x0a\x04\x0a\x00\x12\x00".repeat(1000), vec![0xff]].concat();
    for method in ["Present", "Validate", "GetLimits", "Solve"] {
        let path = format!("/slipdrive.v1.ManeuverService/{method}");
        for rest in [framed(0, &second), framed(0, b""), vec![0]] {
            let status = raw_call(&server, &path, &[GRPC], [framed(0, b""), rest].concat()).await;
            assert_eq!((status.code(), code_of(&status).as_str()), (tonic::Code::InvalidArgument, "malformed_body"));
            assert!(status.message().contains("more than the one message"), "{method}: {status:?}");
        }
    }
    assert_eq!(server.service.jobs_in_flight(), 0, "no place is held");
}

#[tokio::test]
async fn mutated_bodies_are_answered_and_never_a_fault_of_the_server() {
    let server = TestServer::start(4, instant_solver()).await;
    let original = server.get("/examples/forward-drive").await.bytes;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    for round in 0..1000 {
        let mut body = original.clone();
        for _ in 0..random.random_range(1..4) {
            let position = random.random_range(0..body.len());
            match random.random_range(0..4) {
                0 => body[position] = random.random(),
                1 => drop(body.remove(position)),
                2 => body.insert(position, b"0123456789-+.eE{}[]\",:"[random.random_range(0..22)]),
                _ => body.truncate(position.max(1)),
            }
        }
        for path in ["/validate", "/solve"] {
            let answer = server.post(path, body.clone()).await;
            let text = String::from_utf8_lossy(&body);
            assert!(matches!(answer.status, 200 | 400 | 422), "seed {SEED}, round {round}: {text}: {}", answer.text());
        }
    }
}

#[tokio::test]
async fn mutated_messages_are_answered_and_never_a_fault_of_the_server() {
    use prost::Message as _;

    let server = TestServer::start(4, instant_solver()).await;
    let robot = pb::Robot { wheel_radius_m: Some(0.06), gravity_m_s2: Some(9.81), ..pb::Robot::default() };
    let guess =
        pb::InitialGuess { final_time_s: Some(1.0), torque_left_n_m: vec![0.5; 5], torque_right_n_m: vec![0.5; 5] };
    let original = pb::SolveRequest { robot: Some(robot), initial_guess: Some(guess), ..pb::SolveRequest::default() }
        .encode_to_vec();
    let (mut random, mut accepted) = (Xoshiro256PlusPlus::seed_from_u64(SEED), 0);
    for round in 0..1000 {
        let mut message = original.clone();
        for _ in 0..random.random_range(1..4) {
            let position = random.random_range(0..message.len());
            message[position] = random.random();
        }
        let path = "/slipdrive.v1.ManeuverService/Validate";
        let status = raw_call(&server, path, &[GRPC], framed(0, &message)).await;
        if status.code() == tonic::Code::Ok {
            accepted += 1;
        } else {
            assert_eq!(status.code(), tonic::Code::InvalidArgument, "seed {SEED}, round {round}: {status:?}");
            code_of(&status);
        }
    }
    assert!(
        (100..900).contains(&accepted),
        "{accepted} of 1000 are accepted: mutations are neither all bad nor all good"
    );
}
