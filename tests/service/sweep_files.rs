//! Files of sweeps: what they mean, and what is refused.

use std::io::Cursor;
use std::num::NonZeroUsize;

use serde_json::{Value, json};
use slipdrive::contract::Problem;
use slipdrive::jobs::{Jobs, Limits};
use slipdrive::metrics::Metrics;
use slipdrive::sweep::{Row, Shard, Sweep, SweepError};

use crate::support::real_solver;

/// Threads that judge.
const TWO: NonZeroUsize = NonZeroUsize::new(2).unwrap();

fn read(text: &str) -> Result<Sweep, Problem> {
    let jobs = Jobs::new(Limits::default(), real_solver(), &Metrics::new());
    Sweep::read(Cursor::new(text.to_owned()), &jobs).map_err(|error| match error {
        SweepError::Refused(problem) => problem,
        SweepError::Unreadable(error) => panic!("{error}"),
    })
}

fn sweep(file: &Value) -> Sweep {
    read(&file.to_string()).unwrap_or_else(|problem| panic!("{problem} {:?}", problem.errors()))
}

fn faults(file: &Value) -> Vec<String> {
    let Err(problem) = read(&file.to_string()) else { panic!("{file} is accepted") };
    problem.errors().iter().map(|error| format!("{} {}", error.pointer, error.message)).collect()
}

fn rows(sweep: &Sweep) -> Vec<Row> {
    (0..sweep.row_count()).map(|row| sweep.row(row).unwrap()).collect()
}

#[test]
fn axes_are_crossed_and_the_last_runs_fastest() {
    let sweep = sweep(&json!({
        "job": "solve",
        "request": {"view": "plan"},
        "axes": [
            {"field": "robot.wheel_friction_coefficient", "from": 0.2, "to": 0.6, "count": 5},
            {"paired": [
                {"field": "solver.seed", "from": 1, "to": 3, "count": 3.0},
                {"field": "maneuver.goal.x_m", "values": [0.5, 1, 2]},
            ]},
        ],
        "chunk_rows": 4,
    }));
    assert_eq!((sweep.row_count(), sweep.chunk_count(), sweep.chunk(3)), (15, 4, 12..15));
    let rows = rows(&sweep);
    let friction: Vec<_> = rows.iter().step_by(3).map(|row| row.fields[0].1.clone()).collect();
    assert_eq!(friction, [0.2, 0.3, 0.4, 0.5, 0.6], "ends and what is between are what one would write");
    let expected = json!({
        "view": "plan",
        "robot": {"wheel_friction_coefficient": 0.3},
        "solver": {"seed": 2},
        "maneuver": {"goal": {"x_m": 1}},
    });
    assert_eq!(rows[4].request, expected);
    let names: Vec<_> = rows[4].fields.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["robot.wheel_friction_coefficient", "solver.seed", "maneuver.goal.x_m"]);
    assert_eq!(sweep.key(4), format!("{}-4", sweep.hash()));
    assert!(sweep.check(Shard::WHOLE, TWO).is_ok());
}

#[test]
fn lines_are_merged_over_the_request() {
    let file = r#"{"job": "solve", "request": {"view": "plan", "maneuver": {"goal": {"y_m": 5}}}}

{"maneuver": {"goal": {"x_m": 1}}}
  {"maneuver": {"goal": {"y_m": null}}, "grid": {"steps": 20}}
{}
"#;
    let lines = read(file).unwrap();
    let requests: Vec<_> = rows(&lines).into_iter().map(|row| row.request).collect();
    let expected = [
        json!({"view": "plan", "maneuver": {"goal": {"x_m": 1, "y_m": 5}}}),
        json!({"view": "plan", "maneuver": {"goal": {}}, "grid": {"steps": 20}}),
        json!({"view": "plan", "maneuver": {"goal": {"y_m": 5}}}),
    ];
    assert_eq!(requests, expected);
    assert_eq!(lines.row(0).unwrap().fields, [("maneuver.goal.x_m".to_owned(), json!(1))]);
    // Without its last line feed it is the same sweep, with another line it is not.
    assert_eq!(read(file.trim_end()).unwrap().hash(), lines.hash());
    assert_ne!(read(&format!("{file}{{}}")).unwrap().hash(), lines.hash());
}

