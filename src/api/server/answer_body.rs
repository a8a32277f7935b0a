//! Splits the body of an answer into parts, so that the server can detect a caller that does not read.
//!
//! Over HTTP/2 hyper takes a part as soon as the stream's window has room for one byte of it, and keeps it in memory
//! until there is room for the rest; only then does it ask for the next part. So parts are small, and the last byte is
//! a part of its own: while it has not been asked for, the caller has not read everything before it.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use axum::Error;
use axum::body::{Body, Bytes, HttpBody};
use axum::http::Method;
use hyper::body::{Frame, SizeHint};

use super::connection::{UnderWay, Wait};
use super::memory::Lease;
use crate::api::open_line::OpenLine;

/// Largest part, bytes: the memory that one stream holds for an answer that is not read.
const PART_BYTES: usize = 64 * 1024;

/// Hands the answer over part by part, and waits for each to be taken.
pub(super) struct AnswerBody {
    body: Body,
    /// The rest of the current frame after the parts handed over so far.
    rest: Bytes,
    /// Length of the part that was handed over last.
    part_bytes: usize,
    wait: Wait,
    lease: Arc<Lease>,
    request: Answered,
    /// Whether there is nothing more to come.
    is_complete: bool,
}

/// The request that is answered: it counts, and holds memory of its own, until its answer is taken or dropped.
pub(super) struct Answered {
    pub(super) method: Method,
    /// Written when the answer is taken, or its caller has left.
    pub(super) line: Option<OpenLine>,
    pub(super) _under_way: UnderWay,
    pub(super) _held: Lease,
}

impl AnswerBody {
    pub(super) fn new(body: Body, mut wait: Wait, lease: Arc<Lease>, request: Answered) -> Self {
        // The head counts as the first part: without room for one byte of the body, the next is never asked for.
        wait.begin();
        let (rest, is_complete) = (Bytes::new(), body.is_end_stream());
        Self { body, rest, part_bytes: 0, wait, lease, request, is_complete }
    }

    fn part_of(&mut self, mut data: Bytes) -> Frame<Bytes> {
        let last_byte = data.len().saturating_sub(1);
        self.rest = data.split_off(last_byte.clamp(data.len().min(1), PART_BYTES));
        self.part_bytes = data.len();
        self.wait.begin();
        Frame::data(data)
    }
}

impl HttpBody for AnswerBody {
    type Data = Bytes;
    type Error = Error;

    fn poll_frame(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Error>>> {
        let taken = std::mem::take(&mut self.part_bytes);
        self.wait.end(taken);
        if !self.rest.is_empty() {
            let rest = std::mem::take(&mut self.rest);
            let part = self.part_of(rest);
            self.is_complete = self.is_end_stream();
            return Poll::Ready(Some(Ok(part)));
        }
        let frame = ready!(Pin::new(&mut self.body).poll_frame(context)).map(|frame| {
            frame.map(|frame| match frame.into_data() {
                Ok(data) => {
                    let held = self.lease.holding(data);
                    self.part_of(held)
                }
                Err(trailers) => {
                    if let (Some(fields), Some(line)) = (trailers.trailers_ref(), &mut self.request.line) {
                        line.read(fields);
                    }
                    trailers
                }
            })
        });
        self.is_complete = frame.is_none() || self.is_end_stream();
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty() && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let (rest, hint) = (self.rest.len() as u64, self.body.size_hint());
        let mut whole = SizeHint::new();
        whole.set_lower(hint.lower() + rest);
        if let Some(upper) = hint.upper() {
            whole.set_upper(upper + rest);
        }
        whole
    }
}

impl Drop for AnswerBody {
    fn drop(&mut self) {
        let line = self.request.line.as_mut();
        if let Some(line) = line.filter(|_| !self.is_complete && self.request.method != Method::HEAD) {
            line.abandon();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use axum::http::HeaderMap;
    use axum::response::Response;
    use futures_util::{StreamExt as _, stream};
    use http_body_util::BodyExt as _;

    use super::super::connection::Standing;
    use super::super::connections::Connections;
    use super::super::memory::Purpose;
    use super::*;
    use crate::api::access::{AccessLine, Endpoint, RequestContext};
    use crate::api::open_line::{hand_over, no_trailers};
    use crate::metrics::{Metrics, QueueLevels};

    /// An answer of some bytes, and what is counted of it.
    fn answer(body: Body, method: Method) -> (AnswerBody, Arc<Metrics>) {
        let (connection, metrics) = (Connections::detached(), Arc::new(Metrics::new()));
        let (context, span) = RequestContext::open("/solve", &HeaderMap::new(), None);
        let endpoint = Endpoint::Http("/solve".into());
        let mut line = AccessLine::open(method.clone(), context, span, endpoint, Arc::clone(&metrics));
        line.status = Some(200);
        let mut response = hand_over(Response::new(body), line, no_trailers);
        let line = OpenLine::of(&mut response);
        let wait = connection.wait(Duration::MAX);
        let empty = || Lease::empty(&connection, Purpose::Requests);
        let under_way = connection.enter(Standing::Caller).unwrap();
        let request = Answered { method, line, _under_way: under_way, _held: empty() };
        (AnswerBody::new(response.into_body(), wait, Arc::new(empty()), request), metrics)
    }

    /// The status that the request was counted with; none where it is not over.
    fn counted(metrics: &Metrics) -> Option<String> {
        let text = String::from_utf8(metrics.render(&QueueLevels::default())).unwrap();
        let line = text.lines().find(|line| line.starts_with("slipdrive_http_request_duration_seconds_count"))?;
        Some(line.split_once("code=\"")?.1[..3].to_owned())
    }

    #[tokio::test]
    async fn parts_are_small_and_the_last_byte_goes_alone() {
        for length in [0, 1, 2, PART_BYTES, PART_BYTES + 1, 3 * PART_BYTES] {
            let bytes: Vec<_> = (0..=u8::MAX).cycle().take(length).collect();
            let (body, metrics) = answer(Body::from(bytes.clone()), Method::GET);
            assert_eq!((body.size_hint().exact(), body.is_end_stream()), (Some(length as u64), length == 0));
            let parts: Vec<_> = Body::new(body).into_data_stream().map(Result::unwrap).collect().await;
            assert_eq!(parts.concat(), bytes);
            assert!(parts.iter().all(|part| (1..=PART_BYTES).contains(&part.len())));
            assert_eq!(parts.last().map(Bytes::len), (length > 0).then_some(1), "{length}");
            assert_eq!(counted(&metrics).as_deref(), Some("200"));
        }
    }

    #[tokio::test]
    async fn request_is_over_when_its_last_byte_is_asked_for_and_cancelled_before() {
        for (parts, code) in [(0, "499"), (2, "499"), (3, "200")] {
            let (mut body, metrics) = answer(Body::from(vec![7; PART_BYTES + 2]), Method::GET);
            for _ in 0..parts {
                body.frame().await.unwrap().unwrap();
                assert_eq!(counted(&metrics), None);
            }
            drop(body);
            assert_eq!(counted(&metrics).as_deref(), Some(code), "{parts}");
        }
        let (body, metrics) = answer(Body::from("nobody asks for it"), Method::HEAD);
        drop(body);
        assert_eq!(counted(&metrics).as_deref(), Some("200"));
        let pieces = stream::iter([Ok::<_, std::io::Error>("one"), Ok("more")]);
        let (mut body, metrics) = answer(Body::from_stream(pieces), Method::GET);
        body.frame().await.unwrap().unwrap();
        drop(body);
        assert_eq!(counted(&metrics).as_deref(), Some("499"), "a stream that goes on");
    }
}
