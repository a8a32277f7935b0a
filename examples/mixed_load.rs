//! Mixed load on a running server, over REST and gRPC: what the soak, the dashboard and the container are tried with.
//!
//! `cargo run --release --example mixed_load -- [--http ADDR] [--grpc ADDR] [--seconds S] [--callers N]`
//!
//! Each caller draws its next request from a fixed sequence of its own: solves of several sizes, event streams,
//! simulations, validations, faulty bodies, tight deadlines and hang-ups. The summary counts outcomes; the exit code is 0
//! when each request was answered as its kind should be, refusals for want of room included.

#![allow(clippy::unwrap_used, reason = "an example stays short")]

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rand::{Rng as _, RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Value, json};
use slipdrive::api::grpc::pb;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use tonic::Code;
use tonic::transport::{Channel, Endpoint};

/// What is asked, and how often out of a hundred times.
const MIX: [(Kind, u32); 10] = [
    (Kind::Solve, 40),
    (Kind::Events, 6),
    (Kind::Simulate, 8),
    (Kind::Validate, 10),
    (Kind::Faulty, 6),
    (Kind::Deadline, 6),
    (Kind::HangUp, 4),
    (Kind::GrpcSolve, 12),
    (Kind::GrpcStream, 5),
    (Kind::GrpcFaulty, 3),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Solve,
    Events,
    Simulate,
    Validate,
    Faulty,
    Deadline,
    HangUp,
    GrpcSolve,
    GrpcStream,
    GrpcFaulty,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Outcome {
    Answered,
    RefusedForWantOfRoom,
    Unexpected,
}

type Tally = BTreeMap<(Kind, Outcome), u64>;

#[derive(Clone)]
struct Caller {
    http: String,
    client: reqwest::Client,
    grpc: ManeuverServiceClient<Channel>,
    faults: Arc<Mutex<Vec<String>>>,
}

fn body(random: &mut Xoshiro256PlusPlus) -> Value {
    let starts = [1, 1, 2, 8][random.random_range(0..4)];
    let steps = [50, 100, 200][random.random_range(0..3)];
    json!({
        "maneuver": {"goal": {"y_m": random.random_range(0.5..6.0), "x_m": random.random_range(-1.0..1.0)}},
        "grid": {"steps": steps},
        "solver": {"starts": starts, "time_limit_s": 5},
        "view": if random.random_bool(0.5) { "plan" } else { "full" },
    })
}

impl Caller {
    fn post(&self, path: &str, body: &Value) -> reqwest::RequestBuilder {
        let request = self.client.post(format!("{}{path}", self.http)).header("content-type", "application/json");
        request.body(body.to_string())
    }

    async fn call(&mut self, kind: Kind, random: &mut Xoshiro256PlusPlus) -> Outcome {
        let body = body(random);
        match kind {
            Kind::Solve => self.expect(kind, self.post("/solve", &body), &[200]).await,
            Kind::Events => {
                let request = self.post("/solve", &body).header("accept", "text/event-stream");
                self.expect(kind, request, &[200]).await
            }
            Kind::Simulate => {
                let schedule = json!({"interval_s": 0.05, "left_n_m": [0.5, -0.5], "right_n_m": [0.5, -0.2]});
                let body = json!({"torque_schedule": schedule, "grid": {"steps": 200}});
                self.expect(kind, self.post("/simulate", &body), &[200]).await
            }
            Kind::Validate => self.expect(kind, self.post("/validate", &body), &[200]).await,
            Kind::Faulty => {
                let body = json!({"robot": {"wheel_radius_m": -1}, "grid": {"steps": 1_000_000}});
                self.expect(kind, self.post("/solve", &body), &[422]).await
            }
            Kind::Deadline => {
                let deadline = random.random_range(1..300).to_string();
                let request = self.post("/solve", &body).header("request-timeout-ms", deadline);
                self.expect(kind, request, &[200, 504]).await
            }
            Kind::HangUp => {
                let patience = Duration::from_millis(random.random_range(1..100));
                let _ = tokio::time::timeout(patience, self.post("/solve", &body).send()).await;
                Outcome::Answered
            }
            Kind::GrpcSolve => {
                let answer = self.grpc.solve(grpc_request(random)).await;
                self.expect_code(kind, answer.map(|_| ()), Code::Ok)
            }
            Kind::GrpcStream => {
                let answer = self.stream(random).await;
                self.expect_code(kind, answer, Code::Ok)
            }
            Kind::GrpcFaulty => {
                let robot = pb::Robot { wheel_radius_m: Some(-1.0), ..pb::Robot::default() };
                let request = pb::SolveRequest { robot: Some(robot), ..pb::SolveRequest::default() };
                let answer = self.grpc.solve(request).await;
                self.expect_code(kind, answer.map(|_| ()), Code::InvalidArgument)
            }
        }
    }

    async fn stream(&mut self, random: &mut Xoshiro256PlusPlus) -> Result<(), tonic::Status> {
        let pb::SolveRequest { maneuver, solver, .. } = grpc_request(random);
        let request = pb::SolveStreamRequest { maneuver, solver, ..pb::SolveStreamRequest::default() };
        let mut events = self.grpc.solve_stream(request).await?.into_inner();
        while events.message().await?.is_some() {}
        Ok(())
    }

    async fn expect(&self, kind: Kind, request: reqwest::RequestBuilder, expected: &[u16]) -> Outcome {
        let answer = async {
            let response = request.send().await?;
            let status = response.status().as_u16();
            response.bytes().await.map(|body| (status, body))
        };
        match answer.await {
            Ok((status, _)) if expected.contains(&status) => Outcome::Answered,
            Ok((429, _)) => Outcome::RefusedForWantOfRoom,
            Ok((status, body)) => self.unexpected(kind, &format!("{status} {}", String::from_utf8_lossy(&body))),
            Err(error) => self.unexpected(kind, &format!("{error:?}")),
        }
    }

    fn expect_code(&self, kind: Kind, answer: Result<(), tonic::Status>, expected: Code) -> Outcome {
        match answer.err() {
            None if expected == Code::Ok => Outcome::Answered,
            Some(status) if status.code() == expected => Outcome::Answered,
            Some(status) if status.code() == Code::ResourceExhausted => Outcome::RefusedForWantOfRoom,
            other => self.unexpected(kind, &format!("{other:?}")),
        }
    }

    fn unexpected(&self, kind: Kind, what: &str) -> Outcome {
        let mut faults = self.faults.lock().unwrap();
        if faults.len() < 10 {
            faults.push(format!("{kind:?}: {}", what.chars().take(300).collect::<String>()));
        }
        Outcome::Unexpected
    }
}

fn grpc_request(random: &mut Xoshiro256PlusPlus) -> pb::SolveRequest {
    let goal = pb::Goal { y_m: Some(random.random_range(0.5..6.0)), ..pb::Goal::default() };
    let maneuver = pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() };
    let solver = pb::Solver { starts: Some(1), ..pb::Solver::default() };
    pb::SolveRequest { maneuver: Some(maneuver), solver: Some(solver), ..pb::SolveRequest::default() }
}

