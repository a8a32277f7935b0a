//! Ten thousand mutations of a sound body by each endpoint: always an answer, never a fault of the server, and no memory
//! that stays. In a process of its own, so that nobody else's memory is counted.

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::json;
use slipdrive::api::ApiSettings;
use slipdrive::api::server::ServerSettings;
use slipdrive::jobs::Limits;
use slipdrive::service::ServiceSettings;
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::time::timeout;

use crate::support::process::{is_alone, run_alone};
use crate::support::{Answer, HANG_BOUND, TestServer, real_solver};

const SEED: u64 = 11;
const ROUNDS: u32 = 10_000;
/// Until the allocator and the connections have what they keep.
const WARM_ROUNDS: u32 = 1000;
const MAX_GROWTH_BYTES: u64 = 64 << 20;

/// A server whose solves are short whatever a mutation asks for.
async fn server() -> TestServer {
    let limits = Limits { max_rollout_limit: 20, max_time_limit_s: 1.0, max_steps: 1000, ..Limits::default() };
    let settings = ServiceSettings { queue_length: 4, ..ServiceSettings::default() };
    TestServer::start_limited(limits, settings, real_solver(), ApiSettings::default(), ServerSettings::default()).await
}

async fn sound_body(server: &TestServer) -> Vec<u8> {
    let mut body = server.get("/examples/forward-drive").await.json();
    body["grid"] = json!({"steps": 40, "control_intervals": 4});
    body["solver"]["rollout_limit"] = json!(4);
    body["solver"]["starts"] = json!(1);
    body["solver"]["time_limit_s"] = json!(0.1);
    body["initial_guess"] = json!({"final_time_s": 3, "torque_left_n_m": [1, -1], "torque_right_n_m": [1, -1]});
    body.to_string().into_bytes()
}

fn mutated(original: &[u8], random: &mut Xoshiro256PlusPlus) -> Vec<u8> {
    let mut body = original.to_vec();
    // Most of these are still read as JSON; half of the bodies get nothing worse.
    let digits: Vec<_> = (0..body.len()).filter(|&position| body[position].is_ascii_digit()).collect();
    for _ in 0..random.random_range(0..3) {
        body[digits[random.random_range(0..digits.len())]] = random.random_range(b'0'..=b'9');
    }
    for _ in 0..random.random_range(0..3) * random.random_range(0..2) {
        let (position, other) = (random.random_range(0..body.len()), random.random_range(0..body.len()));
        match random.random_range(0..6) {
            0 => body[position] = random.random(),
            1 => drop(body.remove(position)),
            2 => body.insert(position, b"0123456789-+.eE{}[]\",:"[random.random_range(0..22)]),
            3 => body.swap(position, other),
            // A part of the body twice.
            4 => {
                let part = body[position.min(other)..position.max(other)].to_vec();
                body.splice(position..position, part);
            }
            _ => body.truncate(position.max(1)),
        }
    }
    body
}

/// Resident memory, bytes.
#[cfg(target_os = "linux")]
fn memory_bytes() -> u64 {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap();
    statm.split(' ').nth(1).unwrap().parse::<u64>().unwrap() * 4096
}

#[cfg(not(target_os = "linux"))]
fn memory_bytes() -> u64 {
    0
}

#[tokio::test]
async fn hostile_bodies_are_answered_and_leave_no_memory_behind() {
    if !is_alone() {
        return run_alone("mutations::hostile_bodies_are_answered_and_leave_no_memory_behind");
    }
    let server = server().await;
    let original = sound_body(&server).await;
    assert_eq!(server.post("/solve", original.clone()).await.status, 200, "the body is sound");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    let (mut solved, mut warm) = (0, 0);
    for round in 0..=ROUNDS {
        let body = mutated(&original, &mut random);
        for path in ["/validate", "/solve"] {
            let answer = timeout(HANG_BOUND, server.post(path, body.clone())).await.expect("nothing hangs");
            let is_sound = matches!(answer.status, 200 | 400 | 413 | 422);
            assert!(is_sound, "seed {SEED}, round {round}: {}: {}", String::from_utf8_lossy(&body), answer.text());
            solved += u32::from(path == "/solve" && answer.status == 200);
        }
        if round == WARM_ROUNDS {
            warm = memory_bytes();
        }
    }
    assert!(solved > ROUNDS / 10, "{solved} mutations are still sound and were solved");
    endless_and_compressed_bodies_are_refused(&server).await;
    let growth = memory_bytes().saturating_sub(warm);
    println!("{solved} of {ROUNDS} mutations were solved, the memory grew by {} KiB", growth >> 10);
    assert!(growth < MAX_GROWTH_BYTES, "the memory grew by {growth} bytes");
    assert_eq!(server.service.jobs_in_flight(), 0);
}

/// Bodies that would unpack to much more than they are, and bodies without end.
async fn endless_and_compressed_bodies_are_refused(server: &TestServer) {
    for _ in 0..200 {
        let request = server.client.post(server.url("/solve")).header("content-type", "application/json");
        let refused = Answer::of(request.header("content-encoding", "gzip").body(vec![0x1f; 200_000])).await;
        assert_eq!(refused.problem()["code"], "unsupported_media");
    }
    for _ in 0..20 {
        let mut stream = TcpStream::connect(server.address).await.unwrap();
        let head =
            "POST /solve HTTP/1.1\r\nhost: h\r\ncontent-type: application/json\r\ntransfer-encoding: chunked\r\n\r\n";
        stream.write_all(head.as_bytes()).await.unwrap();
        let chunk = format!("{:x}\r\n{}\r\n", 65_536, " ".repeat(65_536));
        let endless = async { while stream.write_all(chunk.as_bytes()).await.is_ok() {} };
        timeout(HANG_BOUND, endless).await.expect("the server stops reading");
    }
}
