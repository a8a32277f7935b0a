//! API keys with names, and their rotation while the server works.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use futures_util::stream;
use slipdrive::api::ApiSettings;
use slipdrive::api::auth::ApiKeys;
use slipdrive::api::grpc::pb;
use slipdrive::api::grpc::pb::batch_request::Request;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use slipdrive::api::server::ServerSettings;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::time::{sleep, timeout};
use tonic::Code;
use tonic::transport::Endpoint;

use crate::support::folder::Folder;
use crate::support::lines::batch;
use crate::support::mounted::Mounted;
use crate::support::process::{ServerProcess, sample, slipdrive};
use crate::support::{Answer, Gate, HANG_BOUND, TestServer, held_solver, instant_solver};

/// What was promised: a key that is withdrawn is refused after so long at most.
const ROTATION_BOUND: Duration = Duration::from_secs(10);
const MOTION: &str = r#"{"torque_schedule": {"interval_s": 0.1, "left_n_m": [0.01], "right_n_m": [0.01]}}"#;

fn client() -> reqwest::Client {
    reqwest::Client::builder().timeout(HANG_BOUND).no_proxy().build().unwrap()
}

async fn status(client: &reqwest::Client, server: &ServerProcess, key: &str) -> u16 {
    let request = client.post(server.url("/simulate")).bearer_auth(key).header("content-type", "application/json");
    request.body(MOTION).send().await.unwrap().status().as_u16()
}

fn keyed<T>(message: T, key: &str) -> tonic::Request<T> {
    let mut request = tonic::Request::new(message);
    request.metadata_mut().insert("authorization", format!("Bearer {key}").parse().unwrap());
    request
}

/// Callers who ask again and again until they are told to stop.
struct Load {
    is_over: Arc<AtomicBool>,
    answered: Arc<AtomicUsize>,
    callers: Vec<tokio::task::JoinHandle<()>>,
}

