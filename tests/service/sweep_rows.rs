//! Rows of sweeps: judged by all threads, begun by plans that lead somewhere alone, in their order.

use std::io::Cursor;
use std::num::NonZeroUsize;
use std::sync::Arc;

use serde_json::{Value, json};
use slipdrive::jobs::{Jobs, Limits, ManeuverSolver};
use slipdrive::metrics::Metrics;
use slipdrive::service::Service;
use slipdrive::solver::{RunControl, SolveInput, Status, StopReason};
use slipdrive::sweep::{self, Ended, Index, Results, Shard, Sweep, write_csv};

use crate::support::folder::Folder;
use crate::support::sweeps::{drives, lines, rests};
use crate::support::{FakeSolver, instant_solver, small_solution};

#[test]
fn any_number_of_threads_judges_every_row() {
    let jobs = Jobs::new(Limits::default(), instant_solver(), &Metrics::new());
    // Radii of 0.9 to -0.9 m, those below zero are faults.
    let axes = json!([{"field": "robot.wheel_radius_m", "from": 0.09, "to": -0.09, "count": 19}]);
    let file = drives(1, &json!({"axes": axes, "chunk_rows": 2}));
    let sweep = Sweep::read(Cursor::new(file.to_string()), &jobs).unwrap();
    for threads in 1..=5 {
        let faults = sweep.check(Shard::WHOLE, NonZeroUsize::new(threads).unwrap()).unwrap_err();
        let rows: Vec<_> = faults.first.iter().map(|fault| fault.0).collect();
        assert_eq!((rows, faults.count), ((9..19).collect(), 10), "{threads} threads");
        let shards: u64 = (0..3)
            .map(|index| {
                let found = sweep.check(Shard { index, of: 3 }, NonZeroUsize::new(threads).unwrap());
                found.err().map_or(0, |faults| faults.count)
            })
            .sum();
        assert_eq!(shards, 10, "{threads} threads");
    }
}

/// All results of a sweep by one worker, in the folder `out`.
async fn swept(file: &Value, solver: Arc<dyn ManeuverSolver>, folder: &Folder) -> Results {
    let jobs = Jobs::new(Limits::default(), solver, &Metrics::new());
    let sweep = Sweep::read(Cursor::new(file.to_string()), &jobs).unwrap();
    let service = Service::start(sweep::service_settings(NonZeroUsize::MIN)).unwrap();
    let mut results = Results::open(&folder.0.join("out"), sweep.header(Shard::WHOLE)).unwrap();
    let ended = sweep::run(&sweep, &mut results, &service, |_| {}, std::future::pending()).await.unwrap();
    assert_eq!(ended, Ended::Complete);
    results
}

#[tokio::test]
async fn a_row_that_a_plan_leads_nowhere_is_searched_as_any_other() {
    let folder = Folder::new("rows-warm");
    let solver = FakeSolver(|input: &SolveInput, _: &RunControl<'_>| {
        let mut solution = small_solution(StopReason::Finished);
        if input.initial_guess.is_some() {
            (solution.status, solution.schedule.final_time) = (Status::Feasible, 9.0);
        }
        solution
    });
    let results = swept(&drives(4, &json!({"warm_start": true, "chunk_rows": 4})), Arc::new(solver), &folder).await;
    assert_eq!(results.progress().statuses.get("converged"), Some(&4), "{:?}", results.progress());
    for line in lines(&folder.file("out")) {
        let row: Value = serde_json::from_str(&line).unwrap();
        assert!(row.get("warm_start_from").is_none() && row["answer"]["final_time_s"] == 1.5, "{row}");
    }
}

#[tokio::test]
async fn plans_that_have_not_converged_are_handed_to_no_row() {
    let folder = Folder::new("rows-unconverged");
    let solver = FakeSolver(|input: &SolveInput, _: &RunControl<'_>| {
        let mut solution = small_solution(StopReason::Finished);
        if input.initial_guess.is_none() {
            solution.status = Status::Feasible;
        }
        solution
    });
    let results = swept(&drives(3, &json!({"warm_start": true, "chunk_rows": 3})), Arc::new(solver), &folder).await;
    assert_eq!(results.progress().statuses.get("feasible"), Some(&3), "{:?}", results.progress());
}

#[tokio::test]
async fn tables_are_in_the_order_of_the_rows_whatever_order_the_results_came_in() {
    let folder = Folder::new("rows-order");
    drop(swept(&rests(30), instant_solver(), &folder).await);
    let mut written = lines(&folder.file("out"));
    written.reverse();
    folder.write("out/rows-0000.jsonl", &(written.join("\n") + "\n"));
    let mut table = Vec::new();
    write_csv(&Index::of(&[folder.0.join("out")]).unwrap(), &mut table).unwrap();
    let table = String::from_utf8(table).unwrap();
    let rows: Vec<u64> = table.lines().skip(1).map(|line| line.split(',').next().unwrap().parse().unwrap()).collect();
    assert_eq!(rows, (0..30).collect::<Vec<_>>());
}
