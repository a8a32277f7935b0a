//! How far a plan ends from its own end where robot, torques or start are a little different from what it was made for.
//!
//! Each change is one rollout of the same torques by Coulomb's law, whatever law the search held the wheels by. Starts and ends
//! are those of the axle midpoint, which stays in its place where the centre of mass does not.

use nalgebra::Rotation2;

use super::carried::{check_robot, joined};
use super::certificate::finite_or_largest;
use super::settings::{SolveInput, SolverSettings};
use crate::robot::{Robot, RobotParameters, State};
use crate::rules::{Checks, Violations};
use crate::shooting::check_state;
use crate::simulation::{Rollout, Simulator, TorqueSchedule};
use crate::stop::{Stop, Stopped};

/// What may differ from what a plan was made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChangedParameter {
    /// Friction coefficients of wheels and front support.
    Friction,
    /// Mass and yaw inertia of the chassis.
    Mass,
    /// Centre of mass of the chassis, to the right.
    CenterOfMassRight,
    /// Centre of mass of the chassis, forward.
    CenterOfMassForward,
    /// Torques of both wheels.
    Torque,
    /// Torques of the left wheel.
    TorqueLeft,
    /// Heading of the start, which turns the velocity of the axle midpoint too.
    StartHeading,
}

impl ChangedParameter {
    /// Each parameter with the size of its changes, in its unit.
    const CHANGES: [(Self, f64); 7] = [
        (Self::Friction, FRICTION_CHANGE),
        (Self::Mass, 0.05),
        (Self::CenterOfMassRight, 0.01),
        (Self::CenterOfMassForward, 0.01),
        (Self::Torque, 0.02),
        (Self::TorqueLeft, 0.02),
        (Self::StartHeading, 0.5 * std::f64::consts::PI / 180.0),
    ];

    /// The unit of a change: a share multiplies the value by 1 + change, anything else is added.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Friction | Self::Mass | Self::Torque | Self::TorqueLeft => "share",
            Self::CenterOfMassRight | Self::CenterOfMassForward => "m",
            Self::StartHeading => "rad",
        }
    }

    /// The name in the public contract.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Friction => "friction",
            Self::Mass => "mass",
            Self::CenterOfMassRight => "center_of_mass_right",
            Self::CenterOfMassForward => "center_of_mass_forward",
            Self::Torque => "torque",
            Self::TorqueLeft => "torque_left",
            Self::StartHeading => "start_heading",
        }
    }
}

/// As a share.
const FRICTION_CHANGE: f64 = 0.1;

/// What a change does to the end of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivity {
    /// What is changed.
    pub parameter: ChangedParameter,
    /// By how much, in the unit of the parameter.
    pub change: f64,
    /// The shift of the end, or the field whose rule refuses the change.
    pub outcome: Result<EndShift, String>,
}

/// From the end of a plan to the end of the changed motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndShift {
    /// Distance of the axle midpoints, m; the largest number where the motion diverges.
    pub distance: f64,
    /// Magnitude of the difference of the headings, not wrapped, rad; the largest number where the motion diverges.
    pub angle: f64,
    /// Whether a contact lifts on the way.
    pub separates: bool,
}

impl EndShift {
    /// In units of the replay's tolerances; none is larger than that of a motion that leaves the model.
    pub(super) fn relative(&self, settings: &SolverSettings) -> f64 {
        if self.separates {
            return f64::INFINITY;
        }
        (self.distance / settings.replay_tolerance_position).max(self.angle / settings.replay_tolerance_heading)
    }
}

/// All changes of a plan, smaller values first; nothing where nothing moves.
///
/// # Errors
/// When it was stopped before the end.
pub(super) fn sensitivity(
    input: &SolveInput,
    (schedule, step_count): (&TorqueSchedule, usize),
    stop: Stop,
) -> Result<Vec<Sensitivity>, Stopped> {
    if schedule.control_count() == 0 {
        return Ok(Vec::new());
    }
    let plan = Plan::new(input, (schedule, step_count), stop)?;
    let changes = ChangedParameter::CHANGES.into_iter();
    changes.flat_map(|(parameter, size)| [-size, size].map(|change| plan.under(parameter, change, stop))).collect()
}

/// The shift of a plan's end under less friction, which no rule refuses.
///
/// # Errors
/// When it was stopped before the end.
pub(super) fn friction_shift(
    input: &SolveInput,
    plan: (&TorqueSchedule, usize),
    stop: Stop,
) -> Result<Option<EndShift>, Stopped> {
    let shift = Plan::new(input, plan, stop)?.under(ChangedParameter::Friction, -FRICTION_CHANGE, stop)?;
    Ok(shift.outcome.ok())
}

/// A plan and its own end.
struct Plan<'a> {
    input: &'a SolveInput,
    /// As a simulation reads it: of the length that the length of an interval rounds to.
    schedule: TorqueSchedule,
    step_count: usize,
    /// At the axle midpoint.
    start: State,
    /// At the axle midpoint.
    end: State,
}

