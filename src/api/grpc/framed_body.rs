//! The body of a batch as its messages come, read ahead.

use std::ops::ControlFlow;
use std::pin::Pin;
use std::task::{Context, Poll};

use axum::Error;
use axum::body::{Bytes, HttpBody};
use futures_util::ready;
use hyper::body::Frame;

use super::status;
use crate::api::read_ahead::{Fault, Framing, ReadAhead};
use crate::contract::{ErrorCode, Problem};

/// Whole messages with their heads.
pub(super) struct FramedBody {
    pub(super) messages: ReadAhead,
    pub(super) request_id: String,
}

impl HttpBody for FramedBody {
    type Data = Bytes;
    type Error = Error;

    fn poll_frame(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Error>>> {
        let passed = ready!(self.messages.poll_next(context));
        Poll::Ready(passed.map(|passed| match passed {
            Ok(messages) => Ok(Frame::data(messages.into())),
            Err(Fault::Broken(error)) => Err(error),
            Err(Fault::Ended(problem)) => Err(Error::new(status::of_problem(&problem, &self.request_id))),
        }))
    }
}

/// Compression flag and length before each message.
pub(super) const FRAME_HEAD_BYTES: usize = 5;

/// Messages after heads that say how long they are.
pub(super) struct HeadsAndMessages {
    /// Longest message, bytes; a longer one is passed on as far as it has come, to be refused.
    pub(super) limit: usize,
    /// What is to be read in place of a message, if anything.
    pub(super) instead: fn(&[u8]) -> Option<Vec<u8>>,
}

/// The message of a body that has one; none where its end is missing.
///
/// # Errors
/// `malformed_body` where more follows: the framework would decode that too, and nobody has judged it.
pub(super) fn only_message(body: &[u8]) -> Result<Option<&[u8]>, Problem> {
    let message = first_message(body);
    if message.is_some_and(|message| FRAME_HEAD_BYTES + message.len() < body.len()) {
        return Err(Problem::new(ErrorCode::MalformedBody, "there is more than the one message that the method takes"));
    }
    Ok(message)
}

/// The first message after its head; none where its end is missing.
fn first_message(bytes: &[u8]) -> Option<&[u8]> {
    bytes.get(FRAME_HEAD_BYTES..FRAME_HEAD_BYTES + length_of_first(bytes)?)
}

fn framed(message: &[u8]) -> Vec<u8> {
    let length = u32::try_from(message.len()).unwrap_or(u32::MAX);
    [&[0], &length.to_be_bytes()[..], message].concat()
}

fn length_of_first(bytes: &[u8]) -> Option<usize> {
    let &[_, first, second, third, fourth] = bytes.first_chunk::<FRAME_HEAD_BYTES>()?;
    Some(u32::from_be_bytes([first, second, third, fourth]) as usize)
}

impl Framing for HeadsAndMessages {
    fn cut(&mut self, partial: &mut Vec<u8>, mut pass: impl FnMut(&[u8])) -> ControlFlow<()> {
        let mut whole = 0;
        let flow = loop {
            let rest = &partial[whole..];
            if length_of_first(rest).is_some_and(|length| length > self.limit) {
                break ControlFlow::Break(());
            }
            let Some(message) = first_message(rest) else { break ControlFlow::Continue(()) };
            let end = FRAME_HEAD_BYTES + message.len();
            match (self.instead)(message) {
                Some(other) => pass(&framed(&other)),
                None => pass(&rest[..end]),
            }
            whole += end;
        };
        partial.drain(..whole);
        flow
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use axum::body::Body;
    use futures_util::{FutureExt as _, StreamExt as _, stream};
    use http_body_util::BodyExt as _;

    use super::*;
    use crate::api::read_ahead::Pace;
    use crate::api::receive::connection_of;

    fn message(length: usize) -> Vec<u8> {
        let mut message = vec![0];
        message.extend(u32::try_from(length).unwrap().to_be_bytes());
        message.resize(FRAME_HEAD_BYTES + length, 7);
        message
    }

    fn read_ahead(chunks: Vec<Vec<u8>>) -> FramedBody {
        let chunks = stream::iter(chunks).map(Ok::<_, std::io::Error>).chain(stream::pending());
        let connection = connection_of(&axum::http::Extensions::new());
        let pace = Pace { pause_bytes: None, keeps_room: false, message_timeout: Duration::MAX };
        let messages = ReadAhead::of(
            Body::from_stream(chunks),
            HeadsAndMessages { limit: 1000, instead: |_| None },
            pace,
            &connection,
        );
        FramedBody { messages, request_id: "id".to_owned() }
    }

    #[tokio::test]
    async fn whole_messages_are_passed_on_and_no_more() {
        let sent: Vec<u8> = [message(3), message(0), message(900), message(5)].concat();
        let (most, last_byte) = sent.split_at(sent.len() - 1);
        for chunk_bytes in [1, 7, 5000] {
            let mut body = read_ahead(most.chunks(chunk_bytes).map(<[u8]>::to_vec).collect());
            let mut passed = Vec::new();
            while passed.len() < sent.len() - message(5).len() {
                passed.extend(body.frame().await.unwrap().unwrap().into_data().unwrap());
            }
            assert_eq!(passed, sent[..passed.len()]);
            assert!(body.frame().now_or_never().is_none(), "{last_byte:?} is missing");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn batch_beyond_its_share_ends() {
        // Of 64 MiB a quarter is for reading ahead, and one connection has a quarter of that.
        let share = 4 << 20;
        let mut body = read_ahead(vec![message(1000); share / 1000 + 1]);
        // Nothing is asked for until all is read.
        tokio::time::sleep(Duration::from_secs(1)).await;
        let mut passed = 0;
        let error = loop {
            match body.frame().await.unwrap() {
                Ok(frame) => passed += frame.into_data().unwrap().len(),
                Err(error) => break error,
            }
        };
        assert!((share - 2000..=share).contains(&passed), "{passed}");
        assert_eq!(tonic::Status::from_error(error.into()).code(), tonic::Code::ResourceExhausted);
    }
}