#[test]
fn hash_is_of_what_decides_the_rows() {
    let file = json!({"job": "solve", "request": {}, "axes": [{"field": "solver.seed", "values": [1, 2]}]});
    let hash = |change: Value| {
        let mut file = file.clone();
        file.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
        sweep(&file).hash().to_owned()
    };
    let plain = hash(json!({}));
    assert_eq!(plain, hash(json!({"chunk_rows": 16, "warm_start": false, "columns": ["final_time_s"]})));
    for change in [json!({"chunk_rows": 8}), json!({"warm_start": true}), json!({"request": {"view": "plan"}})] {
        assert_ne!(plain, hash(change.clone()), "{change}");
    }
    // Counts may be written as tables of numbers write them, as those of requests.
    assert_eq!(hash(json!({"chunk_rows": 8})), hash(json!({"chunk_rows": 8.0})));
    let spaced = file.to_string().replace(',', " ,\n ");
    assert_eq!(plain, read(&spaced).unwrap().hash());
}

#[test]
fn all_faults_of_a_file_are_named_at_once() {
    let found = faults(&json!({
        "job": "solve",
        "request": {"maneuver": 1},
        "axes": [
            {"field": "maneuver.goal.x_m", "values": [1]},
            {"field": "a..b", "values": []},
            {"field": "solver.seed", "from": 0, "to": 1},
            {"field": "solver", "values": [{}]},
            {"field": "solver.starts", "from": 1, "to": 2, "count": 1},
            {"paired": [{"field": "view", "values": ["plan"]}, {"field": "grid.steps", "values": [1, 2]}]},
            {"field": "solver.rollout_limit", "from": 0.5, "to": 9_007_199_254_740_993_u64, "count": 2},
        ],
        "chunk_rows": 0,
        "columns": ["[0]"],
    }));
    for expected in [
        "#/chunk_rows `chunk_rows` is 0, must be between 1 and 1000000",
        "#/columns/0 `columns[0]` is `[0]`, must be a path",
        "#/axes/0/field `axes[0].field` is `maneuver.goal.x_m`, must be a field of `request`, where `maneuver` is a number",
        "#/axes/1/field `axes[1].field` is `a..b`, must be a path",
        "#/axes/1/values `axes[1].values` is 0 items long",
        "#/axes/2/count `axes[2].count` is absent, must be `field` with `values`, `field` with `from`, `to` and `count`",
        "#/axes/4/count `axes[4].count` is 1, must be between 2 and",
        "#/axes/5/paired/1 `axes[5].paired[1]` is 2 items long, must be as long as the first: 1 items",
        "#/axes/6/to `axes[6].to` is 9007199254740992, must be between -9007199254740991 and 9007199254740991",
    ] {
        assert!(found.iter().any(|fault| fault.starts_with(expected)), "{expected} is missing in {found:#?}");
    }
}

#[test]
fn one_field_is_set_once() {
    let axis = |field: &str| json!({"field": field, "values": [1]});
    for (one, other) in [("solver.seed", "solver.seed"), ("solver", "solver.seed"), ("solver.seed", "solver")] {
        let found = faults(&json!({"job": "solve", "request": {}, "axes": [axis(one), axis(other)]}));
        assert!(found[0].contains(&format!("apart from `{one}`, which is set too")), "{found:?}");
    }
}

