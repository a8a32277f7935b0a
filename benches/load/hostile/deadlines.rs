//! Jobs that are hard to stop: the answer must come at the deadline, and the worker must be free with it.

#[path = "../../../tests/service/support/slow_simulation.rs"]
mod slow_simulation;

use std::io;
use std::time::Duration;

use prost::Message as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Value, json};
use slipdrive::api::grpc::pb;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::{Instant, interval, sleep, timeout_at};

use super::attacker::{DATA, END_STREAM, HEADERS, Head, Peer, message};
use super::found::Found;
use super::{KEY, Target};
use crate::process::{WORKER, cpu_time};
use slow_simulation::slow_simulation;

/// How late an answer may be, and how long a worker may go on.
const LATENESS: Duration = Duration::from_millis(50);
/// How often the processor time of the worker is read; the system counts it about as finely.
const CPU_SAMPLES: Duration = Duration::from_millis(5);
/// Processor time in one sample that is no work.
const IDLE_CPU: Duration = Duration::from_micros(500);
/// A worker that did nothing for so long has ended its job.
const IDLE: Duration = Duration::from_secs(1);
/// Room for the largest answer, bytes.
const ANSWER_WINDOW_BYTES: u32 = 16 << 20;
const SEED: u64 = 8;

pub async fn fixed_point(on: Target) -> Found {
    stopped_by_deadline(on, "/simulate", &slow_simulation(), Duration::from_secs(1)).await
}

pub async fn fixed_point_hang_up(on: Target) -> Found {
    stopped_by_hang_up(on, "/simulate", &slow_simulation(), Duration::from_secs(1)).await
}

pub async fn unlucky(on: Target, steps: u32) -> Found {
    stopped_by_deadline(on, "/solve", &unlucky_solve(steps), Duration::from_millis(500)).await
}

pub async fn unlucky_hang_up(on: Target, steps: u32) -> Found {
    stopped_by_hang_up(on, "/solve", &unlucky_solve(steps), Duration::from_millis(500)).await
}

