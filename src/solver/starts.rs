//! The starts of the search: bang-bang legs that would reach the goal if the wheels rolled without slip.
//!
//! A maneuver from rest to rest is a turn, a drive and a turn, each with full effort and full braking. Forwards and
//! backwards, either way round, gives several such plans. A moving start brakes first, a moving goal accelerates last.
//! These are only first guesses: they neglect slip, the shift of normal forces and the centre of mass off the axle.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::segments::{Segment, resampled, schedule_from_segments};
use super::settings::{Method, SolveInput};
use crate::robot::{PerWheel, RobotParameters, State};
use crate::shooting::{Maneuver, StateComponent, wrapped_angle};
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

/// Torques of a plan, as shares of their limits: away from the limit, every torque can move both ways.
const AMPLITUDES: [f64; 2] = [0.8, 0.5];
/// Share of the static friction that a first guess uses.
const GRIP: f64 = 0.9;
/// A turn of more than this is also tried the other way round, rad.
const EITHER_WAY_FROM: f64 = 0.6 * PI;

/// Wheels driven against each other in the middle of a plan: leads to drifting turns.
struct Spin {
    /// Which of the plans, fastest first.
    plan: usize,
    /// Begin and end, in percent of the final time.
    begin: usize,
    end: usize,
    goes_on: After,
    /// Whole turns by which the heading at the goal changes, positive in the sense of the spin.
    revolutions: f64,
}

/// How a plan goes on after a spin.
#[derive(PartialEq)]
enum After {
    /// As before.
    AsPlanned,
    /// With all torques reversed: turned round, the robot brakes by driving forwards.
    TurnedRound,
}

/// In the order of what they find on the benchmark suite that the ones before miss.
const SPINS: [Spin; 9] = [
    Spin { plan: 0, begin: 35, end: 55, goes_on: After::AsPlanned, revolutions: 0.0 },
    Spin { plan: 0, begin: 50, end: 80, goes_on: After::TurnedRound, revolutions: 0.0 },
    Spin { plan: 1, begin: 50, end: 80, goes_on: After::TurnedRound, revolutions: -1.0 },
    Spin { plan: 0, begin: 65, end: 75, goes_on: After::TurnedRound, revolutions: 0.0 },
    Spin { plan: 0, begin: 50, end: 80, goes_on: After::AsPlanned, revolutions: 0.0 },
    Spin { plan: 1, begin: 50, end: 70, goes_on: After::TurnedRound, revolutions: 0.0 },
    Spin { plan: 1, begin: 50, end: 70, goes_on: After::AsPlanned, revolutions: 0.0 },
    Spin { plan: 0, begin: 65, end: 75, goes_on: After::TurnedRound, revolutions: -1.0 },
    Spin { plan: 1, begin: 35, end: 45, goes_on: After::TurnedRound, revolutions: 1.0 },
];

/// Intervals that are perturbed together.
const PERTURBED_STRETCH: usize = 4;
/// Largest perturbation, as a share of the torque limit.
const PERTURBATION: f64 = 0.7;
/// Final times of coasting plans, s, the most likely first: a search changes each by a factor of a few.
const COASTING_TIMES: [f64; 8] = [1.0, 3.0, 0.3, 10.0, 0.1, 30.0, 0.03, 100.0];
/// Speeds below this, m/s or rad/s, count as rest.
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
}

/// The first starts of a search, at most `count`, in the order in which they are tried: the caller's guess, the fastest
/// plan directly, the plans through smoothing, the fastest also with spins, then perturbed copies.
pub(super) fn starts(input: &SolveInput, count: usize) -> Vec<Start> {
    let guess = input.initial_guess.iter().map(|guess| Start {
        schedule: resampled(guess, input.settings.control_count),
        goal_heading: input.maneuver.nearest_goal_heading(),
        strategy: Strategy::Warm,
    });
    let mut starts: Vec<Start> = guess.collect();
    if input.maneuver.torque_limit == PerWheel::new(0.0, 0.0) {
        starts.extend(coasting(input));
        starts.truncate(if input.settings.method == Method::NelderMead { 1 } else { count });
        return starts;
    }
    if input.settings.method == Method::NelderMead {
        starts.push(straight(&input.maneuver, input.robot.parameters(), input.settings.control_count));
        starts.truncate(1);
        return starts;
    }
    let plans = turn_drive_turn(input);
    starts.push(Start { strategy: Strategy::Direct, ..plans[0].clone() });
    starts.extend(plans.iter().take(2).cloned());
    for spin in &SPINS {
        starts.extend(plans.get(spin.plan).into_iter().flat_map(|plan| spin.of(plan, input.maneuver.torque_limit)));
    }
    starts.extend(plans.iter().skip(2).cloned());
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(input.settings.seed);
    for plan in plans.iter().cycle().take(count.saturating_sub(starts.len())) {
        starts.push(perturbed(plan, input.maneuver.torque_limit, &mut rng));
    }
    starts.truncate(count);
    starts
}

