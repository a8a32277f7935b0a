//! One rollout of a given torque schedule.

use super::violations_of_schedule;
use crate::robot::{Robot, RobotParameters, State};
use crate::shooting::{ReferencePoint, check_state};
use crate::simulation::{ContactMethod, ContactModeSpan, Rollout, Separation, Simulator, TorqueSchedule, Trajectory};
use crate::violation::{Checks, Violations};

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
    /// The solver of the one-step friction problem.
    pub contact_method: ContactMethod,
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
        (step_count, contact_method): (usize, ContactMethod),
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
        Ok(Self { robot: Robot::new(robot)?, reference_point, start, schedule, step_count, contact_method })
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
pub fn simulate(input: &SimulateInput) -> Simulation {
    let offset = input.reference_point.offset(input.robot.parameters());
    let start = input.start.moved_by(-offset);
    let rollout = Rollout { start: &start, schedule: &input.schedule, step_count: input.step_count };
    let mut trajectory = Simulator::new(&input.robot).trajectory(&rollout, input.contact_method);
    trajectory.move_states_by(offset);
    Simulation {
        contact_modes: trajectory.contact_modes(),
        separations: trajectory.separations(),
        slip_reversals: trajectory.slip_reversals(),
        trajectory,
    }
}
