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
use futures_util::stream::{BoxStream, FuturesUnordered, StreamExt as _};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{sleep, sleep_until};
use tracing::{Instrument as _, Span};

use super::ApiState;
use super::server::Lease;
use super::submit::{Caller, Entry, unavailable};
use crate::contract::{ErrorCode, Problem};
use crate::rules::{Checks, Rule};
use crate::service::ServiceError;

/// Length of the id of an item, bytes.
const REQUEST_ID_RULE: Rule = Rule::between(1.0, 128.0, "bytes");
const TIMEOUT_RULE: Rule = Rule::at_least(1.0, "ms");

/// How long a batch may last without an item or an answer.
const STANDSTILL: Duration = Duration::from_secs(2 * 60);

/// A message of a batch.
pub(super) struct Message<R> {
    /// Its place among all, from 1.
    pub(super) number: usize,
    /// The item that it is; a problem where it cannot be read.
    pub(super) item: Result<Item<R>, Problem>,
}

/// One item as it was sent.
pub(super) struct Item<R> {
    /// Names it in its answer.
    pub(super) request_id: String,
    /// When its answer is needed, ms after it was read.
    pub(super) timeout_ms: Option<u32>,
    /// What is asked, or why nothing is.
    pub(super) request: Result<R, Problem>,
}

/// What a refusal speaks of.
#[derive(Debug, Clone, Copy)]
pub(super) enum Subject<'a> {
    /// An item that was begun, by its id.
    Item(&'a str),
    /// A message that began no item.
    Message {
        number: usize,
        /// As it was sent; empty where it cannot be read.
        request_id: &'a str,
        /// Whether the id is valid and no other unanswered item has it.
        is_own: bool,
    },
}

/// The answer to one item, and the memory that it holds.
pub(super) type ItemResult<A> = Result<(A, Arc<Lease>), Problem>;

/// How a transport reads requests and writes answers.
pub(super) trait Format: Clone + Send + Sync + 'static {
    /// What is asked, not yet validated.
    type Request: Send + 'static;
    /// One answer.
    type Answer: Send + 'static;

    /// Gives the answer to one item, by its kind.
    fn answer<'a>(
        &'a self,
        state: &'a ApiState,
        request_id: &'a str,
        request: Self::Request,
        caller: (&'a Caller, Entry<'a>),
    ) -> BoxFuture<'a, ItemResult<Self::Answer>>;

    /// What is sent in place of an answer.
    fn refusal(&self, subject: Subject<'_>, problem: &Problem) -> Self::Answer;
}

/// The messages of a batch as they come; a problem where no more can be read.
pub(super) type Inbound<R> = BoxStream<'static, Result<Message<R>, Problem>>;

/// One batch under way.
pub(super) struct Batch<F: Format> {
    state: ApiState,
    caller: Caller,
    format: F,
    /// The span of the call, for the spans of its items.
    span: Span,
    inbound: Inbound<F::Request>,
    is_reading: bool,
    /// The item that is read and waits for memory has its one permit.
    entry: Arc<Semaphore>,
    running: FuturesUnordered<BoxFuture<'static, Ended<F::Answer>>>,
    /// Of the answer that was given last, until the next is asked for.
    lease: Option<Arc<Lease>>,
    /// Ids of the unanswered items.
    unanswered: HashSet<String>,
    end: Option<Problem>,
}

struct Ended<A> {
    request_id: String,
    answer: A,
    lease: Option<Arc<Lease>>,
}

impl<F: Format> Batch<F> {
    /// A batch of these items.
    pub(super) fn new(state: ApiState, caller: Caller, inbound: Inbound<F::Request>, format: F) -> Self {
        let (running, unanswered) = (FuturesUnordered::new(), HashSet::new());
        let (span, entry) = (Span::current(), Arc::new(Semaphore::new(1)));
        let (is_reading, lease, end) = (true, None, None);
        Self { state, caller, format, span, inbound, is_reading, entry, running, lease, unanswered, end }
    }

