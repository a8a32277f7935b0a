//! Callers leave at random moments in every way there is; workers are free again, and no answer goes astray.

use std::sync::Arc;
use std::time::Duration;

use prost::Message as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::json;
use slipdrive::api::ApiSettings;
use slipdrive::api::grpc::pb;
use slipdrive::api::server::ServerSettings;
use slipdrive::service::ServiceSettings;
use slipdrive::shooting::StateComponent;
use slipdrive::simulation::TorqueSchedule;
use slipdrive::solver::SolveInput;
use slipdrive::solver::{RunControl, StopReason};
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};
use tonic::Code;

use crate::support::protobuf::{GRPC, SOLVE, code_of, framed, raw_call};
use crate::support::{FakeSolver, HANG_BOUND, TestServer, small_solution};

const SEED: u64 = 21;
/// Far above the time of the whole test: nobody gets an answer by waiting.
const TIME_LIMIT_S: f64 = 60.0;

fn long_solve() -> pb::SolveRequest {
    let solver = pb::Solver { time_limit_s: Some(TIME_LIMIT_S), ..pb::Solver::default() };
    pb::SolveRequest { solver: Some(solver), ..pb::SolveRequest::default() }
}

/// Of the reasons to refuse only those that a deadline or a crowd gives.
fn assert_refused(status: &tonic::Status) {
    let code = code_of(status);
    assert!(matches!(code.as_str(), "deadline_exceeded" | "deadline_unreachable" | "queue_full"), "{status:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_hundred_departures_leave_nothing_behind() {
    let solver = FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        small_solution(StopReason::Stopped)
    });
    let server = Arc::new(TestServer::start(16, Arc::new(solver)).await);
    let client = server.grpc().await;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    let mut callers = JoinSet::new();
    for number in 0..200 {
        let patience = Duration::from_millis(random.random_range(0..300));
        let (server, mut client) = (Arc::clone(&server), client.clone());
        callers.spawn(async move {
            let body = json!({"solver": {"time_limit_s": TIME_LIMIT_S}}).to_string();
            match number % 4 {
                // A connection is closed, a call is reset, a stream is dropped, a deadline passes.
                0 => {
                    // Who is answered before the departure was refused: no solve ends by itself.
                    if let Ok(answer) = timeout(patience, server.post("/solve", body)).await {
                        assert_eq!((answer.status, answer.problem()["code"].as_str()), (429, Some("queue_full")));
                    }
                }
                1 => {
                    if let Ok(answer) = timeout(patience, client.solve(long_solve())).await {
                        assert_refused(&answer.unwrap_err());
                    }
                }
                2 => {
                    let request = pb::SolveStreamRequest { solver: long_solve().solver, ..Default::default() };
                    if let Ok(events) = client.solve_stream(request).await {
                        sleep(patience).await;
                        drop(events);
                    }
                }
                _ => {
                    let deadline = format!("{}m", patience.as_millis() + 1);
                    let message = framed(0, &long_solve().encode_to_vec());
                    // Not by a generated client, which gives up by itself at this time.
                    let headers = [GRPC, ("grpc-timeout", &deadline)];
                    let call = raw_call(&server, SOLVE, &headers, message);
                    let status = timeout(HANG_BOUND, call).await.expect("the deadline is kept");
                    if status.code() != Code::Ok {
                        assert_refused(&status);
                    }
                }
            }
        });
    }
    while callers.join_next().await.transpose().unwrap().is_some() {}
    let empty = async {
        while server.service.jobs_in_flight() > 0 {
            tokio::task::yield_now().await;
        }
    };
    timeout(HANG_BOUND, empty).await.expect("all places are given back");
    assert_eq!(server.get("/readyz").await.status, 200);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_thousand_solves_of_sixty_four_callers_reach_their_own_caller() {
    // The plan names the goal that it was asked for.
    let solver = FakeSolver(|input: &SolveInput, _: &RunControl<'_>| {
        let final_time = input.maneuver.goal.value(StateComponent::Y).unwrap();
        let schedule = TorqueSchedule { final_time, left: vec![0.0], right: vec![0.0] };
        slipdrive::solver::Solution { schedule, ..small_solution(StopReason::Finished) }
    });
    // Nobody is refused: on a busy machine the work of 64 default searches seems to exceed the default.
    let settings = ServiceSettings { queue_length: 64, queue_work: 10 * HANG_BOUND, ..ServiceSettings::default() };
    let (api, connections) = (ApiSettings::default(), ServerSettings::default());
    let server = Arc::new(TestServer::start_sized(settings, Arc::new(solver), api, connections).await);
    let mut callers = JoinSet::new();
    for caller in 0..64 {
        let server = Arc::clone(&server);
        callers.spawn(async move {
            let mut client = server.grpc().await;
            for round in 0..16 {
                let goal = f64::from(caller * 16 + round + 1);
                let final_time = if (caller + round) % 2 == 0 {
                    let body = json!({"maneuver": {"goal": {"y_m": goal}}, "view": "plan"}).to_string();
                    let answer = server.post("/solve", body).await;
                    answer.json()["final_time_s"].as_f64().unwrap_or_else(|| panic!("{}", answer.text()))
                } else {
                    let goal = pb::Goal { y_m: Some(goal), ..pb::Goal::default() };
                    let maneuver = pb::Maneuver { goal: Some(goal), ..pb::Maneuver::default() };
                    let request = pb::SolveRequest { maneuver: Some(maneuver), ..pb::SolveRequest::default() };
                    client.solve(request).await.unwrap().into_inner().solution.unwrap().final_time_s
                };
                assert_eq!(final_time, goal, "caller {caller}, round {round}");
            }
        });
    }
    let all = async { while callers.join_next().await.transpose().unwrap().is_some() {} };
    timeout(HANG_BOUND, all).await.expect("everyone is answered");
    assert_eq!(server.service.jobs_in_flight(), 0);
}
