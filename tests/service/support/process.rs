//! The program as a process of its own, on free ports.

use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel, sync_channel};
use std::thread;
use std::time::Instant;

use super::HANG_BOUND;

/// The program without the settings of this machine.
pub(crate) fn slipdrive() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_slipdrive"));
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("SLIPDRIVE_") || name.starts_with("OTEL_")) {
        command.env_remove(name);
    }
    command
}

/// Set where a test has a process of its own.
const ALONE: &str = "SLIPDRIVE_TEST_ALONE";

/// Whether no other test shares this process.
pub(crate) fn is_alone() -> bool {
    std::env::var_os(ALONE).is_some()
}

/// Runs one test of this binary, named with its module, in a process of its own.
pub(crate) fn run_alone(test: &str) {
    let mut command = Command::new(std::env::current_exe().unwrap());
    let output = command.args(["--exact", test, "--nocapture"]).env(ALONE, "1").output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    println!("{said}{}", String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success() && said.contains("1 passed"), "`{test}` fails in a process of its own");
}

/// A server that runs; killed on drop.
pub(crate) struct ServerProcess {
    child: Child,
    log: Receiver<String>,
    pub(crate) http: SocketAddr,
    pub(crate) grpc: SocketAddr,
    pub(crate) admin: SocketAddr,
}

impl ServerProcess {
    /// Starts a server on free ports; returns when it listens.
    pub(crate) fn start(flags: &[&str], variables: &[(&str, &str)]) -> Self {
        let (tell, log) = channel();
        let flags = [&["--admin", "127.0.0.1:0"], flags].concat();
        Self::start_telling(&flags, variables, log, move |line| tell.send(line).is_ok())
    }

    /// As [`ServerProcess::start`], with probes and metrics on the port of REST.
    #[cfg(feature = "tls")]
    pub(crate) fn start_without_admin(flags: &[&str]) -> Self {
        let (tell, log) = channel();
        Self::start_telling(flags, &[], log, move |line| tell.send(line).is_ok())
    }

    /// As [`ServerProcess::start`], but of its log only the lines are read that a test asks for.
    pub(crate) fn start_with_unread_log(flags: &[&str]) -> Self {
        let (tell, log) = sync_channel(0);
        let flags = [&["--admin", "127.0.0.1:0"], flags].concat();
        Self::start_telling(&flags, &[], log, move |line| tell.send(line).is_ok())
    }

    fn start_telling(
        flags: &[&str],
        variables: &[(&str, &str)],
        log: Receiver<String>,
        tell: impl Fn(String) -> bool + Send + 'static,
    ) -> Self {
        let mut child = slipdrive()
            .args(["serve", "--http", "127.0.0.1:0", "--grpc", "127.0.0.1:0"])
            .args(["--workers", "1"])
            .args(flags)
            .envs(variables.iter().copied())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                if !tell(line) {
                    return;
                }
            }
        });
        let line = loop {
            let line = log.recv_timeout(HANG_BOUND).expect("the server says where it listens");
            if line.contains("listening") {
                break line;
            }
        };
        let address = |name: &str| address_in(&line, name);
        Self { http: address("http"), grpc: address("grpc"), admin: address("admin"), child, log }
    }

    /// The next line of the log that holds all these words.
    pub(crate) fn log_line(&self, words: &[&str]) -> String {
        let deadline = Instant::now() + HANG_BOUND;
        loop {
            match self.log.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(line) if words.iter().all(|word| line.contains(word)) => return line,
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => panic!("no line of {words:?} comes"),
            }
        }
    }

    /// All lines of the log that were written so far and not read yet.
    pub(crate) fn lines_so_far(&self) -> Vec<String> {
        self.log.try_iter().collect()
    }

    pub(crate) fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().unwrap().success());
    }

    pub(crate) fn wait(&mut self) -> ExitStatus {
        self.child.wait().unwrap()
    }

    pub(crate) fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.http)
    }

    pub(crate) fn admin_url(&self, path: &str) -> String {
        format!("http://{}{path}", self.admin)
    }
}

/// Both forms of the log: `http.address=127.0.0.1:1` and `"http.address":"127.0.0.1:1"`.
fn address_in(line: &str, name: &str) -> SocketAddr {
    let (_, rest) = line.split_once(&format!("{name}.address")).unwrap_or_else(|| panic!("no {name} in {line}"));
    let digits = rest.trim_start_matches(['"', ':', '=']);
    let end = digits.find(|character: char| !(character.is_ascii_digit() || ".:".contains(character)));
    digits[..end.unwrap_or(digits.len())].parse().unwrap_or_else(|_| panic!("no address of {name} in {line}"))
}

impl Drop for ServerProcess {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Reads one sample of the metrics of a server; 0 where there is none yet.
pub(crate) async fn sample(client: &reqwest::Client, server: &ServerProcess, name_and_labels: &str) -> f64 {
    let text = client.get(server.admin_url("/metrics")).send().await.unwrap().text().await.unwrap();
    sample_in(&text, name_and_labels)
}

/// One sample in the text of `/metrics`; 0 where there is none.
pub(crate) fn sample_in(text: &str, name_and_labels: &str) -> f64 {
    let value = text.lines().find_map(|line| line.strip_prefix(name_and_labels)?.strip_prefix(' '));
    value.map_or(0.0, |value| value.parse().unwrap())
}
