//! Spans as a collector gets them: queue wait, solve and each start below the request, in the caller's trace.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener};
use std::sync::mpsc::{Receiver, channel};
use std::thread;

use prost::Message;

use crate::support::HANG_BOUND;
use crate::support::process::{ServerProcess, slipdrive};

/// The parts of `opentelemetry.proto.collector.trace.v1.ExportTraceServiceRequest` that matter here.
#[derive(Clone, PartialEq, Message)]
struct ExportRequest {
    #[prost(message, repeated, tag = "1")]
    resource_spans: Vec<ResourceSpans>,
}

#[derive(Clone, PartialEq, Message)]
struct ResourceSpans {
    #[prost(message, repeated, tag = "2")]
    scope_spans: Vec<ScopeSpans>,
}

#[derive(Clone, PartialEq, Message)]
struct ScopeSpans {
    #[prost(message, repeated, tag = "2")]
    spans: Vec<Span>,
}

#[derive(Clone, PartialEq, Message)]
#[expect(clippy::struct_field_names, reason = "the names of the protocol")]
struct Span {
    #[prost(bytes = "vec", tag = "1")]
    trace_id: Vec<u8>,
    #[prost(bytes = "vec", tag = "2")]
    span_id: Vec<u8>,
    #[prost(bytes = "vec", tag = "4")]
    parent_span_id: Vec<u8>,
    #[prost(string, tag = "5")]
    name: String,
    #[prost(fixed64, tag = "7")]
    start: u64,
    #[prost(fixed64, tag = "8")]
    end: u64,
}

/// Takes what is exported; one request per connection or many.
fn collector() -> (SocketAddr, Receiver<Span>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (tell, spans) = channel();
    thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let mut reader = BufReader::new(stream);
            while let Some(body) = read_request(&mut reader) {
                let request = ExportRequest::decode(body.as_slice()).unwrap();
                let scopes = request.resource_spans.into_iter().flat_map(|resource| resource.scope_spans);
                for span in scopes.flat_map(|scope| scope.spans) {
                    let _ = tell.send(span);
                }
                let answer = b"HTTP/1.1 200 OK\r\ncontent-type: application/x-protobuf\r\ncontent-length: 0\r\n\r\n";
                reader.get_mut().write_all(answer).unwrap();
            }
        }
    });
    (address, spans)
}

fn read_request(reader: &mut BufReader<std::net::TcpStream>) -> Option<Vec<u8>> {
    let mut length = None;
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).ok().filter(|&count| count > 0)?;
        if let Some((name, value)) = line.split_once(':')
            && name.eq_ignore_ascii_case("content-length")
        {
            length = value.trim().parse().ok();
        }
        if line == "\r\n" {
            let mut body = vec![0; length?];
            reader.read_exact(&mut body).ok()?;
            return Some(body);
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

#[tokio::test]
async fn spans_of_a_solve_hang_below_its_request_in_the_callers_trace() {
    const TRACE: &str = "4bf92f3577b34da6a3ce929d0e0e4736";
    const CALLER: &str = "00f067aa0ba902b7";
    let (address, exported) = collector();
    let endpoint = format!("http://{address}");
    let variables = [("OTEL_EXPORTER_OTLP_ENDPOINT", endpoint.as_str()), ("OTEL_BSP_SCHEDULE_DELAY", "100")];
    let mut server = ServerProcess::start(&[], &variables);
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    let request = client.post(server.url("/solve")).header("content-type", "application/json");
    let request = request.header("traceparent", format!("00-{TRACE}-{CALLER}-01"));
    let answer = request.body(r#"{"maneuver": {"goal": {"y_m": 1}}, "solver": {"starts": 2}}"#).send().await.unwrap();
    let traceparent = answer.headers()["traceparent"].to_str().unwrap().to_owned();
    assert!(answer.text().await.unwrap().contains("torque_schedule"));
    server.signal("TERM");
    assert_eq!(server.wait().code(), Some(0), "the exporter does not hold the process");

    let mut spans: HashMap<String, Vec<Span>> = HashMap::new();
    while !(spans.contains_key("request") && spans.contains_key("certificate")) {
        let span = exported.recv_timeout(HANG_BOUND).expect("the spans come");
        if hex(&span.trace_id) == TRACE {
            spans.entry(span.name.clone()).or_default().push(span);
        }
    }
    let only = |name: &str| spans[name][0].clone();
    let (request, solve) = (only("request"), only("solve"));
    assert_eq!(hex(&request.parent_span_id), CALLER);
    assert_eq!(traceparent, format!("00-{TRACE}-{}-01", hex(&request.span_id)), "the answer names the exported span");
    assert_eq!((&only("queue_wait").parent_span_id, &solve.parent_span_id), (&request.span_id, &request.span_id));
    assert!(spans["start"].len() >= 2, "one per start: {}", spans["start"].len());
    for part in spans["start"].iter().chain(&spans["certificate"]) {
        assert_eq!(part.parent_span_id, solve.span_id);
        assert!(solve.start <= part.start && part.start <= part.end && part.end <= solve.end);
    }
}

#[tokio::test]
async fn collector_that_cannot_be_reached_is_told_in_the_log() {
    let nowhere = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let endpoint = format!("http://{nowhere}");
    let variables = [("OTEL_EXPORTER_OTLP_ENDPOINT", endpoint.as_str()), ("OTEL_BSP_SCHEDULE_DELAY", "100")];
    let server = ServerProcess::start(&[], &variables);
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    assert_eq!(client.get(server.url("/limits")).send().await.unwrap().status(), 200);
    server.log_line(&["ERROR", "opentelemetry"]);
}

#[test]
fn endpoint_that_is_no_url_is_refused_unless_nothing_is_exported() {
    let start = |variables: &[(&str, &str)]| {
        // Ends with the address, if not before.
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = taken.local_addr().unwrap().to_string();
        let arguments = ["serve", "--grpc", "127.0.0.1:0", "--http", address.as_str()];
        let output = slipdrive().args(arguments).envs(variables.iter().copied()).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let wrong = ("OTEL_EXPORTER_OTLP_ENDPOINT", "collector:4318");
    let (code, said) = start(&[wrong]);
    assert!(
        code == Some(64) && said.contains("`OTEL_EXPORTER_OTLP_ENDPOINT` is \"collector:4318\""),
        "{code:?} {said}"
    );
    let shown = slipdrive().args(["serve", "--print-config", "--workers", "0"]).env(wrong.0, wrong.1).output().unwrap();
    let said = String::from_utf8(shown.stderr).unwrap();
    assert!(
        shown.status.code() == Some(64) && said.contains(wrong.0) && said.contains("workers"),
        "all at once: {said}"
    );
    let off = [("OTEL_SDK_DISABLED", "true"), ("OTEL_TRACES_EXPORTER", "none"), ("OTEL_EXPORTER_OTLP_ENDPOINT", "")];
    for variable in off {
        let (code, said) = start(&[wrong, variable]);
        assert!(code == Some(1) && said.contains("cannot be bound"), "{variable:?}: {code:?} {said}");
    }
}
