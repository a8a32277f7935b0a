//! Connections that say only what they are told to say: HTTP/2 frame by frame, and plain bytes.

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::Mutex;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout, timeout_at};

use super::KEY;

const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
pub const DATA: u8 = 0x0;
pub const HEADERS: u8 = 0x1;
pub const RST_STREAM: u8 = 0x3;
pub const SETTINGS: u8 = 0x4;
pub const PING: u8 = 0x6;
pub const GOAWAY: u8 = 0x7;
pub const WINDOW_UPDATE: u8 = 0x8;
pub const END_STREAM: u8 = 0x1;
const ACK: u8 = 0x1;
const END_HEADERS: u8 = 0x4;
/// Window that a connection begins with, bytes.
pub const FIRST_WINDOW_BYTES: u32 = 65_535;
/// Largest payload that every server takes, bytes.
pub const MAX_FRAME_BYTES: usize = 16_384;

/// A server that takes no bytes for so long is not waited for.
const WRITE_BOUND: Duration = Duration::from_secs(10);
/// More clients than the backlog holds wait for so long.
const CONNECT_BOUND: Duration = Duration::from_secs(5);

/// A frame as it came.
#[derive(Debug)]
pub struct Frame {
    pub kind: u8,
    pub flags: u8,
    pub stream: u32,
    pub payload: Vec<u8>,
}

impl Frame {
    /// Whether a head of an answer says 200: the first field is the status, and 200 an entry of the static table.
    pub fn is_ok(&self) -> bool {
        self.payload.first() == Some(&0x88)
    }

    /// A number of four bytes in the payload.
    pub fn number_at(&self, position: usize) -> u32 {
        let bytes = self.payload.get(position..position + 4).and_then(|bytes| bytes.try_into().ok());
        bytes.map_or(0, u32::from_be_bytes)
    }
}

/// How long a connection lasted.
#[derive(Debug, Clone, Copy)]
pub struct Life {
    pub lasted: Duration,
    /// Whether the server has not closed it.
    pub is_open: bool,
}

/// One connection of an attacker. Of what comes in, settings and pings are answered, and all frames are handed on.
pub struct Peer {
    writer: Arc<Mutex<OwnedWriteHalf>>,
    frames: UnboundedReceiver<Frame>,
    reader: JoinHandle<()>,
    opened: Instant,
    closed: Arc<OnceLock<Instant>>,
}

impl Peer {
    /// Opens HTTP/2 with so much room for each answer, and for all of them together.
    pub async fn open(address: SocketAddr, window_bytes: u32) -> io::Result<Self> {
        let peer = Self::connect(address, Protocol::Http2).await?;
        let mut preface = PREFACE.to_vec();
        // SETTINGS_INITIAL_WINDOW_SIZE.
        let window = [&[0, 4], window_bytes.to_be_bytes().as_slice()].concat();
        preface.extend(frame(SETTINGS, 0, 0, &window));
        // Only the windows of the streams are to count.
        preface.extend(frame(WINDOW_UPDATE, 0, 0, &(i32::MAX.unsigned_abs() - FIRST_WINDOW_BYTES).to_be_bytes()));
        peer.write(&preface).await;
        Ok(peer)
    }

    /// Opens a connection and says nothing.
    pub async fn plain(address: SocketAddr) -> io::Result<Self> {
        Self::connect(address, Protocol::Plain).await
    }

    async fn connect(address: SocketAddr, protocol: Protocol) -> io::Result<Self> {
        let stream = timeout(CONNECT_BOUND, TcpStream::connect(address)).await??;
        stream.set_nodelay(true)?;
        let (reader, writer) = stream.into_split();
        let (writer, closed) = (Arc::new(Mutex::new(writer)), Arc::new(OnceLock::new()));
        let (hand_on, frames) = unbounded_channel();
        let (answers, has_closed) = (Arc::clone(&writer), Arc::clone(&closed));
        let reader = tokio::spawn(async move {
            match protocol {
                Protocol::Http2 => read_frames(reader, &answers, &hand_on).await,
                Protocol::Plain => read_bytes(reader).await,
            }
            has_closed.get_or_init(Instant::now);
        });
        Ok(Self { writer, frames, reader, opened: Instant::now(), closed })
    }

    /// Writes bytes; whether the server took them.
    pub async fn write(&self, bytes: &[u8]) -> bool {
        let writing = async { self.writer.lock().await.write_all(bytes).await };
        timeout(WRITE_BOUND, writing).await.is_ok_and(|written| written.is_ok())
    }

    /// Sends a frame; whether the server took it.
    pub async fn send(&self, kind: u8, flags: u8, stream: u32, payload: &[u8]) -> bool {
        self.write(&frame(kind, flags, stream, payload)).await
    }

    /// Gives the server room for so many bytes more.
    pub async fn give_room(&self, stream: u32, bytes: u32) -> bool {
        self.send(WINDOW_UPDATE, 0, stream, &bytes.to_be_bytes()).await
    }

    /// Sends the head of a request.
    pub async fn head(&self, stream: u32, request: &Head<'_>, flags: u8) -> bool {
        self.write(&request.frame(stream, flags)).await
    }

