//! Rollouts of 200 steps: exact against fixed-point contact, and derivatives against the bare rollout.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use slipdrive::robot::{Robot, RobotParameters, State};
use slipdrive::simulation::{EndSensitivity, FrictionLaw, Rollout, Simulator, TorqueSchedule};
use slipdrive::stop::Stop;

/// The paper's grid on the reference robot: full effort, then braking with a sliding wheel.
fn bang_bang() -> TorqueSchedule {
    let torques: Vec<f64> = (0..40).map(|interval| if interval < 20 { 1.0 } else { -1.0 }).collect();
    TorqueSchedule { final_time: 2.93, left: torques.clone(), right: torques }
}

/// Both wheels spin against each other on ice: every step slides in the plane.
fn spinning() -> TorqueSchedule {
    TorqueSchedule { final_time: 1.5, left: vec![1.0; 40], right: vec![-1.0; 40] }
}

/// What a linear program of a search leads to.
fn nearby(schedule: &TorqueSchedule) -> TorqueSchedule {
    let less = |torques: &[f64]| torques.iter().map(|torque| 0.95 * torque).collect();
    TorqueSchedule { final_time: 1.02 * schedule.final_time, left: less(&schedule.left), right: less(&schedule.right) }
}

fn rollouts(criterion: &mut Criterion) {
    let start = State::default();
    let ice = RobotParameters { wheel_friction_coefficient: 0.12, ..RobotParameters::default() };
    let cases = [("bang_bang", RobotParameters::default(), bang_bang()), ("both_wheels_slide", ice, spinning())];
    for (name, parameters, schedule) in cases {
        let simulator = Simulator::new(&Robot::new(parameters).expect("a valid robot"));
        let rollout = Rollout { start: &start, schedule: &schedule, step_count: 200 };
        let mut group = criterion.benchmark_group(format!("rollout_200_steps/{name}"));
        group.bench_function("exact", |bench| bench.iter(|| simulator.end_state(black_box(&rollout), Stop::never())));
        // Each one follows another, as in a search: its contact solver starts from what that went through.
        let near = nearby(&schedule);
        let mut in_turn = [rollout, Rollout { schedule: &near, ..rollout }].into_iter().cycle();
        let mut sensitivity = EndSensitivity::default();
        for (law, name) in [(FrictionLaw::Exact, "exact"), (FrictionLaw::Smoothed(0.1), "smoothed")] {
            group.bench_function(format!("{name}_with_derivatives"), |bench| {
                bench.iter(|| {
                    let rollout = in_turn.next().expect("a cycle");
                    simulator.end_sensitivity(black_box(&rollout), law, &mut sensitivity, Stop::never())
                });
            });
        }
        group.sample_size(10);
        group.bench_function("fixed_point", |bench| {
            bench.iter(|| simulator.end_state_by_fixed_point(black_box(&rollout), Stop::never()));
        });
        group.finish();
    }
}

criterion_group!(benches, rollouts);
criterion_main!(benches);
