//! How a maneuver is to be solved, and the validated input of a solve.

use nalgebra::Vector2;

use super::course::first_steps;
use crate::motion::{
    PAPER_STEP_COUNT, ROUNDING, STEP_LIMIT, SimulateInput, TIME_RULE, Undisturbed, check_schedule, rules_of_schedule,
};
use crate::robot::{Payload, Robot, RobotParameters, check_robot, joined};
use crate::rules::{BoundedField, Checks, Rule, RuleSet, Violations};
use crate::shooting::{Aisle, AisleCorners, Maneuver, PathLimits, limited_point};
use crate::simulation::{ContactMethod, TorqueSchedule};

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

/// Which of the local optima is the answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Choice {
    /// The fastest.
    #[default]
    Fastest,
    /// Of those that are nearly as fast, the one whose end shifts least under less friction.
    Steadiest,
}

/// Whether the time grid may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refinement {
    /// The plan is made for the grid asked for.
    Fixed,
    /// The grid is refined, warm, until the plan's replay is within tolerance, up to this many steps.
    UntilConfirmed {
        /// Most steps.
        step_limit: usize,
    },
}

/// Grid, search effort and tolerances of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverSettings {
    /// The optimiser.
    pub method: Method,
    /// Number of time steps, at first; automatic ones of a long drive begin with more.
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
    /// Which of the local optima is the answer.
    pub choice: Choice,
    /// How much slower than the fastest one it may be, as a share of that one's final time.
    pub choose_within: f64,
}

/// Loosest replay tolerances, m and rad: any miss is within.
const LOOSEST_REPLAY: f64 = 100.0;
/// m and rad.
const REPLAY_TOLERANCE: f64 = 1e-3;

impl SolverSettings {
    const RULES: [BoundedField<Self>; 8] = [
        ("grid.steps", |settings| settings.step_count as f64, Rule::at_least(1.0, "")),
        ("grid.control_intervals", |settings| settings.control_count as f64, Rule::at_least(1.0, "")),
        ("solver.starts", |settings| settings.start_count as f64, Rule::at_least(1.0, "")),
        ("solver.rollout_limit", |settings| settings.rollout_limit as f64, Rule::at_least(1.0, "")),
        ("solver.goal_tolerance", |settings| settings.goal_tolerance, Rule::between(ROUNDING, 1.0, "")),
        ("solver.replay_tolerance_m", |settings| settings.replay_tolerance_position, replay_rule("m")),
        ("solver.replay_tolerance_rad", |settings| settings.replay_tolerance_heading, replay_rule("rad")),
        ("solver.choose_within", |settings| settings.choose_within, Rule::between(0.0, 1.0, "")),
    ];

    /// The rules of all settings, by their paths in the contract.
    pub fn rules() -> RuleSet {
        RuleSet::of(Self::RULES.map(|(field, _, rule)| (field, rule))).across(
            &["grid.control_intervals", "grid.steps"],
            "no more control intervals than steps: an interval without a step has no effect",
        )
    }

    /// Steps of the finest grid that may be tried: with automatic steps the last one within their limit on which all control
    /// intervals are equally long.
    pub fn finest_step_count(&self) -> usize {
        match self.refinement {
            Refinement::UntilConfirmed { step_limit } if step_limit < self.control_count => step_limit,
            Refinement::UntilConfirmed { step_limit } => step_limit / self.control_count * self.control_count,
            Refinement::Fixed => self.step_count,
        }
    }
}

impl Default for SolverSettings {
    fn default() -> Self {
        Self {
            method: Method::SequentialLinear,
            step_count: PAPER_STEP_COUNT,
            refinement: Refinement::UntilConfirmed { step_limit: STEP_LIMIT },
            control_count: 40,
            start_count: 36,
            seed: 0,
            rollout_limit: 2_000_000,
            goal_tolerance: 1e-6,
            replay_tolerance_position: REPLAY_TOLERANCE,
            replay_tolerance_heading: REPLAY_TOLERANCE,
            choice: Choice::Fastest,
            choose_within: 0.01,
        }
    }
}

/// A solve before it is validated; [`Default`] is the paper's forward drive by the default search.
#[derive(Debug, Clone, PartialEq)]
pub struct SolveParameters {
    /// The robot without its load.
    pub robot: RobotParameters,
    /// What it carries.
    pub payload: Option<Payload>,
    /// The maneuver.
    pub maneuver: Maneuver,
    /// Where the robot must stay.
    pub aisle: AisleCorners,
    /// Grid, effort, tolerances.
    pub settings: SolverSettings,
    /// The caller's own start of the search, tried first.
    pub initial_guess: Option<TorqueSchedule>,
}

impl Default for SolveParameters {
    fn default() -> Self {
        Self {
            robot: RobotParameters::default(),
            payload: None,
            maneuver: Maneuver::forward_drive(),
            aisle: AisleCorners::default(),
            settings: SolverSettings::default(),
            initial_guess: None,
        }
    }
}

impl SolveParameters {
    /// The paper's forward drive on the paper's grid, from the straight start alone, which leads to the paper's family of
    /// plans. The default search finds faster ones that drift.
    pub fn forward_drive() -> Self {
        let settings = SolverSettings { start_count: 1, refinement: Refinement::Fixed, ..SolverSettings::default() };
        Self { settings, ..Self::default() }
    }

