//! A motion whose robot, torques or start differ from what they should be.
//!
//! Starts and ends are those of the axle midpoint, which stays in its place where the centre of mass does not.

use nalgebra::{Rotation2, Vector2};

use super::{LimitUse, ROUNDING, STEP_LIMIT, motion_with_limits};
use crate::robot::{Payload, PerWheel, Robot, RobotParameters, State, check_robot, joined};
use crate::rules::{Checks, Number, Rule, Violations};
use crate::shooting::{PathLimits, ReferencePoint, check_state};
use crate::simulation::{Rollout, Simulator, TorqueSchedule, control_interval};
use crate::stop::{Stop, Stopped};

/// Most intervals and steps of a motion after a delay.
#[derive(Debug, Clone, Copy)]
struct Most {
    intervals: usize,
    steps: usize,
}

/// Of one that a simulation can be asked for.
const AS_ASKED: Most = Most { intervals: 1_000, steps: STEP_LIMIT };
/// Of one that is rolled out: as many as a delay of the longest plan's own time takes.
const ROLLED_OUT: Most = Most { intervals: 2 * STEP_LIMIT, steps: 2 * STEP_LIMIT };
const DELAY_RULE: Rule = Rule::at_least(0.0, "s");

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
    /// Torques of the right wheel.
    TorqueRight,
    /// Mass of the payload.
    PayloadMass,
    /// Place of the payload, to the right.
    PayloadRight,
    /// Place of the payload, forward.
    PayloadForward,
    /// World x of the start.
    StartX,
    /// World y of the start.
    StartY,
    /// Time for which the left wheel holds zero torque before its schedule begins.
    DelayLeft,
    /// Time for which the right wheel holds zero torque before its schedule begins.
    DelayRight,
}

impl ChangedParameter {
    /// The unit of a change: a share multiplies the value by 1 + change, anything else is added.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Friction | Self::Mass | Self::Torque | Self::TorqueLeft | Self::TorqueRight => "share",
            Self::StartHeading => "rad",
            Self::PayloadMass => "kg",
            Self::CenterOfMassRight
            | Self::CenterOfMassForward
            | Self::PayloadRight
            | Self::PayloadForward
            | Self::StartX
            | Self::StartY => "m",
            Self::DelayLeft | Self::DelayRight => "s",
        }
    }
}

/// A motion as it should be.
#[derive(Debug, Clone)]
pub struct Undisturbed {
    /// The robot without its load.
    pub bare_robot: RobotParameters,
    /// What it carries.
    pub payload: Option<Payload>,
    /// At the axle midpoint.
    pub start: State,
    /// As a simulation reads it: of the length that the length of an interval rounds to.
    pub schedule: TorqueSchedule,
    /// Number of time steps.
    pub step_count: usize,
    /// From the axle midpoint to the point whose start keeps the rules, in the body frame (right, forward), m.
    pub from_axle: Vector2<f64>,
}

/// A motion under changes that the rules admit.
#[derive(Debug, Clone)]
pub struct Disturbed {
    /// The robot without its load.
    pub bare_robot: RobotParameters,
    /// What it carries.
    pub payload: Option<Payload>,
    /// The robot that moves.
    pub robot: Robot,
    /// At the axle midpoint.
    pub start: State,
    /// The torques.
    pub schedule: TorqueSchedule,
    /// Number of time steps.
    pub step_count: usize,
    /// The torques before any delay, which changes nothing of how fast they change.
    commanded: TorqueSchedule,
}

impl Undisturbed {
    /// The motion of these torques from a start at the reference point.
    pub fn new(
        (bare_robot, payload): (RobotParameters, Option<Payload>),
        (reference_point, start): (ReferencePoint, &State),
        (schedule, step_count): (&TorqueSchedule, usize),
    ) -> Self {
        let moving = joined(&bare_robot, payload.as_ref());
        let to_axle = reference_point.to_axle_midpoint(&moving);
        let start = start.moved_by(to_axle);
        Self { bare_robot, payload, start, schedule: as_read(schedule.clone()), step_count, from_axle: -to_axle }
    }

    /// The motion without changes.
    ///
    /// # Panics
    /// When robot and payload break their rules, which those of a validated request do not.
    pub fn unchanged(&self) -> Disturbed {
        self.under(&[]).expect("robot and payload were checked")
    }

    /// The motion with all these changes. After a delay the torques of each step are its own.
    ///
    /// # Errors
    /// The rules that they break, by the fields of a solve; those of a delay by its name.
    pub fn under(&self, changes: &[(ChangedParameter, f64)]) -> Result<Disturbed, Violations> {
        self.changed(changes, ROLLED_OUT)
    }

