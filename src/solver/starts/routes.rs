//! Plans of turns and drives that would reach the goal if the wheels rolled without slip.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::iter::successors;

use nalgebra::Vector2;

use super::super::segments::{Segment, duration, or_coasting, schedule_from_segments};
use super::super::settings::SolveInput;
use super::rolling::{AMPLITUDES, Pose, Rolling};
use super::{Start, Strategy};
use crate::motion::ROUNDING;
use crate::robot::{RobotParameters, State, Velocity};
use crate::shooting::{Maneuver, StateComponent, wrapped_angle};

/// Plans of turns and drives, fastest first.
pub(super) fn rolling_plans(input: &SolveInput) -> Vec<Start> {
    let mut plans: Vec<(f64, Start)> = Vec::new();
    for amplitude in AMPLITUDES {
        let route = Route::new(input, amplitude);
        let through_one_drive = route.through_one_drive();
        let fastest = through_one_drive.iter().map(|plan| plan.0).fold(f64::INFINITY, f64::min);
        plans.extend(through_one_drive);
        plans.extend(route.through_two_drives().into_iter().filter(|plan| plan.0 < fastest));
    }
    plans.sort_by(|a, b| a.0.total_cmp(&b.0));
    plans.into_iter().map(|(_, start)| start).collect()
}

/// A turn, rad, positive to the left, and a drive after it, m, positive forwards, each from rest to rest.
type Leg = (f64, f64);

/// What lies between braking from the motion of the start and gaining that of the goal.
struct Route<'a> {
    input: &'a SolveInput,
    rolling: Rolling,
    first: Vec<Segment>,
    last: Vec<Segment>,
    start: Pose,
    goal: Pose,
}

impl<'a> Route<'a> {
    fn new(input: &'a SolveInput, amplitude: f64) -> Self {
        let (maneuver, robot) = (&input.maneuver, input.robot.parameters());
        let rolling = Rolling::new(input, amplitude);
        let (mut first, mut last) = (Vec::new(), Vec::new());
        let start = rolling.brake(&axle_state(&maneuver.start, maneuver, robot), &mut first);
        let goal_state = goal_state(maneuver, course(maneuver).unwrap_or(start.heading));
        let goal = rolling.brake(&axle_state(&backwards(&goal_state), maneuver, robot), &mut last);
        last.reverse();
        Self { input, rolling, first, last, start, goal }
    }

    /// Turn, drive, turn: forwards and backwards, each turn either way round.
    fn through_one_drive(&self) -> Vec<(f64, Start)> {
        let leg = self.goal.position - self.start.position;
        let maneuver = &self.input.maneuver;
        let heading_is_free = maneuver.goal.value(StateComponent::Heading).is_none() && course(maneuver).is_none();
        let mut plans = Vec::new();
        for direction in [1.0, -1.0] {
            // Forward is (-sin, cos) of the heading.
            let course =
                if leg.norm() > ROUNDING { (-leg.x * direction).atan2(leg.y * direction) } else { self.start.heading };
            for turn in either_way(wrapped_angle(course - self.start.heading)) {
                let heading = self.start.heading + turn;
                let second_turn = if heading_is_free { 0.0 } else { wrapped_angle(self.goal.heading - heading) };
                for second in either_way(second_turn) {
                    plans.push(self.plan(&[(turn, direction * leg.norm()), (second, 0.0)]));
                }
            }
        }
        plans
    }

    /// There and back again in two directions, one of which is that of the start or of the goal: so a robot moves aside by less than
    /// its size. Of the angles between both drives, a right one halved again and again, and of their signs, those of the fastest plans.
    fn through_two_drives(&self) -> Vec<(f64, Start)> {
        let mut plans = Vec::new();
        for side in [1.0, -1.0] {
            let halved = |angle: &f64| Some(0.5 * angle).filter(|angle| *angle > ROUNDING);
            let angles = || successors(Some(FRAC_PI_2), halved).map(|angle| side * angle);
            let first = angles().map(|angle| (self.start.heading + angle, self.goal.heading));
            let second = angles().map(|angle| (self.start.heading, self.goal.heading + angle));
            plans.extend(self.fastest_through(first));
            plans.extend(self.fastest_through(second));
        }
        plans
    }

