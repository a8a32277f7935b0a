//! What the commands write, and what they do not overwrite.

use std::io::Write as _;
use std::process::Stdio;

use crate::command_line::{refused, run_with_input};
use crate::support::folder::Folder;
use crate::support::process::slipdrive;

const TORQUES: &[u8] = br#"{"torque_schedule": {"interval_s": 0.1, "left_n_m": [0.1], "right_n_m": [0.1]}}"#;

#[test]
fn folders_are_no_standard_output() {
    for (command, flag) in [("solve", "--svg"), ("export", "--out"), ("sweep", "--out")] {
        let told = refused(&[command, flag, "-", "-"], b"{}");
        assert!(told.contains(&format!("invalid value '-' for '{flag} <DIR>': must be a folder")), "{told}");
    }
}

#[test]
fn answer_that_nobody_reads_is_saved_all_the_same() {
    let folder = Folder::new("unread");
    let body = br#"{"torque_schedule": {"interval_s": 0.1, "left_n_m": [0.1], "right_n_m": [0.1]}}"#;
    folder.write("body.json", std::str::from_utf8(body).unwrap());
    let (request, plan, out) = (folder.file("body.json"), folder.file("plan.json"), folder.file("out"));
    let unread = |arguments: &[&str]| {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = slipdrive().args(arguments).stdout(writer).stderr(Stdio::piped()).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    };
    unread(&["simulate", &request, "--save", &plan]);
    unread(&["export", &plan, "--format", "csv", "--rate-hz", "100", "--out", &out]);
    unread(&["example"]);
    assert!(folder.read("plan.json").contains("end_state") && folder.read("out/trajectory.csv").starts_with("time_s"));

    let (nowhere, other) = (folder.file("none/answer.json"), folder.file("other.json"));
    let failed = run_with_input(&["simulate", &request, "--json", &nowhere, "--save", &other], b"");
    assert_eq!(failed.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&failed.stderr).contains("answer.json cannot be written"));
    assert_eq!(folder.read("other.json"), folder.read("plan.json"));
}

#[test]
fn dash_is_standard_output_for_one_of_the_outputs() {
    let folder = Folder::new("dash");
    let body = br#"{"torque_schedule": {"interval_s": 0.1, "left_n_m": [0.1], "right_n_m": [0.1]}}"#;
    for (flag, begin) in
        [("--json", "{"), ("--save", "{\"simulate\""), ("--csv", "plan,time_s"), ("--report", "<!doctype")]
    {
        let mut command = slipdrive();
        command.current_dir(&folder.0).args(["simulate", "-", flag, "-"]).stdin(Stdio::piped());
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(body).unwrap();
        let printed = String::from_utf8(child.wait_with_output().unwrap().stdout).unwrap();
        assert!(printed.starts_with(begin), "{flag}: {printed}");
        assert!(!folder.path("-").exists(), "{flag}");
    }
    assert!(refused(&["simulate", "-", "--json", "-", "--csv", "-"], body).contains("2 outputs are `-`"));
}

#[test]
fn what_cannot_be_written_keeps_nothing_else_from_being_written() {
    let folder = Folder::new("some-written");
    let [nowhere, nowhere_either] = ["none/plan.json", "none/motion.csv"].map(|name| folder.file(name));
    let [json, report, svg] = ["answer.json", "page.html", "figures"].map(|name| folder.file(name));
    let good = ["--json", &json, "--report", &report, "--svg", &svg];
    let bad = ["--save", &nowhere, "--csv", &nowhere_either];
    let output = run_with_input(&[&["simulate", "-"], &bad[..], &good[..]].concat(), TORQUES);
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("plan.json cannot be written") && told.contains("motion.csv cannot be written"), "{told}");
    assert!(folder.read("answer.json").contains("end_state") && folder.read("page.html").contains("<svg"));
    assert!(folder.read("figures/path.svg").starts_with("<svg"));
}

#[test]
fn outputs_are_neither_inputs_nor_each_other() {
    let folder = Folder::new("collisions");
    folder.write("body.json", std::str::from_utf8(TORQUES).unwrap());
    let (body, dotted) = (folder.file("body.json"), folder.file("./new.json"));
    let new = folder.file("new.json");
    let told = refused(&["simulate", &body, "--save", &new, "--json", &dotted, "--csv", &body], b"");
    assert!(told.contains(&format!("--csv {body} is an input too, must be another file")), "{told}");
    assert!(told.contains("--json and --save are both"), "{told}");
    assert!(!folder.path("new.json").exists() && folder.read("body.json").as_bytes() == TORQUES);
    // A device keeps nothing.
    let nothing = ["--json", "/dev/null", "--save", "/dev/null"];
    assert_eq!(run_with_input(&[&["simulate", &body], &nothing[..]].concat(), b"").status.code(), Some(0));
}

#[test]
fn files_of_another_kind_are_told_what_they_are_for() {
    let folder = Folder::new("other-kinds");
    folder.write("body.json", std::str::from_utf8(TORQUES).unwrap());
    let [body, plan, both] = ["body.json", "plan.json", "both.json"].map(|name| folder.file(name));
    for command in ["present", "export", "assess"] {
        assert!(refused(&[command, &body], b"").contains("this is a request"), "{command}");
    }
    run_with_input(&["simulate", &body, "--save", &plan], b"");
    run_with_input(&["present", &plan, &plan, "--save", &both], b"");
    for command in ["export", "assess"] {
        assert!(refused(&[command, &both], b"").contains("for `present` alone"), "{command}");
    }
}
