//! Whole solves of the forward drive: sequential linear programs against the paper's Nelder-Mead from the straight start,
//! and the default search with one worker against two.

use std::hint::black_box;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use slipdrive::jobs::solve::Solve;
use slipdrive::jobs::{InProcessSolver, Jobs, Kind as _, Limits};
use slipdrive::service::{Class, Service, ServiceSettings};
use slipdrive::solver::{Method, RunControl, SolveInput, solve};

/// Pairs of solves from which the ratio of one and two workers is taken.
const PAIRED_ROUNDS: usize = 21;

fn forward_drive(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("forward_drive");
    for method in [Method::SequentialLinear, Method::NelderMead] {
        let mut input = SolveInput::forward_drive();
        input.settings.method = method;
        let solution = solve(&input, &RunControl::unattended()).expect("nothing stops it");
        println!(
            "{:<18} t_f {:.5} s, largest goal error {:.1e}, {} rollouts",
            method.as_str(),
            solution.schedule.final_time,
            solution.goal_error.amax(),
            solution.report.rollouts
        );
        if method == Method::NelderMead {
            group.sample_size(10).warm_up_time(Duration::from_millis(1)).measurement_time(Duration::from_secs(50));
        }
        group.bench_function(method.as_str(), |bench| {
            bench.iter(|| solve(black_box(&input), &RunControl::unattended()));
        });
    }
    group.finish();
}

/// The default search, alone and with one idle worker that helps.
fn helped_search(criterion: &mut Criterion) {
    let body = br#"{"maneuver": {"goal": {"y_m": 5}}, "solver": {"time_limit_s": 60}}"#;
    let accepted = Solve::read(body, &Limits::default()).expect("a valid request");
    let mut group = criterion.benchmark_group("default_search");
    let services = [1, 2].map(|workers| {
        let workers = NonZeroUsize::new(workers).expect("at least one");
        let settings = ServiceSettings { workers, queue_length: 0, ..ServiceSettings::default() };
        let service = Service::start(settings).expect("threads can be started");
        let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
        (service, jobs)
    });
    let solve = |(service, jobs): &(Service, Jobs)| {
        let permit = service.reserve(Class::Heavy).expect("nobody else asks");
        let running = permit.submit(Arc::clone(&jobs.solve), accepted.clone(), None, |_, done| done.duration);
        running.expect("no deadline").blocking_outcome().expect("nobody stops it")
    };
    // By turns, so that both meet the same neighbours on the machine.
    let rounds = (0..PAIRED_ROUNDS).map(|_| services.each_ref().map(&solve));
    let mut ratios: Vec<f64> = rounds.map(|[alone, helped]| alone.as_secs_f64() / helped.as_secs_f64()).collect();
    ratios.sort_by(f64::total_cmp);
    println!("default search       1 worker takes {:.2} times as long as 2 (median)", ratios[ratios.len() / 2]);
    for (service, name) in services.iter().zip(["one_worker", "two_workers"]) {
        group.bench_function(name, |bench| bench.iter(|| solve(black_box(service))));
    }
    group.finish();
}

criterion_group!(benches, forward_drive, helped_search);
criterion_main!(benches);