#[test]
fn what_is_no_sweep_is_refused() {
    let axis = |count: u64| json!({"field": format!("solver.seed{count}"), "from": 0, "to": count, "count": count});
    let many = json!({"job": "solve", "request": {}, "axes": [axis(100_000), axis(100_001)]});
    assert!(faults(&many)[0].contains("must be at most 1000000000 rows"));
    let unknown = faults(&json!({"job": "solv", "request": {}}));
    assert!(unknown[0].contains("`job` is `solv`, must be one of solve, simulate"), "{unknown:?}");
    let warm = faults(&json!({"job": "simulate", "request": {}, "warm_start": true}));
    assert!(warm[0].contains("`warm_start` is true, must be false for `simulate`"), "{warm:?}");
    let guessed = json!({"job": "solve", "request": {"initial_guess": {}}, "warm_start": true});
    assert!(faults(&guessed)[0].contains("`request.initial_guess` is given"));
    let axes = json!([{"field": "solver.seed", "values": [1]}, {"field": "initial_guess.final_time_s", "values": [1]}]);
    let guessed = faults(&json!({"job": "solve", "request": {}, "axes": axes, "warm_start": true}));
    let expected =
        "#/axes/1/field `axes[1].field` is `initial_guess.final_time_s`, must be absent where `warm_start` is true";
    assert_eq!(guessed, [expected]);
    for (text, fault) in [
        (r#"{"job": "solve", "request": {"view": "plan", "view": "full"}}"#, "duplicate field `view`"),
        (r#"{"job": "solve", "request": {}, "rows": 1}"#, "unknown field `rows`"),
        (r#"{"job": "solve"}"#, "missing field `request`"),
        ("{\"job\": \"solve\", \"request\": {}}\n[1]", "line 2: "),
        ("{\"job\": \"solve\", \"request\": {}, \"axes\": []}\n{}", "absent where lines with requests follow"),
        ("", "it is empty"),
    ] {
        let problem = read(text).err().unwrap_or_else(|| panic!("{text} is accepted"));
        assert!(problem.to_string().contains(fault), "{text}: {problem}");
    }
}

#[test]
fn all_faulty_lines_are_named_at_once() {
    let lines = |warm_start: bool, lines: &str| {
        let head = json!({"job": "solve", "request": {}, "warm_start": warm_start});
        let problem = read(&format!("{head}\n{lines}")).err().unwrap();
        problem.errors().iter().map(|error| error.message.clone()).collect::<Vec<_>>()
    };
    let long = " ".repeat(9 << 20);
    let found =
        lines(true, &format!("{{}}\n[1]\n\n{{{long}}}\n{{\"initial_guess\": {{}}}}\n{{\"initial_guess\": null}}\n{{"));
    let beginnings =
        ["line 3: ", "line 5: it is longer", "line 6: `initial_guess` is given, must be absent", "line 8: "];
    assert_eq!(found.len(), beginnings.len(), "{found:?}");
    assert!(found.iter().zip(beginnings).all(|(fault, beginning)| fault.starts_with(beginning)), "{found:?}");
    // The line feed is no part of it.
    let of_length = |bytes: usize| format!("{{{}}}\n{{", " ".repeat(bytes - 2));
    let (longest, too_long) = (lines(false, &of_length(4 << 20)), lines(false, &of_length((4 << 20) + 1)));
    assert_eq!((longest.len(), too_long.len()), (1, 2), "{longest:?} {too_long:?}");
    let many = lines(false, &"[]\n".repeat(23));
    assert_eq!((many.len(), many[20].as_str()), (21, "3 more lines are no rows"));
}

#[test]
fn all_rows_are_judged_with_the_words_of_the_service() {
    let sweep = sweep(&json!({
        "job": "solve",
        "request": {"solver": {"time_limit_s": 5}},
        "axes": [{"field": "robot.wheel_radius_m", "from": -1, "to": 28, "count": 30}],
    }));
    let faults = sweep.check(Shard::WHOLE, TWO).unwrap_err();
    assert_eq!((faults.count, faults.first.len()), (30, 20));
    let (row, problem) = &faults.first[1];
    let pointers: Vec<_> = problem.errors().iter().map(|error| error.pointer.as_str()).collect();
    assert_eq!((*row, &pointers[..]), (1, &["#/solver/time_limit_s", "#/robot/wheel_radius_m"][..]));
    // Of the two shards each judges its own.
    assert_eq!(sweep.check(Shard { index: 1, of: 2 }, TWO).unwrap_err().count, 14);
}

#[test]
fn unknown_fields_of_requests_are_refused() {
    let axes = json!([{"field": "robot.friction", "values": [0.4]}]);
    let sweep = sweep(&json!({"job": "solve", "request": {}, "axes": axes}));
    let faults = sweep.check(Shard::WHOLE, TWO).unwrap_err();
    assert!(faults.first[0].1.to_string().contains("unknown field `friction`"), "{}", faults.first[0].1);
}
