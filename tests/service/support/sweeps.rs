//! Sweeps to run, and the rows that they come to.

use std::collections::BTreeMap;
use std::fs;

use serde_json::{Value, json};

/// Drives of 0.5 to 2.5 m on coarse grids from one start: about 10 ms each.
pub(crate) fn drives(rows: u32, more: &Value) -> Value {
    let mut file = json!({
        "job": "solve",
        "request": {"view": "plan", "grid": {"steps": 40, "control_intervals": 8}, "solver": {"starts": 1}},
        "axes": [{"field": "maneuver.goal.y_m", "from": 0.5, "to": 2.5, "count": rows}],
        "chunk_rows": 4,
    });
    file.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    file
}

/// Maneuvers that end where they begin: no search.
pub(crate) fn rests(rows: u32) -> Value {
    let mut file = drives(rows, &json!({"axes": [{"field": "solver.seed", "from": 0, "to": rows - 1, "count": rows}]}));
    file["request"]["maneuver"] = json!({"goal": {"x_m": 0, "y_m": 0}});
    file
}

/// The rows of some folders by their numbers, each of them once; without what clocks say.
pub(crate) fn rows(folders: &[&str]) -> BTreeMap<u64, Value> {
    let mut rows = BTreeMap::new();
    for line in folders.iter().flat_map(|folder| lines(folder)) {
        let mut row: Value = serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line}"));
        if row.get("problem").is_none() {
            row.pointer_mut("/answer/report").unwrap().as_object_mut().unwrap().remove("solve_time_s").unwrap();
        }
        let number = row["row"].as_u64().unwrap();
        assert!(rows.insert(number, row).is_none(), "row {number} is there twice");
    }
    rows
}

/// The lines of all parts of a folder.
pub(crate) fn lines(folder: &str) -> Vec<String> {
    let parts = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    let parts = parts.filter(|path| path.extension().is_some_and(|extension| extension == "jsonl"));
    parts.flat_map(|part| fs::read_to_string(part).unwrap().lines().map(str::to_owned).collect::<Vec<_>>()).collect()
}
