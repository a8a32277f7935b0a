//! The suite's best-known plans: each case has one, and it is what it claims to be.

#[allow(dead_code, unused_imports, reason = "the runner uses more of the suite")]
#[path = "../../benches/maneuvers/suite/mod.rs"]
pub(crate) mod suite;

use std::fs;
use std::path::Path;

use slipdrive::solver::{RunControl, solve};
use suite::{Case, Witness, path_of, read_cases};

/// A bound that is met exactly may be computed as a few units in the last place above it.
const BOUND_ROUNDING: f64 = 1e-9;

fn cases_with_witnesses() -> Vec<(Case, Witness)> {
    let (_, cases) = read_cases().unwrap();
    let with_witness = |case: Case| {
        let witness = Witness::read(&case.name).unwrap();
        let witness = witness.unwrap_or_else(|| panic!("{} has no best-known plan", case.name));
        (case, witness)
    };
    cases.into_iter().map(with_witness).collect()
}

#[test]
fn suite_is_large_and_varied() {
    let (robots, cases) = read_cases().unwrap();
    assert!(cases.len() >= 120, "{} cases", cases.len());
    assert!(robots.len() >= 6, "{} robots", robots.len());
    for robot in robots.keys() {
        let prefix = format!("{robot}/");
        assert!(cases.iter().any(|case| case.name.starts_with(&prefix)), "no case of {robot}");
    }
}

#[test]
fn every_best_known_plan_is_a_witness() {
    let faults: Vec<String> = cases_with_witnesses()
        .iter()
        .filter_map(|(case, witness)| Some(format!("{}: {}", case.name, witness.verify(case).err()?)))
        .collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn no_lower_bound_exceeds_a_best_known_time() {
    for (case, witness) in cases_with_witnesses() {
        let mut input = case.accepted.input.clone();
        // The bound depends on the maneuver alone: one rollout is enough to be told it.
        (input.settings.start_count, input.settings.rollout_limit) = (1, 1);
        let bound = solve(&input, &RunControl::unattended()).unwrap().report.lower_bound.unwrap();
        let limit = witness.final_time_s * (1.0 + BOUND_ROUNDING);
        assert!(bound <= limit, "{}: bound {bound} s, known {} s", case.name, witness.final_time_s);
    }
}

fn files_below(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    for robot in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        for file in fs::read_dir(robot.path()).unwrap().map(Result::unwrap) {
            let (robot, name) = (robot.file_name(), file.path().with_extension(""));
            names.push(format!("{}/{}", robot.to_string_lossy(), name.file_name().unwrap().to_string_lossy()));
        }
    }
    names
}

#[test]
fn best_known_folder_holds_nothing_else() {
    let (_, cases) = read_cases().unwrap();
    let mut files = files_below(&path_of("best_known"));
    let mut expected: Vec<String> = cases.into_iter().map(|case| case.name).collect();
    files.sort();
    expected.sort();
    assert_eq!(files, expected);
}
