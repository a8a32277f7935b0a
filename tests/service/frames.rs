//! Floods of HTTP/2 frames and malformed requests of HTTP/1.1: each attacker is refused or cut, and nobody else notices.

use std::net::SocketAddr;
use std::time::Duration;

use slipdrive::api::ApiSettings;
use slipdrive::api::grpc::pb;
use slipdrive::api::server::ServerSettings;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::net::tcp::OwnedReadHalf;
use tokio::time::timeout;

use crate::support::http2::{
    self, Connection, DATA, END_HEADERS, END_STREAM, HEADERS, PREFACE, RST_STREAM, SETTINGS, frame,
};
use crate::support::{Answer, HANG_BOUND, TestServer, held_solver, instant_solver};

const PING: u8 = 0x6;
const WINDOW_UPDATE: u8 = 0x8;
const CONTINUATION: u8 = 0x9;
const ACK: u8 = 0x1;
const FLOOD: u32 = 10_000;

/// What the server does with a flood.
#[derive(Debug, PartialEq, Eq)]
enum Outcome {
    Closed,
    /// It went on to answer.
    Served,
}

async fn others_are_served(server: &TestServer) {
    assert_eq!(server.get("/livez").await.status, 200);
    let limits = server.grpc().await.get_limits(pb::GetLimitsRequest {}).await.unwrap();
    assert_eq!(limits.get_ref().max_steps, 10_000);
    assert_eq!(server.service.jobs_in_flight(), 0, "no place is held");
}

/// Sends the frames on a connection of its own, then a ping, and reads until that is answered or the server closes.
async fn flood(address: SocketAddr, frames: &[u8]) -> Outcome {
    const MARK: [u8; 8] = *b"all sent";
    let (reader, mut writer) = TcpStream::connect(address).await.unwrap().into_split();
    let bytes = [PREFACE, &frame(SETTINGS, 0, 0, &[]), frames, &frame(PING, 0, 0, &MARK)].concat();
    let writing = tokio::spawn(async move {
        // A server that has closed takes no more.
        let _ = writer.write_all(&bytes).await;
        writer
    });
    let outcome = timeout(HANG_BOUND, outcome(reader, MARK)).await.expect("the server answers or closes");
    drop(writing.await.unwrap());
    outcome
}

async fn outcome(mut reader: OwnedReadHalf, mark: [u8; 8]) -> Outcome {
    while let Some(next) = http2::next_frame(&mut reader).await {
        if next.kind == PING && next.flags & ACK != 0 && next.payload == mark {
            return Outcome::Served;
        }
    }
    Outcome::Closed
}

fn request(stream: u32, flags: u8) -> Vec<u8> {
    http2::request_frame(stream, "/solve", flags)
}

