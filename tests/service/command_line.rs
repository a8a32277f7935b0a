//! The program as its callers meet it: exit codes, messages, and a server that ends on a signal.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Output, Stdio};

use serde_json::{Value, json};

use crate::support::folder::Folder;
use crate::support::process::slipdrive;

pub(crate) fn run_with_input(arguments: &[&str], input: &[u8]) -> Output {
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

pub(crate) fn refused(arguments: &[&str], input: &[u8]) -> String {
    let output = run_with_input(arguments, input);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(64), "{message}");
    assert!(output.stdout.is_empty());
    message
}

#[test]
fn bad_values_are_refused_with_the_words_of_the_service() {
    let body = br#"{"robot": {"wheel_radius_m": 0}, "solver": {"starts": 65}}"#;
    let message = refused(&["solve", "-"], body);
    assert!(
        message.contains("#/robot/wheel_radius_m: `robot.wheel_radius_m` is 0, must be between 0.001 and 10 m"),
        "{message}"
    );
    assert!(message.contains("`solver.starts` is 65, must be at most 64"), "{message}");
}

#[test]
fn saved_plans_are_told_from_requests() {
    let saved = br#"{"solve": {"request": {}, "answer": {}}}"#;
    for kind in ["solve", "simulate"] {
        let message = refused(&[kind, "-"], saved);
        assert!(
            message.contains("unknown field `solve`") && message.contains("`--save` has written this"),
            "{message}"
        );
    }
    assert!(!refused(&["solve", "-"], br#"{"solves": 1}"#).contains("--save"));
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
    assert!(refused(&["solve", "forward-drive", "straight-drive"], b"").contains("straight-drive"));
    let help = run_with_input(&["serve", "--help"], b"");
    assert_eq!(help.status.code(), Some(0));
    let text = String::from_utf8(help.stdout).unwrap();
    for word in
        ["--http", "SLIPDRIVE_HTTP", "--workers", "SLIPDRIVE_WORKERS", "--queue-length", "SLIPDRIVE_QUEUE_LENGTH"]
    {
        assert!(text.contains(word), "{word} is missing in: {text}");
    }
}

#[test]
fn mistyped_names_of_examples_are_told_the_names() {
    let output = run_with_input(&["solve", "forward_drive"], b"");
    assert_eq!(output.status.code(), Some(1));
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.starts_with("error: forward_drive is no example (forward-drive, half-turn"), "{told}");
}

#[test]
fn solved_torques_simulated_again_end_at_the_goal() {
    let solved = run_with_input(&["solve", "--json", "-"], b"");
    assert_eq!(solved.status.code(), Some(0), "{}", String::from_utf8_lossy(&solved.stderr));
    let answer: Value = serde_json::from_slice(&solved.stdout).unwrap();
    let body = json!({"torque_schedule": answer["torque_schedule"], "grid": {"steps": 200}}).to_string();
    let simulated = run_with_input(&["simulate", "-", "--json", "-"], body.as_bytes());
    let motion: Value = serde_json::from_slice(&simulated.stdout).unwrap();
    let end = |field: &str| motion["trajectory"][field].as_array().unwrap().last().unwrap().as_f64().unwrap();
    // The tolerance of the goal, and rounding of interval times count.
    assert!((end("y_m") - 5.0).abs() < 2e-6 && end("x_m").abs() < 2e-6, "{} {}", end("x_m"), end("y_m"));
}

#[test]
fn solve_prints_a_table_and_writes_the_answer_of_the_service() {
    let path = std::env::temp_dir().join(format!("slipdrive-answer-{}.json", std::process::id()));
    let output = run_with_input(&["solve", "forward-drive", "--json", path.to_str().unwrap()], b"");
    let table = String::from_utf8(output.stdout).unwrap();
    for label in ["status", "final time", "goal error", "replay miss", "contact modes", "stick"] {
        assert!(table.contains(label), "{label} is missing in:\n{table}");
    }
    let answer: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    std::fs::remove_file(&path).unwrap();
    assert_eq!(answer["status"], "converged");
    let final_time = format!("{:.6} s", answer["final_time_s"].as_f64().unwrap());
    assert!(table.contains(&final_time), "{final_time} is missing in:\n{table}");
}

#[test]
fn plan_does_not_depend_on_the_number_of_threads() {
    let body = br#"{"maneuver": {"goal": {"x_m": 1, "y_m": 2}}, "grid": {"steps": 60, "control_intervals": 12}}"#;
    let answer = |threads: &str| {
        let output = run_with_input(&["solve", "-", "--json", "-", "--threads", threads], body);
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        let answer = String::from_utf8(output.stdout).unwrap();
        let (head, rest) = answer.split_once("\"solve_time_s\":").unwrap();
        let (_, tail) = rest.split_once(',').unwrap();
        format!("{head}{tail}")
    };
    let one = answer("1");
    assert!(one.contains("\"stop_reason\":\"finished\""), "{one}");
    assert_eq!(one, answer("2"));
    assert_eq!(one, answer("5"));
    assert!(refused(&["solve", "-", "--threads", "0"], body).contains("--threads"));
}

/// Starts a server on a free port; gives its address and the rest of its log.
fn serve(variable: (&str, &str)) -> (Child, String, BufReader<std::process::ChildStderr>) {
    let mut child = slipdrive()
        .args(["serve", "--http", "127.0.0.1:0", "--grpc", "127.0.0.1:0", "--workers", "1"])
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
    if variable.0 == "SLIPDRIVE_QUEUE_LENGTH" {
        assert!(line.contains(variable.1), "the variable is heard: {line}");
    }
    (child, address, log)
}

#[tokio::test]
async fn one_port_speaks_both_protocols() {
    let (mut child, address, _log) = serve(("SLIPDRIVE_ONE_PORT", "true"));
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    assert_eq!(client.get(format!("http://{address}/readyz")).send().await.unwrap().status(), 200);
    let nowhere = client.get(format!("http://{address}/nowhere")).send().await.unwrap();
    assert_eq!(nowhere.status(), 404);
    assert_eq!(nowhere.headers()["content-type"], "application/problem+json", "it passes what every request does");
    let endpoint = tonic::transport::Endpoint::from_shared(format!("http://{address}")).unwrap();
    let mut health = tonic_health::pb::health_client::HealthClient::new(endpoint.connect().await.unwrap());
    assert!(health.check(tonic_health::pb::HealthCheckRequest::default()).await.is_ok());
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn public_server_without_keys_does_not_start() {
    let output = run_with_input(&["serve", "--http", "0.0.0.0:0", "--grpc", "127.0.0.1:0"], b"");
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(64), "{message}");
    assert!(message.contains("SLIPDRIVE_API_KEYS"), "{message}");
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

#[test]
fn figures_of_the_documentation_are_what_the_command_draws() {
    let folder = Folder::new("drawn");
    let output = run_with_input(&["solve", "forward-drive", "--svg", &folder.file("figures")], b"");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let committed = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/figures");
    let mut count = 0;
    for entry in std::fs::read_dir(folder.0.join("figures")).unwrap() {
        let name = entry.unwrap().file_name();
        let drawn = std::fs::read(folder.0.join("figures").join(&name)).unwrap();
        assert!(std::fs::read(committed.join(&name)).unwrap() == drawn, "{}: docs/draw.sh", name.display());
        count += 1;
    }
    assert_eq!(count, std::fs::read_dir(committed).unwrap().count());
    assert_eq!(count, 7);
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = run_with_input(&["solve", "warehouse-aisle", "--svg", &folder.file("aisle")], b"");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let drawn = std::fs::read(folder.0.join("aisle/path.svg")).unwrap();
    assert!(std::fs::read(root.join("docs/aisle.svg")).unwrap() == drawn, "aisle: docs/draw.sh");
}

#[test]
fn saved_plans_are_presented_together_in_a_page_that_needs_nothing() {
    let folder = Folder::new("saved");
    let body = br#"{"maneuver": {"goal": {"y_m": 1}}, "grid": {"steps": 40, "control_intervals": 8}, "solver": {"starts": 1}}"#;
    let solved = run_with_input(
        &["solve", "-", "--save", &folder.file("one.json"), "--json", &folder.file("answer.json")],
        body,
    );
    assert_eq!(solved.status.code(), Some(0), "{}", String::from_utf8_lossy(&solved.stderr));
    let answer: Value = serde_json::from_str(&folder.read("answer.json")).unwrap();
    let torques = json!({"torque_schedule": answer["torque_schedule"], "grid": {"steps": 40}}).to_string();
    let simulated = run_with_input(&["simulate", "-", "--save", &folder.file("two.json")], torques.as_bytes());
    assert_eq!(simulated.status.code(), Some(0), "{}", String::from_utf8_lossy(&simulated.stderr));
    let (one, two, page, csv) =
        (folder.file("one.json"), folder.file("two.json"), folder.file("p.html"), folder.file("p.csv"));
    let presented = run_with_input(&["present", &one, &two, "--report", &page, "--csv", &csv], b"");
    let table = String::from_utf8(presented.stdout).unwrap();
    assert_eq!(presented.status.code(), Some(0), "{}", String::from_utf8_lossy(&presented.stderr));
    let final_time = format!("{:.3} s", answer["final_time_s"].as_f64().unwrap());
    let is_confirmed = answer["replay_confirmed"].as_bool().unwrap();
    let doubt = if is_confirmed { "" } else { ", which no replay in finer steps confirms" };
    let headline = format!("A  The robot reaches its goal in {final_time}{doubt}.");
    assert!(table.contains(&headline) && table.contains("\nB  Given torques"), "{table}");
    // Both as one file, and that with a further one.
    let both = folder.file("both.json");
    let saved = run_with_input(&["present", &one, &two, "--save", &both], b"");
    assert_eq!(saved.status.code(), Some(0), "{}", String::from_utf8_lossy(&saved.stderr));
    for (files, plans) in [(vec![&*both], "AB"), (vec![&*both, &*one], "ABC")] {
        let again = run_with_input(&[&["present"], &files[..]].concat(), b"");
        assert_eq!(again.status.code(), Some(0), "{}", String::from_utf8_lossy(&again.stderr));
        let again = String::from_utf8(again.stdout).unwrap();
        assert!(
            again.starts_with(&table) && plans.chars().all(|label| again.contains(&format!("{label}  "))),
            "{again}"
        );
    }
    folder.write("both.json", &folder.read("both.json").replacen('{', r#"{"note": "ours", "#, 1));
    assert!(refused(&["present", &both], b"").contains("unknown field `note`, expected `plans` or `report`"));
    let page = folder.read("p.html");
    for text in
        [&final_time, "<svg ", "Why to trust it", "How to repeat A", "--report report.html", "default-src 'none'"]
    {
        assert!(page.contains(text), "{text} is missing");
    }
    for text in ["<script", "<link", "<img", "@import", "url("] {
        assert!(!page.contains(text), "{text} is in the page");
    }
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
    let rows: Vec<_> = folder.read("p.csv").lines().map(|row| row.split(',').count()).collect();
    assert_eq!(rows, vec![2 + 10 + 2 + 15; 1 + 2 * 41]);
}

#[test]
fn plan_of_another_robot_is_not_exported() {
    let folder = Folder::new("cli-another");
    let plan = saved_plan(&folder);
    let mut saved: Value = serde_json::from_str(&folder.read("plan.json")).unwrap();
    saved["solve"]["request"]["robot"]["wheel_radius_m"] = json!(0.08);
    folder.write("plan.json", &saved.to_string());
    let out = folder.file("out");
    let said = refused(&["export", &plan, "--format", "csv", "--rate-hz", "100", "--out", &out], b"");
    assert!(said.contains("away from the goal of the request") && !folder.0.join("out").exists(), "{said}");
}

/// The file of a short plan.
fn saved_plan(folder: &Folder) -> String {
    let body = br#"{"maneuver": {"goal": {"y_m": 1}}, "grid": {"steps": 40, "control_intervals": 8}, "solver": {"starts": 1}}"#;
    let plan = folder.file("plan.json");
    assert_eq!(run_with_input(&["solve", "-", "--save", &plan], body).status.code(), Some(0));
    plan
}

#[test]
fn saved_plan_is_exported_into_a_folder() {
    let folder = Folder::new("exported");
    let plan = saved_plan(&folder);
    let bag = folder.file("bag");
    let of_bag = ["--format", "ros2_mcap", "--rate-hz", "50", "--joint-names", r#"["left", "right"]"#, "--out", &bag];
    let exported = run_with_input(&[&["export", &plan], &of_bag[..]].concat(), b"");
    let table = String::from_utf8(exported.stdout).unwrap();
    assert_eq!(exported.status.code(), Some(0), "{}", String::from_utf8_lossy(&exported.stderr));
    assert!(
        table.contains("plan             converged, replay not confirmed\n") && table.contains("  plan.mcap  "),
        "{table}"
    );
    assert!(folder.read("bag/metadata.yaml").contains("- plan.mcap\n"));
    assert!(std::fs::read(folder.0.join("bag/plan.mcap")).unwrap().starts_with(b"\x89MCAP0\r\n"));
    let listed = run_with_input(&["export", &plan, "--format", "csv", "--rate-hz", "50"], b"");
    assert_eq!(listed.status.code(), Some(0));
    assert!(String::from_utf8(listed.stdout).unwrap().contains("  trajectory.csv  "));
    assert_eq!(listed.stderr, b"nothing was written: `--out DIR` writes these files\n");
    let said = refused(&["export", &plan, "--format", "csv", "--rate-hz", "0", "--frame-id", ""], b"");
    assert!(said.contains("#/rate_hz") && said.contains("#/frame_id"), "{said}");
    assert!(refused(&["export", &plan, "--format", "csv"], b"").contains("missing field `rate_hz`"));
    assert_eq!(run_with_input(&["solve", "forward-drive", "--out", &bag], b"").status.code(), Some(64));
    // Texts that would be JSON too.
    for frame in ["123", "true", "null", "{}"] {
        let flags = ["--format", "ros2_json", "--rate-hz", "1", "--frame-id", frame, "--out", &bag];
        assert_eq!(run_with_input(&[&["export", &plan], &flags[..]].concat(), b"").status.code(), Some(0));
        assert!(folder.read("bag/trajectory.json").contains(&format!("\"frame_id\":\"{frame}\"")), "{frame}");
    }
}

#[test]
fn fields_that_are_given_twice_are_refused_in_files_too() {
    let folder = Folder::new("twice");
    let plan = saved_plan(&folder);
    let saved = folder.read("plan.json");
    let flags = ["--format", "csv", "--rate-hz", "50"];
    let doubled = |field: &str| {
        let (_, rest) = saved.split_once(&format!("\"{field}\":")).unwrap();
        let end = rest.find([',', '}']).unwrap();
        saved.replacen(&format!("\"{field}\":"), &format!("\"{field}\":{},\"{field}\":", &rest[..end]), 1)
    };
    for (command, flags) in [("export", &flags[..]), ("export", &[]), ("assess", &[]), ("present", &[])] {
        folder.write("plan.json", &doubled("y_m"));
        let said = refused(&[&[command, &plan], flags].concat(), b"");
        assert!(said.contains("maneuver.goal.y_m`: duplicate field `y_m`"), "{command}: {said}");
    }
    let simulation = br#"{"solve": {}, "format": "csv", "format": "csv"}"#;
    assert!(refused(&["export", "-", "--rate-hz", "50"], simulation).contains("`format`: duplicate field `format`"));
}

#[test]
fn saved_plan_is_assessed_by_flags() {
    let folder = Folder::new("assessed");
    let plan = saved_plan(&folder);
    let uncertain = r#"[{"parameter": "friction", "low": -0.1, "high": 0.1}]"#;
    let flags = ["--uncertain", uncertain, "--tolerances", r#"{"distance_m": 0.05}"#, "--samples", "100"];
    let assessed = run_with_input(&[&["assess", &plan], &flags[..]].concat(), b"");
    let table = String::from_utf8(assessed.stdout).unwrap();
    assert_eq!(assessed.status.code(), Some(0), "{}", String::from_utf8_lossy(&assessed.stderr));
    assert!(table.contains("of 100 samples, 95 % interval") && table.contains("\nworst sample\n"), "{table}");
    let end_of = |words: &str| table.lines().find_map(|line| Some(line.find(words)? + words.len()));
    let share = table.lines().find(|line| line.starts_with("  friction ")).unwrap();
    assert_eq!(share.len(), end_of("speed m/s").unwrap(), "{table}");
    assert!(refused(&["assess", &plan, "--samples", "1"], b"").contains("missing field"));
}

#[test]
fn page_escapes_what_callers_wrote() {
    let folder = Folder::new("escaped");
    let body = br#"{"maneuver": {"goal": {"y_m": 1}, "torque_limit_left_n_m": 0, "torque_limit_right_n_m": 0}}"#;
    assert_eq!(run_with_input(&["solve", "-", "--save", &folder.file("one.json")], body).status.code(), Some(2));
    let spoiled = folder.read("one.json").replace("no torque drives", "<img src=x onerror=alert(1)>$(reboot) drives");
    std::fs::write(folder.file("two.json"), spoiled).unwrap();
    let presented = run_with_input(&["present", &folder.file("two.json"), "--report", &folder.file("p.html")], b"");
    assert_eq!(presented.status.code(), Some(0), "{}", String::from_utf8_lossy(&presented.stderr));
    let page = folder.read("p.html");
    assert!(page.contains("&lt;img src=x onerror=alert(1)&gt;$(reboot) drives") && !page.contains("<img"), "{page}");
}

#[test]
fn exit_codes_are_those_of_the_help() {
    let help = String::from_utf8(run_with_input(&["--help"], b"").stdout).unwrap();
    for words in ["Exit codes:", "\n  0 ", "\n  1 ", "\n  2 ", "\n  64 "] {
        assert!(help.contains(words), "{help}");
    }
    let impossible = br#"{"maneuver": {"goal": {"y_m": 1}, "torque_limit_left_n_m": 0, "torque_limit_right_n_m": 0}}"#;
    assert_eq!(run_with_input(&["solve", "-"], impossible).status.code(), Some(2));
    assert_eq!(run_with_input(&["solve", "/no/such/file"], b"").status.code(), Some(1));
    assert_eq!(run_with_input(&["present"], b"").status.code(), Some(64));
    assert!(refused(&["present", "-"], br#"{"plans": []}"#).contains("between 1 and 4 items"));
    assert!(refused(&["present", "a", "b", "c", "d", "e"], b"").contains("there are 5 files, must be at most 4"));
    assert!(refused(&["example", "no-such-example"], b"").contains("forward-drive"));
}

#[test]
fn examples_and_completions_are_printed() {
    let example = run_with_input(&["example"], b"").stdout;
    let named = run_with_input(&["example", "forward-drive"], b"").stdout;
    assert_eq!(example, named);
    let body: Value = serde_json::from_slice(&example).unwrap();
    assert_eq!(body["maneuver"]["goal"]["y_m"], 5.0);
    let body: Value = serde_json::from_slice(&run_with_input(&["example", "warehouse-aisle"], b"").stdout).unwrap();
    assert_eq!(body["payload"]["mass_kg"], 100.0);
    for shell in ["bash", "zsh", "fish"] {
        let script = String::from_utf8(run_with_input(&["completions", shell], b"").stdout).unwrap();
        assert!(script.contains("present") && script.contains("report"), "{shell}");
    }
}

#[test]
fn nothing_but_words_goes_to_a_pipe() {
    let output = run_with_input(&["solve", "forward-drive"], b"");
    for stream in [output.stdout, output.stderr] {
        assert!(!stream.contains(&0x1b), "{}", String::from_utf8_lossy(&stream));
    }
}
