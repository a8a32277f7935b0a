//! The program as its callers meet it: exit codes, messages, and a server that ends on a signal.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Output, Stdio};

fn slipdrive() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_slipdrive"));
    // The tests' own settings, whatever the machine has.
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("SLIPDRIVE_")) {
        command.env_remove(name);
    }
    command
}

fn run_with_input(arguments: &[&str], input: &[u8]) -> Output {
    let mut child = slipdrive()
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A program that has read enough closes its end.
    let _ = child.stdin.take().unwrap().write_all(input);
    child.wait_with_output().unwrap()
}

fn refused(arguments: &[&str], input: &[u8]) -> String {
    let output = run_with_input(arguments, input);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(64), "{message}");
    assert!(output.stdout.is_empty());
    message
}

#[test]
fn bad_values_are_told_with_the_words_of_the_service() {
    let body = br#"{"robot": {"wheel_radius_m": 0}, "solver": {"starts": 65}}"#;
    let message = refused(&["solve", "-"], body);
    assert!(message.contains("#/robot/wheel_radius_m: `robot.wheel_radius_m` is 0, must be > 0 m"), "{message}");
    assert!(message.contains("`solver.starts` is 65, must be at most 64"), "{message}");
}

#[test]
fn malformed_and_large_bodies_are_refused() {
    assert!(refused(&["solve", "-"], b"{").contains("malformed_body"));
    assert!(refused(&["simulate", "-"], b"{}").contains("missing field `torque_schedule`"));
    assert!(refused(&["solve", "-"], " ".repeat(300_000).as_bytes()).contains("body_too_large"));
}

#[test]
fn wrong_usage_is_bad_input_and_help_is_not() {
    assert!(refused(&["solve", "--no-such-flag"], b"").contains("--no-such-flag"));
    let help = run_with_input(&["serve", "--help"], b"");
    assert_eq!(help.status.code(), Some(0));
    let text = String::from_utf8(help.stdout).unwrap();
    for word in
        ["--http", "SLIPDRIVE_HTTP", "--workers", "SLIPDRIVE_WORKERS", "--queue-length", "SLIPDRIVE_QUEUE_LENGTH"]
    {
        assert!(text.contains(word), "{word} is missing in: {text}");
    }
}

/// Starts a server on a free port; gives its address and the rest of its log.
fn serve(variable: (&str, &str)) -> (Child, String, BufReader<std::process::ChildStderr>) {
    let mut child = slipdrive()
        .args(["serve", "--http", "127.0.0.1:0", "--workers", "1"])
        .env(variable.0, variable.1)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut log = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("listening") {
        line.clear();
        assert!(log.read_line(&mut line).unwrap() > 0, "the server says where it listens");
    }
    let (_, rest) = line.split_once("http.address=").unwrap();
    let address = rest.split_whitespace().next().unwrap().to_owned();
    assert!(line.contains(variable.1), "the variable is heard: {line}");
    (child, address, log)
}

#[cfg(unix)]
#[tokio::test]
async fn terminate_signal_ends_a_ready_server_with_success() {
    for signal in ["TERM", "INT"] {
        let (mut child, address, _log) = serve(("SLIPDRIVE_QUEUE_LENGTH", "7"));
        let client = reqwest::Client::builder().no_proxy().build().unwrap();
        let ready = client.get(format!("http://{address}/readyz")).send().await.unwrap();
        assert_eq!(ready.status(), 200);
        // The client keeps its idle connection: it must not hold the server.
        let killed = Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{signal}");
    }
}
