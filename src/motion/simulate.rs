//! One rollout of a given torque schedule.

use super::{LimitUse, PAPER_STEP_COUNT, TIME_RULE, check_schedule, limit_uses, rules_of_schedule};
use crate::robot::{Payload, Robot, RobotParameters, State, check_robot, joined};
use crate::rules::{Checks, Rule, RuleSet, Violations};
use crate::shooting::{Aisle, AisleCorners, ManeuverLimits, PathLimits, ReferencePoint, check_state, rules_of_state};
use crate::simulation::{ContactMethod, Rollout, Simulator, TorqueSchedule, Trajectory};
use crate::stop::{Stop, Stopped};

const STEP_RULE: Rule = Rule::at_least(1.0, "");
/// The field of the aisle.
const KEEP_IN: &str = "keep_in";
/// Arrays of a torque schedule, left and right.
const SCHEDULE_ARRAYS: (&str, &str) = ("left_n_m", "right_n_m");

/// A validated simulation.
#[derive(Debug, Clone)]
pub struct SimulateInput {
    /// The robot, what it carries joined to its chassis.
    pub robot: Robot,
    /// The robot without its load.
    pub bare_robot: RobotParameters,
    /// What it carries.
    pub payload: Option<Payload>,
    /// The point that the start and the answer speak of.
    pub reference_point: ReferencePoint,
    /// Start state at the reference point.
    pub start: State,
    /// What the motion is compared with.
    pub limits: ManeuverLimits,
    /// Where the robot should stay.
    pub aisle: Option<Aisle>,
    /// The torques.
    pub schedule: TorqueSchedule,
    /// Number of time steps.
    pub step_count: usize,
    /// The solver of the one-step friction problem.
    pub contact_method: ContactMethod,
}

/// A simulation before it is validated; [`Default`] is the reference robot at rest, without torques.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulateParameters {
    /// The robot without its load.
    pub robot: RobotParameters,
    /// What it carries.
    pub payload: Option<Payload>,
    /// The point that the start and the answer speak of.
    pub reference_point: ReferencePoint,
    /// Start state at the reference point.
    pub start: State,
    /// What the motion is compared with.
    pub limits: ManeuverLimits,
    /// Where the robot should stay.
    pub aisle: AisleCorners,
    /// The torques; at least one interval is required.
    pub schedule: TorqueSchedule,
    /// Number of time steps.
    pub step_count: usize,
    /// The solver of the one-step friction problem.
    pub contact_method: ContactMethod,
}

impl Default for SimulateParameters {
    fn default() -> Self {
        Self {
            robot: RobotParameters::default(),
            payload: None,
            reference_point: ReferencePoint::default(),
            start: State::default(),
            limits: ManeuverLimits::default(),
            aisle: AisleCorners::default(),
            schedule: TorqueSchedule::empty(),
            step_count: PAPER_STEP_COUNT,
            contact_method: ContactMethod::default(),
        }
    }
}

impl SimulateParameters {
    /// The rules of all fields, by their paths in the contract.
    pub fn rules() -> RuleSet {
        RuleSet::of([("grid.steps", STEP_RULE)])
            .across(&["grid.steps", "torque_schedule.left_n_m"], "at least as many steps as torques per wheel")
            .with("robot", RobotParameters::rules())
            .with("payload", Payload::rules())
            .with("start", rules_of_state())
            .with("limits", ManeuverLimits::rules())
            .and(AisleCorners::rules(KEEP_IN))
            .with("torque_schedule", rules_of_schedule("interval_s", SCHEDULE_ARRAYS))
    }

    /// Adds the violated rules to `checks`; gives the aisle, if there is one.
    fn check(&self, checks: &mut Checks) -> Option<Aisle> {
        check_robot(&self.robot, self.payload.as_ref(), checks);
        checks.within("start", |checks| check_state(&self.start, checks));
        checks.within("limits", |checks| self.limits.check(checks));
        let aisle = self.aisle.check(KEEP_IN, checks);
        checks.within("torque_schedule", |checks| {
            // Without torques there is no interval, which is another violation.
            if self.schedule.control_count() > 0 {
                checks.bounds("interval_s", self.schedule.interval(), &TIME_RULE);
            }
            check_schedule(&self.schedule, SCHEDULE_ARRAYS, None, checks);
        });
        checks.bounds("grid.steps", self.step_count as f64, &STEP_RULE);
        let intervals = self.schedule.control_count();
        let rule = format!("at least the number of torques per wheel ({intervals})");
        checks.require("grid.steps", self.step_count, self.step_count >= intervals, &rule, Some(intervals as f64));
        aisle
    }
}

impl SimulateInput {
    /// Validates a simulation.
    ///
    /// # Errors
    /// All violated rules, with field names of the public contract.
    pub fn new(parameters: SimulateParameters) -> Result<Self, Violations> {
        let mut checks = Checks::new();
        let aisle = parameters.check(&mut checks);
        checks.finish()?;
        Ok(Self {
            robot: Robot::new(joined(&parameters.robot, parameters.payload.as_ref()))?,
            bare_robot: parameters.robot,
            payload: parameters.payload,
            reference_point: parameters.reference_point,
            start: parameters.start,
            limits: parameters.limits,
            aisle,
            schedule: parameters.schedule,
            step_count: parameters.step_count,
            contact_method: parameters.contact_method,
        })
    }
}

/// The answer of a simulation; trajectory states are those of the reference point.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// The motion.
    pub trajectory: Trajectory,
    /// Steps for whose friction problem a second solution was found, in the motion by the exact contact solver.
    pub indeterminate_steps: usize,
    /// How far each limit that was given is used.
    pub limits: Vec<LimitUse>,
}

/// Integrates one torque schedule.
///
/// # Errors
/// When it was stopped before the end.
pub fn simulate(input: &SimulateInput, stop: Stop) -> Result<Simulation, Stopped> {
    let offset = input.reference_point.offset(input.robot.parameters());
    let start = input.start.moved_by(-offset);
    let rollout = Rollout { start: &start, schedule: &input.schedule, step_count: input.step_count };
    let simulator = Simulator::new(&input.robot);
    let mut trajectory = simulator.trajectory(&rollout, input.contact_method, stop)?;
    let limited = (&input.limits, input.reference_point);
    let limits = PathLimits::new(&input.robot, limited, input.payload.as_ref(), input.aisle.as_ref());
    let limits = limit_uses(&simulator, &limits, &rollout, stop)?;
    let indeterminate_steps = simulator.indeterminate_steps(&rollout, stop)?;
    trajectory.move_states_by(offset);
    Ok(Simulation { trajectory, indeterminate_steps, limits })
}
