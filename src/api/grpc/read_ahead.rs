//! Reads the messages of a batch as they come, into the byte budget, whether or not they are asked for yet.
//!
//! What HTTP/2 keeps for a stream that is not read holds up the whole connection: h2 ends a connection with some
//! thousand small frames unread, and the calls beside it with it. So nothing is left there. Whole messages are passed on,
//! so that a message of which only the head has come holds no more than its head.

use std::collections::VecDeque;
use std::mem;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};

use axum::Error;
use axum::body::{Body, Bytes, HttpBody};
use futures_util::task::AtomicWaker;
use hyper::body::Frame;
use tokio::task::JoinHandle;

use super::admission::FRAME_HEAD_BYTES;
use super::status;
use crate::api::receive::{memory_full, next_chunk};
use crate::api::server::{Connection, Lease, Purpose};

/// What is passed on at once, bytes, if it is more than one message: it stays in the reader of messages, which is in no
/// share of memory.
const PASSED_BYTES: usize = 16 * 1024;

/// The body of a batch, read ahead.
pub(super) struct ReadAhead {
    shared: Arc<Shared>,
    lease: Arc<Lease>,
    /// Length of the messages that were passed on last.
    passed_bytes: usize,
    reader: JoinHandle<()>,
}

#[derive(Default)]
struct Shared {
    unread: Mutex<Unread>,
    arrived: AtomicWaker,
}

#[derive(Default)]
struct Unread {
    /// Whole messages, some together.
    messages: VecDeque<Vec<u8>>,
    /// The beginning of the next message.
    partial: Vec<u8>,
    end: Option<Result<(), Error>>,
}

impl ReadAhead {
    /// Begins to read; longer messages than `limit` bytes are passed on as far as they have come, to be refused.
    pub(super) fn of(body: Body, limit: usize, connection: &Arc<Connection>, request_id: &str) -> Self {
        let shared = Arc::<Shared>::default();
        let lease = Arc::new(Lease::empty(connection, Purpose::ReadAhead));
        let full = Error::new(status::of_problem(&memory_full(), request_id));
        let reader = tokio::spawn(read(body, limit, Arc::clone(&shared), Arc::clone(&lease), full));
        Self { shared, lease, passed_bytes: 0, reader }
    }
}

impl Drop for ReadAhead {
    fn drop(&mut self) {
        self.reader.abort();
    }
}

impl HttpBody for ReadAhead {
    type Data = Bytes;
    type Error = Error;

    fn poll_frame(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Error>>> {
        let passed = mem::take(&mut self.passed_bytes);
        self.lease.shrink(passed);
        self.shared.arrived.register(context.waker());
        let mut unread = self.shared.unread();
        let Some(messages) = unread.messages.pop_front() else {
            return match unread.end.take() {
                Some(Ok(())) => Poll::Ready(None),
                Some(Err(error)) => Poll::Ready(Some(Err(error))),
                None => Poll::Pending,
            };
        };
        drop(unread);
        self.passed_bytes = messages.len();
        Poll::Ready(Some(Ok(Frame::data(messages.into()))))
    }
}

impl Shared {
    fn unread(&self) -> MutexGuard<'_, Unread> {
        self.unread.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn end(&self, result: Result<(), Error>) {
        let mut unread = self.unread();
        // What is left of a message is for the reader of messages to complain of.
        let partial = mem::take(&mut unread.partial);
        unread.messages.extend(Some(partial).filter(|partial| !partial.is_empty()));
        unread.end = Some(result);
        drop(unread);
        self.arrived.wake();
    }
}

async fn read(mut body: Body, limit: usize, shared: Arc<Shared>, lease: Arc<Lease>, full: Error) {
    while let Some(chunk) = next_chunk(&mut body).await {
        let chunk = match chunk {
            Ok(chunk) => chunk,
            Err(error) => return shared.end(Err(error)),
        };
        if !lease.grow_soon(chunk.len()).await {
            return shared.end(Err(full));
        }
        let may_go_on = shared.unread().take(&chunk, limit);
        if !may_go_on {
            return shared.end(Ok(()));
        }
        shared.arrived.wake();
    }
    shared.end(Ok(()));
}

impl Unread {
    /// Takes the next bytes; false where a message is longer than the limit.
    fn take(&mut self, chunk: &[u8], limit: usize) -> bool {
        self.partial.extend_from_slice(chunk);
        let mut whole = 0;
        while let Some(&[_, first, second, third, fourth]) = self.partial[whole..].first_chunk::<FRAME_HEAD_BYTES>() {
            let length = u32::from_be_bytes([first, second, third, fourth]) as usize;
            if length > limit {
                return false;
            }
            let end = whole + FRAME_HEAD_BYTES + length;
            let Some(message) = self.partial.get(whole..end) else { break };
            match self.messages.back_mut().filter(|last| last.len() + message.len() <= PASSED_BYTES) {
                Some(last) => last.extend_from_slice(message),
                None => self.messages.push_back(message.to_vec()),
            }
            whole = end;
        }
        self.partial.drain(..whole);
        true
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use futures_util::{FutureExt as _, StreamExt as _, stream};
    use http_body_util::BodyExt as _;

    use super::*;
    use crate::api::receive::connection_of;

    fn message(length: usize) -> Vec<u8> {
        let mut message = vec![0];
        message.extend(u32::try_from(length).unwrap().to_be_bytes());
        message.resize(FRAME_HEAD_BYTES + length, 7);
        message
    }

    fn read_ahead(chunks: Vec<Vec<u8>>) -> ReadAhead {
        let chunks = stream::iter(chunks).map(Ok::<_, std::io::Error>).chain(stream::pending());
        ReadAhead::of(Body::from_stream(chunks), 1000, &connection_of(&axum::http::Extensions::new()), "id")
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
        while body.shared.unread().end.is_none() {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
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
