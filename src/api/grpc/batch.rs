//! A batch: many jobs over one stream, each answered as it ends.
//!
//! The state lives in the answer stream and moves only when the transport asks for the next answer. So of a caller who does
//! not read at most `batch_window` items are begun; what else it sends waits, unparsed, in the share of the byte budget
//! that [`super::read_ahead`] has. A caller who leaves drops all of it.

use std::collections::HashSet;
use std::future::pending;
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::future::BoxFuture;
use futures_util::stream::{BoxStream, FuturesUnordered, Stream, StreamExt as _, TryStreamExt as _, unfold};
use tokio::time::{sleep, sleep_until};
use tonic::{Status, Streaming};
use tracing::{Instrument as _, Span};

use super::admission::Call;
use super::calls::unavailable;
use super::pb::batch_request::Request;
use super::pb::batch_response::Answer;
use super::{middleware, pb, status};
use crate::api::ApiState;
use crate::api::receive::memory_full;
use crate::api::server::Lease;
use crate::contract::convert::required;
use crate::contract::{ErrorCode, Problem};
use crate::rules::{Checks, Rule};
use crate::service::ServiceError;

/// Length of the id of an item, bytes.
const REQUEST_ID_RULE: Rule = Rule::between(1.0, 128.0, "bytes long");
const TIMEOUT_RULE: Rule = Rule::at_least(1.0, "ms");

/// The answer to one item, and the memory that it holds.
pub(super) type ItemResult = Result<(Answer, Arc<Lease>), Problem>;

/// Gives the answer to one item, by its kind.
pub(super) type Dispatch = for<'a> fn(&'a ApiState, Request, &'a Call) -> BoxFuture<'a, ItemResult>;

/// How long a batch may last without an item or an answer.
const STANDSTILL: Duration = Duration::from_secs(2 * 60);

/// One batch under way.
pub(super) struct Batch {
    state: ApiState,
    call: Call,
    dispatch: Dispatch,
    /// The span of the call, for the spans of its items.
    span: Span,
    /// None once nothing more is read.
    inbound: Option<BoxStream<'static, Result<pb::BatchRequest, Status>>>,
    running: FuturesUnordered<BoxFuture<'static, (pb::BatchResponse, Option<Arc<Lease>>)>>,
    /// Of the answer that was given last, until the next is asked for.
    lease: Option<Arc<Lease>>,
    /// Ids of the unanswered items.
    unanswered: HashSet<String>,
    /// What the stream ends with once all items are answered; none for success.
    end: Option<Problem>,
}