    /// The same with so few intervals that a simulation can be asked for it: where the plan has more steps, some share a mean torque.
    ///
    /// # Errors
    /// As [`Undisturbed::under`].
    pub fn under_as_asked(&self, changes: &[(ChangedParameter, f64)]) -> Result<Disturbed, Violations> {
        self.changed(changes, AS_ASKED)
    }

    fn changed(&self, changes: &[(ChangedParameter, f64)], most: Most) -> Result<Disturbed, Violations> {
        let Self { mut bare_robot, mut payload, mut start, mut schedule, mut step_count, .. } = self.clone();
        let mut delay = PerWheel::new(0.0, 0.0);
        for &(parameter, change) in changes {
            let share = 1.0 + change;
            match parameter {
                ChangedParameter::Friction => {
                    bare_robot.wheel_friction_coefficient *= share;
                    bare_robot.front_friction_coefficient *= share;
                }
                ChangedParameter::Mass => {
                    bare_robot.chassis_mass *= share;
                    bare_robot.chassis_yaw_inertia *= share;
                }
                ChangedParameter::CenterOfMassRight => bare_robot.center_of_mass_right += change,
                ChangedParameter::CenterOfMassForward => bare_robot.center_of_mass_forward += change,
                ChangedParameter::Torque => {
                    scale(&mut schedule.left, share);
                    scale(&mut schedule.right, share);
                }
                ChangedParameter::TorqueLeft => scale(&mut schedule.left, share),
                ChangedParameter::TorqueRight => scale(&mut schedule.right, share),
                ChangedParameter::StartHeading => start = turned(start, change),
                ChangedParameter::StartX => start.configuration.x += change,
                ChangedParameter::StartY => start.configuration.y += change,
                ChangedParameter::PayloadMass => payload.iter_mut().for_each(|load| load.mass += change),
                ChangedParameter::PayloadRight => payload.iter_mut().for_each(|load| load.right += change),
                ChangedParameter::PayloadForward => payload.iter_mut().for_each(|load| load.forward += change),
                ChangedParameter::DelayLeft => delay.left += change,
                ChangedParameter::DelayRight => delay.right += change,
            }
        }
        let mut checks = Checks::new();
        if start != self.start {
            let start = start.moved_by(self.from_axle);
            checks.within("maneuver.start", |checks| check_state(&start, checks));
        }
        if delay != PerWheel::default() {
            check_delay(&delay, &schedule, &mut checks);
        }
        check_robot(&bare_robot, payload.as_ref(), &mut checks);
        checks.finish()?;
        let commanded = schedule.clone();
        if delay != PerWheel::default() {
            (schedule, step_count) = delayed(&schedule, step_count, (&delay, most));
        }
        let robot = Robot::new(joined(&bare_robot, payload.as_ref()))?;
        Ok(Disturbed { bare_robot, payload, robot, start, schedule, step_count, commanded })
    }

    /// Adds to `checks` what robot and payload violate.
    #[cfg(feature = "server")]
    pub(crate) fn check(&self, checks: &mut Checks) {
        check_robot(&self.bare_robot, self.payload.as_ref(), checks);
    }

    /// Steps that the motion has under a delay, s, of either wheel.
    pub fn steps_under_delay(&self, delay: f64) -> f64 {
        let intervals = self.schedule.control_count() as f64;
        let steps = self.step_count as f64 * (1.0 + (delay / self.schedule.interval()).ceil() / intervals);
        steps.min(ROLLED_OUT.steps as f64)
    }
}

impl Disturbed {
    /// The end at the axle midpoint, with the number of times that a contact separates and what is used of these limits.
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub(crate) fn end_with_limits(
        &self,
        limits: &PathLimits,
        stop: Stop,
    ) -> Result<(State, usize, Vec<LimitUse>), Stopped> {
        let (simulator, offset) = (Simulator::new(&self.robot), self.robot.parameters().axle_midpoint());
        let start = self.start.moved_by(-offset);
        let rollout = Rollout { start: &start, schedule: &self.schedule, step_count: self.step_count };
        let (motion, uses) = motion_with_limits(&simulator, limits, (&rollout, &self.commanded), stop)?;
        Ok((simulator.end_frame(&rollout, offset).state(&motion.end), motion.separations, uses))
    }

    /// The end at the axle midpoint, with the number of times that a contact separates.
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn end(&self, stop: Stop) -> Result<(State, usize), Stopped> {
        self.end_with_limits(&PathLimits::default(), stop).map(|(end, separations, _)| (end, separations))
    }
}

/// The schedule that a simulation reads from its torques and the length of an interval.
fn as_read(mut schedule: TorqueSchedule) -> TorqueSchedule {
    schedule.final_time = schedule.interval() * schedule.control_count() as f64;
    schedule
}

