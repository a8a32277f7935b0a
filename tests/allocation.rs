//! The time-stepping loop allocates nothing. A binary of its own, since its allocator counts for a whole process.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[allow(dead_code, reason = "the numerics use more of it")]
#[path = "numerics/random.rs"]
mod random;

use std::alloc::System;

use random::RandomCases;
use slipdrive::robot::{Robot, RobotParameters};
use slipdrive::simulation::{EndSensitivity, Rollout, Simulator};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn allocations(run: impl FnOnce()) -> usize {
    let region = Region::new(ALLOCATOR);
    run();
    let change = region.change();
    change.allocations + change.reallocations
}

// One test, since the counter sees every thread of the process.
#[test]
fn rollouts_and_their_derivatives_allocate_nothing() {
    for seed in 0..40 {
        let mut cases = RandomCases::new(seed);
        let front = if seed % 2 == 0 { 0.0 } else { 0.2 };
        let parameters = RobotParameters { front_friction_coefficient: front, ..*cases.robot().parameters() };
        let Ok(robot) = Robot::new(parameters) else { continue };
        let simulator = Simulator::new(&robot);
        let start = cases.state(&robot, 1.0);
        let schedule = cases.schedule(20, 1.0, 3.0);
        let rollout = Rollout { start: &start, schedule: &schedule, step_count: 200 };
        let mut end = None;
        assert_eq!(allocations(|| end = Some(simulator.end_state(&rollout))), 0, "seed {seed}");
        assert_eq!(allocations(|| end = Some(simulator.end_state_by_fixed_point(&rollout))), 0, "seed {seed}");
        let mut sensitivity = EndSensitivity::default();
        simulator.end_sensitivity(&rollout, 0.0, &mut sensitivity);
        for smoothing in [0.0, 0.03] {
            let again = allocations(|| simulator.end_sensitivity(&rollout, smoothing, &mut sensitivity));
            assert_eq!(again, 0, "seed {seed}: the second sweep reuses the memory of the first");
        }
    }
}
