//! Reads the messages of a batch as they come, into the byte budget, whether or not they are asked for yet.
//!
//! What HTTP/2 keeps for a stream that is not read holds up the whole connection: h2 ends a connection with some
//! thousand small frames unread, and the calls beside it with it. So nothing is left there. Whole messages are passed on,
//! so that a message of which only the head has come holds no more than its head.

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
use crate::api::server::{Connection, Lease};

/// What one batch may have sent ahead of its answers, bytes: tens of thousands of short items, or some of the longest.
pub(super) const SHARE_BYTES: usize = 4 * 1024 * 1024;

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
    bytes: Vec<u8>,
    /// How many of them are whole messages.
    whole: usize,
    end: Option<Result<(), Error>>,
}

impl ReadAhead {
    /// Begins to read; longer messages than `limit` bytes are passed on as far as they have come, to be refused.
    pub(super) fn of(body: Body, limit: usize, connection: &Arc<Connection>, request_id: &str) -> Self {
        let (shared, lease) = (Arc::<Shared>::default(), Arc::new(Lease::empty(connection)));
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
        if unread.whole == 0 {
            return match unread.end.take() {
                Some(Ok(())) => Poll::Ready(None),
                Some(Err(error)) => Poll::Ready(Some(Err(error))),
                None => Poll::Pending,
            };
        }
        let whole = mem::take(&mut unread.whole);
        let rest = unread.bytes.split_off(whole);
        let messages = mem::replace(&mut unread.bytes, rest);
        drop(unread);
        self.passed_bytes = whole;
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
        unread.whole = unread.bytes.len();
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
        let ahead = shared.unread().bytes.len() + chunk.len();
        if ahead > SHARE_BYTES || !lease.grow_soon(chunk.len()).await {
            return shared.end(Err(full));
        }
        let mut unread = shared.unread();
        unread.bytes.extend_from_slice(&chunk);
        if !unread.find_whole(limit) {
            drop(unread);
            return shared.end(Ok(()));
        }
        drop(unread);
        shared.arrived.wake();
    }
    shared.end(Ok(()));
}

impl Unread {
    /// Moves the end of the whole messages on; false where the next one is longer than the limit.
    fn find_whole(&mut self, limit: usize) -> bool {
        while let Some(&[_, first, second, third, fourth]) = self.bytes[self.whole..].first_chunk::<FRAME_HEAD_BYTES>()
        {
            let length = u32::from_be_bytes([first, second, third, fourth]) as usize;
            if length > limit {
                return false;
            }
            let end = self.whole + FRAME_HEAD_BYTES + length;
            if end > self.bytes.len() {
                break;
            }
            self.whole = end;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use futures_util::{StreamExt as _, stream};
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
            assert!(futures_util::poll!(body.frame()).is_pending(), "{last_byte:?} is missing");
        }
    }

    #[tokio::test]
    async fn batch_beyond_its_share_ends() {
        let chunks = vec![message(1000); SHARE_BYTES / 1000 + 1];
        let mut body = read_ahead(chunks);
        // Nothing is asked for until all is read.
        while body.shared.unread().end.is_none() {
            tokio::task::yield_now().await;
        }
        let first = body.frame().await.unwrap().unwrap().into_data().unwrap();
        assert!((SHARE_BYTES - 2000..=SHARE_BYTES).contains(&first.len()));
        let error = body.frame().await.unwrap().unwrap_err();
        assert_eq!(tonic::Status::from_error(error.into()).code(), tonic::Code::ResourceExhausted);
    }
}
