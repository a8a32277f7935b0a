//! The time-stepping loop allocates nothing. A binary of its own, since its allocator counts for a whole process.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[allow(dead_code, reason = "the numerics use more of it")]
#[path = "numerics/random.rs"]
mod random;

use std::alloc::System;

use random::RandomCases;
use slipdrive::robot::{Robot, RobotParameters};
use slipdrive::simulation::{EndSensitivity, FrictionLaw, PathQuantity, Rollout, Simulator};
use slipdrive::stop::Stop;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const ATTEMPTS: usize = 3;

fn allocations(run: impl FnOnce()) -> usize {
    let region = Region::new(ALLOCATOR);
    run();
    let change = region.change();
    change.allocations + change.reallocations
}

/// Allocations in each kind of sweep.
#[derive(Debug, Default, PartialEq)]
struct Counts {
    end_state: usize,
    end_state_by_fixed_point: usize,
    /// Sweeps after the first reuse its memory: the exact one, and a smoothed one.
    later_sensitivities: [usize; 3],
}

/// What a random rollout allocates; nothing is kept from a call before.
fn counts(seed: u64) -> Counts {
    let mut cases = RandomCases::new(seed);
    let front = if seed.is_multiple_of(2) { 0.0 } else { 0.2 };
    let parameters = RobotParameters { front_friction_coefficient: front, ..*cases.robot().parameters() };
    let Ok(robot) = Robot::new(parameters) else { return Counts::default() };
    let simulator = Simulator::new(&robot);
    let start = cases.state(&robot, 1.0);
    let schedule = cases.schedule(20, 1.0, 3.0);
    let rollout = Rollout { start: &start, schedule: &schedule, step_count: 200 };
    let mut end = None;
    let end_state = allocations(|| end = Some(simulator.end_state(&rollout, Stop::never())));
    let end_state_by_fixed_point =
        allocations(|| end = Some(simulator.end_state_by_fixed_point(&rollout, Stop::never())));
    let quantities = vec![PathQuantity::YawRate, PathQuantity::WheelRate { wheel: 0 }];
    let mut sensitivity = EndSensitivity::watching(quantities, schedule.control_count());
    simulator.end_sensitivity(&rollout, FrictionLaw::Exact, &mut sensitivity, Stop::never()).unwrap();
    let laws = [FrictionLaw::Exact, FrictionLaw::Smoothed(0.03), FrictionLaw::Held(0.0)];
    let later_sensitivities = laws
        .map(|law| allocations(|| simulator.end_sensitivity(&rollout, law, &mut sensitivity, Stop::never()).unwrap()));
    Counts { end_state, end_state_by_fixed_point, later_sensitivities }
}

// One test, since the counter sees every thread of the process. That of the harness allocates a little after the start of
// the test, on a busy machine in the middle of a sweep, but not in every attempt.
#[test]
fn rollouts_and_their_derivatives_allocate_nothing() {
    for seed in 0..40 {
        let mut last = Counts::default();
        let allocates_nothing = (0..ATTEMPTS).any(|_| {
            last = counts(seed);
            last == Counts::default()
        });
        assert!(allocates_nothing, "seed {seed}: {last:?} in the last of {ATTEMPTS} attempts");
    }
}