    /// The rules of all fields, by their paths in the contract.
    pub fn rules() -> RuleSet {
        let guess = rules_of_schedule("final_time_s", GUESS_ARRAYS)
            .across(&[GUESS_ARRAYS.0, GUESS_ARRAYS.1], "no torque exceeds the torque limit of its wheel");
        SolverSettings::rules()
            .with("robot", RobotParameters::rules())
            .with("payload", Payload::rules())
            .with("maneuver", Maneuver::rules())
            .and(AisleCorners::rules(KEEP_IN))
            .with("initial_guess", guess)
    }

    /// Adds the violated rules to `checks`; gives the aisle, if there is one.
    fn check(&self, checks: &mut Checks) -> Option<Aisle> {
        check_robot(&self.robot, self.payload.as_ref(), checks);
        checks.within("maneuver", |checks| self.maneuver.check(checks));
        let aisle = self.aisle.check(KEEP_IN, checks);
        check_settings(&self.settings, checks);
        if let Some(guess) = &self.initial_guess {
            checks.within("initial_guess", |checks| {
                checks.bounds("final_time_s", guess.final_time, &TIME_RULE);
                check_schedule(guess, GUESS_ARRAYS, Some(self.maneuver.torque_limit), checks);
            });
        }
        aisle
    }
}

/// A validated solve: everything that the answer depends on, wall time aside.
#[derive(Debug, Clone)]
pub struct SolveInput {
    /// The robot, what it carries joined to its chassis.
    pub robot: Robot,
    /// The robot without its load.
    pub bare_robot: RobotParameters,
    /// What it carries.
    pub payload: Option<Payload>,
    /// The maneuver.
    pub maneuver: Maneuver,
    /// Where the robot must stay.
    pub aisle: Option<Aisle>,
    /// Grid, effort, tolerances.
    pub settings: SolverSettings,
    /// The caller's own start of the search, tried first.
    pub initial_guess: Option<TorqueSchedule>,
}

impl SolveInput {
    /// Validates a solve.
    ///
    /// # Errors
    /// All violated rules, with field names of the public contract.
    pub fn new(parameters: SolveParameters) -> Result<Self, Violations> {
        let mut checks = Checks::new();
        let aisle = parameters.check(&mut checks);
        checks.finish()?;
        let SolveParameters { robot: bare_robot, payload, maneuver, aisle: _, settings, initial_guess } = parameters;
        let robot = Robot::new(joined(&bare_robot, payload.as_ref()))?;
        let settings = SolverSettings { step_count: first_steps(&settings, robot.parameters(), &maneuver), ..settings };
        Ok(Self { robot, bare_robot, payload, maneuver, aisle, settings, initial_guess })
    }

    /// The motion of torques that were found for it, compared with what it must keep.
    pub fn motion_of(&self, schedule: TorqueSchedule, step_count: usize) -> SimulateInput {
        let Self { robot, bare_robot, payload, maneuver, aisle, .. } = self.clone();
        let (reference_point, start, limits) = (maneuver.reference_point, maneuver.start, maneuver.limits);
        let contact_method = ContactMethod::Exact;
        SimulateInput {
            robot,
            bare_robot,
            payload,
            reference_point,
            start,
            limits,
            aisle,
            schedule,
            step_count,
            contact_method,
        }
    }

    /// The motion of a plan of so many steps, by which changes are judged.
    pub(super) fn undisturbed(&self, plan: (&TorqueSchedule, usize)) -> Undisturbed {
        let start = (self.maneuver.reference_point, &self.maneuver.start);
        Undisturbed::new((self.bare_robot, self.payload), start, plan)
    }

    /// What the plan must keep on the way, beside the normal forces.
    pub fn path_limits(&self) -> PathLimits {
        PathLimits::of_maneuver(&self.robot, &self.maneuver, self.payload.as_ref(), self.aisle.as_ref())
    }

    /// Whether the start meets the goal, in no time and without motion.
    pub(super) fn starts_at_goal(&self) -> bool {
        self.maneuver.goal_error(&self.maneuver.start).amax() <= self.settings.goal_tolerance
    }

    /// The point that limits of speeds and accelerations speak of, relative to the chassis centre of mass, (right, forward), m.
    pub(super) fn limited_point(&self) -> Vector2<f64> {
        limited_point(self.robot.parameters(), self.maneuver.reference_point, self.payload.as_ref())
    }

    /// [`SolveParameters::forward_drive`], validated.
    ///
    /// # Panics
    /// Never: the case is valid.
    pub fn forward_drive() -> Self {
        Self::new(SolveParameters::forward_drive()).expect("the paper's case is valid")
    }
}

/// The field of the aisle.
const KEEP_IN: &str = "maneuver.keep_in";
/// Arrays of an initial guess, left and right.
const GUESS_ARRAYS: (&str, &str) = ("torque_left_n_m", "torque_right_n_m");

/// Of a replay tolerance in this unit.
const fn replay_rule(unit: &'static str) -> Rule {
    Rule::between(ROUNDING, LOOSEST_REPLAY, unit)
}

fn check_settings(settings: &SolverSettings, checks: &mut Checks) {
    for (field, value, rule) in SolverSettings::RULES {
        checks.bounds(field, value(settings), &rule);
    }
    let (steps, controls) = (settings.step_count, settings.control_count);
    let rule = format!("at most grid.steps ({steps}): an interval without a step has no effect");
    checks.require("grid.control_intervals", controls, controls <= steps, &rule, Some(steps as f64));
}