fn flood_of(one: impl Fn(u32) -> Vec<u8>) -> Vec<u8> {
    (0..FLOOD).flat_map(|index| one(2 * index + 1)).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn floods_that_ask_for_more_than_an_answer_are_cut() {
    const CANCEL: [u8; 4] = 8_u32.to_be_bytes();
    let server = TestServer::start(4, instant_solver()).await;
    let head = frame(HEADERS, 0, 1, &[0x83]);
    let floods = [
        ("resets", flood_of(|stream| [request(stream, 0), frame(RST_STREAM, 0, stream, &CANCEL)].concat())),
        ("requests without bodies", flood_of(|stream| request(stream, 0))),
        ("continuations", [head, flood_of(|_| frame(CONTINUATION, 0, 1, &[0x84; 1000]))].concat()),
        ("empty data", [request(1, 0), flood_of(|_| frame(DATA, 0, 1, &[]))].concat()),
        ("too much room", frame(WINDOW_UPDATE, 0, 0, &i32::MAX.to_be_bytes())),
        ("too large a frame", frame(DATA, 0, 1, &vec![0; 16_385])),
        ("data without a request", frame(DATA, 0, 1, &[0; 100])),
        ("the end of a head without its begin", frame(CONTINUATION, END_HEADERS, 1, &[0x83])),
    ];
    for (name, frames) in floods {
        for address in [server.address, server.grpc_address] {
            assert_eq!(flood(address, &frames).await, Outcome::Closed, "{name}");
            others_are_served(&server).await;
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn floods_that_are_answered_hold_nobody_up() {
    let server = TestServer::start(4, instant_solver()).await;
    for frames in [flood_of(|_| frame(PING, 0, 0, &[1; 8])), flood_of(|_| frame(SETTINGS, 0, 0, &[]))] {
        for address in [server.address, server.grpc_address] {
            // Cut or answered: either ends.
            let (_, ()) = tokio::join!(flood(address, &frames), others_are_served(&server));
        }
    }
}

#[tokio::test]
async fn pings_whose_answers_are_not_read_are_cut() {
    let settings = ServerSettings { write_timeout: Duration::from_millis(100), ..ServerSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), ApiSettings::default(), settings).await;
    for address in [server.address, server.grpc_address] {
        let mut stream = TcpStream::connect(address).await.unwrap();
        stream.write_all(&[PREFACE, &frame(SETTINGS, 0, 0, &[])].concat()).await.unwrap();
        let pings = frame(PING, 0, 0, &[1; 8]).repeat(1000);
        let endless = async { while stream.write_all(&pings).await.is_ok() {} };
        timeout(HANG_BOUND, endless).await.expect("the server gives up");
    }
    others_are_served(&server).await;
}

#[tokio::test]
async fn too_much_room_for_an_answer_ends_its_stream_alone() {
    let (gate, _has_started, solver) = held_solver();
    let server = TestServer::start(4, solver).await;
    let mut connection = Connection::open(server.address, 65_535).await;
    connection.whole_request(1, "/solve").await;
    connection.send(WINDOW_UPDATE, 0, 1, &i32::MAX.to_be_bytes()).await;
    assert!(connection.reads_up_to(RST_STREAM).await);
    gate.open();
    connection.whole_request(3, "/validate").await;
    assert!(connection.reads_up_to(HEADERS).await, "other streams go on");
}

#[tokio::test]
async fn large_fields_told_a_thousand_times_by_their_index_are_refused() {
    let server = TestServer::start(4, instant_solver()).await;
    // By GET and POST; without the large field both answer 200.
    let doors = [(server.address, 0x82, "/livez"), (server.grpc_address, 0x83, "/slipdrive.v1.ManeuverService/Solve")];
    for (address, method, path) in doors {
        let mut block = http2::request_block(path);
        block[0] = method;
        // A literal that enters the table: `x`, and a value that nearly fills it, of 3,900 bytes: seven bits, then the rest
        // in two bytes.
        block.extend([0x40, 1, b'x', 0x7f, 0xbd, 0x1d]);
        block.extend([b'y'; 3_900]);
        // The first entry of the table that is not static.
        block.extend([0xbe; 12_000]);
        let mut connection = Connection::open(address, 65_535).await;
        connection.send(HEADERS, END_HEADERS | END_STREAM, 1, &block[..]).await;
        let answer = connection.answer().await;
        assert!(answer.is_none_or(|answer| !answer.is_ok()), "48 MB of fields are refused");
        others_are_served(&server).await;
    }
}

#[tokio::test]
async fn compressed_messages_are_refused_unread() {
    let server = TestServer::start(4, instant_solver()).await;
    for path in ["/solve", "/simulate", "/validate"] {
        let request = server.client.post(server.url(path)).header("content-type", "application/json");
        let refused = Answer::of(request.header("content-encoding", "gzip").body(vec![0x1f; 200_000])).await;
        assert_eq!((refused.status, refused.problem()["code"].as_str()), (415, Some("unsupported_media")));
    }
    let mut connection = Connection::open(server.grpc_address, 65_535).await;
    let mut block = http2::request_block("/slipdrive.v1.ManeuverService/Solve");
    block.extend(b"\x00\x0dgrpc-encoding\x04gzip");
    connection.send(HEADERS, END_HEADERS, 1, &block).await;
    let message = [&[1, 0, 0, 4, 0], &[0x1f; 1024][..]].concat();
    connection.send(DATA, END_STREAM, 1, &message).await;
    let answer = connection.answer().await.unwrap();
    assert!(answer.flags & END_STREAM != 0, "an answer without a message");
    others_are_served(&server).await;
}

/// Answers of a server to bytes on one connection, up to its end.
async fn answers_to(server: &TestServer, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    stream.write_all(bytes).await.unwrap();
    let mut answers = Vec::new();
    // A reset closes as well.
    let _ = timeout(HANG_BOUND, stream.read_to_end(&mut answers)).await.expect("the server closes the connection");
    String::from_utf8_lossy(&answers).into_owned()
}

fn statuses(answers: &str) -> Vec<&str> {
    answers.split("HTTP/1.1 ").skip(1).map(|answer| &answer[..3]).collect()
}

/// A request that only those see who disagree about the end of the one before it.
const SMUGGLED: &str = "GET /smuggled HTTP/1.1\r\nhost: h\r\n\r\n";

/// A server whose own patience ends after that of the tests.
async fn patient() -> TestServer {
    let settings = ServerSettings { head_timeout: 10 * HANG_BOUND, ..ServerSettings::default() };
    TestServer::start_with(4, instant_solver(), ApiSettings::default(), settings).await
}

#[tokio::test]
async fn requests_of_doubtful_length_are_refused_with_their_connection() {
    let server = patient().await;
    let post = "POST /validate HTTP/1.1\r\nhost: h\r\ncontent-type: application/json\r\n";
    let cases = [
        ("two lengths", format!("{post}content-length: 2\r\ncontent-length: 3\r\n\r\n{{}}{SMUGGLED}")),
        ("two lengths in one", format!("{post}content-length: 2, 3\r\n\r\n{{}}{SMUGGLED}")),
        ("signed length", format!("{post}content-length: +2\r\n\r\n{{}}{SMUGGLED}")),
        (
            "length and chunks",
            format!("{post}content-length: 7\r\ntransfer-encoding: chunked\r\n\r\n0\r\n\r\n{SMUGGLED}"),
        ),
        ("unknown coding", format!("{post}transfer-encoding: xchunked\r\n\r\n0\r\n\r\n{SMUGGLED}")),
        ("coding after chunks", format!("{post}transfer-encoding: chunked, identity\r\n\r\n0\r\n\r\n{SMUGGLED}")),
        ("folded field", format!("{post}x-folded: a\r\n b\r\ncontent-length: 2\r\n\r\n{{}}{SMUGGLED}")),
        ("space before the colon", format!("{post}content-length : 2\r\n\r\n{{}}{SMUGGLED}")),
        (
            "endless chunk",
            format!("{post}transfer-encoding: chunked\r\n\r\nfffffffffffffffff\r\n{{}}\r\n0\r\n\r\n{SMUGGLED}"),
        ),
        ("chunk of no number", format!("{post}transfer-encoding: chunked\r\n\r\n0x2\r\n{{}}\r\n0\r\n\r\n{SMUGGLED}")),
        ("chunk longer than told", format!("{post}transfer-encoding: chunked\r\n\r\n1\r\n{{}}\r\n0\r\n\r\n{SMUGGLED}")),
        ("bare return", format!("{post}x-bare: a\rb\r\ncontent-length: 2\r\n\r\n{{}}{SMUGGLED}")),
        ("zero byte", format!("{post}x-zero: a\0b\r\ncontent-length: 2\r\n\r\n{{}}{SMUGGLED}")),
    ];
    for (name, bytes) in cases {
        let answers = answers_to(&server, bytes.as_bytes()).await;
        assert_eq!(statuses(&answers), ["400"], "{name}: {answers}");
    }
    others_are_served(&server).await;
}

#[tokio::test]
async fn caller_who_leaves_within_a_body_has_not_sent_a_wrong_one() {
    let server = patient().await;
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let half = b"POST /solve HTTP/1.1\r\nhost: h\r\ncontent-type: application/json\r\ncontent-length: 99\r\n\r\n{\"man";
    stream.write_all(half).await.unwrap();
    drop(stream);
    let metrics = timeout(HANG_BOUND, async {
        loop {
            let metrics = server.get("/metrics").await.text();
            if metrics.contains("route=\"/solve\"") {
                return metrics;
            }
        }
    });
    let metrics = metrics.await.unwrap();
    assert!(metrics.contains("_count{code=\"499\",route=\"/solve\"} 1"), "{metrics}");
    assert!(metrics.contains("slipdrive_rejected_total{code=\"malformed_body\"} 0"), "{metrics}");
}

#[tokio::test]
async fn body_of_a_get_is_no_request() {
    let server = patient().await;
    let last = "GET /livez HTTP/1.1\r\nhost: h\r\nconnection: close\r\n\r\n";
    let get = format!("GET /livez HTTP/1.1\r\nhost: h\r\ncontent-length: {}\r\n\r\n{SMUGGLED}{last}", SMUGGLED.len());
    let answers = answers_to(&server, get.as_bytes()).await;
    assert_eq!(statuses(&answers), ["200", "200"], "{answers}");
    let chunked = format!(
        "GET /livez HTTP/1.1\r\nhost: h\r\ntransfer-encoding: chunked\r\n\r\n{:x}\r\n{SMUGGLED}\r\n0\r\n\r\n{last}",
        SMUGGLED.len()
    );
    let answers = answers_to(&server, chunked.as_bytes()).await;
    assert_eq!(statuses(&answers), ["200", "200"], "{answers}");
}

#[tokio::test]
async fn lines_that_end_without_a_return_are_read_as_others() {
    let server = patient().await;
    let bytes =
        "POST /validate HTTP/1.1\nhost: h\ncontent-type: application/json\ncontent-length: 2\nconnection: close\n\n{}";
    let answers = answers_to(&server, format!("{bytes}{SMUGGLED}").as_bytes()).await;
    assert_eq!(statuses(&answers), ["200"], "{answers}");
}

#[tokio::test]
async fn requests_without_exactly_one_host_are_malformed() {
    let server = patient().await;
    for request in ["GET /livez", "GET /limits", "POST /validate", "GET /nowhere"] {
        for hosts in ["", "host: h\r\nhost: h\r\n", "host: h\r\nhost: other\r\n"] {
            let json = "content-type: application/json\r\ncontent-length: 2\r\nconnection: close";
            let answer =
                answers_to(&server, format!("{request} HTTP/1.1\r\n{hosts}{json}\r\n\r\n{{}}").as_bytes()).await;
            assert_eq!(statuses(&answer), ["400"], "{request} with {hosts:?}: {answer}");
            assert!(answer.contains("content-type: application/problem+json\r\n"), "{answer}");
            assert!(answer.contains("\"code\":\"malformed_body\""), "{answer}");
        }
    }
    // Older than the field.
    let answer = answers_to(&server, b"GET /livez HTTP/1.0\r\n\r\n").await;
    assert!(answer.starts_with("HTTP/1.0 200") || answer.starts_with("HTTP/1.1 200"), "{answer}");
    others_are_served(&server).await;
}
