//! One line of the log for each request, in both forms, and what the health command says.

#[cfg(target_os = "linux")]
use std::io::{Read as _, Write as _};

use serde_json::Value;
use tonic::transport::Endpoint;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

use crate::support::HANG_BOUND;
use crate::support::process::{ServerProcess, sample, slipdrive};

const TRACE: &str = "4bf92f3577b34da6a3ce929d0e0e4736";
const BODY: &str = r#"{"solver": {"starts": 1}, "view": "plan"}"#;

fn client() -> reqwest::Client {
    reqwest::Client::builder().no_proxy().build().unwrap()
}

#[tokio::test]
async fn line_in_json_has_ids_outcome_and_waits_and_no_secrets() {
    let variables = [("SLIPDRIVE_API_KEYS", "very-secret-key"), ("SLIPDRIVE_LOG_FORMAT", "json")];
    let server = ServerProcess::start(&[], &variables);
    let request = client()
        .post(server.url("/solve"))
        .header("content-type", "application/json")
        .header("authorization", "Bearer very-secret-key")
        .header("x-request-id", "caller-7")
        .header("traceparent", format!("00-{TRACE}-00f067aa0ba902b7-01"));
    let answer = request.body(BODY).send().await.unwrap();
    assert_eq!(answer.status(), 200);
    let traceparent = answer.headers()["traceparent"].to_str().unwrap().to_owned();
    assert!(traceparent.starts_with(&format!("00-{TRACE}-")) && !traceparent.contains("00f067aa0ba902b7"));
    assert!(!answer.text().await.unwrap().is_empty());

    let line: Value = serde_json::from_str(&server.log_line(&["caller-7", "request.duration_ms"])).unwrap();
    assert_eq!((&line["level"], &line["message"]), (&"INFO".into(), &"request".into()));
    assert_eq!((&line["request.id"], &line["trace.id"]), (&"caller-7".into(), &TRACE.into()));
    assert_eq!((&line["http.method"], &line["http.path"]), (&"POST".into(), &"/solve".into()));
    assert_eq!((&line["response.status"], line.get("problem.code")), (&200.into(), None));
    assert!(line["peer.address"].as_str().is_some_and(|address| address.starts_with("127.0.0.1:")), "{line}");
    for duration in ["queue.wait_ms", "solve.duration_ms", "request.duration_ms"] {
        assert!(line[duration].as_f64().is_some_and(|value| value >= 0.0), "{duration}: {line}");
    }

    let refused = client().post(server.url("/solve")).header("x-request-id", "caller-8").send().await.unwrap();
    assert_eq!(refused.status(), 401);
    let line: Value = serde_json::from_str(&server.log_line(&["caller-8"])).unwrap();
    assert_eq!((&line["problem.code"], &line["response.status"]), (&"unauthenticated".into(), &401.into()));
    assert!(line.get("queue.wait_ms").is_none() && line["trace.id"].as_str().is_some_and(|id| id.len() == 32));
    assert!(server.lines_so_far().iter().all(|line| !line.contains("very-secret-key")));
}

#[tokio::test]
async fn event_stream_is_logged_when_it_ends_with_its_waits() {
    let server = ServerProcess::start(&["--log-format", "text"], &[]);
    let request = client().post(server.url("/solve")).header("content-type", "application/json");
    let request = request.header("accept", "text/event-stream").header("x-request-id", "stream-1");
    let events = request.body(BODY).send().await.unwrap().text().await.unwrap();
    assert!(events.contains("event: result"), "{events}");
    let line = server.log_line(&["request.id=\"stream-1\"", "request.duration_ms="]);
    assert!(line.contains("queue.wait_ms=") && line.contains("solve.duration_ms="), "{line}");
}

#[tokio::test]
async fn successful_probes_are_logged_for_developers_only() {
    let server = ServerProcess::start(&["--log", "slipdrive=debug", "--log-format", "json"], &[]);
    let level = |words: &[&str]| {
        let line: Value = serde_json::from_str(&server.log_line(words)).unwrap();
        line["level"].as_str().unwrap().to_owned()
    };
    for path in ["/livez", "/readyz", "/metrics"] {
        assert_eq!(client().get(server.admin_url(path)).send().await.unwrap().status(), 200);
        assert_eq!(level(&["request.duration_ms", path]), "DEBUG");
    }
    assert_eq!(client().post(server.admin_url("/livez")).send().await.unwrap().status(), 405);
    assert_eq!(level(&["request.duration_ms", "/livez"]), "INFO", "it failed");
    let endpoint = Endpoint::from_shared(format!("http://{}", server.grpc)).unwrap();
    let mut health = HealthClient::new(endpoint.connect().await.unwrap());
    health.check(HealthCheckRequest::default()).await.unwrap();
    assert_eq!(level(&["request.duration_ms", "/grpc.health.v1.Health/Check"]), "DEBUG");
    health.check(HealthCheckRequest { service: "nothing".to_owned() }).await.unwrap_err();
    assert_eq!(level(&["request.duration_ms", "/grpc.health.v1.Health/Check"]), "INFO");
}

