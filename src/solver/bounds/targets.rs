//! The requirements of a goal on the whole robot's centre of mass, the heading and the wheels, as intervals.
//!
//! Every interval holds all end states that meet the goal within its tolerance.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector2;

use super::capacity::Capacity;
use super::drive_norm::Speeds;
use super::grid_error::Grid;
use crate::robot::{PerWheel, State};
use crate::shooting::{Maneuver, StateComponent};
use crate::solver::settings::SolveInput;

/// Values from the first to the second; infinite where free.
pub(super) type Interval = (f64, f64);

/// Everywhere.
const FREE: Interval = (f64::NEG_INFINITY, f64::INFINITY);

/// Start and goal at the whole robot's centre of mass.
#[derive(Debug, Clone, Copy)]
pub(super) struct Targets<'a> {
    maneuver: &'a Maneuver,
    tolerance: f64,
    rounding: f64,
    /// From the reference point to the centre of mass in the body frame, m.
    offset: Vector2<f64>,
    /// Whether any friction changes the yaw rate.
    can_turn: bool,
    /// Start at the centre of mass.
    pub(super) start: State,
    /// Distance of the reference point from the chassis centre of mass, m.
    lever: f64,
    /// By how much the velocity of the chassis centre of mass is turned at most before the goal judges it, as a chord, rad.
    end_turn: f64,
    /// Largest speed of the chassis centre of mass at the end, where the goal leaves it free, m/s.
    free_speed: f64,
    has_restitution: bool,
}

impl<'a> Targets<'a> {
    pub(super) fn new(input: &'a SolveInput, capacity: &Capacity, grid: Grid) -> Self {
        let maneuver = &input.maneuver;
        let offset = capacity.center - maneuver.reference_point.offset(input.robot.parameters());
        let goal: f64 = maneuver.goal.constrained().map(|(_, value)| value.abs()).sum();
        // A few units in the last place per step.
        let size = maneuver.start.to_vector().lp_norm(1) + goal + 1.0;
        let step_count = match grid {
            Grid::Steps(count) => count as f64,
            Grid::Continuous => 0.0,
        };
        let rounding = 4.0 * f64::EPSILON * (step_count + 16.0) * size;
        Self {
            maneuver,
            tolerance: input.settings.goal_tolerance,
            rounding,
            offset,
            can_turn: capacity.yaw_acceleration > 0.0,
            start: maneuver.start.moved_by(offset),
            lever: maneuver.reference_point.offset(input.robot.parameters()).norm(),
            end_turn: 0.0,
            free_speed: f64::INFINITY,
            has_restitution: input.robot.parameters().tangential_restitution > 0.0,
        }
    }

    /// Allows for the frame in which the goal judges velocities, in plans whose end has turned by at most `end_turn` rad within
    /// half a step, and whose chassis centre of mass is no faster than `free_speed`, m/s.
    pub(super) fn turn_end(&mut self, end_turn: f64, free_speed: f64) {
        // With restitution the frame also takes a share of the speed, at most that by which the cosine is below one.
        let speed_left = if self.has_restitution { end_turn.min(FRAC_PI_2).cos() } else { 1.0 };
        let chord = if self.has_restitution { end_turn } else { end_turn.min(2.0) };
        (self.end_turn, self.free_speed) = (chord / speed_left, free_speed);
    }

    pub(super) fn value(&self, component: StateComponent) -> Option<f64> {
        self.maneuver.goal.value(component)
    }

    /// What is asked of one component, at the reference point.
    pub(super) fn component(&self, component: StateComponent) -> Interval {
        let slack = self.tolerance + self.rounding;
        self.value(component).map_or(FREE, |value| (value - slack, value + slack))
    }

    /// Displacement of the centre of mass along a unit vector, m.
    pub(super) fn displacement(&self, direction: Vector2<f64>) -> Interval {
        self.displacement_of(Vector2::zeros(), direction)
    }

    /// Displacement of a point relative to the centre of mass (right, forward) along a unit vector, m.
    pub(super) fn displacement_of(&self, from_center: Vector2<f64>, direction: Vector2<f64>) -> Interval {
        let from = self.start.moved_by(from_center).configuration;
        let start = direction.dot(&Vector2::new(from.x, from.y));
        let reference = self.along(direction, [StateComponent::X, StateComponent::Y]);
        let offset = self.offset + from_center;
        let offset = match self.value(StateComponent::Heading) {
            Some(heading) => around(direction.dot(&rotated(offset, heading)), offset.norm() * self.tolerance),
            None => around(0.0, offset.norm()),
        };
        (reference.0 + offset.0 - start, reference.1 + offset.1 - start)
    }

