//! Callers who do nothing wrong and yet meet a bound: many small messages, a log that nobody reads, a stop signal.

use std::collections::HashMap;
use std::process::Command;
use std::time::Duration;

use futures_util::future::join;
use prost::Message as _;
use slipdrive::api::grpc::pb;
use tokio::time::{Instant, sleep};

use super::attacker::{
    DATA, END_STREAM, FIRST_WINDOW_BYTES, GOAWAY, HEADERS, Head, Peer, WINDOW_UPDATE, frame, message, streams,
};
use super::found::Found;
use super::{KEY, Target};

const BATCHES: u32 = 200;
const ITEMS: usize = 100;
/// More small frames than a server that counts them takes, and less bytes than its window of a connection.
const BATCHES_AT_ONCE: usize = 64;
/// Room for all answers of a batch, bytes.
const WIDE_WINDOW_BYTES: u32 = 16 << 20;
const REQUESTS: usize = 2_000;
const PATIENCE: Duration = Duration::from_secs(5);
/// That of the server, by its flag.
const DRAIN_DELAY: Duration = Duration::from_secs(1);
const GOAWAY_BOUND: Duration = Duration::from_millis(100);

/// Batches whose items have a frame each, as common clients send them; all answers are read.
pub async fn small_batches(on: Target) -> Found {
    let Ok(mut peer) = Peer::open(on.grpc, WIDE_WINDOW_BYTES).await else { return Found::new("not connected") };
    let mut answers: HashMap<u32, Answers> = HashMap::new();
    let (mut at_once, mut complete, mut goaway) = (0, 0, None);
    let mut batches = streams(BATCHES).map(batch).peekable();
    // What the server has room for; frame heads, which need none, are counted too.
    let mut room = FIRST_WINDOW_BYTES as usize;
    loop {
        while at_once < BATCHES_AT_ONCE
            && let Some(batch) = batches.next_if(|batch| batch.len() <= room)
        {
            peer.write(&batch).await;
            room -= batch.len();
            at_once += 1;
        }
        if at_once == 0 && batches.peek().is_none() {
            break;
        }
        let Some(frame) = peer.next_before(on.end).await else { break };
        match frame.kind {
            DATA => answers.entry(frame.stream).or_default().take(&frame.payload),
            HEADERS if frame.flags & END_STREAM != 0 => {
                at_once -= 1;
                complete += usize::from(answers.remove(&frame.stream).is_some_and(|answers| answers.count == ITEMS));
            }
            WINDOW_UPDATE if frame.stream == 0 => room += frame.number_at(0) as usize,
            // The last stream, the error code, and what went wrong in words. A second one tells no more than the first.
            GOAWAY if goaway.is_none() => {
                goaway = Some((frame.number_at(4), String::from_utf8_lossy(&frame.payload[8..]).into_owned()));
            }
            _ => {}
        }
    }
    let goaway = goaway.map_or_else(String::new, |(code, words)| format!(", told to go away: error {code} `{words}`"));
    let mut found = Found::new(format!("{complete} of {BATCHES} batches complete{goaway}"));
    found.require(complete == BATCHES as usize, "batches are cut");
    found.add(peer.life());
    found
}

/// The messages of one answer stream so far.
#[derive(Default)]
struct Answers {
    bytes: Vec<u8>,
    count: usize,
}

impl Answers {
    fn take(&mut self, payload: &[u8]) {
        self.bytes.extend(payload);
        while let Some(length) = self.bytes.get(1..5) {
            let end = 5 + u32::from_be_bytes(length.try_into().unwrap()) as usize;
            if self.bytes.len() < end {
                return;
            }
            self.bytes.drain(..end);
            self.count += 1;
        }
    }
}

/// One whole batch, in turn of the older and the newer call.
fn batch(stream: u32) -> Vec<u8> {
    let is_older = stream % 4 == 1;
    let method = if is_older { "SolveBatch" } else { "Batch" };
    let path = format!("/slipdrive.v1.ManeuverService/{method}");
    let mut bytes = Head::with_key(&path).frame(stream, 0);
    for index in 0..ITEMS {
        let (request_id, maneuver) = (format!("item-{index}"), maneuver(index));
        let item = if is_older {
            pb::SolveBatchRequest { request_id, maneuver, ..pb::SolveBatchRequest::default() }.encode_to_vec()
        } else {
            let solve = pb::SolveRequest { maneuver, ..pb::SolveRequest::default() };
            let request = Some(pb::batch_request::Request::Solve(solve));
            pb::BatchRequest { request_id, request, timeout_ms: None }.encode_to_vec()
        };
        bytes.extend(frame(DATA, 0, stream, &message(&item)));
    }
    bytes.extend(frame(DATA, END_STREAM, stream, &[]));
    bytes
}

