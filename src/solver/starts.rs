//! The starts of the search: bang-bang legs that would reach the goal if the wheels rolled without slip.
//!
//! A maneuver from rest to rest is a turn, a drive and a turn, each with full effort and full braking. Forwards and
//! backwards, either way round, gives several such plans. A moving start brakes first, a moving goal accelerates last.
//! These are only first guesses: they neglect slip, the shift of normal forces and the centre of mass off the axle.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::segments::{Segment, resampled, schedule_from_segments};
use super::settings::{Method, SolveInput};
use crate::robot::{Motor, PerWheel, RobotParameters, State, Velocity};
use crate::shooting::{Maneuver, ManeuverLimits, StateComponent, wrapped_angle};
use crate::simulation::TorqueSchedule;

/// A first guess, with the winding of the goal heading that it aims at.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Start {
    pub(super) schedule: TorqueSchedule,
    /// The goal heading, or none where it is free.
    pub(super) goal_heading: Option<f64>,
    pub(super) strategy: Strategy,
}

/// The strategy from a start to a local optimum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Strategy {
    /// As [`Strategy::Direct`] with the least effort: the start is the plan of a similar maneuver.
    Warm,
    /// Under the exact friction law at once: to the nearest local optimum, the paper's family on the paper's case.
    Direct,
    /// Through smoothed laws: slower, and often to a much better local optimum.
    Smoothed,
}

/// Torques of the plans, as shares of their limits: away from the limit, every torque can move both ways.
const AMPLITUDES: [f64; 2] = [0.8, 0.5];
/// Plans that are tried with spins: the fastest ones.
const SPUN_PLANS: usize = 2;
/// Coasting times: the time to the goal at the speed of the start times powers of two, up to so many.
const COASTING_DOUBLINGS: i32 = 4;

/// Wheels driven against each other for a part of a plan: leads to drifting turns.
#[derive(Debug, Clone, Copy)]
struct Spin {
    /// Begin and end, as shares of the final time.
    begin: f64,
    end: f64,
    /// 1 to the left, -1 to the right.
    turn: f64,
    goes_on: After,
    /// Whole turns by which the heading at the goal changes, positive in the sense of the spin.
    revolutions: f64,
}

/// How a plan goes on after a spin.
#[derive(Debug, Clone, Copy, PartialEq)]
enum After {
    /// As before.
    AsPlanned,
    /// With all torques reversed: turned round, the robot brakes by driving forwards.
    TurnedRound,
}

/// Distances and speeds below this, m, m/s or rad/s, count as none.
const REST: f64 = 1e-9;

/// Pose of the axle midpoint.
#[derive(Debug, Clone, Copy)]
struct Pose {
    position: Vector2<f64>,
    heading: f64,
}

/// Inertias and torques of rolling without slip, from which the legs are computed.
#[derive(Debug, Clone, Copy)]
struct Rolling {
    torque: PerWheel<f64>,
    /// Force of both torques at the floor, N.
    force: f64,
    /// Moment of both torques about the axle midpoint, N m.
    moment: f64,
    /// kg
    mass: f64,
    /// About the axle midpoint, kg m2.
    yaw_inertia: f64,
    /// What speed and yaw rate may be, m/s and rad/s.
    top_speed: f64,
    top_yaw_rate: f64,
}

/// The first starts of a search, at most `count`, in the order in which they are tried: the caller's guess, the fastest
/// plan directly and through smoothing, then the other plans in turn with spins drawn at random.
pub(super) fn starts(input: &SolveInput, count: usize) -> Vec<Start> {
    let guess = input.initial_guess.iter().map(|guess| Start {
        schedule: resampled(guess, input.settings.control_count),
        goal_heading: input.maneuver.nearest_goal_heading(),
        strategy: Strategy::Warm,
    });
    let mut starts: Vec<Start> = guess.collect();
    let is_nelder_mead = input.settings.method == Method::NelderMead;
    if input.maneuver.torque_limit == PerWheel::new(0.0, 0.0) {
        starts.extend(coasting(input));
    } else if is_nelder_mead {
        starts.push(straight(input));
    } else {
        let plans = turn_drive_turn(input);
        starts.push(Start { strategy: Strategy::Direct, ..plans[0].clone() });
        starts.push(plans[0].clone());
        let mut others = plans.iter().skip(1);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(input.settings.seed);
        for plan in plans[..SPUN_PLANS.min(plans.len())].iter().cycle() {
            if starts.len() >= count {
                break;
            }
            starts.extend(others.next().cloned());
            starts.push(Spin::drawn(&mut rng).of(plan, input.robot.torques_near_grip(input.maneuver.torque_limit)));
        }
    }
    starts.truncate(if is_nelder_mead { 1 } else { count });
    starts
}

