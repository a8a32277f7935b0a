//! Reads the messages of a batch as they come, into the byte budget, whether or not they are asked for yet.
//!
//! What HTTP/2 keeps for a stream that is not read holds up the whole connection: h2 ends a connection with some
//! thousand small frames unread, and the calls beside it with it. So nothing is left there, unless a transport asks for
//! pauses. Whole messages are passed on, so that a message of which only the head has come holds no more than its head.

use std::collections::VecDeque;
use std::mem;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::Error;
use axum::body::Body;
use futures_util::task::AtomicWaker;
use tokio::sync::Notify;
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout};

use super::receive::{body_timed_out, discard, memory_full, next_chunk};
use super::server::{Connection, Lease, Purpose, STREAM_WINDOW_BYTES};
use crate::contract::Problem;

/// What is passed on at once, bytes, if it is more than one message: it stays in the reader of messages, which is in no
/// share of memory.
const PASSED_BYTES: usize = 16 * 1024;

/// Room for the beginning of a message that stays, bytes.
const LEAST_ROOM_BYTES: usize = 1024;

/// Where messages end.
pub(super) trait Framing: Send + Sync + 'static {
    /// Passes on whole messages from the front of `partial`, and leaves the beginning of the next one; breaks where nothing
    /// can be read any more.
    fn cut(&mut self, partial: &mut Vec<u8>, pass: impl FnMut(&[u8])) -> ControlFlow<()>;
}

/// How a body is read.
#[derive(Clone, Copy)]
pub(super) struct Pace {
    /// Whole messages not yet asked for, bytes, at which nothing more is read until some are; none: never.
    pub(super) pause_bytes: Option<usize>,
    /// Whether who takes the messages keeps room for the longest of them as long as it reads, as tonic does.
    pub(super) keeps_room: bool,
    /// How long the rest of a message may take once it has begun; pauses do not count.
    pub(super) message_timeout: Duration,
}

/// Why there are no more messages.
#[derive(Debug)]
pub(super) enum Fault {
    /// The body ended before it was complete.
    Broken(Error),
    /// The server reads no more of it.
    Ended(Problem),
}

/// The messages of a body, read ahead.
pub(super) struct ReadAhead {
    shared: Arc<Shared>,
    lease: Arc<Lease>,
    /// Length of the messages that were passed on last.
    passed_bytes: usize,
    /// What their reader keeps for the longest so far, where it does.
    room: Option<(Lease, usize)>,
    reader: JoinHandle<()>,
}

#[derive(Default)]
struct Shared {
    unread: Mutex<Unread>,
    arrived: AtomicWaker,
    taken: Notify,
}

#[derive(Default)]
struct Unread {
    /// Whole messages, some together.
    messages: VecDeque<Vec<u8>>,
    /// Length of all of them.
    bytes: usize,
    /// The beginning of the next message.
    partial: Vec<u8>,
    fault: Option<Fault>,
    is_over: bool,
}

impl ReadAhead {
    /// Begins to read.
    pub(super) fn of(body: Body, framing: impl Framing, pace: Pace, connection: &Arc<Connection>) -> Self {
        let shared = Arc::<Shared>::default();
        let lease = Arc::new(Lease::empty(connection, Purpose::ReadAhead));
        let reader = Reader { framing, pace, shared: Arc::clone(&shared), lease: Arc::clone(&lease) };
        let room = pace.keeps_room.then(|| (Lease::empty(connection, Purpose::Requests), 0));
        Self { shared, lease, passed_bytes: 0, room, reader: tokio::spawn(reader.read_all(body)) }
    }

    /// The next messages, one or some together. After a fault the next call waits until the peer has most likely seen
    /// why.
    pub(super) fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<Option<Result<Vec<u8>, Fault>>> {
        let passed = mem::take(&mut self.passed_bytes);
        self.lease.shrink(passed);
        if let Some((room, bytes)) = &mut self.room {
            *bytes = passed.max(*bytes);
            room.settle(*bytes);
        }
        self.shared.arrived.register(context.waker());
        let mut unread = self.shared.unread();
        if let Some(messages) = unread.messages.pop_front() {
            unread.bytes -= messages.len();
            drop(unread);
            self.shared.taken.notify_one();
            self.passed_bytes = messages.len();
            return Poll::Ready(Some(Ok(messages)));
        }
        match unread.fault.take() {
            Some(fault) => Poll::Ready(Some(Err(fault))),
            None if unread.is_over => Poll::Ready(None),
            None => Poll::Pending,
        }
    }
}

impl Drop for ReadAhead {
    fn drop(&mut self) {
        self.reader.abort();
    }
}

impl Shared {
    fn unread(&self) -> MutexGuard<'_, Unread> {
        self.unread.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut Unread)) {
        change(&mut self.unread());
        self.arrived.wake();
    }
}

struct Reader<F> {
    framing: F,
    pace: Pace,
    shared: Arc<Shared>,
    lease: Arc<Lease>,
}

impl<F: Framing> Reader<F> {
    async fn read_all(mut self, mut body: Body) {
        let result = self.read(&mut body).await;
        // What is left of a message is for the reader of messages to complain of.
        self.shared.change(|unread| {
            let partial = mem::take(&mut unread.partial);
            unread.push(&partial);
        });
        if let Err(fault) = result {
            self.shared.change(|unread| unread.fault = Some(fault));
            discard(&mut body).await;
        }
        self.shared.change(|unread| unread.is_over = true);
    }