    fn fastest_through(&self, headings: impl Iterator<Item = (f64, f64)>) -> Option<(f64, Start)> {
        let plans = headings.filter_map(|headings| self.legs_through(headings)).map(|legs| self.plan(&legs));
        plans.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Two drives with these headings; none if they are parallel.
    fn legs_through(&self, (one, other): (f64, f64)) -> Option<[Leg; 3]> {
        let forward = |heading: f64| Vector2::new(-heading.sin(), heading.cos());
        let leg = self.goal.position - self.start.position;
        let across = forward(one).perp(&forward(other));
        let (there, back) = (leg.perp(&forward(other)) / across, forward(one).perp(&leg) / across);
        (there.is_finite() && back.is_finite()).then(|| {
            [
                (wrapped_angle(one - self.start.heading), there),
                (wrapped_angle(other - one), back),
                (wrapped_angle(self.goal.heading - other), 0.0),
            ]
        })
    }

    /// Time in s and plan.
    fn plan(&self, legs: &[Leg]) -> (f64, Start) {
        let segments = self.segments(legs);
        let turned: f64 = legs.iter().map(|(turn, _)| turn).sum();
        let winding = self.start.heading + turned - self.goal.heading;
        let goal_heading = self.input.maneuver.goal.value(StateComponent::Heading);
        let goal_heading = goal_heading.map(|goal| goal + (winding / TAU).round() * TAU);
        let schedule = schedule_from_segments(&segments, self.input.settings.control_count);
        (duration(&segments), Start { schedule, goal_heading, strategy: Strategy::Smoothed })
    }

    fn segments(&self, legs: &[Leg]) -> Vec<Segment> {
        let mut segments = self.first.clone();
        for &(turn, drive) in legs {
            self.rolling.go(&self.rolling.turn, turn, &mut segments);
            self.rolling.go(&self.rolling.drive, drive, &mut segments);
        }
        segments.extend(&self.last);
        or_coasting(segments, self.input.robot.parameters().natural_time())
    }
}

/// The turn itself, and the other way round where that is at most three times as long.
fn either_way(turn: f64) -> impl Iterator<Item = f64> {
    let other = (turn.abs() > FRAC_PI_2).then(|| turn - TAU.copysign(turn));
    [turn].into_iter().chain(other)
}

/// The state of a motion run backwards, but for the wheels: the same torques in the opposite order bring rest to the state.
fn backwards(state: &State) -> State {
    let mut reversed = *state;
    let u = &mut reversed.velocity;
    (u.x, u.y, u.yaw_rate) = (-u.x, -u.y, -u.yaw_rate);
    reversed
}

/// A state at the reference point as one of the axle midpoint.
fn axle_state(state: &State, maneuver: &Maneuver, robot: &RobotParameters) -> State {
    state.moved_by(maneuver.reference_point.to_axle_midpoint(robot))
}

/// The heading of a goal that asks for a velocity and leaves the heading free.
fn course(maneuver: &Maneuver) -> Option<f64> {
    let goal = |component| maneuver.goal.value(component);
    let along = |component| goal(component).unwrap_or(0.0);
    let (x, y) = (along(StateComponent::VelocityX), along(StateComponent::VelocityY));
    let moves = goal(StateComponent::Heading).is_none() && x.hypot(y) > ROUNDING;
    // Forward is (-sin, cos) of the heading.
    moves.then(|| (-x).atan2(y))
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
    use crate::solver::settings::SolveParameters;

    /// The route to a pose of the axle midpoint, from rest at the origin.
    fn input(x: f64, y: f64) -> SolveInput {
        let mut parameters = SolveParameters::default();
        parameters.maneuver.goal.set(StateComponent::X, Some(x));
        parameters.maneuver.goal.set(StateComponent::Y, Some(y));
        SolveInput::new(parameters).unwrap()
    }

    #[test]
    fn two_drives_lead_to_the_goal() {
        let input = input(0.3, -0.2);
        let route = Route::new(&input, AMPLITUDES[0]);
        let (mut position, mut heading) = (route.start.position, route.start.heading);
        for (turn, drive) in route.legs_through((0.4, -0.7)).unwrap() {
            heading += turn;
            position += drive * Vector2::new(-heading.sin(), heading.cos());
        }
        assert!((position - route.goal.position).norm() < 1e-12, "{position} in place of {}", route.goal.position);
        assert!((heading - route.goal.heading).abs() < 1e-12);
        assert!(route.legs_through((0.4, 0.4)).is_none(), "parallel drives");
    }

    #[test]
    fn two_drives_are_for_moving_aside() {
        let fastest = |plans: Vec<(f64, Start)>| plans.iter().map(|plan| plan.0).fold(f64::INFINITY, f64::min);
        let ratio = |input: &SolveInput| {
            let route = Route::new(input, AMPLITUDES[0]);
            fastest(route.through_two_drives()) / fastest(route.through_one_drive())
        };
        assert!(ratio(&input(1e-3, 0.0)) < 0.5, "a millimetre aside");
        assert!(ratio(&input(0.0, 1.0)) >= 1.0, "straight ahead");
    }
}
