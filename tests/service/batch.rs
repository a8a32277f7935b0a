//! Batches of any kind of job, over real sockets.

use std::collections::BTreeMap;
use std::sync::Arc;

use futures_util::stream;
use slipdrive::api::grpc::pb::batch_request::Request;
use slipdrive::api::grpc::pb::batch_response::Answer;
use slipdrive::api::grpc::pb::{self, BatchRequest};
use slipdrive::solver::{RunControl, SolveInput, StopReason};
use tokio::time::timeout;
use tonic::Code;

use crate::support::{FakeSolver, HANG_BOUND, TestServer, instant_solver, small_solution};

fn solve(request_id: &str) -> BatchRequest {
    let request = Some(Request::Solve(pb::SolveRequest::default()));
    BatchRequest { request_id: request_id.to_owned(), request, timeout_ms: None }
}

fn simulate(request_id: &str, torques: usize) -> BatchRequest {
    let zeros = vec![0.0; torques];
    let schedule = pb::TorqueSchedule { interval_s: Some(0.1), left_n_m: zeros.clone(), right_n_m: zeros };
    let request = pb::SimulateRequest { torque_schedule: Some(schedule), ..pb::SimulateRequest::default() };
    let request = Some(Request::Simulate(request));
    BatchRequest { request_id: request_id.to_owned(), request, timeout_ms: None }
}

async fn answers(server: &TestServer, items: Vec<BatchRequest>) -> BTreeMap<String, Answer> {
    let mut answers = server.grpc().await.batch(stream::iter(items)).await.unwrap().into_inner();
    let mut by_id = BTreeMap::new();
    while let Some(response) = timeout(HANG_BOUND, answers.message()).await.unwrap().unwrap() {
        assert!(by_id.insert(response.request_id, response.answer.unwrap()).is_none(), "one answer for each item");
    }
    by_id
}

#[tokio::test]
async fn items_of_any_kind_are_answered_by_their_kind() {
    let server = TestServer::start(4, instant_solver()).await;
    let answers = answers(&server, vec![solve("plan"), simulate("motion", 3), simulate("nothing", 0)]).await;
    assert_eq!(answers.len(), 3);
    assert!(matches!(&answers["plan"], Answer::Solve(solution) if solution.final_time_s == 1.5), "{answers:?}");
    assert!(matches!(&answers["motion"], Answer::Simulate(motion) if motion.trajectory.is_some()), "{answers:?}");
    let Answer::Error(error) = &answers["nothing"] else { panic!("{answers:?}") };
    assert_eq!(error.code, i32::from(Code::InvalidArgument));
    // No interval has no length either: the details name each field.
    assert!(error.message.contains("values break their rules") && !error.details.is_empty(), "{error:?}");
}

#[tokio::test]
async fn items_that_ask_for_nothing_or_at_no_time_are_refused() {
    let server = TestServer::start(4, instant_solver()).await;
    let items = vec![
        BatchRequest { request: None, ..solve("empty") },
        BatchRequest { timeout_ms: Some(0), ..solve("never") },
        solve(&"x".repeat(129)),
    ];
    let answers = answers(&server, items).await;
    for (id, field) in [("empty", "request"), ("never", "timeout_ms"), ("", "request_id")] {
        let Answer::Error(error) = &answers[id] else { panic!("{id}: {answers:?}") };
        assert_eq!(error.code, i32::from(Code::InvalidArgument));
        assert!(error.message.contains(field), "{error:?}");
        if field == "request_id" {
            assert!(error.message.contains("is 129 bytes long, must be between 1 and 128 bytes"), "{error:?}");
        }
    }
}

#[tokio::test]
async fn timeout_of_an_item_is_its_deadline() {
    let solver = FakeSolver(|_: &SolveInput, control: &RunControl<'_>| {
        while !control.is_stopped() {
            std::thread::yield_now();
        }
        small_solution(StopReason::Stopped)
    });
    let server = TestServer::start(4, Arc::new(solver)).await;
    let answers = answers(&server, vec![BatchRequest { timeout_ms: Some(100), ..solve("soon") }]).await;
    let Answer::Solve(solution) = &answers["soon"] else { panic!("{answers:?}") };
    assert_eq!(solution.stop_reason(), pb::StopReason::Deadline);
}