#[tokio::test]
async fn log_that_nobody_reads_holds_nothing_up_and_its_lines_are_counted() {
    let mut server = ServerProcess::start_with_unread_log(&[]);
    let client = reqwest::Client::builder().no_proxy().timeout(HANG_BOUND).build().unwrap();
    for _ in 0..2000 {
        assert_eq!(client.get(server.url("/limits")).send().await.unwrap().status(), 200);
    }
    assert_eq!(client.get(server.admin_url("/livez")).send().await.unwrap().status(), 200);
    assert!(sample(&client, &server, "slipdrive_log_lines_dropped_total").await > 0.0);
    #[cfg(unix)]
    {
        server.signal("TERM");
        assert_eq!(server.wait().code(), Some(0), "nobody reads the last lines either");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn log_that_cannot_be_written_is_counted() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    drop(listener);
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let arguments = ["serve", "--http", &address, "--grpc", "127.0.0.1:0"];
    let mut server = slipdrive().args(arguments).stderr(full).spawn().unwrap();
    let deadline = std::time::Instant::now() + HANG_BOUND;
    let asked = || {
        let mut stream = std::net::TcpStream::connect(&address).ok()?;
        stream.write_all(b"GET /metrics HTTP/1.1\r\nhost: h\r\nconnection: close\r\n\r\n").ok()?;
        let mut text = String::new();
        stream.read_to_string(&mut text).ok()?;
        text.lines().find_map(|line| line.strip_prefix("slipdrive_log_lines_dropped_total ")?.parse::<f64>().ok())
    };
    // The line that it listens is lost.
    while asked().is_none_or(|lost| lost == 0.0) {
        assert!(std::time::Instant::now() < deadline, "no lost line is counted");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    server.kill().unwrap();
    server.wait().unwrap();
}

#[cfg(unix)]
#[tokio::test]
async fn hangup_signal_is_logged_and_ends_nothing() {
    let server = ServerProcess::start(&[], &[]);
    for _ in 0..2 {
        server.signal("HUP");
        server.log_line(&["SIGHUP changes nothing"]);
    }
    assert_eq!(client().get(server.admin_url("/readyz")).send().await.unwrap().status(), 200);
}

#[tokio::test]
async fn health_command_tells_readiness_by_its_exit_code() {
    let server = ServerProcess::start(&["--drain-delay-s", "1000"], &[]);
    let health = |flags: &[&str]| {
        let output = slipdrive().arg("health").args(flags).env("SLIPDRIVE_ADMIN", server.admin.to_string()).output();
        output.unwrap().status.code()
    };
    assert_eq!((health(&[]), health(&["--live"])), (Some(0), Some(0)));
    assert_eq!(health(&["--admin", "127.0.0.1:1"]), Some(1), "nobody listens there");
    assert_eq!(health(&["--admin", "nowhere"]), Some(64));
    #[cfg(unix)]
    {
        server.signal("TERM");
        server.log_line(&["draining"]);
        assert_eq!((health(&[]), health(&["--live"])), (Some(1), Some(0)), "alive, but not for new callers");
    }
}

#[test]
fn faults_of_the_configuration_end_the_program_before_it_listens() {
    let output = slipdrive()
        .args(["serve", "--http", "0.0.0.0:0", "--workers", "none"])
        .env("SLIPDRIVE_QUEUE_LENGTH", "-1")
        .env("SLIPDRIVE_LOG_FORMAT", "xml")
        .output()
        .unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(64), "{message}");
    for fault in ["`workers` is \"none\" (from --workers)", "(from SLIPDRIVE_QUEUE_LENGTH)", "`log_format` is \"xml\""]
    {
        assert!(message.contains(fault), "{fault} in {message}");
    }
    assert!(!message.contains("listening"), "{message}");
}

#[test]
fn printed_configuration_tells_sources_and_no_secrets() {
    let output = slipdrive()
        .args(["serve", "--print-config", "--queue-length", "9"])
        .env("SLIPDRIVE_API_KEYS", "very-secret-key,another")
        .env("SLIPDRIVE_WORKERS", "3")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("queue_length = 9 # from --queue-length\n"), "{text}");
    assert!(text.contains("workers = 3 # from SLIPDRIVE_WORKERS\n"), "{text}");
    assert!(text.contains("# 2 API keys, which are not shown") && !text.contains("secret"), "{text}");
}
