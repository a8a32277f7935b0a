//! How a maneuver is to be solved, and the validated input of a solve.

use super::violations_of_schedule;
use crate::robot::{Robot, RobotParameters};
use crate::shooting::Maneuver;
use crate::simulation::TorqueSchedule;
use crate::violation::{Checks, Violations};

/// The optimiser.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Trust-region sequential linear programming on an exact penalty.
    #[default]
    SequentialLinear,
    /// The paper's Nelder-Mead on the paper's penalty.
    NelderMead,
}

impl Method {
    /// The name in the public contract.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::SequentialLinear => "sequential_linear",
            Self::NelderMead => "nelder_mead",
        }
    }
}

/// Whether the time grid may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refinement {
    /// The plan is made for the grid asked for.
    Fixed,
    /// The grid is refined, warm, until the plan's replay is within tolerance, up to this many steps.
    UntilExecutable {
        /// Most steps.
        step_limit: usize,
    },
}

/// Grid, search effort and tolerances of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverSettings {
    /// The optimiser.
    pub method: Method,
    /// Number of time steps, at first.
    pub step_count: usize,
    /// Whether the number of steps may grow.
    pub refinement: Refinement,
    /// Torques per wheel.
    pub control_count: usize,
    /// Number of starts that the search may try.
    pub start_count: usize,
    /// Seed of all randomness.
    pub seed: u64,
    /// Most rollouts that the search may spend.
    pub rollout_limit: u64,
    /// Largest accepted magnitude of each goal error (m, rad, m/s, rad/s).
    pub goal_tolerance: f64,
    /// Largest accepted replay miss of the position, m.
    pub replay_tolerance_position: f64,
    /// Largest accepted replay miss of the heading, rad.
    pub replay_tolerance_heading: f64,
}

impl SolverSettings {
    /// The paper's number of steps.
    pub const PAPER_STEP_COUNT: usize = 200;
    /// Most steps of automatic grids, unless a caller says otherwise.
    pub const STEP_LIMIT: usize = 10_000;

    /// The grid that automatic steps start from: the paper's, or the next one on which all control intervals are equally
    /// long. On other grids the steps' midpoints favour some intervals, and finer grids would see other torques.
    pub fn first_step_count(control_count: usize) -> usize {
        Self::PAPER_STEP_COUNT.checked_next_multiple_of(control_count).unwrap_or(Self::PAPER_STEP_COUNT)
    }
}

impl Default for SolverSettings {
    fn default() -> Self {
        Self {
            method: Method::SequentialLinear,
            step_count: Self::PAPER_STEP_COUNT,
            refinement: Refinement::UntilExecutable { step_limit: Self::STEP_LIMIT },
            control_count: 40,
            start_count: 24,
            seed: 0,
            rollout_limit: 2_000_000,
            goal_tolerance: 1e-6,
            replay_tolerance_position: 1e-3,
            replay_tolerance_heading: 1e-3,
        }
    }
}

/// Tightest goal tolerance: a rollout of thousands of steps rounds to about 1e-12.
const GOAL_TOLERANCE_RANGE: (f64, f64) = (1e-9, 1.0);
const REPLAY_TOLERANCE_RANGE: (f64, f64) = (1e-9, 100.0);
const ROLLOUT_LIMIT_RANGE: (f64, f64) = (1.0, 1e9);

/// A validated solve: everything that the answer depends on, wall time aside.
#[derive(Debug, Clone)]
pub struct SolveInput {
    /// The robot.
    pub robot: Robot,
    /// The maneuver.
    pub maneuver: Maneuver,
    /// Grid, effort, tolerances.
    pub settings: SolverSettings,
    /// The caller's own start of the search, tried first.
    pub initial_guess: Option<TorqueSchedule>,
}

impl SolveInput {
    /// Validates a solve; `checks` may hold violations found before.
    ///
    /// # Errors
    /// All violated rules, those in `checks` included.
    pub fn new(
        mut checks: Checks,
        robot: RobotParameters,
        maneuver: Maneuver,
        settings: SolverSettings,
        initial_guess: Option<TorqueSchedule>,
    ) -> Result<Self, Violations> {
        checks.within("robot", |checks| robot.check(checks));
        checks.within("maneuver", |checks| maneuver.check(checks));
        check_settings(&settings, &mut checks);
        if let Some(guess) = &initial_guess {
            checks.within("initial_guess", |checks| check_guess(guess, &maneuver, checks));
        }
        checks.into_result(())?;
        Ok(Self { robot: Robot::new(robot)?, maneuver, settings, initial_guess })
    }

    /// The paper's forward drive on the reference robot and the paper's grid: from the straight start alone, which leads to the paper's family
    /// of plans. The default search finds faster ones that drift.
    ///
    /// # Panics
    /// Never: the case is valid.
    pub fn forward_drive() -> Self {
        let robot = Robot::new(RobotParameters::default()).expect("the reference robot is valid");
        let settings = SolverSettings { start_count: 1, refinement: Refinement::Fixed, ..SolverSettings::default() };
        Self { robot, maneuver: Maneuver::forward_drive(), settings, initial_guess: None }
    }
}

fn check_settings(settings: &SolverSettings, checks: &mut Checks) {
    checks.within("grid", |checks| {
        check_count("steps", settings.step_count, checks);
        check_count("control_intervals", settings.control_count, checks);
        let (steps, controls) = (settings.step_count, settings.control_count);
        let rule = format!("at most grid.steps ({steps}): an interval without a step has no effect");
        checks.require("control_intervals", controls, controls <= steps, &rule, Some(steps as f64));
    });
    checks.within("solver", |checks| {
        check_count("starts", settings.start_count, checks);
        checks.between("rollout_limit", settings.rollout_limit as f64, ROLLOUT_LIMIT_RANGE, "");
        checks.between("goal_tolerance", settings.goal_tolerance, GOAL_TOLERANCE_RANGE, "");
        checks.between("replay_tolerance_m", settings.replay_tolerance_position, REPLAY_TOLERANCE_RANGE, "m");
        checks.between("replay_tolerance_rad", settings.replay_tolerance_heading, REPLAY_TOLERANCE_RANGE, "rad");
    });
}

fn check_count(field: &str, count: usize, checks: &mut Checks) {
    checks.require(field, count, count >= 1, ">= 1", Some(1.0));
}

fn check_guess(guess: &TorqueSchedule, maneuver: &Maneuver, checks: &mut Checks) {
    checks.positive("final_time_s", guess.final_time, "s");
    violations_of_schedule(guess, ("torque_left_n_m", "torque_right_n_m"), Some(maneuver.torque_limit), checks);
}