/// Without torque there is only the final time to choose: those of the start's speed, the most likely first.
fn coasting(input: &SolveInput) -> impl Iterator<Item = Start> {
    let zeros = vec![0.0; input.settings.control_count];
    let goal_heading = input.maneuver.nearest_goal_heading();
    let (velocity, error) = (input.maneuver.start.velocity, input.maneuver.goal_error(&input.maneuver.start));
    let times =
        [velocity.x, velocity.y, velocity.yaw_rate].into_iter().zip(error.iter()).map(|(rate, error)| -error / rate);
    let time = times.filter(|time| time.is_finite()).fold(0.0, f64::max);
    let time = if time > 0.0 { time } else { 1.0 };
    let doublings = (0..=COASTING_DOUBLINGS).flat_map(|doublings| [doublings, -doublings]).skip(1);
    doublings.map(move |doublings| Start {
        schedule: TorqueSchedule {
            final_time: time * 2.0_f64.powi(doublings),
            left: zeros.clone(),
            right: zeros.clone(),
        },
        goal_heading,
        strategy: Strategy::Direct,
    })
}

impl Spin {
    /// One after which the robot is turned round two times in three, and in one of three with a turn more or less.
    fn drawn(rng: &mut Xoshiro256PlusPlus) -> Self {
        let (one, other) = (rng.random::<f64>(), rng.random::<f64>());
        Self {
            begin: one.min(other),
            end: one.max(other),
            turn: drawn_from(&[1.0, -1.0], rng),
            goes_on: drawn_from(&[After::AsPlanned, After::TurnedRound, After::TurnedRound], rng),
            revolutions: drawn_from(&[0.0, 0.0, 0.0, 0.0, 1.0, -1.0], rng),
        }
    }

    /// The plan with this spin.
    fn of(&self, plan: &Start, limit: PerWheel<f64>) -> Start {
        // The left wheel forwards turns to the right.
        let torque = PerWheel::new(-self.turn * limit.left, self.turn * limit.right);
        Start {
            schedule: self.in_schedule(&plan.schedule, torque),
            goal_heading: plan.goal_heading.map(|heading| heading + self.turn * self.revolutions * TAU),
            strategy: plan.strategy,
        }
    }

    fn in_schedule(&self, schedule: &TorqueSchedule, torque: PerWheel<f64>) -> TorqueSchedule {
        let mut schedule = schedule.clone();
        let count = schedule.control_count();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the intervals")]
        let interval = |share: f64| (share * count as f64) as usize;
        let begin = interval(self.begin).min(count - 1);
        let end = interval(self.end).clamp(begin + 1, count);
        for (torques, torque) in [(&mut schedule.left, torque.left), (&mut schedule.right, torque.right)] {
            torques[begin..end].fill(torque);
            if self.goes_on == After::TurnedRound {
                torques[end..].iter_mut().for_each(|torque| *torque = -*torque);
            }
        }
        schedule
    }
}

fn drawn_from<T: Copy>(values: &[T], rng: &mut Xoshiro256PlusPlus) -> T {
    values[rng.random_range(0..values.len())]
}