impl<'a> Plan<'a> {
    fn new(
        input: &'a SolveInput,
        (schedule, step_count): (&TorqueSchedule, usize),
        stop: Stop,
    ) -> Result<Self, Stopped> {
        let final_time = schedule.interval() * schedule.control_count() as f64;
        let schedule = TorqueSchedule { final_time, ..schedule.clone() };
        let parameters = input.robot.parameters();
        let to_axle = parameters.axle_midpoint() - input.maneuver.reference_point.offset(parameters);
        let start = input.maneuver.start.moved_by(to_axle);
        let (end, _) = end_at_axle(&input.robot, &start, (&schedule, step_count), stop)?;
        Ok(Self { input, schedule, step_count, start, end })
    }

    fn under(&self, parameter: ChangedParameter, change: f64, stop: Stop) -> Result<Sensitivity, Stopped> {
        let outcome = match self.changed(parameter, change) {
            Ok((robot, start, schedule)) => Ok(self.shift(&robot, &start, &schedule, stop)?),
            Err(violations) => Err(violations.list()[0].field.clone()),
        };
        Ok(Sensitivity { parameter, change, outcome })
    }

    /// Robot, start at the axle midpoint and torques with a change, where the rules admit it.
    fn changed(&self, parameter: ChangedParameter, change: f64) -> Result<(Robot, State, TorqueSchedule), Violations> {
        let (mut bare, mut start, mut schedule) = (self.input.bare_robot, self.start, self.schedule.clone());
        let share = 1.0 + change;
        let mut checks = Checks::new();
        match parameter {
            ChangedParameter::Friction => {
                bare.wheel_friction_coefficient *= share;
                bare.front_friction_coefficient *= share;
            }
            ChangedParameter::Mass => {
                bare.chassis_mass *= share;
                bare.chassis_yaw_inertia *= share;
            }
            ChangedParameter::CenterOfMassRight => bare.center_of_mass_right += change,
            ChangedParameter::CenterOfMassForward => bare.center_of_mass_forward += change,
            ChangedParameter::Torque => {
                scale(&mut schedule.left, share);
                scale(&mut schedule.right, share);
            }
            ChangedParameter::TorqueLeft => scale(&mut schedule.left, share),
            ChangedParameter::StartHeading => {
                start = turned(start, change);
                self.check_start(&start, &mut checks);
            }
        }
        check_robot(&bare, self.input.payload.as_ref(), &mut checks);
        checks.finish()?;
        Ok((Robot::new(joined(&bare, self.input.payload.as_ref()))?, start, schedule))
    }

    /// The rules hold at the reference point.
    fn check_start(&self, at_axle: &State, checks: &mut Checks) {
        let parameters: &RobotParameters = self.input.robot.parameters();
        let from_axle = self.input.maneuver.reference_point.offset(parameters) - parameters.axle_midpoint();
        let start = at_axle.moved_by(from_axle);
        checks.within("maneuver", |checks| checks.within("start", |checks| check_state(&start, checks)));
    }

    fn shift(&self, robot: &Robot, start: &State, schedule: &TorqueSchedule, stop: Stop) -> Result<EndShift, Stopped> {
        let (end, separations) = end_at_axle(robot, start, (schedule, self.step_count), stop)?;
        let (end, planned) = (end.configuration, self.end.configuration);
        Ok(EndShift {
            distance: finite_or_largest((end.x - planned.x).hypot(end.y - planned.y)),
            angle: finite_or_largest((end.heading - planned.heading).abs()),
            separates: separations > 0,
        })
    }
}

/// The end of a motion, with the number of times that a contact lifts; start and end at the axle midpoint.
fn end_at_axle(
    robot: &Robot,
    start: &State,
    (schedule, step_count): (&TorqueSchedule, usize),
    stop: Stop,
) -> Result<(State, usize), Stopped> {
    let (simulator, offset) = (Simulator::new(robot), robot.parameters().axle_midpoint());
    let start = start.moved_by(-offset);
    let rollout = Rollout { start: &start, schedule, step_count };
    let (end, separations) = simulator.end_state_and_separations(&rollout, stop)?;
    Ok((simulator.end_frame(&rollout, offset).state(&end), separations))
}

fn scale(torques: &mut [f64], share: f64) {
    for torque in torques {
        *torque *= share;
    }
}

/// The same motion, turned about the point that the state speaks of.
fn turned(state: State, angle: f64) -> State {
    let mut turned = state;
    turned.configuration.heading += angle;
    let velocity = Rotation2::new(angle) * nalgebra::Vector2::new(state.velocity.x, state.velocity.y);
    (turned.velocity.x, turned.velocity.y) = (velocity.x, velocity.y);
    turned
}
