//! The lines of a body, each a message of the batch.

use std::future::poll_fn;
use std::ops::ControlFlow;
use std::sync::Arc;

use futures_util::stream::{StreamExt as _, unfold};

use super::kinds::{Asked, Kinds};
use super::line;
use crate::api::batch::{Inbound, Message};
use crate::api::read_ahead::{Fault, Framing, ReadAhead};
use crate::contract::{BodyLimit, ErrorCode, Problem};

/// Messages that end with a line feed.
pub(super) struct Lines {
    limit: usize,
    /// How much of the next line was looked at.
    searched: usize,
    /// Whether the rest of the line is beyond the limit.
    is_skipping: bool,
}

impl Lines {
    /// Lines of at most so many bytes. Of a longer one the beginning is passed on, one byte more than that, and the rest is
    /// skipped.
    pub(super) fn up_to(limit: usize) -> Self {
        Self { limit, searched: 0, is_skipping: false }
    }
}

impl Framing for Lines {
    fn cut(&mut self, partial: &mut Vec<u8>, mut pass: impl FnMut(&[u8])) -> ControlFlow<()> {
        let mut whole = 0;
        while let Some(length) = partial[whole + self.searched..].iter().position(|&byte| byte == b'\n') {
            let end = whole + self.searched + length;
            match &partial[whole..end] {
                _ if self.is_skipping => self.is_skipping = false,
                line if line.len() > self.limit => pass(&beginning(line, self.limit)),
                _ => pass(&partial[whole..=end]),
            }
            (whole, self.searched) = (end + 1, 0);
        }
        partial.drain(..whole);
        if partial.len() > self.limit && !self.is_skipping {
            pass(&beginning(partial, self.limit));
            self.is_skipping = true;
        }
        if self.is_skipping {
            partial.clear();
        }
        self.searched = partial.len();
        ControlFlow::Continue(())
    }
}

/// Enough of a line to show that it is too long.
fn beginning(line: &[u8], limit: usize) -> Vec<u8> {
    [&line[..=limit], b"\n"].concat()
}

/// The lines as messages, until no more come.
pub(super) fn messages(read_ahead: ReadAhead, kinds: Arc<Kinds>) -> Inbound<Asked> {
    let limit = kinds.longest_line();
    let reader = Reader { read_ahead, kinds, limit, passed: Vec::new(), begin: 0, number: 0 };
    unfold(reader, |mut reader| async move {
        let message = reader.next().await?;
        Some((message, reader))
    })
    .boxed()
}

struct Reader {
    read_ahead: ReadAhead,
    kinds: Arc<Kinds>,
    /// The longest line.
    limit: BodyLimit,
    /// Lines that were passed on together.
    passed: Vec<u8>,
    /// Where the next of them begins.
    begin: usize,
    /// Lines so far.
    number: usize,
}

impl Reader {
    async fn next(&mut self) -> Option<Result<Message<Asked>, Problem>> {
        loop {
            if self.begin >= self.passed.len() {
                self.begin = 0;
                self.passed = Vec::new();
                match poll_fn(|context| self.read_ahead.poll_next(context)).await? {
                    Ok(passed) => self.passed = passed,
                    Err(Fault::Ended(problem)) => return Some(Err(problem)),
                    // Over HTTP/1 nothing else tells that the caller is gone.
                    Err(Fault::Broken(error)) => {
                        let detail = format!("the body ended before it was complete: {error}");
                        return Some(Err(Problem::new(ErrorCode::Cancelled, detail)));
                    }
                }
            }
            let rest = &self.passed[self.begin..];
            let line = rest.split(|&byte| byte == b'\n').next().unwrap_or_default();
            self.begin += line.len() + 1;
            self.number += 1;
            if !line.iter().all(u8::is_ascii_whitespace) {
                let is_whole = line.len() <= self.limit.bytes;
                let item =
                    if is_whole { line::read(line, &self.kinds) } else { Err(Problem::body_too_large(self.limit)) };
                return Some(Ok(Message { number: self.number, item }));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(text: &[u8], chunk_bytes: usize, limit: usize) -> Vec<u8> {
        let (mut lines, mut partial, mut passed) = (Lines::up_to(limit), Vec::new(), Vec::new());
        for chunk in text.chunks(chunk_bytes) {
            partial.extend_from_slice(chunk);
            let flow = lines.cut(&mut partial, |line| {
                assert_eq!(line.iter().position(|&byte| byte == b'\n'), Some(line.len() - 1));
                passed.extend_from_slice(line);
            });
            assert!(flow.is_continue() && partial.len() <= limit);
        }
        [passed, partial].concat()
    }

    #[test]
    fn lines_are_whole_and_long_ones_are_cut_however_they_come() {
        let text = b"one\n\n1234\r\n123456789\n12345\n123456\nlast";
        for chunk_bytes in 1..=text.len() {
            let passed = cut(text, chunk_bytes, 5);
            assert_eq!(passed, b"one\n\n1234\r\n123456\n12345\n123456\nlast", "{chunk_bytes}");
        }
    }
}
