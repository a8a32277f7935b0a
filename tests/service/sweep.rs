//! Sweeps as their users meet them: the program, its folder, and what a killed one leaves.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead as _, BufReader, Cursor, Write as _};
use std::path::Path;
use std::process::{Child, Output, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::StreamExt as _;
use serde_json::{Value, json};
use slipdrive::jobs::{Jobs, Limits};
use slipdrive::metrics::Metrics;
use slipdrive::service::Service;
use slipdrive::solver::{RunControl, SolveInput, StopReason};
use slipdrive::sweep::{self, Ended, Results, Shard, Sweep};

use crate::support::folder::Folder;
use crate::support::process::slipdrive;
use crate::support::sweeps::{self, drives, lines, rests};
use crate::support::{FakeSolver, HANG_BOUND, small_solution};

fn written(folder: &Folder, name: &str, file: &Value) -> String {
    folder.write(name, &file.to_string());
    folder.file(name)
}

fn run(arguments: &[&str]) -> Output {
    slipdrive().arg("sweep").args(arguments).output().unwrap()
}

fn done(arguments: &[&str]) -> String {
    let output = run(arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{said}");
    said
}

fn refused(arguments: &[&str]) -> String {
    let output = run(arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(64), "{said}");
    said
}

/// The rows of some folders, all of them answered.
fn rows(folders: &[&str]) -> BTreeMap<u64, Value> {
    let rows = sweeps::rows(folders);
    assert!(rows.values().all(|row| row.get("problem").is_none()), "{rows:?}");
    rows
}

/// Starts a run and gives it when its folder has so many rows.
fn started(file: &str, folder: &str, row_count: usize) -> Child {
    let arguments = ["sweep", file, "--out", folder, "--threads", "1"];
    let child = slipdrive().args(arguments).stderr(Stdio::piped()).spawn().unwrap();
    let patience_ends = Instant::now() + HANG_BOUND;
    while lines(folder).len() < row_count {
        assert!(Instant::now() < patience_ends, "no rows come");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

fn append(path: &Path, text: &str) {
    OpenOptions::new().append(true).open(path).unwrap().write_all(text.as_bytes()).unwrap();
}

#[test]
fn killed_sweeps_and_shards_come_to_the_rows_of_an_undisturbed_one() {
    let folder = Folder::new("sweep-killed");
    let file = written(&folder, "drives.json", &drives(42, &json!({})));
    let [whole, killed] = ["whole", "killed"].map(|name| folder.file(name));
    done(&[&file, "--out", &whole, "--threads", "2"]);
    let expected = rows(&[&whole]);
    assert_eq!(expected.len(), 42);
    assert!(expected.values().all(|row| row["answer"]["status"] == "converged"));
    for row_count in [3, 20] {
        let mut child = started(&file, &killed, row_count);
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert!(lines(&killed).len() < 42, "it was killed before its end");
    append(&folder.0.join("killed/rows-0000.jsonl"), "{\"key\":\"to");
    assert!(done(&[&file, "--out", &killed]).contains("cut a torn end"));
    assert_eq!(rows(&[&killed]), expected);
    let shards = ["0/2", "1/2"].map(|shard| {
        let out = folder.file(&shard.replace('/', "-"));
        done(&[&file, "--out", &out, "--shard", shard, "--threads", "1"]);
        out
    });
    assert_eq!(lines(&shards[1]).len(), 20, "chunks 1, 3, 5, 7 and 9 of eleven");
    assert_eq!(rows(&[&shards[0], &shards[1]]), expected);
    let third = folder.file("third");
    done(&[&file, "--out", &third, "--shard", "3/4"]);
    let some = run(&["--status", "--out", &shards[0], "--out", &third]);
    let said = String::from_utf8(some.stdout).unwrap();
    assert!(said.starts_with("30 of 30 rows, 30 converged\n"), "{said}");
    assert!(said.ends_with("12 rows belong to shards that are not here\n"), "{said}");
    assert_eq!(some.status.code(), Some(75));
    assert_eq!(run(&["--status", "--out", &third]).status.code(), Some(0), "one shard alone is complete");
    let both = run(&["--status", "--out", &shards[0], "--out", &shards[1]]);
    assert!(String::from_utf8(both.stdout).unwrap().starts_with("42 of 42 rows, 42 converged\n"));
    let overlapping = refused(&["--status", "--out", &shards[0], "--out", &shards[1], "--out", &shards[0]]);
    assert!(overlapping.contains("are for the same rows"), "{overlapping}");
}

#[cfg(target_os = "linux")]
#[test]
fn nobody_to_be_told_is_no_reason_to_end() {
    let folder = Folder::new("sweep-untold");
    let file = written(&folder, "drives.json", &drives(2, &json!({"columns": ["status"]})));
    let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
    let status = slipdrive().args(["sweep", &file, "--out", &folder.file("out")]).stderr(full).status().unwrap();
    assert_eq!(status.code(), Some(0));
    assert_eq!(folder.read("out/rows.csv").lines().count(), 3);
}

#[test]
fn warm_chains_do_not_depend_on_threads_or_on_where_they_were_cut() {
    let folder = Folder::new("sweep-warm");
    let file = written(&folder, "warm.json", &drives(18, &json!({"warm_start": true, "chunk_rows": 6})));
    let whole = folder.file("whole");
    done(&[&file, "--out", &whole, "--threads", "2"]);
    let expected = rows(&[&whole]);
    for (number, row) in &expected {
        let (hash, of_key) = row["key"].as_str().unwrap().rsplit_once('-').unwrap();
        assert_eq!(of_key, number.to_string());
        let from = row.get("warm_start_from").and_then(Value::as_str);
        if number.is_multiple_of(6) {
            assert_eq!(from, None, "a chunk begins with a search");
        } else if let Some(from) = from {
            assert_eq!(from, format!("{hash}-{}", number - 1));
        }
    }
    assert!(expected.values().any(|row| row.get("warm_start_from").is_some()));
    // Cut within a chunk, between two chunks, and with rows missing before others that are done.
    let done_rows: [&[u64]; 3] = [&[0, 1, 2], &[0, 1, 2, 3, 4, 5], &[0, 1, 3, 4, 5, 7, 8, 10]];
    for (index, kept) in done_rows.into_iter().enumerate() {
        let part = folder.file(&format!("cut-{index}"));
        fs::create_dir(&part).unwrap();
        fs::copy(folder.0.join("whole/sweep.json"), format!("{part}/sweep.json")).unwrap();
        let is_kept =
            |line: &&String| kept.contains(&serde_json::from_str::<Value>(line).unwrap()["row"].as_u64().unwrap());
        let text: Vec<_> = lines(&whole).iter().filter(is_kept).map(|line| format!("{line}\n")).collect();
        fs::write(format!("{part}/rows-0000.jsonl"), text.concat()).unwrap();
        done(&[&file, "--out", &part, "--threads", "1"]);
        assert_eq!(rows(&[&part]), expected, "{kept:?}");
    }
}

#[test]
fn folders_of_others_are_refused() {
    let folder = Folder::new("sweep-foreign");
    let (one, other) = (written(&folder, "one.json", &rests(3)), written(&folder, "other.json", &rests(4)));
    let out = folder.file("out");
    done(&[&one, "--out", &out]);
    assert!(refused(&[&other, "--out", &out]).contains("has results of another sweep: its hash is "));
    let other_shard = refused(&[&one, "--out", &out, "--shard", "0/2"]);
    assert!(other_shard.contains("its shard is 0/1, this one's is 0/2"), "{other_shard}");
    let header = folder.read("out/sweep.json");
    fs::write(folder.0.join("out/sweep.json"), header.replace("\"solver_version\": \"", "\"solver_version\": \"9"))
        .unwrap();
    assert!(refused(&[&one, "--out", &out]).contains("its solver version is 9"));
    fs::write(folder.0.join("out/sweep.json"), header).unwrap();
    let lock = File::open(folder.0.join("out/lock")).unwrap();
    lock.try_lock().unwrap();
    let in_use = run(&[&one, "--out", &out]);
    assert_eq!(in_use.status.code(), Some(75));
    assert!(String::from_utf8(in_use.stderr).unwrap().contains("is in use"));
    let status = String::from_utf8(run(&["--status", "--out", &out]).stdout).unwrap();
    assert!(status.starts_with("3 of 3 rows, 3 converged\n") && status.contains("by another process"), "{status}");
    drop(lock);
    fs::remove_file(folder.0.join("out/sweep.json")).unwrap();
    let output = run(&[&one, "--out", &out]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().contains("is missing beside rows"));
    assert!(refused(&["--status", "--out", &folder.file("nowhere")]).contains("has no results of a sweep"));
}

#[test]
fn damaged_lines_are_told_and_nothing_is_lost() {
    let folder = Folder::new("sweep-damaged");
    let file = written(&folder, "drives.json", &drives(6, &json!({"columns": ["status"]})));
    let out = folder.file("out");
    done(&[&file, "--out", &out]);
    let (rows, table) = (folder.read("out/rows-0000.jsonl"), folder.read("out/rows.csv"));
    let damaged = |third: &str| {
        let lines = rows.lines().enumerate().map(|(index, line)| if index == 2 { third } else { line });
        lines.collect::<Vec<_>>().join("\n") + "\n"
    };
    let renumbered = rows.lines().nth(2).unwrap().replace("\"row\":", "\"row\":1");
    let header = folder.read("out/sweep.json");
    for third in ["garbage", renumbered.as_str()] {
        fs::write(folder.0.join("out/rows-0000.jsonl"), damaged(third)).unwrap();
        for arguments in [vec!["--status", "--out", &out], vec![&file, "--out", &out]] {
            let output = run(&arguments);
            let said = String::from_utf8(output.stderr).unwrap();
            assert_eq!((output.status.code(), output.stdout.as_slice()), (Some(1), &b""[..]), "{said}");
            assert!(said.contains("rows-0000.jsonl is damaged: what begins at byte "), "{said}");
        }
        assert_eq!((folder.read("out/rows-0000.jsonl"), folder.read("out/rows.csv")), (damaged(third), table.clone()));
    }
    // Rows of the other shard: the second chunk has two.
    fs::write(folder.0.join("out/rows-0000.jsonl"), rows).unwrap();
    fs::write(folder.0.join("out/sweep.json"), header.replace("\"of\": 1", "\"of\": 2")).unwrap();
    let output = run(&["--status", "--out", &out]);
    assert!(String::from_utf8(output.stderr).unwrap().contains("is no row of this sweep and shard"));
}

#[test]
fn faults_of_rows_are_told_before_anything_runs() {
    let folder = Folder::new("sweep-faults");
    let axes = json!([{"field": "robot.wheel_radius_m", "values": [0.06, 0, -1]}]);
    let file = written(&folder, "faults.json", &drives(1, &json!({"axes": axes})));
    let said = refused(&[&file, "--out", &folder.file("out")]);
    assert!(said.contains("row 1: ") && said.contains("row 2: ") && !said.contains("row 0: "), "{said}");
    assert!(said.contains("`robot.wheel_radius_m` is -1, must be between") && !said.contains("  #/robot"), "{said}");
    assert!(!folder.0.join("out").exists());
    assert!(refused(&[&file, "--count"]).contains("row 1: "));
    let file = written(&folder, "good.json", &rests(5));
    let counted = String::from_utf8(run(&[&file, "--count"]).stdout).unwrap();
    assert!(counted.starts_with("rows    5\nchunks  2\n"), "{counted}");
    let unfit = refused(&[&file, "--out", &folder.file("out"), "--figure", "seed,goal.z_m,final_time_s"]);
    assert!(unfit.contains("`goal.z_m` does not differ") && !folder.0.join("out").exists(), "{unfit}");
    let lines = "{\"job\": \"solve\", \"request\": {}}\n{\"view\": \"plan\"}\n{\"solver\": {\"seed\": 1}}\n";
    folder.write("lines.jsonl", lines);
    let unfit = refused(&[&folder.file("lines.jsonl"), "--count", "--figure", "seed,view,final_time_s,y_m=1"]);
    assert!(unfit.contains("`y_m` does not differ from row to row; solver.seed, view do"), "{unfit}");
    assert!(refused(&[]).contains("neither a file nor `--out`"));
    assert!(refused(&[&file]).contains("one `--out`"));
}

#[test]
fn maps_with_two_rows_of_one_place_or_none_are_refused_before_anything_runs() {
    let folder = Folder::new("sweep-maps");
    let out = folder.file("out");
    let payloads = json!([{"mass_kg": 1, "height_m": 0.2}, {"mass_kg": 4, "height_m": 0.2}]);
    let axes = json!([
        {"paired": [{"field": "solver.seed", "from": 1, "to": 2, "count": 2}, {"field": "solver.starts", "values": [1, 2]}]},
        {"field": "solver.goal_tolerance", "values": [1e-7, 1e-6]},
        {"field": "payload", "values": payloads},
    ]);
    let file = written(&folder, "axes.json", &drives(1, &json!({"axes": axes})));
    let lines = "{\"job\": \"solve\", \"request\": {}}
{\"solver\": {\"seed\": 1, \"starts\": 1}, \"view\": \"plan\"}
{\"solver\": {\"seed\": 1, \"starts\": 1}, \"view\": \"full\"}\n";
    folder.write("lines.jsonl", lines);
    let lines = folder.file("lines.jsonl");
    let (one, four) = (payloads[0].to_string(), payloads[1].to_string());
    let of = "seed,goal_tolerance,final_time_s";
    for (file, figure, fault) in [
        (
            &file,
            of.to_owned(),
            format!("as `payload` differs too; add payload=VALUE: `payload` is one of {one}, {four}"),
        ),
        (
            &file,
            format!("{of},payload={{\"mass_kg\": 5}}"),
            "no row has `payload` = {\"mass_kg\":5}: `payload` is one of".to_owned(),
        ),
        (
            &file,
            format!("{of},payload={one},starts=2,seed=1"),
            "no row has `solver.starts` = 2 and `solver.seed` = 1".to_owned(),
        ),
        (&file, "seed,payload,final_time_s,goal_tolerance=1e-6".to_owned(), "must be a number".to_owned()),
        (&lines, "seed,starts,final_time_s".to_owned(), "rows 0 and 1 have one place".to_owned()),
        (&lines, "seed,starts,final_time_s,view=fulll".to_owned(), "no row has `view` = \"fulll\"".to_owned()),
        (&lines, "seed,view,final_time_s".to_owned(), "`view` is no number in row 0".to_owned()),
    ] {
        let unfit = refused(&[file, "--out", &out, "--figure", &figure]);
        assert!(unfit.contains(&fault) && !folder.0.join("out").exists(), "{figure}: {unfit}");
    }
    done(&[&lines, "--count", "--figure", "seed,starts,final_time_s,view=plan"]);
    // What answers have is known when they are there; the sweep is complete all the same.
    let said = done(&[&file, "--out", &out, "--figure", &format!("{of}x,payload={one}")]);
    assert!(said.contains("no map: none of the 8 answers has a number at `final_time_sx`"), "{said}");
    assert!(!folder.0.join("out/map.svg").exists());
    done(&[&file, "--out", &out, "--figure", &format!("{of},payload={{\"height_m\": 0.2, \"mass_kg\": 1.0}}")]);
    assert!(folder.read("out/map.svg").contains("8 of 8 rows"));
    let unfit = run(&["--status", "--out", &out, "--figure", of]);
    assert_eq!(unfit.status.code(), Some(64), "the same is refused later");
}

#[test]
fn tables_and_maps_are_made_of_whole_and_of_unfinished_sweeps() {
    let folder = Folder::new("sweep-tables");
    let axes = json!([
        {"field": "robot.wheel_friction_coefficient", "values": [0.3, 0.6]},
        {"field": "maneuver.goal.y_m", "values": [0.5, 1, 1.5]},
    ]);
    let more = json!({"axes": axes, "columns": ["status", "final_time_s", "no.such"], "chunk_rows": 1});
    let (file, out) = (written(&folder, "map.json", &drives(1, &more)), folder.file("out"));
    let of = "goal.y_m,wheel_friction_coefficient,final_time_s";
    let said = done(&[&file, "--out", &out, "--shard", "0/2", "--figure", of]);
    assert!(said.ends_with("empty column: none of the 3 answers has `no.such`\n"), "{said}");
    assert_eq!(said.matches("empty column").count(), 1, "{said}");
    let map = folder.read("out/map.svg");
    for words in ["Final time over goal y and wheel friction coefficient", "goal y (m)", "not run yet", "3 of 3 rows"] {
        assert!(map.contains(words), "{words} is missing in {map}");
    }
    let table = folder.read("out/rows.csv");
    let head = "row,robot.wheel_friction_coefficient,maneuver.goal.y_m,status,final_time_s,no.such,problem\n";
    assert!(table.starts_with(head), "{table}");
    let beginnings = ["0,0.3,0.5,converged,", "2,0.3,1.5,converged,", "4,0.6,1,converged,"];
    for (line, beginning) in table.lines().skip(1).zip(beginnings) {
        assert!(line.starts_with(beginning) && line.ends_with(",,"), "{line}");
    }
    assert_eq!(table.lines().count(), 4);
    let other = folder.file("other");
    done(&[&file, "--out", &other, "--shard", "1/2"]);
    let output = run(&["--out", &other, "--out", &out, "--figure", of]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!folder.read("other/map.svg").contains("not run yet"));
    assert_eq!(folder.read("other/rows.csv").lines().count(), 7);
    let unfit = run(&["--out", &out, "--figure", "goal.x_m,y_m,final_time_s"]);
    assert_eq!(unfit.status.code(), Some(64));
    assert!(String::from_utf8(unfit.stderr).unwrap().contains("`goal.x_m` does not differ"));
}

#[cfg(unix)]
#[test]
fn signals_end_a_sweep_that_can_go_on() {
    let folder = Folder::new("sweep-signal");
    let (file, out) = (written(&folder, "drives.json", &drives(400, &json!({}))), folder.file("out"));
    let child = started(&file, &out, 2);
    assert!(std::process::Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(75), "{said}");
    assert!(said.contains("of 400 rows") && said.contains("the same command goes on from here"), "{said}");
    assert!(rows(&[&out]).len() >= 2);
    assert_eq!(run(&["--status", "--out", &out]).status.code(), Some(75));
}

#[cfg(unix)]
#[test]
fn signals_end_the_writing_of_a_table_too() {
    let folder = Folder::new("sweep-table-signal");
    let file = written(&folder, "drives.json", &drives(2, &json!({"columns": ["status"]})));
    let out = folder.file("out");
    fs::create_dir(&out).unwrap();
    // As if somebody else was writing it.
    let other = File::create(folder.path("out/table.lock")).unwrap();
    other.lock().unwrap();
    let mut child = slipdrive().args(["sweep", &file, "--out", &out]).stderr(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(said.next().unwrap().unwrap().ends_with("2 of 2 rows, 2 converged"));
    assert!(std::process::Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(said.next().unwrap().unwrap(), "stopped; the same command goes on from here");
    assert_eq!(child.wait().unwrap().code(), Some(75));
    assert!(!folder.path("out/rows.csv").exists());
    drop(other);
    done(&[&file, "--out", &out]);
    assert_eq!(folder.read("out/rows.csv").lines().count(), 3);
}

#[cfg(target_os = "linux")]
#[test]
fn no_room_at_the_start_is_no_reason_to_give_a_shard_up() {
    let folder = Folder::new("sweep-no-room");
    let (file, out) = (written(&folder, "rests.json", &rests(2)), folder.file("out"));
    // No file may grow, which is what a quota does: `sweep.json` cannot be written.
    let command = "ulimit -f 0; exec \"$0\" sweep \"$1\" --out \"$2\"";
    let program = env!("CARGO_BIN_EXE_slipdrive");
    let output = std::process::Command::new("sh").args(["-c", command, program, &file, &out]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(75), "{said}");
    assert!(
        said.contains("out cannot be written: File too large") && said.contains("the same command goes on"),
        "{said}"
    );
    done(&[&file, "--out", &out]);
}

#[cfg(target_os = "linux")]
#[test]
fn sweeps_come_from_pipes_and_what_cannot_be_read_is_named() {
    let folder = Folder::new("sweep-input");
    let counted = |file: &str, input: Stdio| {
        let output = slipdrive().args(["sweep", file, "--count"]).stdin(input).output().unwrap();
        (output.status.code(), String::from_utf8([output.stdout, output.stderr].concat()).unwrap())
    };
    let lines = "{\"job\": \"solve\", \"request\": {}}\n{\"view\": \"plan\"}\n{}\n";
    for text in [rests(2).to_string().as_str(), lines] {
        for file in ["-", "/dev/stdin"] {
            let (input, mut writer) = std::io::pipe().unwrap();
            writer.write_all(text.as_bytes()).unwrap();
            drop(writer);
            let (code, said) = counted(file, input.into());
            assert!(code == Some(0) && said.starts_with("rows    2\n"), "{file}: {said}");
        }
    }
    let of_folder = counted(&folder.file(""), Stdio::null());
    let expected = format!("error: {} cannot be read: Is a directory (os error 21)\n", folder.file(""));
    assert_eq!(of_folder, (Some(1), expected));
}

#[cfg(target_os = "linux")]
#[test]
fn output_that_cannot_be_written_is_told_and_readers_may_leave() {
    let folder = Folder::new("sweep-output");
    let file = written(&folder, "rests.json", &rests(2));
    let counted = |output: Stdio| slipdrive().args(["sweep", &file, "--count"]).stdout(output).output().unwrap();
    let full = counted(OpenOptions::new().write(true).open("/dev/full").unwrap().into());
    let said = String::from_utf8(full.stderr).unwrap();
    assert!(full.status.code() == Some(1) && said.contains("standard output cannot be written: No space"), "{said}");
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let left = counted(writer.into());
    assert_eq!((left.status.code(), left.stderr.as_slice()), (Some(0), &b""[..]));
}

#[tokio::test]
async fn a_panic_of_a_solve_is_a_failed_row() {
    let folder = Folder::new("sweep-panic");
    let solver = FakeSolver(|input: &SolveInput, _: &RunControl<'_>| {
        assert!(input.settings.seed != 2, "a fault of the solver");
        small_solution(StopReason::Finished)
    });
    let jobs = Jobs::new(Limits::default(), Arc::new(solver), &Metrics::new());
    let sweep = Sweep::read(Cursor::new(rests(5).to_string()), &jobs).unwrap();
    let service = Service::start(sweep::service_settings(std::num::NonZeroUsize::MIN)).unwrap();
    for _ in 0..2 {
        let mut results = Results::open(&folder.0.join("out"), sweep.header(Shard::WHOLE)).unwrap();
        let ended = sweep::run(&sweep, &mut results, &service, |_| {}, std::future::pending()).await.unwrap();
        assert_eq!(ended, Ended::Complete);
        let progress = results.progress();
        assert_eq!((progress.done, progress.failed, progress.statuses["converged"]), (5, 1, 4));
    }
    // A transport would run the first chunk so.
    let chunk = sweep.chunk(0).map(|row| sweep.row(row).unwrap()).collect();
    let chunk: Vec<_> = sweep.runner().rows(chunk, &service).collect().await;
    let mut of_chunk: Vec<_> = chunk.iter().map(|finished| (finished.row.number, finished.answer.is_ok())).collect();
    of_chunk.sort_unstable();
    assert_eq!(of_chunk, [(0, true), (1, true), (2, false), (3, true)]);
    let rows = lines(&folder.file("out"));
    let failed: Vec<Value> = rows.iter().map(|row| serde_json::from_str(row).unwrap()).collect();
    let failed: Vec<_> = failed.iter().filter(|row| row.get("problem").is_some()).collect();
    assert_eq!((failed.len(), &failed[0]["row"]), (1, &json!(2)));
    assert_eq!(failed[0]["problem"]["code"], "solver_panic");
}

#[cfg(not(feature = "nats"))]
#[test]
fn program_without_nats_says_so() {
    for arguments in [&["worker"][..], &["sweep", "--nats", "nats://localhost"]] {
        let output = slipdrive().args(arguments).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(64));
        assert!(said.ends_with("this program was built without the feature `nats`\n"), "{said}");
    }
    assert!(!refused(&["--natz"]).contains("nats`"));
}
