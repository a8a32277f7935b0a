//! What an assessment costs beside plain rollouts of the same samples on the same grid, for each example of a solve.
//!
//! `cargo bench --bench assess [number of samples]`; CPU time of one thread, the shortest of five runs in turn.

#[path = "maneuvers/timing.rs"]
mod timing;

use std::hint::black_box;
use std::sync::Arc;

use slipdrive::assessment::{AssessInput, Distribution, Limited, assess};
use slipdrive::contract::json;
use slipdrive::jobs::solve::Solve;
use slipdrive::jobs::{InProcessSolver, Jobs, Kind as _, Limits};
use slipdrive::metrics::Metrics;
use slipdrive::motion::{ChangedParameter, Disturbed, Undisturbed};
use slipdrive::simulation::{Rollout, Simulator};
use slipdrive::solver::{RunControl, SolveInput, solve};
use slipdrive::stop::Stop;

const REPETITIONS: usize = 5;

fn main() {
    let given = std::env::args().skip(1).find_map(|argument| argument.parse().ok());
    let sample_count = given.unwrap_or(1_000);
    let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), &Metrics::new());
    println!("| plan | steps | limits | plain rollouts, ms | assessed |");
    println!("|---|---|---|---|---|");
    for example in Solve::EXAMPLES {
        let accepted = Solve::read(&json::write(&(example.request)()), jobs.limits()).expect("an example is valid");
        measure(example.name, &accepted.input, sample_count);
    }
}

fn measure(name: &str, solved: &SolveInput, sample_count: usize) {
    let input = assessed(solved, sample_count);
    let factor = assess(&input, &RunControl::unattended()).expect("never stopped").grid.factor;
    let driven = Undisturbed { step_count: factor * input.driven.step_count, ..input.driven.clone() };
    let motions: Vec<Disturbed> = (0..sample_count).filter_map(|sample| changed(&driven, &input, sample)).collect();
    let mut shortest = [f64::INFINITY; 2];
    for _ in 0..REPETITIONS {
        let ((), plain) = timing::shortest_ms(1, || motions.iter().for_each(plain_rollout));
        let assessment = || black_box(assess(&input, &RunControl::unattended()).expect("never stopped"));
        let (_, assessed) = timing::shortest_ms(1, assessment);
        shortest = [shortest[0].min(plain), shortest[1].min(assessed)];
    }
    let ([plain, assessed], limits) = (shortest, if input.has_limits() { "yes" } else { "no" });
    println!("| {name} | {} | {limits} | {plain:.1} | {:.2} |", driven.step_count, assessed / plain);
}

fn assessed(solved: &SolveInput, sample_count: usize) -> AssessInput {
    let solution = solve(solved, &RunControl::unattended()).expect("never stopped");
    let SolveInput { maneuver, .. } = solved;
    let planned = Undisturbed::new(
        (solved.bare_robot, solved.payload),
        (maneuver.reference_point, &maneuver.start),
        (&solution.schedule, solution.report.step_count),
    );
    let share = |parameter, half: f64| (parameter, Distribution::Uniform { low: -half, high: half });
    AssessInput {
        driven: planned.clone(),
        planned,
        goal: Some(maneuver.goal),
        limited: Limited::Maneuver(Box::new(*maneuver)),
        aisle: solved.aisle.clone(),
        uncertain: vec![
            share(ChangedParameter::Friction, 0.1),
            share(ChangedParameter::Mass, 0.05),
            share(ChangedParameter::TorqueLeft, 0.02),
            share(ChangedParameter::StartHeading, 0.01),
        ],
        tolerances: [None, None, Some(0.1), None, None],
        sample_count,
        seed: 0,
    }
}

fn changed(driven: &Undisturbed, input: &AssessInput, sample: usize) -> Option<Disturbed> {
    let drawn = input.uncertain.iter().map(|&(parameter, of)| (parameter, of.draw(input.seed, sample, parameter)));
    driven.under(&drawn.collect::<Vec<_>>()).ok()
}

fn plain_rollout(motion: &Disturbed) {
    let rollout = Rollout { start: &motion.start, schedule: &motion.schedule, step_count: motion.step_count };
    black_box(Simulator::new(&motion.robot).end_state(&rollout, Stop::never()).expect("never stopped"));
}
