//! Splits the body of an answer into parts, so that the server can detect a caller that does not read.
//!
//! Over HTTP/2 hyper takes a part as soon as the stream's window has room for one byte of it, and keeps it in memory
//! until there is room for the rest; only then does it ask for the next part. So parts are small, and the last byte is
//! a part of its own: while it has not been asked for, the caller has not read everything before it.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use axum::Error;
use axum::body::{Body, Bytes, HttpBody};
use hyper::body::{Frame, SizeHint};

use super::connection::{UnderWay, Wait};
use super::memory::Lease;

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
    /// The request counts, and holds memory of its own, until its answer is taken or dropped.
    _request: (UnderWay, Lease),
}

impl AnswerBody {
    pub(super) fn new(body: Body, mut wait: Wait, lease: Arc<Lease>, request: (UnderWay, Lease)) -> Self {
        // The head counts as the first part: without room for one byte of the body, the next is never asked for.
        wait.begin();
        Self { body, rest: Bytes::new(), part_bytes: 0, wait, lease, _request: request }
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
            return Poll::Ready(Some(Ok(self.part_of(rest))));
        }
        Pin::new(&mut self.body).poll_frame(context).map_ok(|frame| match frame.into_data() {
            Ok(data) => {
                let held = self.lease.holding(data);
                self.part_of(held)
            }
            Err(trailers) => trailers,
        })
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use futures_util::StreamExt as _;

    use super::super::connection::Standing;
    use super::super::connections::Connections;
    use super::super::memory::Purpose;
    use super::*;

    #[tokio::test]
    async fn parts_are_small_and_the_last_byte_goes_alone() {
        let connection = Connections::detached();
        for length in [0, 1, 2, PART_BYTES, PART_BYTES + 1, 3 * PART_BYTES] {
            let bytes: Vec<_> = (0..=u8::MAX).cycle().take(length).collect();
            let (wait, under_way) = (connection.wait(Duration::MAX), connection.enter(Standing::Caller).unwrap());
            let lease = Arc::new(Lease::empty(&connection, Purpose::Requests));
            let held = Lease::empty(&connection, Purpose::Requests);
            let body = AnswerBody::new(Body::from(bytes.clone()), wait, lease, (under_way, held));
            assert_eq!((body.size_hint().exact(), body.is_end_stream()), (Some(length as u64), length == 0));
            let parts: Vec<_> = Body::new(body).into_data_stream().map(Result::unwrap).collect().await;
            assert_eq!(parts.concat(), bytes);
            assert!(parts.iter().all(|part| (1..=PART_BYTES).contains(&part.len())));
            assert_eq!(parts.last().map(Bytes::len), (length > 0).then_some(1), "{length}");
        }
    }
}
