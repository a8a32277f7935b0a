//! Batches over REST as a client speaks them that sends and reads when it likes.

use std::net::SocketAddr;

use serde_json::Value;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::time::timeout;

use super::{HANG_BOUND, conformance};

/// Opens a batch with these further fields in its head.
pub(crate) async fn batch(address: SocketAddr, fields: &str) -> (Sender, Receiver) {
    let (reader, mut writer) = TcpStream::connect(address).await.unwrap().into_split();
    let head = format!(
        "POST /batch HTTP/1.1\r\nhost: h\r\ncontent-type: application/x-ndjson\r\ntransfer-encoding: chunked\r\n{fields}\r\n"
    );
    writer.write_all(head.as_bytes()).await.unwrap();
    (Sender(writer), Receiver { reader: BufReader::new(reader), text: Vec::new(), head: String::new() })
}

/// Where lines are sent.
pub(crate) struct Sender(OwnedWriteHalf);

impl Sender {
    /// Sends bytes as a chunk; false once the server takes no more.
    pub(crate) async fn send(&mut self, text: &str) -> bool {
        let chunk = format!("{:x}\r\n{text}\r\n", text.len());
        self.0.write_all(chunk.as_bytes()).await.is_ok()
    }

    /// Says that all was sent.
    pub(crate) async fn end(mut self) -> OwnedWriteHalf {
        // A server that has closed takes nothing.
        let _ = self.0.write_all(b"0\r\n\r\n").await;
        self.0
    }
}

/// Where lines come.
pub(crate) struct Receiver {
    reader: BufReader<OwnedReadHalf>,
    /// What came after the last line.
    text: Vec<u8>,
    head: String,
}

impl Receiver {
    /// The head of the answer.
    pub(crate) async fn head(&mut self) -> &str {
        while !self.head.ends_with("\r\n\r\n") {
            let read = timeout(HANG_BOUND, self.reader.read_line(&mut self.head)).await.expect("the server answers");
            assert!(read.unwrap() > 0, "the head is complete: {}", self.head);
        }
        &self.head
    }

    /// The next line, held against the OpenAPI document; none at the end of the answer.
    pub(crate) async fn line(&mut self) -> Option<Value> {
        self.head().await;
        timeout(HANG_BOUND, self.next_line()).await.expect("the server goes on or ends")
    }

    async fn next_line(&mut self) -> Option<Value> {
        loop {
            if let Some(end) = self.text.iter().position(|&byte| byte == b'\n') {
                let line: Vec<_> = self.text.drain(..=end).collect();
                return Some(conformance::document().await.line(&line));
            }
            let mut size = String::new();
            self.reader.read_line(&mut size).await.ok()?;
            let size = usize::from_str_radix(size.trim(), 16).ok()?;
            let mut chunk = vec![0; size + 2];
            self.reader.read_exact(&mut chunk).await.ok()?;
            if size == 0 {
                assert!(self.text.is_empty(), "the last line is complete");
                return None;
            }
            self.text.extend(&chunk[..size]);
        }
    }

    /// All lines that are left.
    pub(crate) async fn rest(&mut self) -> Vec<Value> {
        let mut lines = Vec::new();
        while let Some(line) = self.line().await {
            lines.push(line);
        }
        lines
    }
}