fn check_delay(delay: &PerWheel<f64>, schedule: &TorqueSchedule, checks: &mut Checks) {
    let before = checks.count();
    let (left, right) = (("delay_left", delay.left), ("delay_right", delay.right));
    for (name, delay) in [left, right] {
        checks.bounds(name, delay, &DELAY_RULE);
    }
    if checks.count() > before {
        return;
    }
    let (name, longest) = if left.1 > right.1 { left } else { right };
    let with_delay = schedule.control_count() as f64 + (longest / schedule.interval()).ceil();
    let fits = with_delay <= AS_ASKED.intervals as f64;
    checks.require(name, Number(longest), fits, "a delay of at most 1000 intervals in all", None);
}

/// The torques that each wheel begins after its delay, in equal parts: the steps, or several of them where these are too many. A part
/// within which a torque changes holds the mean of it; the end of the slower wheel is rounded up to that of a part.
fn delayed(
    schedule: &TorqueSchedule,
    step_count: usize,
    (delay, most): (&PerWheel<f64>, Most),
) -> (TorqueSchedule, usize) {
    let (count, final_time) = (schedule.control_count(), schedule.final_time);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: 0 to 1,000")]
    let whole = |parts: f64| parts as usize;
    let longest = delay.left.max(delay.right);
    let intervals = count + whole((longest / schedule.interval()).ceil());
    let part_count = if step_count * intervals <= count * most.intervals {
        step_count
    } else {
        // Equal parts of each interval, each of as few whole steps as leave few enough of them.
        let per_interval = step_count.div_ceil(count);
        count * per_interval.div_ceil(per_interval.div_ceil(most.intervals / intervals))
    };
    let part = final_time / part_count as f64;
    let shift = |delay: f64| {
        let parts = delay / part;
        // A whole number of parts but for rounding is one.
        let parts = if (parts - parts.round()).abs() <= ROUNDING { parts.round() } else { parts };
        (whole(parts), parts.fract())
    };
    let (parts, rest) = shift(longest);
    let with_delay = part_count + parts + usize::from(rest > 0.0);
    let of_wheel = |torques: &[f64], delay: f64| -> Vec<f64> {
        let (parts, rest) = shift(delay);
        let held = |part: usize, later: usize| {
            let from = part.checked_sub(later).filter(|from| *from < part_count);
            from.map_or(0.0, |from| torques[control_interval(from, part_count, count)])
        };
        // Without a rest these are the torques themselves, to the bit.
        (0..with_delay).map(|part| (1.0 - rest) * held(part, parts) + rest * held(part, parts + 1)).collect()
    };
    let (left, right) = (of_wheel(&schedule.left, delay.left), of_wheel(&schedule.right, delay.right));
    let steps_per_part = step_count.div_ceil(part_count).min(most.steps / with_delay);
    let final_time = part * with_delay as f64;
    (as_read(TorqueSchedule { final_time, left, right }), steps_per_part * with_delay)
}

fn scale(torques: &mut [f64], share: f64) {
    for torque in torques {
        *torque *= share;
    }
}