    /// Sends a whole request with a body that fits the windows of a fresh stream.
    pub async fn request(&self, stream: u32, request: &Head<'_>, body: &[u8]) -> bool {
        let mut bytes = request.frame(stream, 0);
        for chunk in body.chunks(MAX_FRAME_BYTES) {
            bytes.extend(frame(DATA, 0, stream, chunk));
        }
        bytes.extend(frame(DATA, END_STREAM, stream, &[]));
        self.write(&bytes).await
    }

    /// The next frame; none once the server has closed, or at `end`.
    pub async fn next_before(&mut self, end: Instant) -> Option<Frame> {
        timeout_at(end, self.frames.recv()).await.ok().flatten()
    }

    /// Waits until the server closes, or until `end`.
    pub async fn stay(&mut self, end: Instant) {
        let _ = timeout_at(end, async { while self.frames.recv().await.is_some() {} }).await;
    }

    pub fn is_open(&self) -> bool {
        self.closed.get().is_none()
    }

    /// From its begin until the server closed it, or until now.
    pub fn life(&self) -> Life {
        let end = self.closed.get().copied().unwrap_or_else(Instant::now);
        Life { lasted: end.duration_since(self.opened), is_open: self.is_open() }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.reader.abort();
    }
}

#[derive(Clone, Copy)]
enum Protocol {
    Http2,
    Plain,
}

/// The head of a request.
#[derive(Debug, Clone, Copy)]
pub struct Head<'a> {
    path: &'a str,
    has_key: bool,
    /// Of a call of gRPC.
    deadline: Option<Duration>,
}

impl<'a> Head<'a> {
    /// Without a key.
    pub fn of(path: &'a str) -> Self {
        Self { path, has_key: false, deadline: None }
    }

    pub fn with_key(path: &'a str) -> Self {
        Self { has_key: true, ..Self::of(path) }
    }

    pub fn with_deadline(self, deadline: Duration) -> Self {
        Self { deadline: Some(deadline), ..self }
    }

    /// The bytes of its frame.
    pub fn frame(&self, stream: u32, flags: u8) -> Vec<u8> {
        frame(HEADERS, END_HEADERS | flags, stream, &self.block())
    }

    /// Fields of the static table, then literals with names from there.
    fn block(&self) -> Vec<u8> {
        let is_call = self.path.starts_with("/slipdrive") || self.path.starts_with("/grpc");
        let is_post = is_call || !matches!(self.path, "/metrics" | "/livez");
        let mut block = vec![if is_post { 0x83 } else { 0x82 }, 0x86];
        let content_type = if is_call { "application/grpc" } else { "application/json" };
        let authorization = format!("Bearer {KEY}");
        let deadline = self.deadline.map(|deadline| format!("{}m", deadline.as_millis()));
        // :path, :authority, content-type, authorization.
        let mut fields: Vec<(&[u8], &str)> =
            vec![(&[0x04], self.path), (&[0x01], "localhost"), (&[0x0f, 0x10], content_type)];
        if self.has_key {
            fields.push((&[0x0f, 0x08], &authorization));
        }
        if let Some(deadline) = &deadline {
            fields.push((b"\x00\x0cgrpc-timeout", deadline));
        }
        for (name, value) in fields {
            block.extend(name);
            block.push(u8::try_from(value.len()).unwrap());
            block.extend(value.as_bytes());
        }
        block
    }
}

/// The bytes of a frame.
pub fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap().to_be_bytes();
    let mut bytes = length[1..].to_vec();
    bytes.extend([kind, flags]);
    bytes.extend(stream.to_be_bytes());
    bytes.extend(payload);
    bytes
}

/// A message of gRPC, uncompressed.
pub fn message(bytes: &[u8]) -> Vec<u8> {
    let length = u32::try_from(bytes.len()).unwrap().to_be_bytes();
    [&[0], length.as_slice(), bytes].concat()
}

/// Streams of a client in the order in which they are opened.
pub fn streams(count: u32) -> impl Iterator<Item = u32> {
    (0..count).map(|index| 2 * index + 1)
}

async fn read_frames(mut reader: OwnedReadHalf, answers: &Mutex<OwnedWriteHalf>, hand_on: &UnboundedSender<Frame>) {
    loop {
        let mut head = [0; 9];
        if reader.read_exact(&mut head).await.is_err() {
            return;
        }
        let length = usize::from(head[0]) << 16 | usize::from(head[1]) << 8 | usize::from(head[2]);
        let mut payload = vec![0; length];
        if reader.read_exact(&mut payload).await.is_err() {
            return;
        }
        let (kind, flags) = (head[3], head[4]);
        let stream = u32::from_be_bytes([head[5], head[6], head[7], head[8]]);
        let answer: Option<&[u8]> = match kind {
            SETTINGS if flags & ACK == 0 => Some(&[]),
            PING if flags & ACK == 0 => Some(&payload),
            _ => None,
        };
        // A server that is busy closing takes no answers; reading on shows when it has closed.
        if let Some(answer) = answer {
            let _ = answers.lock().await.write_all(&frame(kind, ACK, 0, answer)).await;
        }
        if hand_on.send(Frame { kind, flags, stream, payload }).is_err() {
            return;
        }
    }
}

async fn read_bytes(mut reader: OwnedReadHalf) {
    let mut bytes = [0; 4096];
    while reader.read(&mut bytes).await.is_ok_and(|count| count > 0) {}
}