/// What is answered at once: a standstill, or a goal that is out of reach without torque.
fn maneuver(index: usize) -> Option<pb::Maneuver> {
    let out_of_reach = pb::Maneuver {
        goal: Some(pb::Goal { y_m: Some(5.0), ..pb::Goal::default() }),
        torque_limit_left_n_m: Some(0.0),
        torque_limit_right_n_m: Some(0.0),
        ..pb::Maneuver::default()
    };
    index.is_multiple_of(2).then_some(out_of_reach)
}

/// Requests that are logged, while nobody reads the log.
pub async fn unread_log(on: Target) -> Found {
    let client = reqwest::Client::builder().no_proxy().timeout(PATIENCE).build().unwrap();
    let mut answered = 0;
    while answered < REQUESTS && Instant::now() < on.end {
        let request = client.get(format!("http://{}/limits", on.rest)).bearer_auth(KEY);
        if !request.send().await.is_ok_and(|answer| answer.status().is_success()) {
            break;
        }
        answered += 1;
    }
    // Good callers ask at least once more.
    sleep(PATIENCE).await;
    let mut found = Found::new(format!("{answered} of {REQUESTS} answered"));
    found.require(answered == REQUESTS, "the log holds the server up");
    found
}

/// A stop signal while a solve runs and another waits, asked for over a door each.
pub async fn stop_signal(on: Target) -> Found {
    let json = br#"{"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 10000}, "view": "plan",
        "solver": {"starts": 64, "time_limit_s": 3}}"#;
    let goal = pb::Goal { y_m: Some(5.0), ..pb::Goal::default() };
    let request = pb::SolveRequest {
        maneuver: Some(pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() }),
        grid: Some(pb::SolveGrid { steps: Some(10_000), ..pb::SolveGrid::default() }),
        solver: Some(pb::Solver { starts: Some(64), time_limit_s: Some(3.0), ..pb::Solver::default() }),
        view: pb::View::Plan.into(),
        ..pb::SolveRequest::default()
    };
    let mut rest = Peer::open(on.rest, WIDE_WINDOW_BYTES).await.unwrap();
    rest.request(1, &Head::with_key("/solve"), json).await;
    let mut grpc = Peer::open(on.grpc, WIDE_WINDOW_BYTES).await.unwrap();
    let head = Head::with_key("/slipdrive.v1.ManeuverService/Solve");
    grpc.request(1, &head, &message(&request.encode_to_vec())).await;
    sleep(Duration::from_millis(500)).await;
    assert!(Command::new("kill").args(["-TERM", &on.process.to_string()]).status().unwrap().success());
    let signalled = Instant::now();
    let ends = join(end_of(&mut rest, signalled, on.end), end_of(&mut grpc, signalled, on.end)).await;
    let mut found = Found::default();
    let mut parts = Vec::new();
    for (door, end) in [("REST", ends.0), ("gRPC", ends.1)] {
        let goaway = end.goaway.map_or_else(|| "none".to_owned(), |after| format!("{} ms", after.as_millis()));
        parts.push(format!("{door}: GOAWAY {goaway} after the signal, plan {}", end.has_plan));
        found
            .require(end.goaway.is_some_and(|after| after <= DRAIN_DELAY + GOAWAY_BOUND), format!("{door}: told late"));
        found.require(end.has_plan, format!("{door}: not answered"));
    }
    found.add(rest.life());
    found.add(grpc.life());
    found.with_text(parts.join("; "))
}

/// How a connection ended.
#[derive(Default)]
struct End {
    /// When it was told to go elsewhere, after the signal.
    goaway: Option<Duration>,
    has_plan: bool,
}

async fn end_of(peer: &mut Peer, signalled: Instant, end: Instant) -> End {
    let mut found = End::default();
    while let Some(frame) = peer.next_before(end).await {
        match frame.kind {
            GOAWAY if found.goaway.is_none() => found.goaway = Some(signalled.elapsed()),
            // Refusals of gRPC are 200 too, but have no body.
            HEADERS if frame.is_ok() && frame.flags & END_STREAM == 0 => found.has_plan = true,
            _ => {}
        }
    }
    found
}
