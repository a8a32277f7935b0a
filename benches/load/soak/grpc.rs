//! Questions over gRPC.

use std::collections::BTreeSet;
use std::error::Error;

use futures_util::stream;
use slipdrive::api::grpc::pb;
use slipdrive::api::grpc::pb::maneuver_service_client::ManeuverServiceClient;
use tonic::transport::Channel;
use tonic::{Request, Status, Streaming, TimeoutExpired};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;
use tonic_types::{RpcStatusExt as _, StatusExt as _};

use super::question::{BATCH_ITEMS, DEADLINE, Failure, Question, content_of_motion, simulation};
use crate::hostile::KEY;

/// What the answer says.
pub async fn ask(channel: Channel, question: Question) -> Result<String, Failure> {
    let failure = |status| failure_of(question, &status);
    let mut client = ManeuverServiceClient::new(channel.clone());
    match question {
        Question::Health => {
            let answer = HealthClient::new(channel).check(HealthCheckRequest::default()).await.map_err(failure)?;
            let is_serving = answer.get_ref().status() == ServingStatus::Serving;
            Ok(if is_serving { "live" } else { "not serving" }.to_owned())
        }
        Question::Validate => {
            let answer = client.validate(with_key(question.solve())).await.map_err(failure)?;
            Ok(answer.into_inner().input_hash)
        }
        Question::Simulate => {
            let answer = client.simulate(with_key(simulation())).await.map_err(failure)?;
            content_of_motion(answer.get_ref())
        }
        Question::Batch => {
            let answers = client.batch(with_key(stream::iter((0..BATCH_ITEMS).map(item)))).await.map_err(failure)?;
            content_of_batch(answers.into_inner()).await
        }
        Question::Events => {
            let events = client.solve_stream(with_key(question.solve())).await.map_err(failure)?;
            content_of_events(question, events.into_inner()).await
        }
        Question::Solve | Question::SolvePlan | Question::SolveUntilDeadline | Question::HangUp => {
            let mut request = with_key(question.solve());
            if question == Question::SolveUntilDeadline {
                request.set_timeout(DEADLINE);
            }
            let answer = client.solve(request).await.map_err(failure)?.into_inner();
            question.content_of(&answer.solution.unwrap_or_default())
        }
    }
}

fn with_key<T>(message: T) -> Request<T> {
    let mut request = Request::new(message);
    request.metadata_mut().insert("authorization", format!("Bearer {KEY}").parse().unwrap());
    request
}

fn item(index: usize) -> pb::BatchRequest {
    let solve = pb::batch_request::Request::Solve(Question::Batch.solve());
    pb::BatchRequest { request_id: index.to_string(), request: Some(solve), timeout_ms: None }
}

/// What all items say: each must be answered once, and all alike.
async fn content_of_batch(mut answers: Streaming<pb::BatchResponse>) -> Result<String, Failure> {
    let (mut ids, mut contents) = (BTreeSet::new(), BTreeSet::new());
    while let Some(pb::BatchResponse { request_id, answer }) = next(Question::Batch, &mut answers).await? {
        contents.insert(match answer {
            Some(pb::batch_response::Answer::Solve(solution)) => Question::Batch.content_of(&solution)?,
            Some(pb::batch_response::Answer::Error(error)) => {
                let code = error.get_details_error_info().map_or(error.message, |info| info.reason.to_lowercase());
                return Err(Failure::refusal(Question::Batch, code));
            }
            Some(
                pb::batch_response::Answer::Simulate(_)
                | pb::batch_response::Answer::Present(_)
                | pb::batch_response::Answer::Export(_)
                | pb::batch_response::Answer::Assess(_),
            )
            | None => "no plan".to_owned(),
        });
        if !ids.insert(request_id) {
            return Err(Failure::Unexpected("an item is answered twice".to_owned()));
        }
    }
    Ok(format!("{} items: {contents:?}", ids.len()))
}

/// What the last of the events says; the first must tell the place in the queue.
async fn content_of_events(
    question: Question,
    mut events: Streaming<pb::SolveStreamResponse>,
) -> Result<String, Failure> {
    use pb::solve_stream_response::Event;
    let mut is_queued = false;
    while let Some(pb::SolveStreamResponse { event }) = next(question, &mut events).await? {
        match event {
            Some(Event::Queued(_)) => is_queued = true,
            Some(Event::Solution(solution)) if is_queued => return question.content_of(&solution),
            Some(Event::Progress(_)) if is_queued => {}
            Some(Event::Progress(_) | Event::Solution(_)) | None => {
                return Err(Failure::Unexpected("events in disorder".to_owned()));
            }
        }
    }
    Err(Failure::cut_in_the_answer())
}

async fn next<T>(question: Question, answers: &mut Streaming<T>) -> Result<Option<T>, Failure> {
    answers.message().await.map_err(|status| match failure_of(question, &status) {
        Failure::Cut => Failure::cut_in_the_answer(),
        failure @ (Failure::Refused(_) | Failure::Unexpected(_)) => failure,
    })
}

/// Statuses of the server bear a code; of the others those with a cause tell that the connection broke.
fn failure_of(question: Question, status: &Status) -> Failure {
    if let Some(info) = status.get_details_error_info() {
        return Failure::refusal(question, info.reason.to_lowercase());
    }
    let mut causes = std::iter::successors(status.source(), |cause| (*cause).source()).peekable();
    let is_broken = causes.peek().is_some();
    // Only questions with a deadline have one here; the client gives up by itself when the answer is late.
    if causes.any(<dyn Error>::is::<TimeoutExpired>) {
        return Failure::Refused("given up at the deadline".to_owned());
    }
    if is_broken { Failure::Cut } else { Failure::Unexpected(format!("{:?} `{}`", status.code(), status.message())) }
}