impl Load {
    /// Two callers over REST and one over gRPC, each with a connection of its own.
    async fn start(server: &ServerProcess, key: &'static str) -> Self {
        let (is_over, answered) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicUsize::new(0)));
        let mut callers = Vec::new();
        for client in [client(), client()] {
            let (url, is_over, answered) = (server.url("/simulate"), Arc::clone(&is_over), Arc::clone(&answered));
            callers.push(tokio::spawn(async move {
                while !is_over.load(Ordering::Relaxed) {
                    let request = client.post(&url).bearer_auth(key).header("content-type", "application/json");
                    let answer = request.body(MOTION).send().await.expect("no connection is dropped");
                    assert_eq!(answer.status(), 200);
                    answer.bytes().await.expect("the answer is complete");
                    answered.fetch_add(1, Ordering::Relaxed);
                }
            }));
        }
        let endpoint = Endpoint::from_shared(format!("http://{}", server.grpc)).unwrap();
        let mut grpc = ManeuverServiceClient::new(endpoint.connect().await.unwrap());
        let (over, count) = (Arc::clone(&is_over), Arc::clone(&answered));
        callers.push(tokio::spawn(async move {
            while !over.load(Ordering::Relaxed) {
                grpc.validate(keyed(pb::SolveRequest::default(), key)).await.expect("the key is as good as before");
                count.fetch_add(1, Ordering::Relaxed);
            }
        }));
        Self { is_over, answered, callers }
    }

    fn answered(&self) -> usize {
        self.answered.load(Ordering::Relaxed)
    }

    async fn end(self) -> usize {
        self.is_over.store(true, Ordering::Relaxed);
        for caller in self.callers {
            caller.await.expect("no request failed");
        }
        self.answered.load(Ordering::Relaxed)
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn key_file_is_rotated_under_load_and_nobody_with_a_valid_key_notices() {
    let mounted = Mounted::new("keys", &[("api-keys", "fleet:old\nplanner:steady\n")]);
    let server = ServerProcess::start(&["--api-keys-file", mounted.path("api-keys").to_str().unwrap()], &[]);
    let client = client();
    assert_eq!((status(&client, &server, "old").await, status(&client, &server, "new").await), (200, 401));
    let load = Load::start(&server, "steady").await;
    mounted.swap(&[("api-keys", "fleet:new\nplanner:steady\n")]);
    let begin = Instant::now();
    while status(&client, &server, "old").await == 200 {
        assert!(begin.elapsed() < HANG_BOUND, "the old key is refused at last");
        sleep(Duration::from_millis(50)).await;
    }
    let refused_after = begin.elapsed();
    assert!(refused_after < ROTATION_BOUND, "the old key was refused after {refused_after:?}");
    assert_eq!((status(&client, &server, "old").await, status(&client, &server, "new").await), (401, 200));
    let before = load.answered();
    while load.answered() < before + 10 {
        sleep(Duration::from_millis(10)).await;
    }
    let answered = load.end().await;
    println!("refused after {refused_after:?}, {answered} requests of the steady key answered");
    server.log_line(&["read again", "api_keys"]);
    assert_eq!(sample(&client, &server, "slipdrive_file_reads_total{file=\"api_keys\",outcome=\"used\"}").await, 1.0);
    assert!(sample(&client, &server, "slipdrive_caller_requests_total{caller=\"planner\"}").await >= answered as f64);
}

#[tokio::test]
async fn keys_that_cannot_be_used_leave_the_old_ones_in_force_until_they_can() {
    let mounted = Mounted::new("bad-keys", &[("api-keys", "fleet:one\n")]);
    let server = ServerProcess::start(&["--api-keys-file", mounted.path("api-keys").to_str().unwrap()], &[]);
    let client = client();
    let stale = async || sample(&client, &server, "slipdrive_file_stale{file=\"api_keys\"}").await;
    assert_eq!(stale().await, 0.0);
    for bad in ["fleet:one\nFLEET:two-is-secret\n", "", "\u{0}a:b"] {
        mounted.swap(&[("api-keys", bad)]);
        server.signal("HUP");
        let line = server.log_line(&["what was read before stays in force", "api_keys"]);
        assert!(!line.contains("two-is-secret"), "{line}");
        assert_eq!((status(&client, &server, "one").await, stale().await), (200, 1.0), "{bad:?}");
    }
    mounted.swap(&[]);
    server.signal("HUP");
    server.log_line(&["cannot be read"]);
    assert_eq!(status(&client, &server, "one").await, 200);
    mounted.swap(&[("api-keys", "fleet:two\n")]);
    server.signal("HUP");
    server.log_line(&["read again"]);
    assert_eq!((status(&client, &server, "one").await, status(&client, &server, "two").await), (401, 200));
    assert_eq!(stale().await, 0.0);
    assert_eq!(client.get(server.admin_url("/readyz")).send().await.unwrap().status(), 200);
}

#[tokio::test]
async fn callers_are_named_in_the_log_and_in_the_metrics() {
    let server = ServerProcess::start(&["--log-format", "json"], &[("SLIPDRIVE_API_KEYS", "fleet:one,two")]);
    let client = client();
    assert_eq!(status(&client, &server, "one").await, 200);
    let line = server.log_line(&["\"request\"", "/simulate"]);
    assert!(line.contains("\"caller.name\":\"fleet\""), "{line}");
    assert_eq!(status(&client, &server, "two").await, 200);
    let line = server.log_line(&["\"request\"", "/simulate"]);
    assert!(line.contains("\"caller.name\":\"(unnamed)\""), "{line}");
    assert_eq!(status(&client, &server, "three").await, 401);
    let line = server.log_line(&["\"request\"", "/simulate"]);
    assert!(!line.contains("caller.name"), "{line}");
    for caller in ["fleet", "(unnamed)"] {
        let label = format!("slipdrive_caller_requests_total{{caller=\"{caller}\"}}");
        assert_eq!(sample(&client, &server, &label).await, 1.0, "{caller}");
    }
}

#[test]
fn faults_of_keys_are_told_by_their_lines_at_once() {
    let files = Folder::new("faulty-keys");
    let path = files.write("api-keys", "good\nBad:secret\nsha256:abc\n");
    let output = slipdrive().args(["serve", "--api-keys-file"]).arg(path).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(64), "{said}");
    assert!(said.contains("`api_keys_file`: line 2: ") && said.contains("`api_keys_file`: line 3: "), "{said}");
    assert!(!said.contains("secret") && !said.contains("abc"), "{said}");
}

