//! The bytes of one connection: a peer that does not read is given up, and one that sends much is read in turns.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Sleep, sleep, sleep_until};

use super::connection::{Connection, Wait};

/// What is read before the handlers of the connection have their turn, bytes: some hundred of the smallest frames of gRPC.
/// Otherwise all that a fast peer has sent lies unread in HTTP/2's buffers, and h2 ends connections with too many small
/// frames unread.
const TURN_BYTES: usize = 8 * 1024;
/// How long that turn is. Yielding to the scheduler is not enough: handlers may wait on another thread of it.
const TURN: Duration = Duration::from_millis(1);

/// A stream that fails when its peer is too slow to take what is sent; also counts the bytes that arrive.
#[derive(Debug)]
pub(super) struct MeteredStream<S> {
    stream: S,
    connection: Arc<Connection>,
    read_in_turn: usize,
    /// Runs while the handlers have their turn.
    turn: Option<Pin<Box<Sleep>>>,
    wait: Wait,
    /// Runs while a write is pending.
    pending: Option<Pin<Box<Sleep>>>,
}

impl<S> MeteredStream<S> {
    pub(super) fn new(stream: S, write_timeout: Duration, connection: Arc<Connection>) -> Self {
        let wait = connection.wait(write_timeout);
        Self { stream, connection, read_in_turn: 0, turn: None, wait, pending: None }
    }

    /// The result of a write, or an error when the peer has kept it pending for too long.
    fn or_timed_out<T>(
        &mut self,
        context: &mut Context<'_>,
        written: Poll<io::Result<T>>,
        bytes: impl FnOnce(&T) -> usize,
    ) -> Poll<io::Result<T>> {
        if let Poll::Ready(result) = &written {
            self.pending = None;
            self.wait.end(result.as_ref().map_or(0, bytes));
            return written;
        }
        if self.pending.is_none() {
            self.wait.begin();
            self.pending = self.wait.until().map(|until| Box::pin(sleep_until(until)));
        }
        match &mut self.pending {
            Some(pending) => ready!(pending.as_mut().poll(context)),
            // Beyond the range of the clock.
            None => return written,
        }
        Poll::Ready(Err(io::Error::new(io::ErrorKind::TimedOut, "the peer does not read")))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for MeteredStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.read_in_turn >= TURN_BYTES {
            ready!(self.turn.get_or_insert_with(|| Box::pin(sleep(TURN))).as_mut().poll(context));
            (self.turn, self.read_in_turn) = (None, 0);
        }
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(context, buffer);
        let bytes = buffer.filled().len() - before;
        self.connection.read(bytes);
        self.read_in_turn = if read.is_pending() { 0 } else { self.read_in_turn + bytes };
        read
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for MeteredStream<S> {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.or_timed_out(context, written, |&bytes| bytes)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, parts);
        self.or_timed_out(context, written, |&bytes| bytes)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let flushed = Pin::new(&mut self.stream).poll_flush(context);
        self.or_timed_out(context, flushed, |()| 0)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let closed = Pin::new(&mut self.stream).poll_shutdown(context);
        self.or_timed_out(context, closed, |()| 0)
    }
}