    /// The next answer; none when nothing more is read and all items are answered.
    pub(super) async fn next_answer(&mut self) -> Option<F::Answer> {
        self.lease = None;
        loop {
            let may_read = self.running.len() < self.state.settings.batch_window.get();
            let (service, deadline) = (&self.state.service, self.caller.deadline);
            let credential = self.caller.credential.clone();
            let is_idle = self.is_reading && self.running.is_empty();
            // Who leaves a batch idle may be ended for its memory, like those who do not read. Twice the time, since the
            // batch ends by itself before.
            let _wait = is_idle.then(|| self.caller.connection.wait(2 * STANDSTILL).begun());
            tokio::select! {
                Some(Ended { request_id, answer, lease }) = self.running.next(), if !self.running.is_empty() => {
                    self.lease = lease;
                    self.unanswered.remove(&request_id);
                    return Some(answer);
                }
                (message, entry) = next_message(&mut self.inbound, &self.entry), if may_read && self.is_reading => match message {
                    Some(Ok(message)) => {
                        if let Some(refused) = self.take(message, entry) {
                            return Some(refused);
                        }
                    }
                    None => self.is_reading = false,
                    Some(Err(problem)) => self.end_with(problem),
                },
                () = service.closed(), if self.is_reading => {
                    self.end_with(unavailable(&self.state));
                }
                () = credential.revoked(), if self.is_reading => {
                    self.end_with(Problem::new(ErrorCode::Unauthenticated, "the API key is accepted no more"));
                }
                () = sleep(STANDSTILL), if is_idle => {
                    let detail = format!("nothing came for {STANDSTILL:?}");
                    self.end_with(Problem::new(ErrorCode::BodyTimeout, detail));
                }
                () = passed(deadline), if self.is_reading => {
                    self.end_with(ServiceError::DeadlineExceeded.into());
                }
                else => return None,
            }
        }
    }

    /// Why the batch ended before its caller ended it; given once, after the last answer.
    pub(super) fn take_end(&mut self) -> Option<Problem> {
        self.end.take()
    }

    /// Reads to the end without regard to what comes.
    pub(super) async fn discard(&mut self) {
        while self.inbound.next().await.is_some() {}
    }

    fn end_with(&mut self, problem: Problem) {
        self.is_reading = false;
        // One who left reads no answers.
        if problem.code() == ErrorCode::Cancelled {
            self.running.clear();
        }
        self.end = Some(problem);
    }

    /// Starts an item, or answers it at once.
    fn take(&mut self, message: Message<F::Request>, entry: OwnedSemaphorePermit) -> Option<F::Answer> {
        let number = message.number;
        let Item { request_id, timeout_ms, request } = match message.item {
            Ok(item) => item,
            Err(problem) => {
                let subject = Subject::Message { number, request_id: "", is_own: false };
                return Some(refused(&self.state, &self.format, subject, &problem));
            }
        };
        let request = match self.check(&request_id, timeout_ms).and(request) {
            Ok(request) => request,
            Err(problem) => {
                let is_own = self.check(&request_id, None).is_ok();
                let subject = Subject::Message { number, request_id: &request_id, is_own };
                return Some(refused(&self.state, &self.format, subject, &problem));
            }
        };
        self.unanswered.insert(request_id.clone());
        let (state, mut caller, format) = (self.state.clone(), self.caller.clone(), self.format.clone());
        let item_deadline =
            timeout_ms.and_then(|timeout| Instant::now().checked_add(Duration::from_millis(timeout.into())));
        caller.deadline = item_deadline.into_iter().chain(caller.deadline).min();
        let answered = async move {
            let answered = match Entry::of(&caller, entry).await {
                Ok(entry) => format.answer(&state, &request_id, request, (&caller, entry)).await,
                Err(problem) => Err(problem),
            };
            match answered {
                Ok((answer, lease)) => Ended { request_id, answer, lease: Some(lease) },
                Err(problem) => {
                    let answer = refused(&state, &format, Subject::Item(&request_id), &problem);
                    Ended { request_id, answer, lease: None }
                }
            }
        };
        self.running.push(Box::pin(answered.instrument(self.span.clone())));
        None
    }

    fn check(&self, request_id: &str, timeout_ms: Option<u32>) -> Result<(), Problem> {
        let mut checks = Checks::new();
        let length = request_id.len() as f64;
        let (holds, passed) = (REQUEST_ID_RULE.admits(length), REQUEST_ID_RULE.passed_by(length));
        checks.require("request_id", format!("{length} bytes long"), holds, REQUEST_ID_RULE, passed);
        let is_new = !self.unanswered.contains(request_id);
        checks.require("request_id", format!("\"{request_id}\""), is_new, "unique among the unanswered items", None);
        if let Some(timeout) = timeout_ms {
            checks.bounds("timeout_ms", timeout.into(), &TIMEOUT_RULE);
        }
        Ok(checks.finish()?)
    }
}

/// The next message, once the one before has the memory that it needs.
async fn next_message<R>(
    inbound: &mut Inbound<R>,
    entry: &Arc<Semaphore>,
) -> (Option<Result<Message<R>, Problem>>, OwnedSemaphorePermit) {
    // It is never closed.
    let Ok(entry) = Arc::clone(entry).acquire_owned().await else { pending().await };
    (inbound.next().await, entry)
}

async fn passed(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline.into()).await,
        None => pending().await,
    }
}

/// What is sent in place of an answer, counted.
fn refused<F: Format>(state: &ApiState, format: &F, subject: Subject<'_>, problem: &Problem) -> F::Answer {
    state.service.metrics().rejected(problem.code().entry().code);
    format.refusal(subject, problem)
}
