//! The end of a server under load: who is still served, who is told to go elsewhere, and when the process is gone.

use std::time::{Duration, Instant};

use reqwest::Client;
use slipdrive::api::grpc::pb;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tonic::Code;
use tonic::transport::Endpoint;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use crate::support::HANG_BOUND;
use crate::support::process::{ServerProcess, sample};

/// A solve that ends by itself well within any drain timeout here.
const SHORT: &str = r#"{"maneuver": {"goal": {"y_m": 1}}, "solver": {"starts": 1}, "grid": {"steps": 100}}"#;
/// A solve that lasts until it is stopped.
const ENDLESS: &str = r#"{"maneuver": {"goal": {"y_m": 5}},
    "grid": {"steps": 10000, "control_intervals": 1000},
    "solver": {"method": "nelder_mead", "starts": 64, "time_limit_s": 60}}"#;

/// A motion of the most steps.
const LARGE: &str = r#"{"torque_schedule": {"interval_s": 1, "left_n_m": [0.5, -0.4], "right_n_m": [0.4, -0.5]},
    "grid": {"steps": 10000}}"#;

fn client() -> Client {
    Client::builder().no_proxy().timeout(HANG_BOUND).build().unwrap()
}

async fn post(client: &Client, url: String, body: &'static str) -> (u16, String) {
    let answer = client.post(url).header("content-type", "application/json").body(body).send().await.unwrap();
    (answer.status().as_u16(), answer.text().await.unwrap())
}

fn spawn_post(client: &Client, server: &ServerProcess, body: &'static str) -> tokio::task::JoinHandle<(u16, String)> {
    let (client, url) = (client.clone(), server.url("/solve"));
    tokio::spawn(async move { post(&client, url, body).await })
}

