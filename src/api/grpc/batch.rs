//! A batch: many solves over one stream, each answered as it ends.
//!
//! The state lives in the answer stream and moves only when the transport asks for the next answer. So a caller who does
//! not read is not read from either, at most `batch_window` items are held, and a caller who leaves drops them all.

use std::collections::HashSet;
use std::future::pending;
use std::pin::Pin;
use std::time::Instant;

use futures_util::stream::{FuturesUnordered, Stream, StreamExt as _, unfold};
use tokio::time::{sleep_until, timeout_at};
use tonic::{Status, Streaming};
use tracing::{Instrument as _, Span};

use super::admission::Call;
use super::handlers::start;
use super::pb::solve_batch_response::Answer;
use super::{border, convert_request, pb, status};
use crate::api::Door;
use crate::api::error_table::ErrorCode;
use crate::api::problem::Problem;
use crate::service::ServiceError;

/// Longest id of an item, bytes.
const MAX_REQUEST_ID: usize = 128;

type Running = Pin<Box<dyn Future<Output = pb::SolveBatchResponse> + Send>>;

/// One batch under way.
pub(super) struct Batch {
    door: Door,
    call: Call,
    /// The span of the call, for the spans of its items.
    span: Span,
    /// None once nothing more is read.
    inbound: Option<Streaming<pb::SolveBatchRequest>>,
    running: FuturesUnordered<Running>,
    /// Ids of the unanswered items.
    unanswered: HashSet<String>,
    /// What the stream ends with once all items are answered; none for success.
    end: Option<Problem>,
}

impl Batch {
    pub(super) fn new(door: Door, call: Call, inbound: Streaming<pb::SolveBatchRequest>) -> Self {
        let (running, unanswered) = (FuturesUnordered::new(), HashSet::new());
        Self { door, call, span: Span::current(), inbound: Some(inbound), running, unanswered, end: None }
    }

    /// All answers; the last is an error if the batch was ended before its caller ended it.
    pub(super) fn into_answers(self) -> impl Stream<Item = Result<pb::SolveBatchResponse, Status>> + Send {
        unfold(Some(self), |batch| async move {
            let mut batch = batch?;
            if let Some(answer) = batch.next_answer().await {
                return Some((Ok(answer), Some(batch)));
            }
            let end = batch.end.take()?;
            Some((Err(status::of_problem(&end, &batch.call.request_id)), None))
        })
    }

    /// The next answer; none when nothing more is read and all items are answered.
    async fn next_answer(&mut self) -> Option<pb::SolveBatchResponse> {
        loop {
            let has_room = self.running.len() < self.door.settings.batch_window.get();
            let (service, deadline) = (&self.door.service, self.call.deadline);
            tokio::select! {
                Some(answer) = self.running.next(), if !self.running.is_empty() => {
                    self.unanswered.remove(&answer.request_id);
                    return Some(answer);
                }
                item = next_item(&mut self.inbound), if has_room && self.inbound.is_some() => match item {
                    Ok(Some(item)) => {
                        if let Some(refused) = self.take(item) {
                            return Some(refused);
                        }
                    }
                    Ok(None) => self.inbound = None,
                    Err(status) => {
                        let limit = self.door.service.limits().max_body_bytes;
                        self.end_with(border::of_framework(&status, "", limit));
                    }
                },
                () = service.closed(), if self.inbound.is_some() => {
                    let unavailable = self.door.service.check_open().err();
                    self.end_with(unavailable.map_or_else(|| Problem::new(ErrorCode::Unavailable, ""), Problem::from));
                }
                () = passed(deadline), if self.inbound.is_some() => {
                    self.end_with(ServiceError::DeadlineExceeded.into());
                }
                else => return None,
            }
        }
    }

    fn end_with(&mut self, problem: Problem) {
        self.inbound = None;
        self.end = Some(problem);
    }

    /// Starts an item, or answers it at once.
    fn take(&mut self, item: pb::SolveBatchRequest) -> Option<pb::SolveBatchResponse> {
        let (request_id, message) = convert_request::batch_item(item);
        if let Err(problem) = self.check_id(&request_id) {
            return Some(refused(&self.door, request_id, &problem));
        }
        self.unanswered.insert(request_id.clone());
        let (door, call) = (self.door.clone(), self.call.clone());
        let answered = async move {
            match solve(&door, message, &call).await {
                Ok(solution) => pb::SolveBatchResponse { request_id, answer: Some(Answer::Solution(solution)) },
                Err(problem) => refused(&door, request_id, &problem),
            }
        };
        self.running.push(Box::pin(answered.instrument(self.span.clone())));
        None
    }

    fn check_id(&self, request_id: &str) -> Result<(), Problem> {
        let rule = if !(1..=MAX_REQUEST_ID).contains(&request_id.len()) {
            format!("`request_id` is {} bytes long, must be 1 to {MAX_REQUEST_ID}", request_id.len())
        } else if self.unanswered.contains(request_id) {
            format!("`request_id` is \"{request_id}\", must be unique among the unanswered items")
        } else {
            return Ok(());
        };
        Err(Problem::at_field(ErrorCode::InvalidValue, "#/request_id".to_owned(), rule))
    }
}

async fn next_item(
    inbound: &mut Option<Streaming<pb::SolveBatchRequest>>,
) -> Result<Option<pb::SolveBatchRequest>, Status> {
    match inbound {
        Some(inbound) => inbound.message().await,
        None => Ok(None),
    }
}

async fn passed(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline.into()).await,
        None => pending().await,
    }
}

/// Waits for a place, where single callers would be refused; the last quarter of the queue stays theirs.
async fn solve(door: &Door, message: pb::SolveRequest, call: &Call) -> Result<pb::Solution, Problem> {
    let accepted = door.accept(message)?;
    let place = match call.deadline {
        Some(deadline) => timeout_at(deadline.into(), door.service.reserve_for_batch())
            .await
            .unwrap_or(Err(ServiceError::DeadlineExceeded))?,
        None => door.service.reserve_for_batch().await?,
    };
    Ok(start(place, accepted, call)?.outcome().await?)
}

/// The answer to an item without a plan: the status that a single call would get.
fn refused(door: &Door, request_id: String, problem: &Problem) -> pb::SolveBatchResponse {
    door.service.metrics().rejected(problem.code().entry().code);
    let error = status::as_message(&status::of_problem(problem, &request_id));
    pb::SolveBatchResponse { request_id, answer: Some(Answer::Error(error)) }
}