impl Batch {
    /// A batch of these items, which may be those of an older call.
    pub(super) fn new<T: Into<pb::BatchRequest> + Send + 'static>(
        state: ApiState,
        call: Call,
        inbound: Streaming<T>,
        dispatch: Dispatch,
    ) -> Self {
        let (running, unanswered) = (FuturesUnordered::new(), HashSet::new());
        let inbound = Some(inbound.map_ok(Into::into).boxed());
        Self { state, call, dispatch, span: Span::current(), inbound, running, lease: None, unanswered, end: None }
    }

    /// All answers; the last is an error if the batch was ended before its caller ended it.
    pub(super) fn into_answers(self) -> impl Stream<Item = Result<pb::BatchResponse, Status>> + Send {
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
    async fn next_answer(&mut self) -> Option<pb::BatchResponse> {
        self.lease = None;
        loop {
            let may_read = self.running.len() < self.state.settings.batch_window.get();
            let (service, deadline) = (&self.state.service, self.call.deadline);
            let is_idle = self.inbound.is_some() && self.running.is_empty();
            // Who leaves a batch idle may be ended for its memory, like those who do not read. Twice the time, since the
            // batch ends by itself before.
            let _wait = is_idle.then(|| self.call.connection.wait(2 * STANDSTILL).begun());
            tokio::select! {
                Some((answer, lease)) = self.running.next(), if !self.running.is_empty() => {
                    self.lease = lease;
                    self.unanswered.remove(&answer.request_id);
                    return Some(answer);
                }
                item = next_item(&mut self.inbound), if may_read && self.inbound.is_some() => match item {
                    Ok(Some(item)) => {
                        if let Some(refused) = self.take(item) {
                            return Some(refused);
                        }
                    }
                    Ok(None) => self.inbound = None,
                    Err(status) => self.end_with(self.unreadable(&status)),
                },
                () = service.closed(), if self.inbound.is_some() => {
                    self.end_with(unavailable(&self.state));
                }
                () = sleep(STANDSTILL), if is_idle => {
                    let detail = format!("nothing came for {STANDSTILL:?}");
                    self.end_with(Problem::new(ErrorCode::BodyTimeout, detail));
                }
                () = passed(deadline), if self.inbound.is_some() => {
                    self.end_with(ServiceError::DeadlineExceeded.into());
                }
                else => return None,
            }
        }
    }

    /// Why the next item cannot be read.
    fn unreadable(&self, status: &Status) -> Problem {
        match status::code_of(status) {
            Some(ErrorCode::MemoryFull) => memory_full(),
            _ => middleware::of_framework(status, false, "", self.call.max_message_bytes),
        }
    }

    fn end_with(&mut self, problem: Problem) {
        self.inbound = None;
        self.end = Some(problem);
    }

    /// Starts an item, or answers it at once.
    fn take(&mut self, item: pb::BatchRequest) -> Option<pb::BatchResponse> {
        let pb::BatchRequest { request_id, timeout_ms, request } = item;
        let checked = self.check(&request_id, timeout_ms).and_then(|()| required(request, "request"));
        let request = match checked {
            Ok(request) => request,
            Err(problem) => return Some(refused(&self.state, request_id, &problem)),
        };
        self.unanswered.insert(request_id.clone());
        let (state, mut call, dispatch) = (self.state.clone(), self.call.clone(), self.dispatch);
        let item_deadline =
            timeout_ms.and_then(|timeout| Instant::now().checked_add(Duration::from_millis(timeout.into())));
        call.deadline = item_deadline.into_iter().chain(call.deadline).min();
        let answered = async move {
            match dispatch(&state, request, &call).await {
                Ok((answer, lease)) => (pb::BatchResponse { request_id, answer: Some(answer) }, Some(lease)),
                Err(problem) => (refused(&state, request_id, &problem), None),
            }
        };
        self.running.push(Box::pin(answered.instrument(self.span.clone())));
        None
    }

    fn check(&self, request_id: &str, timeout_ms: Option<u32>) -> Result<(), Problem> {
        let mut checks = Checks::new();
        checks.bounds("request_id", request_id.len() as f64, &REQUEST_ID_RULE);
        let is_new = !self.unanswered.contains(request_id);
        checks.require("request_id", format!("\"{request_id}\""), is_new, "unique among the unanswered items", None);
        if let Some(timeout) = timeout_ms {
            checks.bounds("timeout_ms", timeout.into(), &TIMEOUT_RULE);
        }
        Ok(checks.finish()?)
    }
}

async fn next_item(
    inbound: &mut Option<BoxStream<'static, Result<pb::BatchRequest, Status>>>,
) -> Result<Option<pb::BatchRequest>, Status> {
    match inbound {
        Some(inbound) => inbound.try_next().await,
        None => Ok(None),
    }
}

async fn passed(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline.into()).await,
        None => pending().await,
    }
}

/// The answer to an item without a plan: the status that a single call would get.
fn refused(state: &ApiState, request_id: String, problem: &Problem) -> pb::BatchResponse {
    state.service.metrics().rejected(problem.code().entry().code);
    let error = status::as_message(&status::of_problem(problem, &request_id));
    pb::BatchResponse { request_id, answer: Some(Answer::Error(error)) }
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
