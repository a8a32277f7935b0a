//! The body of an answer, in parts small enough to see whether its caller reads.

use std::pin::Pin;
use std::task::{Context, Poll};

use axum::Error;
use axum::body::{Body, Bytes, HttpBody};
use hyper::body::{Frame, SizeHint};

use super::activity::UnderWay;

/// Largest part, bytes. HTTP/2 takes a part as soon as its caller has room for one byte of it: what one stream holds
/// beyond that is one part.
const PART_BYTES: usize = 64 * 1024;

/// Hands the answer over part by part and tells the activity of its connection.
pub(super) struct AnswerBody {
    body: Body,
    /// The rest of a frame that was too large for one part.
    rest: Bytes,
    under_way: UnderWay,
}

impl AnswerBody {
    pub(super) fn new(body: Body, under_way: UnderWay) -> Self {
        // The head is the first part: a caller without room for a byte never asks for the second.
        under_way.handed_over();
        Self { body, rest: Bytes::new(), under_way }
    }

    fn part_of(&mut self, mut data: Bytes) -> Frame<Bytes> {
        self.rest = data.split_off(data.len().min(PART_BYTES));
        self.under_way.handed_over();
        Frame::data(data)
    }
}

impl HttpBody for AnswerBody {
    type Data = Bytes;
    type Error = Error;

    fn poll_frame(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Error>>> {
        self.under_way.asked_for();
        if !self.rest.is_empty() {
            let rest = std::mem::take(&mut self.rest);
            return Poll::Ready(Some(Ok(self.part_of(rest))));
        }
        Pin::new(&mut self.body).poll_frame(context).map_ok(|frame| match frame.into_data() {
            Ok(data) => self.part_of(data),
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