/// The same motion, turned about the point that the state speaks of.
fn turned(mut state: State, angle: f64) -> State {
    state.configuration.heading += angle;
    let velocity = Rotation2::new(angle) * Vector2::new(state.velocity.x, state.velocity.y);
    (state.velocity.x, state.velocity.y) = (velocity.x, velocity.y);
    state
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planned(step_count: usize) -> Undisturbed {
        let schedule = TorqueSchedule { final_time: 0.4, left: vec![1.0, 2.0], right: vec![3.0, 4.0] };
        let start = (ReferencePoint::AxleMidpoint, &State::default());
        Undisturbed::new((RobotParameters::default(), None), start, (&schedule, step_count))
    }

    #[test]
    fn delayed_wheel_holds_zero_torque_first_and_the_other_one_last() {
        let changes = [(ChangedParameter::DelayLeft, 0.1), (ChangedParameter::DelayRight, 0.06)];
        // Two parts of 0.1 s per interval, since it has two steps; the right wheel begins within the first.
        let Disturbed { schedule, step_count, .. } = planned(4).under(&changes).unwrap();
        assert_eq!(schedule.left, [0.0, 1.0, 1.0, 2.0, 2.0]);
        for (torque, mean) in schedule.right.iter().zip([1.2, 3.0, 3.4, 4.0, 2.4]) {
            assert!((torque - mean).abs() < 1e-14, "{:?}", schedule.right);
        }
        assert_eq!(step_count, 5);
        assert!((schedule.final_time - 0.5).abs() < 1e-15);
        let Disturbed { schedule, step_count, .. } = planned(40).under(&changes).unwrap();
        assert_eq!((schedule.left.len(), schedule.right.len(), step_count), (50, 50, 50));
        assert_eq!(schedule.right.iter().filter(|&&torque| torque == 0.0).count(), 10);
        assert_eq!((schedule.right[5], schedule.right[6], schedule.right[49]), (0.0, 3.0, 0.0));
    }

    #[test]
    fn delays_keep_the_steps_and_the_impulse() {
        for (step_count, delay) in
            [(4, 1e-4), (5, 0.05), (7, 0.33), (674, 1e-6), (1001, 0.01), (10_000, 0.02), (1999, 0.7)]
        {
            let (planned, change) = (planned(step_count), [(ChangedParameter::DelayLeft, delay)]);
            let step = 0.4 / step_count as f64;
            for (delayed, most) in [(planned.under(&change), ROLLED_OUT), (planned.under_as_asked(&change), AS_ASKED)] {
                let Disturbed { schedule, step_count: steps, .. } = delayed.unwrap();
                assert!(schedule.control_count() <= most.intervals && steps <= most.steps);
                assert!(steps.is_multiple_of(schedule.control_count()));
                // Of whole steps there may be half of the parts that there might be.
                assert!(schedule.control_count() >= step_count.min(most.intervals) / 2, "{step_count}: {schedule:?}");
                assert!(schedule.final_time / steps as f64 <= 1.1 * step, "{step_count} become {steps}");
                let with_part = 0.4 + delay + schedule.interval();
                assert!(schedule.final_time >= 0.4 + delay - 1e-12 && schedule.final_time <= with_part);
                let impulse = |torques: &[f64]| schedule.interval() * torques.iter().sum::<f64>();
                // Where steps cross the ends of intervals, the midpoints of a plan favour some.
                let slack = if step_count.is_multiple_of(2) { 1e-12 } else { step };
                assert!((impulse(&schedule.left) - 0.6).abs() < slack);
                assert!((impulse(&schedule.right) - 1.4).abs() < slack);
            }
        }
    }

    #[test]
    fn delay_within_a_step_is_that_of_the_step_however_many_there_are() {
        // A quarter of a step later: its torque is the mean of both.
        let (planned, change) = (planned(4_000), [(ChangedParameter::DelayLeft, 2.5e-5)]);
        let schedule = planned.under(&change).unwrap().schedule;
        assert_eq!(schedule.control_count(), 4_001);
        for (step, torque) in [(0, 0.75), (1, 1.0), (1_999, 1.0), (2_000, 1.75), (2_001, 2.0), (4_000, 0.5)] {
            assert!((schedule.left[step] - torque).abs() < 1e-9, "{step}: {}", schedule.left[step]);
        }
        assert!(planned.under_as_asked(&change).unwrap().schedule.control_count() <= 1_000);
    }

    #[test]
    fn delay_leaves_the_torque_rate() {
        let limits = PathLimits { torque_rate: Some(6.0), ..PathLimits::default() };
        let changes = [(ChangedParameter::DelayLeft, 1e-3), (ChangedParameter::DelayRight, 0.05)];
        let uses = |changes| planned(40).under(changes).unwrap().end_with_limits(&limits, Stop::never()).unwrap().2;
        let delayed = uses(&changes);
        // By 1 N m in 0.2 s.
        assert!((delayed[0].largest - 5.0).abs() < 1e-12 && delayed == uses(&[]), "{delayed:?}");
    }

    #[test]
    fn wheels_that_begin_late_together_move_alike() {
        for step_count in [60, 90, 200, 10_000] {
            let mut planned = planned(step_count);
            planned.schedule =
                TorqueSchedule { final_time: 1.0, left: vec![0.5, -0.2, 0.1], right: vec![0.4, 0.1, -0.3] };
            let end = |delay: f64| {
                let changes = [(ChangedParameter::DelayLeft, delay), (ChangedParameter::DelayRight, delay)];
                planned.under(&changes).unwrap().end(Stop::never()).unwrap().0.configuration
            };
            let (prompt, late) = (end(0.0), end(10.0 / 60.0));
            let apart = [late.x - prompt.x, late.y - prompt.y, late.heading - prompt.heading];
            assert!(apart.iter().all(|apart| apart.abs() < 0.02), "{step_count}: {apart:?}");
        }
    }

    #[test]
    fn impossible_delays_are_refused_by_name() {
        let field = |change| planned(4).under(&[change]).unwrap_err().list()[0].field.clone();
        assert_eq!(field((ChangedParameter::DelayLeft, -1e-3)), "delay_left");
        assert_eq!(field((ChangedParameter::DelayRight, 200.0)), "delay_right");
        assert_eq!(field((ChangedParameter::DelayRight, f64::INFINITY)), "delay_right");
        assert!(planned(4).under(&[(ChangedParameter::DelayRight, 199.0)]).is_ok());
    }

    #[test]
    fn changes_add_up() {
        let changes = [(ChangedParameter::Torque, 0.5), (ChangedParameter::TorqueRight, 0.5)];
        let Disturbed { schedule, .. } = planned(4).under(&changes).unwrap();
        assert_eq!((schedule.left[0], schedule.right[0]), (1.5, 6.75));
    }
}