/// Full effort towards the goal in the first half, full braking in the second, as if the goal lay straight ahead.
fn straight(input: &SolveInput) -> Start {
    let maneuver = &input.maneuver;
    let rolling = Rolling::new(input, AMPLITUDES[0]);
    let start = &maneuver.start.configuration;
    let x = maneuver.goal.value(StateComponent::X).unwrap_or(start.x) - start.x;
    let y = maneuver.goal.value(StateComponent::Y).unwrap_or(start.y) - start.y;
    let ahead = y * start.heading.cos() - x * start.heading.sin();
    let mut segments = Vec::new();
    rolling.drive(x.hypot(y).copysign(ahead), &mut segments);
    Start {
        schedule: schedule_from_segments(&segments, input.settings.control_count),
        goal_heading: maneuver.nearest_goal_heading(),
        strategy: Strategy::Direct,
    }
}

/// Turn - drive - turn plans, fastest first.
fn turn_drive_turn(input: &SolveInput) -> Vec<Start> {
    let mut plans: Vec<(f64, Start)> = Vec::new();
    for amplitude in AMPLITUDES {
        let rolling = Rolling::new(input, amplitude);
        for direction in [1.0, -1.0] {
            plans.extend(plans_in_direction(input, &rolling, direction));
        }
    }
    plans.sort_by(|a, b| a.0.total_cmp(&b.0));
    plans.into_iter().map(|(_, start)| start).collect()
}

fn plans_in_direction(input: &SolveInput, rolling: &Rolling, direction: f64) -> Vec<(f64, Start)> {
    let (maneuver, robot) = (&input.maneuver, input.robot.parameters());
    let mut first = Vec::new();
    let start = rolling.brake(&axle_state(&maneuver.start, maneuver, robot), &mut first);
    let mut last = Vec::new();
    let goal = goal_state(maneuver, start.heading);
    let reversed = rolling.brake(&axle_state(&backwards(&goal), maneuver, robot), &mut last);
    let goal_pose = Pose { heading: reversed.heading, ..reversed };
    let last = time_reversed(last);

    let leg = goal_pose.position - start.position;
    let distance = leg.norm();
    let heading_is_free = maneuver.goal.value(StateComponent::Heading).is_none();
    // Forward is (-sin, cos) of the heading.
    let course = if distance > REST { (-leg.x * direction).atan2(leg.y * direction) } else { start.heading };
    let first_turn = wrapped_angle(course - start.heading);
    let mut plans = Vec::new();
    for turn in either_way(first_turn) {
        let heading = start.heading + turn;
        let second_turn = if heading_is_free { 0.0 } else { wrapped_angle(goal_pose.heading - heading) };
        for second in either_way(second_turn) {
            let mut segments = first.clone();
            rolling.turn(turn, &mut segments);
            rolling.drive(direction * distance, &mut segments);
            rolling.turn(second, &mut segments);
            segments.extend(last.iter().copied());
            let final_time: f64 = segments.iter().map(|segment| segment.duration).sum();
            let winding = heading + second - goal_pose.heading;
            let goal_heading =
                maneuver.goal.value(StateComponent::Heading).map(|goal| goal + (winding / TAU).round() * TAU);
            let schedule = schedule_from_segments(&segments, input.settings.control_count);
            plans.push((final_time, Start { schedule, goal_heading, strategy: Strategy::Smoothed }));
        }
    }
    plans
}

/// The turn itself, and the other way round where that is at most three times as long.
fn either_way(turn: f64) -> impl Iterator<Item = f64> {
    let other = (turn.abs() > FRAC_PI_2).then(|| turn - TAU.copysign(turn));
    [turn].into_iter().chain(other)
}