fn draw(random: &mut Xoshiro256PlusPlus) -> Kind {
    let mut ticket = random.next_u32() % 100;
    for (kind, share) in MIX {
        if ticket < share {
            return kind;
        }
        ticket -= share;
    }
    Kind::Solve
}

/// The value behind a flag of the command line.
fn flag(name: &str, default: &str) -> String {
    let arguments: Vec<_> = std::env::args().collect();
    let value = arguments.iter().position(|argument| argument == name).and_then(|index| arguments.get(index + 1));
    value.map_or_else(|| default.to_owned(), Clone::clone)
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    let http = format!("http://{}", flag("--http", "127.0.0.1:8080"));
    let grpc = format!("http://{}", flag("--grpc", "127.0.0.1:50051"));
    let duration = Duration::from_secs_f64(flag("--seconds", "10").parse().unwrap());
    let callers: u64 = flag("--callers", "4").parse().unwrap();
    let client = reqwest::Client::builder().no_proxy().timeout(Duration::from_secs(120)).build().unwrap();
    let channel = Endpoint::from_shared(grpc).unwrap().connect_lazy();
    let grpc = ManeuverServiceClient::new(channel).max_decoding_message_size(16 * 1024 * 1024);
    let caller = Caller { http, client, grpc, faults: Arc::default() };
    let (start, faults) = (Instant::now(), Arc::clone(&caller.faults));
    let tasks: Vec<_> = (0..callers)
        .map(|number| {
            let mut caller = caller.clone();
            tokio::spawn(async move {
                let mut random = Xoshiro256PlusPlus::seed_from_u64(number);
                let mut tally = Tally::new();
                while start.elapsed() < duration {
                    let kind = draw(&mut random);
                    let outcome = caller.call(kind, &mut random).await;
                    *tally.entry((kind, outcome)).or_default() += 1;
                    if outcome == Outcome::RefusedForWantOfRoom {
                        tokio::time::sleep(Duration::from_millis(50)).await;
                    }
                }
                tally
            })
        })
        .collect();
    let mut total = Tally::new();
    for task in tasks {
        for (key, count) in task.await.unwrap() {
            *total.entry(key).or_default() += count;
        }
    }
    let sum =
        |wanted: Outcome| total.iter().filter(|((_, outcome), _)| *outcome == wanted).map(|(_, n)| n).sum::<u64>();
    for ((kind, outcome), count) in &total {
        println!("{:<12} {:<22} {count}", format!("{kind:?}"), format!("{outcome:?}"));
    }
    for fault in faults.lock().unwrap().iter() {
        println!("unexpected: {fault}");
    }
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{} answered, {} refused for want of room, {} unexpected in {seconds:.1} s",
        sum(Outcome::Answered),
        sum(Outcome::RefusedForWantOfRoom),
        sum(Outcome::Unexpected)
    );
    if sum(Outcome::Unexpected) == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