    /// Velocity of the centre of mass along a unit vector at the end, m/s.
    pub(super) fn end_velocity(&self, direction: Vector2<f64>) -> Interval {
        let reference = self.along(direction, [StateComponent::VelocityX, StateComponent::VelocityY]);
        let lever = self.offset.norm();
        let turning = match (self.end_yaw_rate(), self.value(StateComponent::Heading)) {
            _ if lever == 0.0 => (0.0, 0.0),
            (None, _) => FREE,
            (Some(rate), None) => around(0.0, lever * (rate.abs() + self.tolerance)),
            (Some(rate), Some(heading)) => {
                let arm = rotated(self.offset, heading);
                let velocity = rate * Vector2::new(-arm.y, arm.x);
                let slack = lever * self.tolerance * (1.0 + rate.abs() + self.tolerance);
                around(direction.dot(&velocity), slack)
            }
        };
        let turned = self.turned();
        (reference.0 + turning.0 - turned, reference.1 + turning.1 + turned)
    }

    /// By how much the frame of the goal changes the velocity of the chassis centre of mass at most, m/s.
    fn turned(&self) -> f64 {
        if self.end_turn == 0.0 { 0.0 } else { self.end_turn * self.largest_end_speed() }
    }

    /// By how much the velocities of points then differ from those of a body that is turned as a whole, m/s: with restitution the
    /// turn is not that of the heading.
    fn stretch(&self) -> f64 {
        if self.has_restitution { self.turned() } else { 0.0 }
    }

    /// The largest speed of the chassis centre of mass that the goal allows, m/s.
    fn largest_end_speed(&self) -> f64 {
        let largest = |component| largest_magnitude(self.component(component));
        let swing = if self.lever == 0.0 { 0.0 } else { self.lever * largest(StateComponent::YawRate) };
        let asked = largest(StateComponent::VelocityX).hypot(largest(StateComponent::VelocityY)) + swing;
        asked.min(self.free_speed)
    }

    /// The least and the largest speed at the end of a point at this distance from the reference point, m/s; none where the goal
    /// leaves it free.
    pub(super) fn end_speed_at(&self, distance: f64) -> Option<Interval> {
        let components = [StateComponent::VelocityX, StateComponent::VelocityY];
        let swing = if distance == 0.0 { 0.0 } else { distance * (self.end_yaw_rate()?.abs() + self.tolerance) };
        components.iter().all(|component| self.value(*component).is_some()).then(|| {
            let [x, y] = components.map(|component| self.component(component));
            let largest = largest_magnitude(x).hypot(largest_magnitude(y));
            let slack = swing + self.stretch();
            ((least_magnitude(x).hypot(least_magnitude(y)) - slack).max(0.0), largest + slack)
        })
    }

    /// Speed at the start of a point relative to G (right, forward), m/s.
    pub(super) fn start_speed_at(&self, from_center: Vector2<f64>) -> f64 {
        let velocity = self.start.moved_by(from_center).velocity;
        velocity.x.hypot(velocity.y)
    }

    /// The yaw rate at the end where it is known: asked for, or unchangeable.
    pub(super) fn end_yaw_rate(&self) -> Option<f64> {
        let unchanged = (!self.can_turn).then_some(self.start.velocity.yaw_rate);
        self.value(StateComponent::YawRate).or(unchanged)
    }

    pub(super) fn start_velocity(&self) -> Vector2<f64> {
        Vector2::new(self.start.velocity.x, self.start.velocity.y)
    }

    /// Heading changes that meet the goal, in the two windings around `middle`, rad.
    pub(super) fn heading_changes(&self, middle: f64) -> Vec<Interval> {
        let (low, high) = self.component(StateComponent::Heading);
        if low == f64::NEG_INFINITY {
            return vec![FREE];
        }
        let start = self.start.configuration.heading;
        let center = 0.5 * (low + high) - start;
        let middle = if middle.is_finite() { middle } else { 0.0 };
        let below = center + ((middle - center) / TAU).floor() * TAU;
        // Whole turns round like the angles themselves.
        let slack = 0.5 * (high - low) + 4.0 * f64::EPSILON * (below.abs() + TAU);
        [below, below + TAU].map(|change| around(change, slack)).to_vec()
    }

    /// Magnitudes of the speeds at the start.
    pub(super) fn start_speeds(&self) -> Speeds {
        let velocity = &self.start.velocity;
        Speeds {
            translation: self.start_velocity().norm(),
            yaw: velocity.yaw_rate.abs(),
            wheel: PerWheel::new(velocity.wheel_rate.left.abs(), velocity.wheel_rate.right.abs()),
        }
    }

    /// Least magnitudes of the speeds at the goal.
    pub(super) fn least_end_speeds(&self) -> Speeds {
        let along = |direction| least_magnitude(self.end_velocity(direction));
        let of = |component| least_magnitude(self.component(component));
        Speeds {
            translation: along(Vector2::x()).hypot(along(Vector2::y())),
            yaw: of(StateComponent::YawRate),
            wheel: PerWheel::new(of(StateComponent::WheelRateLeft), of(StateComponent::WheelRateRight)),
        }
    }

