//! Batches as messages of `proto/`.

use std::sync::Arc;

use futures_util::future::BoxFuture;
use futures_util::stream::{Stream, StreamExt as _, unfold};
use tonic::{Status, Streaming};

use super::admission::Call;
use super::pb::batch_request::Request;
use super::pb::batch_response::Answer;
use super::{middleware, pb, status};
use crate::api::ApiState;
use crate::api::batch::{Batch, Format, Item, ItemResult, Message, Subject};
use crate::api::receive::memory_full;
use crate::api::submit::{Caller, Entry};
use crate::contract::convert::required;
use crate::contract::{BodyLimit, ErrorCode, Problem};
use crate::jobs::present::count::PlansOfMessage;

/// Gives the answer to one item, by its kind.
pub(super) type Dispatch =
    for<'a> fn(&'a ApiState, Request, (&'a Caller, Entry<'a>)) -> BoxFuture<'a, ItemResult<Answer>>;

/// Answers by the kind of the item.
#[derive(Clone)]
pub(super) struct ByKind {
    dispatch: Dispatch,
    /// The id of the call, for errors of no item.
    call_id: Arc<str>,
}

impl Format for ByKind {
    type Request = Request;
    type Answer = pb::BatchResponse;

    fn answer<'a>(
        &'a self,
        state: &'a ApiState,
        request_id: &'a str,
        request: Request,
        caller: (&'a Caller, Entry<'a>),
    ) -> BoxFuture<'a, ItemResult<pb::BatchResponse>> {
        Box::pin(async move {
            let (answer, lease) = (self.dispatch)(state, request, caller).await?;
            Ok((pb::BatchResponse { request_id: request_id.to_owned(), answer: Some(answer) }, lease))
        })
    }

    /// The status that a single call would get. Who matches answers by their ids must not take the refusal of a message for
    /// the answer to the item that has the same id.
    fn refusal(&self, subject: Subject<'_>, problem: &Problem) -> pb::BatchResponse {
        let item = match subject {
            Subject::Item(request_id) | Subject::Message { request_id, is_own: true, .. } => Some(request_id),
            Subject::Message { is_own: false, .. } => None,
        };
        let error = status::message_of(problem, item.unwrap_or(&self.call_id));
        pb::BatchResponse { request_id: item.unwrap_or_default().to_owned(), answer: Some(Answer::Error(error)) }
    }
}

/// A batch of these items, which may be those of an older call.
pub(super) fn batch<T: Into<pb::BatchRequest> + Send + 'static>(
    state: ApiState,
    call: &Call,
    inbound: Streaming<T>,
    dispatch: Dispatch,
) -> Batch<ByKind> {
    let limit = call.limit;
    let messages = inbound.enumerate().map(move |(before, message)| match message {
        Ok(message) => Ok(Message { number: before + 1, item: Ok(item_of(message.into())) }),
        Err(status) => Err(unreadable(&status, limit)),
    });
    Batch::new(
        state,
        call.caller.clone(),
        messages.boxed(),
        ByKind { dispatch, call_id: call.request_id.as_str().into() },
    )
}

/// All answers; the last is an error if the batch was ended before its caller ended it.
pub(super) fn answers(
    batch: Batch<ByKind>,
    request_id: String,
) -> impl Stream<Item = Result<pb::BatchResponse, Status>> + Send {
    unfold(Some((batch, request_id)), |under_way| async {
        let (mut batch, request_id) = under_way?;
        if let Some(answer) = batch.next_answer().await {
            return Some((Ok(answer), Some((batch, request_id))));
        }
        let end = batch.take_end()?;
        Some((Err(status::of_problem(&end, &request_id)), None))
    })
}

/// What of an item is looked at before it is read; of an item of an older call nothing.
#[derive(Clone, PartialEq, prost::Message)]
struct ItemAsWritten {
    #[prost(string, tag = "1")]
    request_id: String,
    #[prost(uint32, optional, tag = "2")]
    timeout_ms: Option<u32>,
    #[prost(message, optional, tag = "5")]
    present: Option<PlansOfMessage>,
}

/// What is to be read in place of an item that would hold far more than its own length: as many plans without content, which are refused by
/// their number like any others.
pub(super) fn instead_of_item(message: &[u8]) -> Option<Vec<u8>> {
    let item: Result<ItemAsWritten, _> = prost::Message::decode(message);
    // What can be read as neither: its beginning must not be.
    let Ok(item) = item else { return Some(vec![u8::MAX]) };
    let present = item.present.as_ref().filter(|plans| plans.check().is_err())?.emptied();
    Some(prost::Message::encode_to_vec(&ItemAsWritten { present: Some(present), ..item }))
}

fn item_of(message: pb::BatchRequest) -> Item<Request> {
    let pb::BatchRequest { request_id, timeout_ms, request } = message;
    Item { request_id, timeout_ms, request: required(request, "request") }
}

/// Why the next message cannot be read.
fn unreadable(status: &Status, limit: BodyLimit) -> Problem {
    match status::code_of(status) {
        Some(ErrorCode::MemoryFull) => memory_full(),
        Some(code) => Problem::new(code, status.message()),
        None => middleware::of_framework(status, false, "", limit),
    }
}

impl From<pb::SolveBatchRequest> for pb::BatchRequest {
    fn from(item: pb::SolveBatchRequest) -> Self {
        let pb::SolveBatchRequest { robot, payload, maneuver, grid, solver, initial_guess, view, request_id } = item;
        let solve = pb::SolveRequest { robot, payload, maneuver, grid, solver, initial_guess, view };
        Self { request_id, timeout_ms: None, request: Some(Request::Solve(solve)) }
    }
}

impl From<pb::BatchResponse> for pb::SolveBatchResponse {
    fn from(answer: pb::BatchResponse) -> Self {
        use pb::solve_batch_response::Answer as OfSolve;
        let pb::BatchResponse { request_id, answer } = answer;
        let answer = match answer {
            Some(Answer::Solve(solution)) => Some(OfSolve::Solution(solution)),
            Some(Answer::Error(error)) => Some(OfSolve::Error(error)),
            // Items of this call are solves.
            Some(_) | None => None,
        };
        Self { request_id, answer }
    }
}

#[cfg(test)]
mod tests {
    use prost::Message as _;

    use super::*;

    #[test]
    fn far_too_many_plans_are_read_as_empty_ones() {
        let item = |plan: pb::PresentedPlan, count| {
            let request = pb::PresentRequest { plans: vec![plan; count], report: false };
            let request = Some(Request::Present(request));
            pb::BatchRequest { request_id: "one".to_owned(), timeout_ms: Some(7), request }
        };
        let plan = pb::PresentedPlan { solve: Some(Box::default()), simulate: None };
        assert_eq!(instead_of_item(&item(plan.clone(), 5).encode_to_vec()), None);
        // Two halves of a message are one.
        let halves = [item(plan.clone(), 40), item(plan, 40)].map(|item| item.encode_to_vec()).concat();
        let instead = instead_of_item(&halves).unwrap();
        assert_eq!(pb::BatchRequest::decode(&*instead).unwrap(), item(pb::PresentedPlan::default(), 80));
        let torn = instead_of_item(&halves[..halves.len() - 1]).unwrap();
        assert!(pb::BatchRequest::decode(&*torn).is_err());
    }
}