    async fn read(&mut self, body: &mut Body) -> Result<(), Fault> {
        let mut left = self.pace.message_timeout;
        loop {
            self.pause().await?;
            let (begin, is_begun) = (Instant::now(), !self.shared.unread().partial.is_empty());
            let chunk = if is_begun {
                let in_time = timeout(left, next_chunk(body)).await;
                in_time.map_err(|_| Fault::Ended(body_timed_out(self.pace.message_timeout)))?
            } else {
                next_chunk(body).await
            };
            let Some(chunk) = chunk else { return Ok(()) };
            let chunk = chunk.map_err(Fault::Broken)?;
            if !self.lease.grow_soon(chunk.len()).await {
                return Err(Fault::Ended(memory_full()));
            }
            let taken = self.take(&chunk);
            let starts_anew = taken.has_ended_one || !is_begun;
            left = if starts_anew { self.pace.message_timeout } else { left.saturating_sub(begin.elapsed()) };
            if taken.flow.is_break() {
                return Ok(());
            }
        }
    }

    /// Waits until some of what was read is asked for, where it is much.
    async fn pause(&self) -> Result<(), Fault> {
        let Some(most) = self.pace.pause_bytes else { return Ok(()) };
        let is_full = || self.shared.unread().bytes >= most;
        if !is_full() {
            return Ok(());
        }
        // What the connection keeps of the stream meanwhile.
        if !self.lease.grow_soon(STREAM_WINDOW_BYTES as usize).await {
            return Err(Fault::Ended(memory_full()));
        }
        while is_full() {
            self.shared.taken.notified().await;
        }
        self.lease.shrink(STREAM_WINDOW_BYTES as usize);
        Ok(())
    }

    fn take(&mut self, chunk: &[u8]) -> Taken {
        let mut unread = self.shared.unread();
        let before = unread.bytes + unread.partial.len();
        let mut partial = mem::take(&mut unread.partial);
        partial.extend_from_slice(chunk);
        let mut has_ended_one = false;
        let flow = self.framing.cut(&mut partial, |message| {
            has_ended_one = true;
            unread.push(message);
        });
        // A long message leaves its room behind, which the lease does not count.
        if partial.capacity() > 4 * partial.len().max(LEAST_ROOM_BYTES) {
            partial.shrink_to(partial.len());
        }
        unread.partial = partial;
        let after = unread.bytes + unread.partial.len();
        drop(unread);
        self.lease.shrink((before + chunk.len()).saturating_sub(after));
        self.shared.arrived.wake();
        Taken { flow, has_ended_one }
    }
}

struct Taken {
    flow: ControlFlow<()>,
    has_ended_one: bool,
}

impl Unread {
    fn push(&mut self, message: &[u8]) {
        self.bytes += message.len();
        match self.messages.back_mut().filter(|last| last.len() + message.len() <= PASSED_BYTES) {
            Some(last) => last.extend_from_slice(message),
            None if message.is_empty() => {}
            None => self.messages.push_back(message.to_vec()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;

    use axum::body::Bytes;
    use futures_util::stream::{self, StreamExt as _};

    use super::*;
    use crate::api::receive::connection_of;
    use crate::contract::ErrorCode;

    const TIMEOUT: Duration = Duration::from_secs(10);

    /// Messages of four bytes.
    struct Fours;

    impl Framing for Fours {
        fn cut(&mut self, partial: &mut Vec<u8>, mut pass: impl FnMut(&[u8])) -> ControlFlow<()> {
            let rest = partial.split_off(partial.len() / 4 * 4);
            std::mem::replace(partial, rest).chunks(4).for_each(&mut pass);
            ControlFlow::Continue(())
        }
    }

    /// These bytes, each after so long, and then nothing for ever.
    fn read_ahead(chunks: &[(u64, &'static str)]) -> ReadAhead {
        let later = stream::iter(chunks.to_vec()).then(async |(wait_s, text)| {
            tokio::time::sleep(Duration::from_secs(wait_s)).await;
            Ok::<_, std::io::Error>(Bytes::from_static(text.as_bytes()))
        });
        let pace = Pace { pause_bytes: Some(8), keeps_room: false, message_timeout: TIMEOUT };
        let body = Body::from_stream(later.chain(stream::pending()));
        ReadAhead::of(body, Fours, pace, &connection_of(&axum::http::Extensions::new()))
    }

    async fn next(read_ahead: &mut ReadAhead) -> Result<Vec<u8>, Fault> {
        poll_fn(|context| read_ahead.poll_next(context)).await.unwrap()
    }

    #[tokio::test(start_paused = true)]
    async fn time_of_a_message_rests_while_nothing_is_read() {
        let mut read_ahead = read_ahead(&[(0, "aaaabbbbcc"), (0, "cc")]);
        tokio::time::sleep(100 * TIMEOUT).await;
        assert_eq!(read_ahead.shared.unread().partial, b"cc", "no more is read until some is taken");
        assert_eq!(next(&mut read_ahead).await.unwrap(), b"aaaabbbb");
        assert_eq!(next(&mut read_ahead).await.unwrap(), b"cccc");
    }

    #[tokio::test(start_paused = true)]
    async fn message_has_its_time_from_its_first_byte() {
        let mut slow = read_ahead(&[(100, "aa"), (9, "aa"), (100, "b"), (4, "b"), (4, "b"), (4, "b")]);
        assert_eq!(next(&mut slow).await.unwrap(), b"aaaa");
        let fault = loop {
            match next(&mut slow).await {
                Ok(rest) => assert_eq!(rest, b"bbb"),
                Err(fault) => break fault,
            }
        };
        assert!(matches!(&fault, Fault::Ended(problem) if problem.code() == ErrorCode::BodyTimeout), "{fault:?}");
    }
}
