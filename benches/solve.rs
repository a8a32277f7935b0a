//! Whole solves of the paper's forward drive: sequential linear programs against the paper's Nelder-Mead.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use slipdrive::solver::{Method, RunControl, SolveInput, solve};

fn forward_drive(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("forward_drive");
    for method in [Method::SequentialLinear, Method::NelderMead] {
        let mut input = SolveInput::forward_drive();
        input.settings.method = method;
        let solution = solve(&input, &RunControl::unattended());
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

criterion_group!(benches, forward_drive);
criterion_main!(benches);