    /// Interval of two components along a unit vector.
    fn along(&self, direction: Vector2<f64>, components: [StateComponent; 2]) -> Interval {
        let (mut low, mut high) = (0.0, 0.0);
        for (factor, component) in [direction.x, direction.y].into_iter().zip(components) {
            if factor != 0.0 {
                let (a, b) = self.component(component);
                let (a, b) = if factor > 0.0 { (a, b) } else { (b, a) };
                low += factor * a;
                high += factor * b;
            }
        }
        (low, high)
    }
}

fn around(center: f64, slack: f64) -> Interval {
    (center - slack, center + slack)
}

fn least_magnitude((low, high): Interval) -> f64 {
    low.max(-high).max(0.0)
}

fn largest_magnitude((low, high): Interval) -> f64 {
    high.max(-low)
}

fn rotated(vector: Vector2<f64>, heading: f64) -> Vector2<f64> {
    let (sin, cos) = heading.sin_cos();
    Vector2::new(cos * vector.x - sin * vector.y, sin * vector.x + cos * vector.y)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::shooting::{Goal, ReferencePoint};
    use crate::solver::settings::SolveParameters;

    const COMPONENTS: [StateComponent; 6] = [
        StateComponent::X,
        StateComponent::Y,
        StateComponent::Heading,
        StateComponent::VelocityX,
        StateComponent::VelocityY,
        StateComponent::YawRate,
    ];

    /// A goal, some of whose components are free.
    fn drawn_input(rng: &mut Xoshiro256PlusPlus) -> SolveInput {
        let mut parameters = SolveParameters::forward_drive();
        let mut goal = Goal::at_rest(0.0, 5.0, 0.0);
        for component in COMPONENTS {
            let size = 10.0_f64.powf(rng.random_range(-2.0..1.0));
            let value = rng.random_bool(0.7).then(|| rng.random_range(-size..size));
            goal.set(component, value);
        }
        parameters.maneuver.goal = goal;
        if rng.random_bool(0.5) {
            parameters.maneuver.reference_point = ReferencePoint::AxleMidpoint;
        }
        parameters.settings.goal_tolerance = 10.0_f64.powf(rng.random_range(-6.0..-2.0));
        SolveInput::new(parameters).unwrap()
    }

    /// The end that misses each component that is asked for by all of the tolerance.
    fn drawn_end(rng: &mut Xoshiro256PlusPlus, input: &SolveInput) -> State {
        let mut end = State::default().to_vector();
        for component in COMPONENTS {
            let miss =
                if rng.random_bool(0.5) { input.settings.goal_tolerance } else { -input.settings.goal_tolerance };
            let asked = input.maneuver.goal.value(component);
            end[component.index()] = asked.map_or_else(|| rng.random_range(-3.0..3.0), |value| value + miss);
        }
        State::from_vector(&end)
    }

    #[test]
    fn intervals_hold_all_ends_within_the_tolerance() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let holds = |(low, high): Interval, value: f64| low <= value && value <= high;
        let planar = |state: &State| Vector2::new(state.velocity.x, state.velocity.y);
        for _ in 0..3000 {
            let input = drawn_input(&mut rng);
            let targets = Targets::new(&input, &Capacity::new(&input, Grid::Continuous), Grid::Continuous);
            let end = drawn_end(&mut rng, &input);
            let center = end.moved_by(targets.offset);
            // Along what turning adds, where the interval has least to spare, and along any other direction.
            let (turning, angle) = (planar(&center) - planar(&end), rng.random_range(0.0..TAU));
            let any = Vector2::new(angle.cos(), angle.sin());
            for direction in turning.try_normalize(0.0).into_iter().chain([any]) {
                let velocity = direction.dot(&planar(&center));
                assert!(holds(targets.end_velocity(direction), velocity), "{:?} {end:?}", input.maneuver.goal);
                let (from, to) = (targets.start.configuration, center.configuration);
                let way = direction.dot(&Vector2::new(to.x - from.x, to.y - from.y));
                assert!(holds(targets.displacement(direction), way), "{:?} {end:?}", input.maneuver.goal);
            }
            // Of the points at a distance the one that turning makes fastest, and the slowest one.
            let along = rotated(planar(&end), -end.configuration.heading).try_normalize(0.0).unwrap_or(any);
            for distance in [0.0, 0.5] {
                let arm = distance * Vector2::new(along.y, -along.x);
                for arm in [arm, -arm] {
                    let speed = planar(&end.moved_by(arm)).norm();
                    let asked = targets.end_speed_at(distance);
                    assert!(asked.is_none_or(|asked| holds(asked, speed)), "{:?} {end:?}", input.maneuver.goal);
                }
            }
        }
    }
}
