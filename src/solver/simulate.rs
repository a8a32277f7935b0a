//! One rollout of a given torque schedule.

use super::violations_of_schedule;
use crate::robot::{Robot, RobotParameters, State};
use crate::shooting::{ReferencePoint, check_state};
use crate::simulation::{ContactModeSpan, Separation, TorqueSchedule, Trajectory};
use crate::violation::{Checks, Violations};

/// The solver of the one-step friction problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactSolver {
    /// Contact modes solved exactly.
    #[default]
    Exact,
    /// The paper's prox fixed point.
    FixedPoint,
}

/// A validated simulation.
#[derive(Debug, Clone)]
pub struct SimulateInput {
    /// The robot.
    pub robot: Robot,
    /// The point that the start and the answer speak of.
    pub reference_point: ReferencePoint,
    /// Start state at the reference point.
    pub start: State,
    /// The torques.
    pub schedule: TorqueSchedule,
    /// Number of time steps.
    pub step_count: usize,
    /// The contact solver.
    pub contact_solver: ContactSolver,
}

impl SimulateInput {
    /// Validates a simulation on the given robot; `checks` may hold violations found before.
    ///
    /// # Errors
    /// All violated rules, those in `checks` included.
    pub fn new(
        mut checks: Checks,
        robot: RobotParameters,
        (reference_point, start): (ReferencePoint, State),
        schedule: TorqueSchedule,
        (step_count, contact_solver): (usize, ContactSolver),
    ) -> Result<Self, Violations> {
        checks.within("robot", |checks| robot.check(checks));
        checks.within("start", |checks| check_state(&start, checks));
        checks.within("torque_schedule", |checks| {
            checks.positive("interval_s", schedule.interval(), "s");
            violations_of_schedule(&schedule, ("left_n_m", "right_n_m"), None, checks);
        });
        checks.within("grid", |checks| {
            let intervals = schedule.control_count();
            let rule = format!("at least the number of control intervals ({intervals})");
            checks.require("steps", step_count, step_count >= intervals.max(1), &rule, Some(intervals as f64));
        });
        checks.into_result(())?;
        Ok(Self { robot: Robot::new(robot)?, reference_point, start, schedule, step_count, contact_solver })
    }
}

/// The answer of a simulation; trajectory states are those of the reference point.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// The motion.
    pub trajectory: Trajectory,
    /// Contact modes over time.
    pub contact_modes: Vec<ContactModeSpan>,
    /// Steps in which a contact would have had to pull.
    pub separations: Vec<Separation>,
    /// Slip reversals.
    pub slip_reversals: usize,
}

/// Integrates one torque schedule.
pub fn simulate(_input: &SimulateInput) -> Simulation {
    panic!("the simulator is not here yet")
}