/// Without torque there is only the final time to choose.
fn coasting(input: &SolveInput) -> impl Iterator<Item = Start> {
    let zeros = vec![0.0; input.settings.control_count];
    let goal_heading = input.maneuver.nearest_goal_heading();
    COASTING_TIMES.into_iter().map(move |final_time| Start {
        schedule: TorqueSchedule { final_time, left: zeros.clone(), right: zeros.clone() },
        goal_heading,
        strategy: Strategy::Direct,
    })
}

impl Spin {
    /// The plan with this spin, either way round; none where it would turn on to a goal heading that is free.
    fn of(&self, plan: &Start, limit: PerWheel<f64>) -> Vec<Start> {
        if plan.goal_heading.is_none() && self.revolutions != 0.0 {
            return Vec::new();
        }
        // The left wheel forwards turns to the right.
        let either_way = [-1.0, 1.0].map(|turn| {
            let torque = PerWheel::new(-turn * limit.left, turn * limit.right);
            let goal_heading = plan.goal_heading.map(|heading| heading + turn * self.revolutions * TAU);
            Start { schedule: self.in_schedule(&plan.schedule, torque), goal_heading, strategy: plan.strategy }
        });
        either_way.into()
    }

    fn in_schedule(&self, schedule: &TorqueSchedule, torque: PerWheel<f64>) -> TorqueSchedule {
        let mut schedule = schedule.clone();
        let count = schedule.control_count();
        let begin = count * self.begin / 100;
        let end = (count * self.end / 100).clamp(begin + 1, count);
        for (torques, torque) in [(&mut schedule.left, torque.left), (&mut schedule.right, torque.right)] {
            torques[begin..end].fill(torque);
            if self.goes_on == After::TurnedRound {
                torques[end..].iter_mut().for_each(|torque| *torque = -*torque);
            }
        }
        schedule
    }
}

/// The same plan with random torques added to stretches of it.
fn perturbed(plan: &Start, limit: PerWheel<f64>, rng: &mut Xoshiro256PlusPlus) -> Start {
    let mut start = plan.clone();
    let schedule = &mut start.schedule;
    for (torques, limit) in [(&mut schedule.left, limit.left), (&mut schedule.right, limit.right)] {
        for stretch in torques.chunks_mut(PERTURBED_STRETCH) {
            let change = PERTURBATION * limit * rng.random_range(-1.0..1.0);
            for torque in stretch {
                *torque = (*torque + change).clamp(-limit, limit);
            }
        }
    }
    schedule.final_time *= rng.random_range(0.8..1.2);
    start
}

/// Full effort towards the goal in the first half, full braking in the second, as if the goal lay straight ahead.
fn straight(maneuver: &Maneuver, robot: &RobotParameters, control_count: usize) -> Start {
    let rolling = Rolling::new(maneuver, robot, AMPLITUDES[0]);
    let start = &maneuver.start.configuration;
    let x = maneuver.goal.value(StateComponent::X).unwrap_or(start.x) - start.x;
    let y = maneuver.goal.value(StateComponent::Y).unwrap_or(start.y) - start.y;
    let ahead = y * start.heading.cos() - x * start.heading.sin();
    let mut segments = Vec::new();
    rolling.drive(x.hypot(y).copysign(ahead), &mut segments);
    Start {
        schedule: schedule_from_segments(&segments, control_count),
        goal_heading: maneuver.nearest_goal_heading(),
        strategy: Strategy::Direct,
    }
}

/// Turn - drive - turn plans, fastest first.
fn turn_drive_turn(input: &SolveInput) -> Vec<Start> {
    let (maneuver, robot) = (&input.maneuver, input.robot.parameters());
    let control_count = input.settings.control_count;
    let mut plans: Vec<(f64, Start)> = Vec::new();
    for amplitude in AMPLITUDES {
        let rolling = Rolling::new(maneuver, robot, amplitude);
        for direction in [1.0, -1.0] {
            plans.extend(plans_in_direction(maneuver, robot, &rolling, direction, control_count));
        }
    }
    plans.sort_by(|a, b| a.0.total_cmp(&b.0));
    plans.into_iter().map(|(_, start)| start).collect()
}