impl Rolling {
    fn new(input: &SolveInput, amplitude: f64) -> Self {
        let robot = input.robot.parameters();
        let axle = robot.axle_midpoint();
        let half_track = robot.track_width / 2.0;
        let axle_load = robot.total_mass() * robot.gravity
            - robot.chassis_mass * robot.gravity * robot.center_of_mass_forward / robot.axle_to_front_support;
        let grip = robot.wheel_friction_coefficient * axle_load / 2.0 * robot.wheel_radius;
        let limits = &input.maneuver.limits;
        let share = amplitude * limits.grip_utilization.unwrap_or(1.0);
        let limited = |limit: f64| share * limit.min(if grip > 0.0 { grip } else { f64::INFINITY });
        let limit = input.robot.torques_near_grip(input.maneuver.torque_limit);
        let torque = PerWheel::new(limited(limit.left), limited(limit.right));
        let spin = 2.0 * robot.wheel_spin_inertia / robot.wheel_radius.powi(2);
        let force = (torque.left + torque.right) / robot.wheel_radius;
        let rim_speed = robot.wheel_radius * top_wheel_rate(robot, limits, torque);
        Self {
            torque,
            force,
            moment: force * half_track,
            mass: robot.total_mass() + spin,
            yaw_inertia: robot.chassis_yaw_inertia
                + robot.chassis_mass * axle.norm_squared()
                + 2.0 * robot.wheel_diametral_inertia
                + (2.0 * robot.wheel_mass + spin) * half_track * half_track,
            top_speed: rim_speed.min(limits.speed.unwrap_or(f64::INFINITY)),
            top_yaw_rate: (rim_speed / half_track).min(limits.yaw_rate.unwrap_or(f64::INFINITY)),
        }
        .gentle(limits)
    }

    /// With as much of the torques as the limits of the accelerations allow.
    fn gentle(mut self, limits: &ManeuverLimits) -> Self {
        let largest = |limit: Option<f64>, acceleration: f64| limit.map_or(1.0, |limit| limit / acceleration);
        let along = self.force / self.mass;
        let share = largest(limits.acceleration, along)
            .min(largest(limits.deceleration, along))
            .min(largest(limits.yaw_acceleration, self.moment / self.yaw_inertia));
        if share < 1.0 {
            self.torque = PerWheel::new(share * self.torque.left, share * self.torque.right);
            (self.force, self.moment) = (share * self.force, share * self.moment);
        }
        self
    }

    /// Full effort over half the distance, full braking over the rest; at the top speed in between.
    fn drive(&self, distance: f64, segments: &mut Vec<Segment>) {
        let sign = distance.signum();
        let torque = PerWheel::new(sign * self.torque.left, sign * self.torque.right);
        let half = (distance.abs() * self.mass / self.force).sqrt();
        push_trapezoid((half, distance.abs() / self.top_speed), torque, segments);
    }

    /// Positive angles turn left: the right wheel drives forward.
    fn turn(&self, angle: f64, segments: &mut Vec<Segment>) {
        let sign = angle.signum();
        let torque = PerWheel::new(-sign * self.torque.left, sign * self.torque.right);
        let half = (angle.abs() * self.yaw_inertia / self.moment).sqrt();
        push_trapezoid((half, angle.abs() / self.top_yaw_rate), torque, segments);
    }

    /// Brakes a moving state to rest; returns where the axle then stands.
    fn brake(&self, state: &State, segments: &mut Vec<Segment>) -> Pose {
        let q = &state.configuration;
        let forward = Vector2::new(-q.heading.sin(), q.heading.cos());
        let speed = forward.dot(&Vector2::new(state.velocity.x, state.velocity.y));
        let yaw_rate = state.velocity.yaw_rate;
        let mut pose = Pose { position: Vector2::new(q.x, q.y), heading: q.heading };
        if speed.abs() > REST {
            let duration = speed.abs() * self.mass / self.force;
            let sign = -speed.signum();
            let torque = PerWheel::new(sign * self.torque.left, sign * self.torque.right);
            segments.push(Segment { duration, torque });
            pose.position += forward * (speed * duration / 2.0);
        }
        if yaw_rate.abs() > REST {
            let duration = yaw_rate.abs() * self.yaw_inertia / self.moment;
            let sign = -yaw_rate.signum();
            segments
                .push(Segment { duration, torque: PerWheel::new(-sign * self.torque.left, sign * self.torque.right) });
            pose.heading += yaw_rate * duration / 2.0;
        }
        pose
    }
}

