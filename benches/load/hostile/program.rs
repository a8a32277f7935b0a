//! The program under attack.

use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::net::TcpStream;
use tokio::task::JoinHandle;
use tokio::time::{interval, sleep, timeout};

use super::KEY;
use crate::process::memory_bytes;

const MEMORY_SAMPLES: Duration = Duration::from_millis(100);
const START_BOUND: Duration = Duration::from_secs(30);

/// What becomes of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Log {
    Discarded,
    /// Written to a pipe that is full sooner or later.
    Unread,
}

/// A server that runs; killed on drop.
pub struct Program {
    child: Child,
    pub rest: SocketAddr,
    pub grpc: SocketAddr,
    /// Held open and never read.
    _log: Option<ChildStderr>,
}

impl Program {
    /// Starts a server with one worker and a key; returns when it listens.
    pub async fn start(path: &Path, flags: &[&str], log: Log) -> Self {
        let [rest, grpc] = free_addresses();
        let mut command = Command::new(path);
        for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("SLIPDRIVE_")) {
            command.env_remove(name);
        }
        command.args(["serve", "--http", &rest.to_string(), "--grpc", &grpc.to_string(), "--workers", "1"]).args(flags);
        command.env("SLIPDRIVE_API_KEYS", KEY).env("SLIPDRIVE_LOG", "warn");
        let stderr = match log {
            Log::Discarded => Stdio::null(),
            Log::Unread => Stdio::piped(),
        };
        let mut child = command.stderr(stderr).spawn().expect("the program starts");
        let log = child.stderr.take();
        let program = Self { child, rest, grpc, _log: log };
        for address in [rest, grpc] {
            let listening = async {
                while TcpStream::connect(address).await.is_err() {
                    sleep(Duration::from_millis(10)).await;
                }
            };
            timeout(START_BOUND, listening).await.expect("the program listens");
        }
        program
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    pub fn memory_bytes(&self) -> u64 {
        memory_bytes(self.child.id())
    }

    /// Watches the memory until it is stopped.
    pub fn sample_memory(&self) -> MemorySampler {
        let (peak, process) = (Arc::new(AtomicU64::new(0)), self.child.id());
        let highest = Arc::clone(&peak);
        let task = tokio::spawn(async move {
            let mut ticks = interval(MEMORY_SAMPLES);
            loop {
                ticks.tick().await;
                highest.fetch_max(memory_bytes(process), Ordering::Relaxed);
            }
        });
        MemorySampler { task, peak }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The highest memory so far.
pub struct MemorySampler {
    task: JoinHandle<()>,
    peak: Arc<AtomicU64>,
}

impl MemorySampler {
    /// The highest memory, bytes.
    pub fn stop(self) -> u64 {
        self.task.abort();
        self.peak.load(Ordering::Relaxed)
    }
}

/// Where nobody listens; the log that would name addresses that the program takes by itself is not read.
fn free_addresses() -> [SocketAddr; 2] {
    let listeners = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    listeners.map(|listener| listener.local_addr().unwrap())
}
