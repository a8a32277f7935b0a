//! Sweeps over NATS, where a server is installed: what is killed, sent twice or cancelled, and what is there in the end.

use std::net::TcpListener;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use async_nats::{Client, ConnectOptions, Subscriber};
use futures_util::StreamExt as _;
use serde_json::{Value, json};
use tokio::time::{sleep, timeout};

use crate::support::folder::Folder;
use crate::support::process::slipdrive;
use crate::support::sweeps::{drives, rests, rows};

/// How long anything may take here.
const PATIENCE: Duration = Duration::from_secs(60);

/// A process that ends with the test.
struct Running(Child);

impl Running {
    fn kill(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }

    /// The exit code, once it ends by itself.
    async fn code(&mut self) -> Option<i32> {
        let patience_ends = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.0.try_wait().unwrap() {
                return status.code();
            }
            assert!(Instant::now() < patience_ends, "it does not end");
            sleep(Duration::from_millis(20)).await;
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A server with a client and a folder for files.
struct Nats {
    folder: Folder,
    url: String,
    client: Client,
    server: Running,
}

impl Nats {
    /// None where no server is installed.
    async fn start(name: &str) -> Option<Self> {
        Self::guarded(name, &[], "", ConnectOptions::new()).await
    }

    /// With these flags of its own, for clients whose URL begins with `user`.
    async fn guarded(name: &str, flags: &[&str], user: &str, options: ConnectOptions) -> Option<Self> {
        let program = ["nats-server", "/usr/sbin/nats-server"].into_iter().find(|program| {
            Command::new(program).arg("--version").stdout(Stdio::null()).status().is_ok_and(|status| status.success())
        });
        let Some(program) = program else {
            println!("SKIPPED: no nats-server is installed (Debian package nats-server)");
            return None;
        };
        let folder = Folder::new(name);
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let (store, port) = (folder.file("store"), port.to_string());
        let server = Command::new(program)
            .args(["-a", "127.0.0.1", "-p", &port, "-js", "-sd", &store])
            .args(flags)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let patience_ends = Instant::now() + PATIENCE;
        let client = loop {
            match options.clone().connect(format!("127.0.0.1:{port}")).await {
                Ok(client) => break client,
                Err(error) => assert!(Instant::now() < patience_ends, "{error}"),
            }
            sleep(Duration::from_millis(20)).await;
        };
        Some(Self { folder, url: format!("nats://{user}127.0.0.1:{port}"), client, server: Running(server) })
    }

    fn file(&self, name: &str, sweep: &Value) -> String {
        self.folder.write(name, &sweep.to_string());
        self.folder.file(name)
    }

    fn sweep(&self, arguments: &[&str]) -> Output {
        slipdrive().arg("sweep").args(arguments).args(["--nats", &self.url]).output().unwrap()
    }

    /// A sweep that must succeed.
    fn swept(&self, arguments: &[&str]) {
        let output = self.sweep(arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }

    fn sweeping(&self, arguments: &[&str]) -> Running {
        let command = &mut slipdrive();
        Running(command.arg("sweep").args(arguments).args(["--nats", &self.url]).stderr(Stdio::null()).spawn().unwrap())
    }

    fn worker(&self, more: &[&str]) -> Running {
        let command = &mut slipdrive();
        command.args(["worker", "--threads", "1", "--lease-s", "1", "--nats", &self.url]).args(more);
        Running(command.stderr(Stdio::null()).spawn().unwrap())
    }

    async fn heard(&self, subject: &str) -> Subscriber {
        let heard = self.client.subscribe(subject.to_owned()).await.unwrap();
        self.client.flush().await.unwrap();
        heard
    }
}

/// The version as subjects have it.
fn version() -> String {
    env!("CARGO_PKG_VERSION").replace('.', "_")
}

/// The first message of which something is said; `what` it is, should none come.
async fn first<T>(what: &str, heard: &mut Subscriber, said: impl Fn(&async_nats::Message) -> Option<T>) -> T {
    let find = async {
        loop {
            if let Some(found) = said(&heard.next().await.unwrap()) {
                return found;
            }
        }
    };
    timeout(PATIENCE, find).await.unwrap_or_else(|_| panic!("{what} is not heard"))
}

#[tokio::test(flavor = "multi_thread")]
async fn killed_worker_and_chunks_that_come_twice_leave_one_result_a_row() {
    let Some(nats) = Nats::start("nats-killed").await else { return };
    let mut rests = rests(500);
    rests["chunk_rows"] = json!(1);
    let warm = drives(20, &json!({"warm_start": true}));
    for (name, sweep) in [("rests", rests), ("drives", drives(20, &json!({}))), ("warm", warm)] {
        let file = nats.file(&format!("{name}.json"), &sweep);
        let (out, local) = (nats.folder.file(name), nats.folder.file(&format!("{name}-local")));
        assert!(slipdrive().args(["sweep", &file, "--out", &local]).output().unwrap().status.success());
        let (mut chunks, mut results) = (nats.heard("slipdrive.chunk.>").await, nats.heard("slipdrive.result.>").await);
        let mut collecting = nats.sweeping(&[&file, "--out", &out]);
        let sent = first("a chunk", &mut chunks, |chunk| Some((chunk.subject.clone(), chunk.payload.clone())));
        let (subject, payload) = sent.await;
        let (mut killed, _other) = (nats.worker(&[]), nats.worker(&[]));
        first("a result", &mut results, |_| Some(())).await;
        killed.kill();
        // Without its id, which the server would know it by.
        for _ in 0..3 {
            nats.client.publish(subject.clone(), payload.clone()).await.unwrap();
        }
        assert_eq!(collecting.code().await, Some(0), "{name}");
        assert_eq!(rows(&[&out]), rows(&[&local]), "{name}");
        let again = nats.sweep(&[&file]);
        let said = String::from_utf8(again.stderr).unwrap();
        let chunk_count = sweep["axes"][0]["count"].as_u64().unwrap() / sweep["chunk_rows"].as_u64().unwrap();
        assert!(said.contains(&format!("0 of {chunk_count} chunks published, {chunk_count} have results")), "{said}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn lost_row_of_a_warm_chunk_comes_back_as_it_was() {
    let Some(nats) = Nats::start("nats-lost-row").await else { return };
    let file = nats.file("warm.json", &drives(8, &json!({"warm_start": true})));
    let _worker = nats.worker(&[]);
    let [before, after] = ["before", "after"].map(|name| nats.folder.file(name));
    assert_eq!(nats.sweeping(&[&file, "--out", &before]).code().await, Some(0));
    let expected = rows(&[&before]);
    let is_warm = |row: &u64| expected[row].get("warm_start_from").is_some();
    // Neither the first nor the last of its chunk of four.
    let lost = [1, 2, 5, 6].into_iter().find(is_warm).expect("a warm row");
    let (sweep, _) = expected[&lost]["key"].as_str().unwrap().rsplit_once('-').unwrap();
    let results = async_nats::jetstream::new(nats.client.clone()).get_stream("slipdrive-results").await.unwrap();
    let subject = format!("slipdrive.result.{}.{sweep}.{lost}", version());
    let message = results.get_last_raw_message_by_subject(&subject).await.unwrap();
    assert!(results.delete_message(message.sequence).await.unwrap());
    assert_eq!(nats.sweeping(&[&file, "--out", &after]).code().await, Some(0));
    assert_eq!(rows(&[&after]), expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn rows_that_the_folder_has_are_not_run_again() {
    let Some(nats) = Nats::start("nats-folder").await else { return };
    let file = nats.file("rests.json", &rests(12));
    let out = nats.folder.file("out");
    let local = slipdrive().args(["sweep", &file, "--out", &out]).output().unwrap();
    assert!(local.status.success());
    let complete = nats.sweep(&[&file, "--out", &out]);
    let said = String::from_utf8(complete.stderr).unwrap();
    assert!(complete.status.success() && !said.contains("published"), "{said}");
    let lines = nats.folder.read("out/rows-0000.jsonl");
    let is_of_last = |line: &&str| serde_json::from_str::<Value>(line).unwrap()["row"].as_u64().unwrap() >= 8;
    let rest: String = lines.split_inclusive('\n').filter(|line| !is_of_last(line)).collect();
    nats.folder.write("out/rows-0000.jsonl", &rest);
    let mut results = nats.heard("slipdrive.result.>").await;
    let _worker = nats.worker(&[]);
    nats.swept(&[&file, "--out", &out]);
    assert_eq!(rows(&[&out]).len(), 12);
    for _ in 8..12 {
        let row =
            first("a result", &mut results, |result| result.subject.rsplit('.').next()?.parse::<u64>().ok()).await;
        assert!(row >= 8, "row {row} is run again");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn results_of_other_versions_are_no_results() {
    let Some(nats) = Nats::start("nats-versions").await else { return };
    let file = nats.file("rests.json", &rests(8));
    let counted = slipdrive().args(["sweep", &file, "--count"]).output().unwrap();
    let counted = String::from_utf8(counted.stdout).unwrap();
    let hash = counted.lines().find_map(|line| line.strip_prefix("hash ")).unwrap().trim().to_owned();
    // Makes the streams.
    nats.swept(&[&file, "--cancel"]);
    let stream = async_nats::jetstream::new(nats.client.clone());
    for (of, row) in ["", ".0_0_9"].into_iter().flat_map(|of| (0..8).map(move |row| (of, row))) {
        let subject = format!("slipdrive.result{of}.{hash}.{row}");
        stream.publish(subject, "of another version".into()).await.unwrap().await.unwrap();
    }
    let published = nats.sweep(&[&file]);
    let said = String::from_utf8(published.stderr).unwrap();
    assert!(said.contains("2 of 2 chunks published, 0 have results"), "{said}");
    let _worker = nats.worker(&[]);
    let out = nats.folder.file("out");
    nats.swept(&[&file, "--collect", "--out", &out]);
    assert_eq!(rows(&[&out]).len(), 8);
}

#[tokio::test(flavor = "multi_thread")]
async fn row_that_kills_its_workers_is_named_and_the_others_are_answered() {
    let Some(nats) = Nats::start("nats-poison").await else { return };
    // The middle one runs for many seconds: a busy machine, too, kills its worker before it ends.
    let axes = json!([{"paired": [
        {"field": "maneuver.goal.y_m", "values": [1, 5, 2]},
        {"field": "grid.steps", "values": [40, 5000, 40]},
        {"field": "solver.method", "values": ["sequential_linear", "nelder_mead", "sequential_linear"]},
    ]}]);
    let file = nats.file("poison.json", &drives(3, &json!({"axes": axes})));
    let (mut signs, mut marks) = (nats.heard("$JS.ACK.>").await, nats.heard("slipdrive.mark.>").await);
    let out = nats.folder.file("out");
    let mut collecting = nats.sweeping(&[&file, "--out", &out]);
    for delivery in [1, 2] {
        let mut worker = nats.worker(&[]);
        first(&format!("delivery {delivery}"), &mut signs, |sign| {
            (&*sign.payload == b"+WPI" && delivery_of(&sign.subject) == delivery).then_some(())
        })
        .await;
        worker.kill();
    }
    for beginning in ["1", "2", "3"] {
        let mut worker = nats.worker(&[]);
        first(&format!("beginning {beginning}"), &mut marks, |mark| {
            (mark.subject.ends_with(".1") && *mark.payload == *beginning.as_bytes()).then_some(())
        })
        .await;
        worker.kill();
    }
    let mut dead = nats.heard("slipdrive.dead.row.>").await;
    let _worker = nats.worker(&[]);
    let letter: Value = first("a dead letter", &mut dead, |letter| serde_json::from_slice(&letter.payload).ok()).await;
    assert_eq!((&letter["row"], &letter["request"]["grid"]["steps"]), (&json!(1), &json!(5000)));
    assert_eq!(collecting.code().await, Some(1), "complete, with a failure");
    let rows = rows(&[&out]);
    assert_eq!(rows[&1]["problem"]["code"], "worker_lost");
    assert!(rows.len() == 3 && [0, 2].iter().all(|row| rows[row]["answer"]["status"] == "converged"), "{rows:?}");
}

/// How often a message was delivered, from the subject that its lease is held under.
fn delivery_of(subject: &str) -> u64 {
    let words: Vec<_> = subject.split('.').collect();
    words[if words.len() == 9 { 4 } else { 6 }].parse().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn cancelled_sweep_leaves_the_queue_and_can_be_published_again() {
    let Some(nats) = Nats::start("nats-cancelled").await else { return };
    let file = nats.file("drives.json", &drives(40, &json!({})));
    let out = nats.folder.file("out");
    nats.swept(&[&file]);
    let cancelled = nats.sweep(&[&file, "--cancel"]);
    assert!(String::from_utf8(cancelled.stdout).unwrap().starts_with("10 chunks are taken back"));
    let collected = nats.sweep(&[&file, "--collect", "--out", &out]);
    let said = String::from_utf8(collected.stderr).unwrap();
    assert!(collected.status.code() == Some(75) && said.contains("cancelled"), "{said}");
    let mut worker = nats.worker(&[]);
    nats.swept(&[&file, "--out", &out]);
    assert_eq!(rows(&[&out]).len(), 40);
    Command::new("kill").arg(worker.0.id().to_string()).status().unwrap();
    assert_eq!(worker.code().await, Some(0), "a worker ends in order");
}

#[tokio::test(flavor = "multi_thread")]
async fn worker_says_whether_it_is_connected_and_what_it_did() {
    let Some(nats) = Nats::start("nats-probes").await else { return };
    let admin = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let _worker = nats.worker(&["--admin", &admin]);
    let file = nats.file("drives.json", &drives(8, &json!({})));
    nats.swept(&[&file, "--out", &nats.folder.file("out")]);
    let get = async |path: &str| {
        let answer = reqwest::get(format!("http://{admin}{path}")).await.unwrap();
        (answer.status().as_u16(), answer.text().await.unwrap())
    };
    for line in ["slipdrive_sweep_chunks_total{outcome=\"complete\"} 2", "slipdrive_sweep_chunks_in_flight 0"] {
        let patience_ends = Instant::now() + PATIENCE;
        while !get("/metrics").await.1.lines().any(|found| found == line) {
            assert!(Instant::now() < patience_ends, "{line}");
            sleep(Duration::from_millis(50)).await;
        }
    }
    let text = get("/metrics").await.1;
    for line in ["slipdrive_sweep_rows_total{outcome=\"answered\"} 8", "slipdrive_sweep_connected 1"] {
        assert!(text.lines().any(|found| found == line), "{line} in {text}");
    }
    for family in slipdrive::metrics::catalogue::sweep_workers::ALL {
        assert!(text.contains(&format!("# TYPE {} ", family.name)), "{}", family.name);
    }
    assert_eq!((get("/livez").await.0, get("/readyz").await.0), (200, 200));
    drop(nats.server);
    let patience_ends = Instant::now() + PATIENCE;
    while get("/readyz").await.0 != 503 {
        assert!(Instant::now() < patience_ends, "it is ready without a server");
        sleep(Duration::from_millis(50)).await;
    }
    assert_eq!(get("/livez").await.0, 200);
}

#[test]
fn empty_variables_are_absent_and_others_need_no_url() {
    let folder = Folder::new("nats-variables");
    folder.write("rests.json", &rests(2).to_string());
    let file = folder.file("rests.json");
    let told = |arguments: &[&str], variables: &[(&str, &str)]| {
        let output = slipdrive().args(arguments).envs(variables.iter().copied()).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let empty = ["NATS_URL", "NATS_CREDENTIALS", "NATS_CA", "NATS_CHUNKS_MIB", "NATS_RESULTS_MIB", "NATS_REPLICAS"];
    let empty: Vec<_> = [&empty[..], &["LEASE_S", "THREADS", "ADMIN"]].concat();
    let names: Vec<_> = empty.iter().map(|name| format!("SLIPDRIVE_{name}")).collect();
    let empty: Vec<_> = names.iter().map(|name| (name.as_str(), "")).collect();
    let of_others = [("SLIPDRIVE_NATS_CA", "/x"), ("SLIPDRIVE_NATS_CREDENTIALS", "/x")];
    for (variables, out) in [(&empty[..], "one"), (&of_others[..], "other")] {
        let (code, said) = told(&["sweep", &file, "--out", &folder.file(out)], variables);
        assert_eq!(code, Some(0), "{said}");
    }
    let (code, said) = told(&["worker"], &empty);
    assert!(code == Some(64) && said.contains("there is no URL of NATS"), "{said}");
    for flag in ["--nats-ca", "--nats-credentials"] {
        let (code, said) = told(&["sweep", &file, "--count", flag, "/x"], &empty);
        assert!(code == Some(64) && said.contains(&format!("`{flag}` needs `--nats`")), "{said}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn users_and_tokens_stand_in_the_url() {
    let by_password = ConnectOptions::with_user_and_password("fleet".to_owned(), "p@ss:word".to_owned());
    let by_token = ConnectOptions::with_token("t/ken".to_owned());
    let (flags, token) = (["--user", "fleet", "--pass", "p@ss:word"], ["--auth", "t/ken"]);
    for (name, flags, user, options) in [
        ("nats-user", &flags[..], "fleet:p%40ss%3Aword@", by_password),
        ("nats-token", &token[..], "t%2Fken@", by_token),
    ] {
        let Some(nats) = Nats::guarded(name, flags, user, options).await else { return };
        nats.swept(&[&nats.file("drives.json", &drives(4, &json!({})))]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_used_is_said_without_secrets() {
    let file = ["sweep", "final-time-map", "--nats"];
    let refused = |url: &str| {
        let output = slipdrive().args(file).arg(url).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    for url in [format!("nats://user:secret@127.0.0.1:{port}"), "nats://user:secret@[".to_owned()] {
        let (code, said) = refused(&url);
        assert!(code == Some(1) && said.contains("NATS") && !said.contains("secret"), "{code:?} {said}");
    }
    let worker = slipdrive().arg("worker").output().unwrap();
    assert_eq!(worker.status.code(), Some(64));
}

#[tokio::test(flavor = "multi_thread")]
async fn worker_that_never_reached_a_server_says_that_it_is_not_connected() {
    let free = || TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let (nowhere, admin) = (format!("nats://{}", free()), free().to_string());
    let command = &mut slipdrive();
    command.args(["worker", "--threads", "1", "--nats", &nowhere, "--admin", &admin]).stderr(Stdio::null());
    let _worker = Running(command.spawn().unwrap());
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    let patience_ends = Instant::now() + PATIENCE;
    let text = loop {
        match client.get(format!("http://{admin}/metrics")).send().await {
            Ok(answer) => break answer.text().await.unwrap(),
            Err(error) => assert!(Instant::now() < patience_ends, "{error}"),
        }
        sleep(Duration::from_millis(20)).await;
    };
    assert!(text.lines().any(|line| line == "slipdrive_sweep_connected 0"), "{text}");
}