/// Solves that last until they are stopped, over both doors.
pub async fn solves(on: Target) -> Found {
    let body = json!({"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 10_000}, "solver": {"time_limit_s": 60}});
    let (mut found, mut parts) = (Found::default(), Vec::new());
    for milliseconds in [300, 500, 1000] {
        let deadline = Duration::from_millis(milliseconds);
        let (mut rest, mut grpc) = (Duration::ZERO, Duration::ZERO);
        for _ in 0..3 {
            let answer = ask(on, "/solve", &body, deadline).await;
            found.require(answer.is_sound(), format!("REST: {}", answer.told));
            rest = rest.max(answer.took);
            let answer = ask_grpc(on, deadline).await;
            found.require(answer.is_sound(), format!("gRPC: {}", answer.told));
            grpc = grpc.max(answer.took);
        }
        parts.push(format!("{milliseconds} ms: REST {}, gRPC {} ms", rest.as_millis(), grpc.as_millis()));
        found.require(rest.max(grpc) <= deadline + LATENESS, format!("late at {milliseconds} ms"));
    }
    found.with_text(format!("slowest of 3, deadline {}", parts.join("; ")))
}

/// A robot whose contact patterns are hard to find.
fn unlucky_solve(steps: u32) -> Value {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    let mut torques = || (0..100).map(|_| random.random_range(-2.0..2.0)).collect::<Vec<f64>>();
    json!({
        "robot": {
            "chassis_mass_kg": 7.413, "wheel_mass_kg": 8.257, "chassis_yaw_inertia_kg_m2": 0.01234,
            "wheel_diametral_inertia_kg_m2": 1.27, "wheel_spin_inertia_kg_m2": 0.004_612, "wheel_radius_m": 0.3388,
            "track_width_m": 3.017, "axle_to_front_support_m": 0.03469, "center_of_mass_height_m": 0.008_886,
            "wheel_friction_coefficient": 0.695, "front_friction_coefficient": 1.757,
        },
        "maneuver": {
            "goal": {"x_m": 1.0, "y_m": 2.0, "heading_rad": 0.7},
            "torque_limit_left_n_m": 2, "torque_limit_right_n_m": 2,
        },
        "grid": {"steps": steps, "control_intervals": 100},
        "initial_guess": {"final_time_s": 9.1, "torque_left_n_m": torques(), "torque_right_n_m": torques()},
    })
}

async fn stopped_by_deadline(on: Target, path: &str, body: &Value, deadline: Duration) -> Found {
    let asked = Instant::now();
    let (answer, worked) = tokio::join!(ask(on, path, body, deadline), worked_since(on, asked + deadline));
    let (ms, after) = (answer.took.as_millis(), worked.as_millis());
    let mut found =
        Found::new(format!("`{}` after {ms} ms, worker busy until {after} ms after the deadline", answer.told));
    found.require(answer.is_sound(), "no answer or refusal");
    found.require(answer.took <= deadline + LATENESS, "late");
    found.require(worked <= LATENESS, "the worker goes on");
    found
}

async fn stopped_by_hang_up(on: Target, path: &str, body: &Value, stay: Duration) -> Found {
    let mut stream = TcpStream::connect(on.rest).await.unwrap();
    stream.write_all(request(path, body, None).as_bytes()).await.unwrap();
    sleep(stay).await;
    drop(stream);
    let worked = worked_since(on, Instant::now()).await;
    let mut found = Found::new(format!("worker busy until {} ms after the hang-up", worked.as_millis()));
    found.require(worked <= LATENESS, "the worker goes on");
    found
}

/// How long after `begin` the worker was last busy; watched until it is idle, or until the end of the attack.
async fn worked_since(on: Target, begin: Instant) -> Duration {
    let cpu = || cpu_time(on.process, WORKER);
    let (mut before, mut last) = (cpu(), begin);
    let mut ticks = interval(CPU_SAMPLES);
    while Instant::now() < (last.max(begin) + IDLE).min(on.end) {
        let now = ticks.tick().await;
        let used = cpu();
        if used > before + IDLE_CPU {
            last = now;
        }
        before = used;
    }
    last.saturating_duration_since(begin)
}

/// What came back.
struct Answer {
    took: Duration,
    /// The status or what failed.
    told: String,
}

impl Answer {
    /// A plan, or that there is none at the deadline.
    fn is_sound(&self) -> bool {
        matches!(self.told.as_str(), "200" | "504" | "plan" | "refusal")
    }
}

fn request(path: &str, body: &Value, deadline: Option<Duration>) -> String {
    let body = body.to_string();
    let deadline =
        deadline.map_or_else(String::new, |deadline| format!("request-timeout-ms: {}\r\n", deadline.as_millis()));
    format!(
        "POST {path} HTTP/1.1\r\nhost: localhost\r\nauthorization: Bearer {KEY}\r\ncontent-type: application/json\r\n\
         connection: close\r\n{deadline}content-length: {}\r\n\r\n{body}",
        body.len()
    )
}

async fn ask(on: Target, path: &str, body: &Value, deadline: Duration) -> Answer {
    let asked = Instant::now();
    let exchange = async {
        let mut stream = TcpStream::connect(on.rest).await?;
        stream.write_all(request(path, body, Some(deadline)).as_bytes()).await?;
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).await?;
        io::Result::Ok(answer)
    };
    let told = match timeout_at(on.end, exchange).await {
        // The status follows `HTTP/1.1 `.
        Ok(Ok(answer)) => String::from_utf8_lossy(answer.get(9..12).unwrap_or_default()).into_owned(),
        Ok(Err(error)) => error.to_string(),
        Err(_) => "nothing".to_owned(),
    };
    Answer { took: asked.elapsed(), told }
}

/// Frame by frame: clients of gRPC give up by themselves at the deadline.
async fn ask_grpc(on: Target, deadline: Duration) -> Answer {
    let goal = pb::Goal { y_m: Some(5.0), ..pb::Goal::default() };
    let request = pb::SolveRequest {
        maneuver: Some(pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() }),
        grid: Some(pb::SolveGrid { steps: Some(10_000), ..pb::SolveGrid::default() }),
        solver: Some(pb::Solver { time_limit_s: Some(60.0), ..pb::Solver::default() }),
        ..pb::SolveRequest::default()
    };
    let head = Head::with_key("/slipdrive.v1.ManeuverService/Solve").with_deadline(deadline);
    let asked = Instant::now();
    let mut peer = Peer::open(on.grpc, ANSWER_WINDOW_BYTES).await.unwrap();
    peer.request(1, &head, &message(&request.encode_to_vec())).await;
    let mut told = "nothing";
    while let Some(frame) = peer.next_before(on.end).await {
        match frame.kind {
            DATA => told = "plan",
            // Refusals are a head alone.
            HEADERS if frame.flags & END_STREAM != 0 && told == "nothing" => told = "refusal",
            _ => {}
        }
        if frame.stream == 1 && frame.flags & END_STREAM != 0 {
            break;
        }
    }
    Answer { took: asked.elapsed(), told: told.to_owned() }
}