async fn held_server(keys: &ApiKeys) -> (TestServer, Arc<Gate>, UnboundedReceiver<()>) {
    let (gate, started, solver) = held_solver();
    let api = ApiSettings { keys: keys.clone(), ..ApiSettings::default() };
    (TestServer::start_with(4, solver, api, ServerSettings::default()).await, gate, started)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn withdrawn_key_ends_the_reading_of_its_lines() {
    let keys = ApiKeys::parse("a:gone\nb:stays").unwrap();
    let (server, gate, mut started) = held_server(&keys).await;
    let (mut sender, mut receiver) = batch(server.address, "authorization: Bearer gone\r\n").await;
    let (mut other, mut others) = batch(server.address, "authorization: Bearer stays\r\n").await;
    assert!(sender.send("{\"request_id\": \"begun\", \"solve\": {}}\n").await);
    timeout(HANG_BOUND, started.recv()).await.unwrap().unwrap();
    keys.replace("b:stays").unwrap();
    gate.open();
    let lines = receiver.rest().await;
    assert_eq!((&lines[0]["request_id"], lines.len()), (&"begun".into(), 3), "{lines:?}");
    assert_eq!(lines[1]["problem"]["code"], "unauthenticated");
    assert_eq!(lines[2]["end"]["answered"], 1);
    assert!(other.send("{\"request_id\": \"b\", \"solve\": {}}\n").await);
    assert_eq!(others.line().await.unwrap()["request_id"], "b", "others go on");
    let refused = Answer::of(server.client.post(server.url("/solve")).bearer_auth("gone").body("{}")).await;
    assert_eq!(refused.status, 401);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn withdrawn_key_ends_the_reading_of_its_batch_over_grpc() {
    let keys = ApiKeys::parse("a:gone\nb:stays").unwrap();
    let (server, gate, mut started) = held_server(&keys).await;
    let (items, sent) = unbounded_channel();
    let item = |id: &str| {
        let request = Some(Request::Solve(pb::SolveRequest::default()));
        pb::BatchRequest { request_id: id.to_owned(), request, timeout_ms: None }
    };
    items.send(item("begun")).unwrap();
    let sent = stream::unfold(sent, async |mut sent| sent.recv().await.map(|item| (item, sent)));
    let call = keyed(sent, "gone");
    let mut answers = server.grpc().await.batch(call).await.unwrap().into_inner();
    timeout(HANG_BOUND, started.recv()).await.unwrap().unwrap();
    keys.replace("b:stays").unwrap();
    gate.open();
    let first = timeout(HANG_BOUND, answers.message()).await.unwrap().unwrap().unwrap();
    assert_eq!(first.request_id, "begun");
    let end = timeout(HANG_BOUND, answers.message()).await.unwrap().unwrap_err();
    assert_eq!(end.code(), Code::Unauthenticated, "{end:?}");
    drop(items);
}

#[tokio::test]
async fn answers_are_what_their_type_says_and_are_kept_by_nobody() {
    let api = ApiSettings { cors_origins: vec!["https://fleet.example".parse().unwrap()], ..ApiSettings::default() };
    let server = TestServer::start_with(4, instant_solver(), api, ServerSettings::default()).await;
    for (answer, kept) in [
        (server.post("/solve", "{}").await, "no-store"),
        (server.post("/solve", "{").await, "no-store"),
        (server.get("/nothing").await, "no-store"),
        (server.get("/readyz").await, "no-store"),
        (server.get("/limits").await, "no-cache"),
        (server.get("/").await, "no-cache"),
    ] {
        let headers = (answer.header("x-content-type-options"), answer.header("cache-control"));
        assert_eq!(headers, ("nosniff", kept), "{answer:?}");
    }
    let asked = server.client.request(reqwest::Method::OPTIONS, server.url("/solve"));
    let asked = asked.header("origin", "https://fleet.example").header("access-control-request-method", "POST");
    let leave = Answer::of(asked).await;
    assert!(leave.header("access-control-allow-headers").contains("traceparent"));
    assert_eq!(leave.header("access-control-max-age"), "7200");
}