/// Waits until a sample of the server's metrics has a value.
async fn until(client: &Client, server: &ServerProcess, name: &str, value: f64) {
    let waited = timeout(HANG_BOUND, async {
        while sample(client, server, name).await != value {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    });
    waited.await.unwrap_or_else(|_| panic!("{name} is never {value}"));
}

async fn readiness(client: &Client, server: &ServerProcess) -> u16 {
    client.get(server.admin_url("/readyz")).send().await.unwrap().status().as_u16()
}

/// Calls without pause until the server is closed; every call must be answered with a plan or a refusal that tells to go
/// elsewhere. Gives how many plans came after `mark`.
async fn keep_calling(client: Client, url: String, mark: Instant) -> usize {
    let mut served = 0;
    loop {
        let request = client.post(&url).header("content-type", "application/json").body(SHORT).send();
        match request.await {
            Ok(answer) if answer.status() == 200 => {
                assert!(answer.text().await.unwrap().contains("torque_schedule"), "the answer is complete");
                served += usize::from(Instant::now() > mark);
            }
            Ok(answer) => {
                assert_eq!(answer.status(), 503);
                assert!(answer.headers().contains_key("retry-after"));
                return served;
            }
            // The listener is closed: nothing was accepted.
            Err(error) => {
                assert!(error.is_connect() || error.is_request(), "{error:?}");
                return served;
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_accepted_request_is_lost_in_a_drain() {
    let flags = ["--drain-delay-s", "1", "--drain-timeout-s", "50", "--queue-length", "20"];
    let mut server = ServerProcess::start(&flags, &[]);
    let client = client();
    assert_eq!(post(&client, server.url("/solve"), SHORT).await.0, 200);
    let signalled = Instant::now();
    let callers: Vec<_> =
        (0..4).map(|_| tokio::spawn(keep_calling(client.clone(), server.url("/solve"), signalled))).collect();
    until(&client, &server, "slipdrive_workers{state=\"busy\"}", 1.0).await;
    server.signal("TERM");
    server.log_line(&["draining"]);
    assert_eq!(readiness(&client, &server).await, 503, "balancers are told at once");
    assert_eq!(client.get(server.admin_url("/livez")).send().await.unwrap().status(), 200);
    let (status, body) = post(&client, server.url("/solve"), SHORT).await;
    assert_eq!(status, 200, "within the drain delay new callers are served: {body}");
    let mut served = 0;
    for caller in callers {
        served += timeout(HANG_BOUND, caller).await.expect("nothing hangs").unwrap();
    }
    assert!(served > 4, "{served} were served after the signal");
    assert_eq!(server.wait().code(), Some(0));
}

// The connection answers while this waits for the process.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nobody_waits_for_watches_of_the_health() {
    let mut server = ServerProcess::start(&[], &[]);
    let channel = Endpoint::from_shared(format!("http://{}", server.grpc)).unwrap().connect().await.unwrap();
    let watched = HealthClient::new(channel).watch(HealthCheckRequest::default()).await;
    let mut watched = watched.unwrap().into_inner();
    let mut next = async || timeout(HANG_BOUND, watched.message()).await.unwrap();
    assert_eq!(next().await.unwrap().unwrap().status(), ServingStatus::Serving);
    server.signal("TERM");
    assert_eq!(next().await.unwrap().unwrap().status(), ServingStatus::NotServing);
    assert_eq!(next().await.unwrap_err().code(), Code::Unavailable);
    assert_eq!(server.wait().code(), Some(0));
    let log = server.lines_so_far();
    assert!(!log.iter().any(|line| line.contains("last answer")), "{log:?}");
}

#[tokio::test]
async fn after_the_drain_delay_new_callers_are_sent_elsewhere_and_work_in_flight_ends() {
    let mut server = ServerProcess::start(&["--drain-timeout-s", "50", "--queue-length", "4"], &[]);
    let client = client();
    let slow = r#"{"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 2000},
        "solver": {"starts": 64, "time_limit_s": 2}}"#;
    let (running, waiting) = (spawn_post(&client, &server, slow), spawn_post(&client, &server, slow));
    until(&client, &server, "slipdrive_queue_depth", 1.0).await;
    server.signal("TERM");
    server.log_line(&["taking no more work"]);
    let refused = post(&client, server.url("/solve"), SHORT).await;
    assert!(refused.0 == 503 && refused.1.contains("\"unavailable\""), "{}", refused.0);
    // A new connection: those of before are closed, beneath a request if it comes at that moment.
    let channel = Endpoint::from_shared(format!("http://{}", server.grpc)).unwrap().connect().await.unwrap();
    let mut grpc = ManeuverServiceClient::new(channel);
    let refused = grpc.solve(pb::SolveRequest::default()).await.unwrap_err();
    assert_eq!(refused.code(), Code::Unavailable, "{refused}");
    assert_eq!(readiness(&client, &server).await, 503);
    for job in [running, waiting] {
        let (status, body) = job.await.unwrap();
        assert_eq!(status, 200, "an accepted solve is answered: {body}");
    }
    assert_eq!(server.wait().code(), Some(0));
}

#[tokio::test]
async fn solves_that_outlast_the_drain_timeout_are_answered_as_unavailable() {
    // Each is expected to use up its time limit of a minute.
    let flags = ["--drain-timeout-s", "0.2", "--queue-length", "4", "--queue-work-s", "600"];
    let mut server = ServerProcess::start(&flags, &[]);
    let client = client();
    let jobs = [spawn_post(&client, &server, ENDLESS), spawn_post(&client, &server, ENDLESS)];
    until(&client, &server, "slipdrive_queue_depth", 1.0).await;
    server.signal("TERM");
    for job in jobs {
        let (status, body) = timeout(HANG_BOUND, job).await.expect("nothing hangs").unwrap();
        assert!(status == 503 && body.contains("\"unavailable\""), "{status}");
    }
    assert_eq!(server.wait().code(), Some(0));
}

#[tokio::test]
async fn second_signal_cancels_at_once() {
    let flags = ["--drain-delay-s", "1000", "--drain-timeout-s", "1000", "--queue-length", "4"];
    for first_then_second in [["TERM", "TERM"], ["TERM", "INT"]] {
        let mut server = ServerProcess::start(&flags, &[]);
        let client = client();
        let job = spawn_post(&client, &server, ENDLESS);
        until(&client, &server, "slipdrive_workers{state=\"busy\"}", 1.0).await;
        server.signal(first_then_second[0]);
        server.log_line(&["draining"]);
        assert_eq!(readiness(&client, &server).await, 503);
        server.signal(first_then_second[1]);
        let (status, body) = timeout(HANG_BOUND, job).await.expect("it does not wait for the delay").unwrap();
        assert!(status == 503 && body.contains("\"unavailable\""), "{status}");
        assert_eq!(server.wait().code(), Some(0));
    }
}

/// Callers who say nothing, half a head, half a body, or do not read their answer.
#[tokio::test]
async fn silent_callers_do_not_hold_the_process() {
    let mut server = ServerProcess::start(&["--drain-timeout-s", "1"], &[]);
    let client = client();
    let connect = || async { TcpStream::connect(server.http).await.unwrap() };
    let _mute = connect().await;
    let mut half_a_head = connect().await;
    half_a_head.write_all(b"POST /solve HTTP/1.1\r\nhost: h\r\n").await.unwrap();
    let mut half_a_body = connect().await;
    let head = b"POST /solve HTTP/1.1\r\nhost: h\r\ncontent-type: application/json\r\ncontent-length: 99\r\n\r\n{";
    half_a_body.write_all(head).await.unwrap();
    let mut unread = connect().await;
    // Some 4 MB each, more than the buffers of both sides hold; but for the first bytes never read.
    let head = "POST /simulate HTTP/1.1\r\nhost: h\r\ncontent-type: application/json";
    let large = format!("{head}\r\ncontent-length: {}\r\n\r\n{LARGE}", LARGE.len());
    unread.write_all(large.repeat(3).as_bytes()).await.unwrap();
    let mut status = [0; 12];
    timeout(HANG_BOUND, unread.read_exact(&mut status)).await.expect("the first answer begins").unwrap();
    assert_eq!(&status, b"HTTP/1.1 200");
    let mut idle_http2 = TcpStream::connect(server.grpc).await.unwrap();
    idle_http2.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\x00\x00\x00\x04\x00\x00\x00\x00\x00").await.unwrap();
    assert!(idle_http2.read(&mut [0; 9]).await.unwrap() > 0, "the server speaks HTTP/2");
    assert_eq!(readiness(&client, &server).await, 200);
    let signalled = Instant::now();
    server.signal("TERM");
    let status = timeout(HANG_BOUND, tokio::task::spawn_blocking(move || server.wait())).await.expect("it ends");
    assert_eq!(status.unwrap().code(), Some(0));
    assert!(signalled.elapsed() < Duration::from_secs(30), "{:?}", signalled.elapsed());
}
