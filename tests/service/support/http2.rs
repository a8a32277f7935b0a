//! HTTP/2 frame by frame, as no regular client speaks it.

use std::net::SocketAddr;

use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::HANG_BOUND;

pub(crate) const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
pub(crate) const DATA: u8 = 0x0;
pub(crate) const HEADERS: u8 = 0x1;
pub(crate) const RST_STREAM: u8 = 0x3;
pub(crate) const GOAWAY: u8 = 0x7;
pub(crate) const WINDOW_UPDATE: u8 = 0x8;
pub(crate) const SETTINGS: u8 = 0x4;
const INITIAL_WINDOW_SIZE: u8 = 0x4;
pub(crate) const END_HEADERS: u8 = 0x4;
pub(crate) const END_STREAM: u8 = 0x1;

/// Whether the path is that of a call of gRPC.
fn is_call(path: &str) -> bool {
    path.starts_with("/slipdrive") || path.starts_with("/grpc")
}

/// A frame as it came.
pub(crate) struct Frame {
    pub(crate) kind: u8,
    pub(crate) flags: u8,
    pub(crate) payload: Vec<u8>,
}

impl Frame {
    /// Whether a head of an answer says 200: the first field is the status, and 200 an entry of the static table.
    pub(crate) fn is_ok(&self) -> bool {
        self.payload.first() == Some(&0x88)
    }
}

/// Reads a frame; none once the server has closed.
pub(crate) async fn next_frame(reader: &mut (impl AsyncRead + Unpin)) -> Option<Frame> {
    let mut head = [0; 9];
    reader.read_exact(&mut head).await.ok()?;
    let length = usize::from(head[0]) << 16 | usize::from(head[1]) << 8 | usize::from(head[2]);
    let mut payload = vec![0; length];
    reader.read_exact(&mut payload).await.ok()?;
    Some(Frame { kind: head[3], flags: head[4], payload })
}

/// The bytes of a frame.
pub(crate) fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap().to_be_bytes();
    let mut bytes = length[1..].to_vec();
    bytes.extend([kind, flags]);
    bytes.extend(stream.to_be_bytes());
    bytes.extend(payload);
    bytes
}

/// The fields of a request of JSON, or of protobuf where the path is that of a call.
pub(crate) fn request_block(path: &str) -> Vec<u8> {
    let content_type = match path {
        _ if is_call(path) => "application/grpc",
        "/batch" => "application/x-ndjson",
        _ => "application/json",
    };
    // POST and http from the static table, then literals with names from there: :path, :authority, content-type.
    let mut block = vec![0x83, 0x86];
    for (name, value) in [(vec![0x04], path), (vec![0x01], "h"), (vec![0x0f, 0x10], content_type)] {
        block.extend(name);
        block.push(u8::try_from(value.len()).unwrap());
        block.extend(value.as_bytes());
    }
    block
}

/// The head of such a request.
pub(crate) fn request_frame(stream: u32, path: &str, flags: u8) -> Vec<u8> {
    frame(HEADERS, END_HEADERS | flags, stream, &request_block(path))
}

/// A connection that says only what it is told to say, and answers nothing by itself.
pub(crate) struct Connection(TcpStream);

impl Connection {
    /// Opens a connection whose streams may send so many bytes before they are read on.
    pub(crate) async fn open(address: SocketAddr, window_bytes: u32) -> Self {
        let mut connection = Self(TcpStream::connect(address).await.unwrap());
        connection.0.write_all(PREFACE).await.unwrap();
        let mut window = vec![0, INITIAL_WINDOW_SIZE];
        window.extend(window_bytes.to_be_bytes());
        connection.send(SETTINGS, 0, 0, &window).await;
        connection
    }

    /// Begins a request of JSON, or of protobuf where the path is that of a call.
    pub(crate) async fn request(&mut self, stream: u32, path: &str, flags: u8) {
        self.write(&request_frame(stream, path, flags)).await;
    }

    /// A whole request to read what is at the path.
    pub(crate) async fn get(&mut self, stream: u32, path: &str) {
        let mut block = request_block(path);
        // GET from the static table.
        block[0] = 0x82;
        self.send(HEADERS, END_HEADERS | END_STREAM, stream, &block).await;
    }

    /// A whole request with the smallest body that its transport understands.
    pub(crate) async fn whole_request(&mut self, stream: u32, path: &str) {
        self.request(stream, path, 0).await;
        let body: &[u8] = if is_call(path) { &[0; 5] } else { b"{}" };
        self.send(DATA, END_STREAM, stream, body).await;
    }

    pub(crate) async fn send(&mut self, kind: u8, flags: u8, stream: u32, payload: &[u8]) {
        self.write(&frame(kind, flags, stream, payload)).await;
    }

    async fn write(&mut self, bytes: &[u8]) {
        // A server that has closed takes nothing; what follows shows it.
        let _ = self.0.write_all(bytes).await;
    }

    /// The next frame; none once the server has closed.
    async fn next(&mut self) -> Option<Frame> {
        timeout(HANG_BOUND, next_frame(&mut self.0)).await.expect("the server speaks or closes")
    }

    /// The head of the next answer; none when its stream or the connection is ended instead.
    pub(crate) async fn answer(&mut self) -> Option<Frame> {
        loop {
            let next = self.next().await?;
            match next.kind {
                HEADERS => return Some(next),
                RST_STREAM | GOAWAY => return None,
                _ => {}
            }
        }
    }

    /// Reads until a frame of this kind comes; whether one came before the server closed.
    pub(crate) async fn reads_up_to(&mut self, kind: u8) -> bool {
        while let Some(next) = self.next().await {
            if next.kind == kind {
                return true;
            }
        }
        false
    }

    /// Reads until the server closes.
    pub(crate) async fn reads_to_the_end(&mut self) {
        while self.next().await.is_some() {}
    }
}
