//! A server in a process of its own, and what the system says of it.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::callers::Addresses;

/// A running server; ended with its standard input.
pub struct Server {
    child: Child,
    output: BufReader<ChildStdout>,
    pub addresses: Addresses,
    /// The echo of both doors.
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
        let told: Value = serde_json::from_str(&line).expect("the server tells where it listens");
        let address = |name: &str| told[name].as_str().unwrap().to_owned();
        Self {
            child,
            output,
            addresses: Addresses { rest: address("rest"), grpc: address("grpc") },
            echo: Addresses { rest: address("echo"), grpc: address("echo") },
        }
    }

    /// Resident memory, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let statm = fs::read_to_string(format!("/proc/{}/statm", self.child.id())).unwrap_or_default();
        // Pages of 4 KiB on all machines that this bench knows.
        statm.split(' ').nth(1).and_then(|pages| pages.parse::<u64>().ok()).unwrap_or_default() * 4096
    }

    /// Processor time of all threads whose name begins so.
    pub fn cpu_time(&self, thread: &str) -> Duration {
        let threads = fs::read_dir(format!("/proc/{}/task", self.child.id())).into_iter().flatten().flatten();
        let named = threads
            .filter(|entry| fs::read_to_string(entry.path().join("comm")).is_ok_and(|name| name.starts_with(thread)));
        let nanoseconds = named.filter_map(|entry| {
            let text = fs::read_to_string(entry.path().join("schedstat")).ok()?;
            text.split(' ').next()?.parse::<u64>().ok()
        });
        Duration::from_nanos(nanoseconds.sum())
    }

    /// Ends the server; what it saw itself.
    pub fn end(mut self) -> Value {
        drop(self.child.stdin.take());
        let mut rest = String::new();
        self.output.read_to_string(&mut rest).unwrap();
        self.child.wait().unwrap();
        serde_json::from_str(&rest).expect("the server tells what it saw")
    }
}
