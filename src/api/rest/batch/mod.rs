//! `POST /batch`: many jobs of any kind, a line of JSON for each, answered by a line as each ends.

mod kinds;
mod line;
mod lines;

use std::sync::Arc;

use axum::Extension;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use futures_util::future::BoxFuture;
use futures_util::stream::unfold;
use tokio::time::timeout;

pub(super) use self::kinds::Kinds;
use self::kinds::{Asked, Line};
use self::lines::Lines;
use super::events::UNBUFFERED;
use super::extract::admit_lines;
use super::problem_json;
use crate::api::ApiState;
use crate::api::access::RequestContext;
use crate::api::auth::Credential;
use crate::api::batch::{Batch, Format, ItemResult, Subject};
use crate::api::read_ahead::{Pace, ReadAhead};
use crate::api::receive::{DISCARD_TIMEOUT, connection_of};
use crate::api::submit::{Caller, Entry};
use crate::contract::{ErrorCode, Problem, json};

/// A line of JSON after the other.
pub(super) const MEDIA_TYPE: &str = "application/x-ndjson";

/// `POST /batch`. When the caller leaves, the server drops the body of the answer, which stops all jobs.
#[expect(clippy::unused_async, reason = "it is a handler")]
pub(super) async fn run(
    kinds: Arc<Kinds>,
    State(state): State<ApiState>,
    (Extension(context), Extension(credential)): (Extension<RequestContext>, Extension<Credential>),
    request: Request,
) -> Result<Response, Problem> {
    let (head, body) = request.into_parts();
    let deadline = admit_lines(&state, &head.headers, context.arrival)?;
    let connection = connection_of(&head.extensions);
    let limit = kinds.longest_line().bytes;
    // One who sends all before reading anything is read to the end, as other bodies are.
    let pace = Pace { pause_bytes: Some(limit), keeps_room: false, message_timeout: state.settings.body_timeout };
    let read_ahead = ReadAhead::of(body, Lines::up_to(limit), pace, &connection);
    let inbound = lines::messages(read_ahead, kinds);
    let caller = Caller { notes: context.notes.clone(), deadline, connection, credential };
    let format = AsLines(Arc::new(context));
    let answers =
        Answers { batch: Batch::new(state, caller, inbound, format.clone()), format, count: Count::default() };
    let lines = unfold(Stage::Answers(answers), Stage::next);
    let headers = [(header::CONTENT_TYPE, MEDIA_TYPE)];
    Ok((headers, UNBUFFERED, Body::from_stream(lines)).into_response())
}

/// Answers and problems as lines.
#[derive(Clone)]
struct AsLines(Arc<RequestContext>);

impl Format for AsLines {
    type Request = Asked;
    type Answer = Line;

    fn answer<'a>(
        &'a self,
        state: &'a ApiState,
        request_id: &'a str,
        asked: Asked,
        caller: (&'a Caller, Entry<'a>),
    ) -> BoxFuture<'a, ItemResult<Line>> {
        let Asked { kind, body } = asked;
        Box::pin(async move { kind.answer(state, request_id, body, caller).await })
    }

    fn refusal(&self, subject: Subject<'_>, problem: &Problem) -> Line {
        let line = match subject {
            Subject::Item(request_id) => self.problem(None, Some(request_id), problem),
            Subject::Message { number, request_id, is_own } => {
                self.problem(Some(number), is_own.then_some(request_id), problem)
            }
        };
        Line { bytes: line, is_problem: true }
    }
}

impl AsLines {
    /// `{"line": .., "request_id": .., "problem": ..}` with what is known.
    fn problem(&self, number: Option<usize>, item: Option<&str>, problem: &Problem) -> Vec<u8> {
        let mut line = b"{".to_vec();
        if let Some(number) = number {
            line.extend(format!("\"line\":{number},").into_bytes());
        }
        if let Some(item) = item {
            line.extend([b"\"request_id\":", &*json::write(&item), b","].concat());
        }
        line.extend(b"\"problem\":");
        line.extend(problem_json::body(problem, &self.0.path, item.unwrap_or(&self.0.request_id)));
        line.extend(b"}\n");
        line
    }
}

/// The lines of an answer.
struct Answers {
    batch: Batch<AsLines>,
    format: AsLines,
    count: Count,
}

#[derive(Clone, Copy, Default)]
struct Count {
    answered: usize,
    problems: usize,
}

impl Count {
    fn last_line(self) -> Bytes {
        let Self { answered, problems } = self;
        format!("{{\"end\":{{\"answered\":{answered},\"problems\":{problems}}}}}\n").into()
    }
}

/// What is sent next.
enum Stage {
    /// The answers as they come.
    Answers(Answers),
    /// That no more come; with the batch where its caller may still send.
    End(Count, Option<Batch<AsLines>>),
    /// Nothing.
    Over(Option<Batch<AsLines>>),
}

impl Stage {
    async fn next(self) -> Option<(Result<Bytes, Problem>, Self)> {
        match self {
            Self::Answers(mut answers) => {
                let Some(Line { bytes, is_problem }) = answers.batch.next_answer().await else {
                    return Some(answers.ended());
                };
                answers.count.problems += usize::from(is_problem);
                answers.count.answered += usize::from(!is_problem);
                Some((Ok(bytes.into()), Self::Answers(answers)))
            }
            Self::End(count, unread) => Some((Ok(count.last_line()), Self::Over(unread))),
            Self::Over(unread) => {
                if let Some(mut batch) = unread {
                    // A connection that is closed with unread bytes is reset, and the last lines are lost.
                    let _ = timeout(DISCARD_TIMEOUT, batch.discard()).await;
                }
                None
            }
        }
    }
}

impl Answers {
    /// The line after the last answer.
    fn ended(mut self) -> (Result<Bytes, Problem>, Stage) {
        let Some(problem) = self.batch.take_end() else { return (Ok(self.count.last_line()), Stage::Over(None)) };
        if problem.code() == ErrorCode::Cancelled {
            return (Err(problem), Stage::Over(None));
        }
        self.format.0.notes.problem(problem.code());
        self.count.problems += 1;
        (Ok(self.format.problem(None, None, &problem).into()), Stage::End(self.count, Some(self.batch)))
    }
}
