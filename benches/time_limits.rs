//! How far solves overrun their time limits, and what they answer then.
//!
//! 200 random limits from 1 ms to 1 s on solves that alone take longer, over grids up to the largest one: from the start
//! of the solve to the last byte of its JSON answer. `cargo bench --bench time_limits [number of limits] [seed]`.
//!
//! `cargo bench --bench time_limits -- stopping [number of robots] [seed]` prints how long a worker runs on after its flags.

#[path = "time_limits/stopping.rs"]
mod stopping;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::contract::json;
use slipdrive::jobs::solve::{AcceptedSolve, Solve, Solved, StopReason};
use slipdrive::jobs::{InProcessSolver, Jobs, Kind as _, Limits};
use slipdrive::service::{Class, Done, Service, ServiceSettings};

/// Grids with their names.
const GRIDS: [(&str, &str); 6] = [
    ("automatic", "{}"),
    ("automatic, 1000 torques", r#"{"control_intervals": 1000}"#),
    ("200 x 40", r#"{"steps": 200}"#),
    ("2000 x 200", r#"{"steps": 2000, "control_intervals": 200}"#),
    ("10000 x 40", r#"{"steps": 10000}"#),
    ("10000 x 1000", r#"{"steps": 10000, "control_intervals": 1000}"#),
];

fn main() {
    let mut arguments = std::env::args().skip(1).filter_map(|argument| argument.parse::<u64>().ok());
    let count = arguments.next().unwrap_or(200);
    let seed = arguments.next().unwrap_or(1);
    if std::env::args().any(|argument| argument == "stopping") {
        stopping::run(count, seed);
        return;
    }
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let settings = ServiceSettings { queue_length: 0, ..ServiceSettings::default() };
    let service = Service::start(settings).expect("threads");
    let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
    let mut overruns = Vec::new();
    let mut by_grid: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    let mut statuses: BTreeMap<&str, usize> = BTreeMap::new();
    let mut finished = 0;
    for _ in 0..count {
        // As many limits between 1 and 10 ms as between 100 ms and 1 s.
        let time_limit_s = 10_f64.powf(random.random_range(-3.0..0.0));
        let (name, grid) = GRIDS[random.random_range(0..GRIDS.len())];
        let method = if random.random_bool(0.5) { "nelder_mead" } else { "sequential_linear" };
        let (x, y): (f64, f64) = (random.random_range(-3.0..3.0), random.random_range(2.0..10.0));
        let body = format!(
            r#"{{"maneuver": {{"goal": {{"x_m": {x}, "y_m": {y}}}}}, "grid": {grid},
                "solver": {{"method": "{method}", "starts": 64, "time_limit_s": {time_limit_s}}}}}"#
        );
        let accepted = Solve::read(body.as_bytes(), jobs.limits()).expect("a valid request");
        let answer = |accepted: &AcceptedSolve, done: &Done<Solved>| {
            (json::write(&Solve::answer(accepted, done)), done.output.clone())
        };
        let start = Instant::now();
        let permit = service.reserve(Class::Heavy).expect("an idle worker");
        let running = permit.submit(Arc::clone(&jobs.solve), accepted, None, answer).expect("no deadline");
        let (_, solved) = running.blocking_outcome().expect("an answer");
        let overrun = (start.elapsed().as_secs_f64() - time_limit_s) * 1e3;
        if solved.stop_reason == StopReason::Finished {
            finished += 1;
            continue;
        }
        assert!(solved.solution.schedule.final_time > 0.0, "the best iterate is an answer");
        *statuses.entry(solved.solution.status.as_str()).or_default() += 1;
        by_grid.entry(format!("{name}, {method}")).or_default().push(overrun);
        overruns.push(overrun);
    }
    println!("overrun in ms over {} limits ({finished} solves ended before theirs)", overruns.len());
    print_row("all", &mut overruns);
    for (name, overruns) in &mut by_grid {
        print_row(name, overruns);
    }
    println!("statuses: {statuses:?}");
}

fn print_row(name: &str, overruns: &mut [f64]) {
    overruns.sort_by(f64::total_cmp);
    let at = |share: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index of a short list")]
        let index = (share * (overruns.len() - 1) as f64).round() as usize;
        overruns.get(index).copied().unwrap_or(f64::NAN)
    };
    println!(
        "{name:<42} {:>4} limits  median {:>8.2}  p95 {:>8.2}  max {:>8.2}",
        overruns.len(),
        at(0.5),
        at(0.95),
        at(1.0)
    );
}
