//! A server in a process of its own, so that its memory and processor time can be measured apart from the generator's.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::callers::Addresses;

/// The name of worker threads, as far as the system keeps it.
pub const WORKER: &str = "slipdrive-worke";

/// A running server; it ends when its standard input is closed.
pub struct Server {
    child: Child,
    output: BufReader<ChildStdout>,
    pub addresses: Addresses,
    /// The echo of both transports.
    pub echo: Addresses,
}

impl Server {
    pub fn start(solver: &str) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        let mut child =
            command.args(["serve", "--solver", solver]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        output.read_line(&mut line).unwrap();
        let report: Value = serde_json::from_str(&line).expect("the server reports its addresses");
        let address = |name: &str| report[name].as_str().unwrap().to_owned();
        Self {
            child,
            output,
            addresses: Addresses { rest: address("rest"), grpc: address("grpc") },
            echo: Addresses { rest: address("echo"), grpc: address("echo") },
        }
    }

    /// Resident memory, bytes.
    pub fn memory_bytes(&self) -> u64 {
        memory_bytes(self.child.id())
    }

    /// Processor time of all threads whose name begins so.
    pub fn cpu_time(&self, thread: &str) -> Duration {
        cpu_time(self.child.id(), thread)
    }

    /// Ends the server and returns its own counts.
    pub fn end(mut self) -> Value {
        drop(self.child.stdin.take());
        let mut rest = String::new();
        self.output.read_to_string(&mut rest).unwrap();
        self.child.wait().unwrap();
        serde_json::from_str(&rest).expect("the server reports its counts")
    }
}

/// Resident memory of a process, bytes; zero once it has ended.
pub fn memory_bytes(process: u32) -> u64 {
    let statm = fs::read_to_string(format!("/proc/{process}/statm")).unwrap_or_default();
    // Pages of 4 KiB on all machines that this bench knows.
    statm.split(' ').nth(1).and_then(|pages| pages.parse::<u64>().ok()).unwrap_or_default() * 4096
}

/// Files that a process has open, connections among them; zero once it has ended.
pub fn open_files(process: u32) -> usize {
    fs::read_dir(format!("/proc/{process}/fd")).into_iter().flatten().count()
}

/// Threads of a process; zero once it has ended.
pub fn threads(process: u32) -> usize {
    fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().count()
}

/// Processor time of all threads of a process whose name begins so.
pub fn cpu_time(process: u32, thread: &str) -> Duration {
    let threads = fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let named = threads
        .filter(|entry| fs::read_to_string(entry.path().join("comm")).is_ok_and(|name| name.starts_with(thread)));
    let nanoseconds = named.filter_map(|entry| {
        let text = fs::read_to_string(entry.path().join("schedstat")).ok()?;
        text.split(' ').next()?.parse::<u64>().ok()
    });
    Duration::from_nanos(nanoseconds.sum())
}