/// The rate at which a wheel may turn under its torque, rad/s.
fn top_wheel_rate(robot: &RobotParameters, limits: &ManeuverLimits, torque: PerWheel<f64>) -> f64 {
    let of_motor = |motor: Motor| {
        let share = torque.left.max(torque.right) / motor.stall_torque;
        motor.free_speed * (1.0 - share).max(1.0 - AMPLITUDES[0])
    };
    let of_motor = robot.motor.map_or(f64::INFINITY, of_motor);
    of_motor.min(limits.wheel_rate.unwrap_or(f64::INFINITY))
}

/// Full effort and full braking of a half each; where that passes the top speed, at which the way takes `at_top_speed`, coasting in
/// between. Times in s.
fn push_trapezoid((half, at_top_speed): (f64, f64), torque: PerWheel<f64>, segments: &mut Vec<Segment>) {
    if half > 0.0 {
        let braking = PerWheel::new(-torque.left, -torque.right);
        // The speed in the middle is the way over a half; at the top speed the effort is as much shorter.
        let effort = half * (half / at_top_speed).min(1.0);
        segments.push(Segment { duration: effort, torque });
        if effort < half {
            segments.push(Segment { duration: at_top_speed - effort, torque: PerWheel::new(0.0, 0.0) });
        }
        segments.push(Segment { duration: effort, torque: braking });
    }
}

/// A motion run backwards: the same torques in the opposite order bring rest to the state.
fn time_reversed(segments: Vec<Segment>) -> Vec<Segment> {
    segments.into_iter().rev().collect()
}

fn backwards(state: &State) -> State {
    let mut reversed = *state;
    let u = &mut reversed.velocity;
    (u.x, u.y, u.yaw_rate) = (-u.x, -u.y, -u.yaw_rate);
    u.wheel_rate = PerWheel::new(-u.wheel_rate.left, -u.wheel_rate.right);
    reversed
}

/// A state at the reference point as one of the axle midpoint.
fn axle_state(state: &State, maneuver: &Maneuver, robot: &RobotParameters) -> State {
    state.moved_by(robot.axle_midpoint() - maneuver.reference_point.offset(robot))
}

/// The goal with free components taken from the start, at rest where speeds are free.
fn goal_state(maneuver: &Maneuver, heading: f64) -> State {
    let mut goal = State { velocity: Velocity::default(), ..maneuver.start }.to_vector();
    goal[StateComponent::Heading.index()] = heading;
    for (component, value) in maneuver.goal.constrained() {
        goal[component.index()] = value;
    }
    State::from_vector(&goal)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(goal_heading: Option<f64>) -> Start {
        let torques = [1.0, 1.0, -1.0, -1.0].to_vec();
        let schedule = TorqueSchedule { final_time: 2.0, left: torques.clone(), right: torques };
        Start { schedule, goal_heading, strategy: Strategy::Smoothed }
    }

    #[test]
    fn a_robot_that_turned_round_brakes_by_driving_forwards() {
        let limit = PerWheel::new(3.0, 2.0);
        let right = Spin { begin: 0.5, end: 0.75, turn: -1.0, goes_on: After::TurnedRound, revolutions: -1.0 };
        let left = Spin { turn: 1.0, ..right }.of(&plan(Some(0.1)), limit);
        let right = right.of(&plan(Some(0.1)), limit);
        assert_eq!(right.schedule.left, [1.0, 1.0, 3.0, 1.0]);
        assert_eq!(right.schedule.right, [1.0, 1.0, -2.0, 1.0]);
        assert_eq!(right.goal_heading, Some(0.1 + TAU));
        assert_eq!(left.schedule.left, [1.0, 1.0, -3.0, 1.0]);
        assert_eq!(left.goal_heading, Some(0.1 - TAU));
    }

    #[test]
    fn spins_fit_into_the_coarsest_grid() {
        let mut plan = plan(None);
        plan.schedule.left.truncate(1);
        plan.schedule.right.truncate(1);
        let spin = Spin { begin: 1.0, end: 1.0, turn: -1.0, goes_on: After::AsPlanned, revolutions: 0.0 };
        let spun = spin.of(&plan, PerWheel::new(1.0, 1.0));
        assert_eq!(spun.schedule.left, [1.0]);
    }
}