fn plans_in_direction(
    maneuver: &Maneuver,
    robot: &RobotParameters,
    rolling: &Rolling,
    direction: f64,
    control_count: usize,
) -> Vec<(f64, Start)> {
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
    let course = if distance > 1e-9 { (-leg.x * direction).atan2(leg.y * direction) } else { start.heading };
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
            let schedule = schedule_from_segments(&segments, control_count);
            plans.push((final_time, Start { schedule, goal_heading, strategy: Strategy::Smoothed }));
        }
    }
    plans
}

/// The turn itself, and the other way round where that is not much longer.
fn either_way(turn: f64) -> impl Iterator<Item = f64> {
    let other = (turn.abs() > EITHER_WAY_FROM).then(|| turn - TAU.copysign(turn));
    [turn].into_iter().chain(other)
}

impl Rolling {
    fn new(maneuver: &Maneuver, robot: &RobotParameters, amplitude: f64) -> Self {
        let axle = robot.axle_midpoint();
        let half_track = robot.track_width / 2.0;
        let axle_load = robot.total_mass() * robot.gravity
            - robot.chassis_mass * robot.gravity * robot.center_of_mass_forward / robot.axle_to_front_support;
        let grip = GRIP * robot.wheel_friction_coefficient * axle_load / 2.0 * robot.wheel_radius;
        let limited = |limit: f64| (amplitude * limit).min(if grip > 0.0 { grip } else { f64::INFINITY });
        let torque = PerWheel::new(limited(maneuver.torque_limit.left), limited(maneuver.torque_limit.right));
        let spin = 2.0 * robot.wheel_spin_inertia / robot.wheel_radius.powi(2);
        let force = (torque.left + torque.right) / robot.wheel_radius;
        Self {
            torque,
            force,
            moment: force * half_track,
            mass: robot.total_mass() + spin,
            yaw_inertia: robot.chassis_yaw_inertia
                + robot.chassis_mass * axle.norm_squared()
                + 2.0 * robot.wheel_diametral_inertia
                + (2.0 * robot.wheel_mass + spin) * half_track * half_track,
        }
    }

    /// Full effort over half the distance, full braking over the rest.
    fn drive(&self, distance: f64, segments: &mut Vec<Segment>) {
        let sign = distance.signum();
        let torque = PerWheel::new(sign * self.torque.left, sign * self.torque.right);
        push_bang_bang((distance.abs() * self.mass / self.force).sqrt(), torque, segments);
    }

    /// Positive angles turn left: the right wheel drives forward.
    fn turn(&self, angle: f64, segments: &mut Vec<Segment>) {
        let sign = angle.signum();
        let torque = PerWheel::new(-sign * self.torque.left, sign * self.torque.right);
        push_bang_bang((angle.abs() * self.yaw_inertia / self.moment).sqrt(), torque, segments);
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

fn push_bang_bang(half: f64, torque: PerWheel<f64>, segments: &mut Vec<Segment>) {
    if half > 0.0 {
        let braking = PerWheel::new(-torque.left, -torque.right);
        segments.push(Segment { duration: half, torque });
        segments.push(Segment { duration: half, torque: braking });
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
    let mut goal = maneuver.start.to_vector();
    goal.fixed_rows_mut::<5>(5).fill(0.0);
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
        let spin = Spin { plan: 0, begin: 50, end: 75, goes_on: After::TurnedRound, revolutions: -1.0 };
        let [right, left] = <[Start; 2]>::try_from(spin.of(&plan(Some(0.1)), PerWheel::new(3.0, 2.0))).unwrap();
        assert_eq!(right.schedule.left, [1.0, 1.0, 3.0, 1.0]);
        assert_eq!(right.schedule.right, [1.0, 1.0, -2.0, 1.0]);
        assert_eq!(right.goal_heading, Some(0.1 + TAU));
        assert_eq!(left.schedule.left, [1.0, 1.0, -3.0, 1.0]);
        assert_eq!(left.goal_heading, Some(0.1 - TAU));
    }

    #[test]
    fn no_extra_turns_with_a_free_heading() {
        let count = |spin: &Spin| spin.of(&plan(None), PerWheel::new(1.0, 1.0)).len();
        assert!(SPINS.iter().all(|spin| count(spin) == if spin.revolutions == 0.0 { 2 } else { 0 }));
    }

    #[test]
    fn spins_fit_into_the_coarsest_grid() {
        let mut plan = plan(None);
        plan.schedule.left.truncate(1);
        plan.schedule.right.truncate(1);
        let spun = SPINS[0].of(&plan, PerWheel::new(1.0, 1.0));
        assert_eq!(spun[0].schedule.left, [1.0]);
    }
}
