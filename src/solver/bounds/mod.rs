//! What no plan can do: lower bounds on the final time that hold for every plan of the discretised model without separation, and
//! starts, goals and robots to which there is none.
//!
//! Friction and torque bound the accelerations of the whole robot's centre of mass, of the heading and of the wheels, and a
//! goal that requires more change takes longer. Each bound is that of a double integrator with bounded acceleration; the
//! derivations, also of the drive norm, are in `docs/bounds.md`.

mod axis;
mod capacity;
mod ceiling;
mod curve;
mod drive_norm;
mod drive_rate;
mod envelope;
mod excluded_ends;
mod first_time;
mod grid_error;
mod impossibility;
mod largest_normal_force;
mod limited_point;
mod loads;
mod rolling;
mod standstill;
mod targets;

use nalgebra::Vector2;

use self::axis::{Axis, GridLaw, Push};
use self::capacity::Capacity;
pub(super) use self::capacity::LAW_ERROR;
use self::ceiling::{Ceiling, SpeedLevel};
use self::curve::Curve;
pub(super) use self::excluded_ends::slip_by_wheel_rates;
use self::first_time::{Cover, Floor, first_time_beyond};
pub(super) use self::grid_error::Grid;
use self::grid_error::{GridError, KnownRates};
pub(super) use self::impossibility::impossibility;
pub(super) use self::standstill::{fields_of_torque_at_rest, may_stay_at_start};
use self::targets::Targets;
use super::settings::SolveInput;
use super::solution::LowerBoundAssumption;
use crate::robot::PerWheel;
use crate::shooting::{LONGEST_FINAL_TIME, StateComponent};

/// A bound with what it rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LowerBound {
    /// No plan is faster, s; infinite where there is none at all.
    pub(super) time: f64,
    pub(super) assumption: LowerBoundAssumption,
    /// The goal component that takes the time.
    pub(super) component: StateComponent,
}

/// Which of the bounds are worked out; those that do not matter may come out lower.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Wanted {
    /// The largest one.
    Largest,
    /// All above a time, s.
    Above(f64),
}

/// The largest bound for motions of a grid; the first one where several are equal.
pub(super) fn largest_lower_bound(input: &SolveInput, grid: Grid) -> LowerBound {
    largest(&lower_bounds(input, grid, Wanted::Largest))
}

/// The bounds for motions of a grid.
pub(super) fn lower_bounds(input: &SolveInput, grid: Grid, wanted: Wanted) -> Vec<LowerBound> {
    let mut bounds = Bounds::new(input, grid);
    let direction = bounds.most_promising_direction();
    // The equations of motion have no step, and so no frame of its end.
    let Grid::Steps(step_count) = grid else {
        return bounds.all(direction, wanted);
    };
    let goal = &input.maneuver.goal;
    let rest = [StateComponent::VelocityX, StateComponent::VelocityY, StateComponent::YawRate];
    if rest.iter().all(|component| goal.value(*component) == Some(0.0)) {
        // A turn by rounding: that of the longest plan does not matter either.
        bounds.turn_end(LONGEST_FINAL_TIME, step_count);
        return bounds.all(direction, wanted);
    }
    let longest = largest(&bounds.all(direction, Wanted::Largest)).time;
    // The longer the step, the more the frame of the goal's velocity turns: plans up to the first bound turn it at most so
    // much, and longer plans need no second one.
    bounds.turn_end(longest, step_count);
    let within = |bound: LowerBound| LowerBound { time: bound.time.min(longest), ..bound };
    bounds.all(direction, wanted).into_iter().map(within).collect()
}

fn largest(bounds: &[LowerBound]) -> LowerBound {
    let nothing = LowerBound { time: 0.0, assumption: LowerBoundAssumption::Friction, component: StateComponent::X };
    bounds.iter().fold(nothing, |best, bound| if bound.time > best.time { *bound } else { best })
}

/// The bounds that are known so far.
struct Found {
    wanted: Wanted,
    bounds: Vec<LowerBound>,
}

impl Found {
    /// What further bounds have to exceed.
    fn floor(&self) -> Floor {
        match self.wanted {
            Wanted::Largest => Floor { time: largest(&self.bounds).time, is_proven: true },
            Wanted::Above(time) => Floor { time, is_proven: false },
        }
    }
}

struct Bounds<'a> {
    input: &'a SolveInput,
    capacity: Capacity,
    targets: Targets<'a>,
    rates: KnownRates,
    grid: Grid,
}

impl<'a> Bounds<'a> {
    fn new(input: &'a SolveInput, grid: Grid) -> Self {
        let capacity = Capacity::new(input, grid);
        let targets = Targets::new(input, &capacity, grid);
        let (low, high) = targets.component(StateComponent::YawRate);
        let to_axle = input.maneuver.reference_point.to_axle_midpoint(input.robot.parameters());
        let rates = KnownRates {
            start_yaw: targets.start.velocity.yaw_rate.abs(),
            end_yaw: targets.value(StateComponent::YawRate).map(|_| high.max(-low)),
            start_norm: capacity.norm.at_most(&targets.start_speeds()),
            end_forward: targets.end_speed_at(to_axle.norm()).map(|(_, largest)| largest),
        };
        Self { input, capacity, targets, rates, grid }
    }

    /// Allows for the frame in which a goal judges velocities, in plans of at most this duration, s.
    fn turn_end(&mut self, longest: f64, step_count: usize) {
        let Self { input, capacity, targets, rates, .. } = self;
        let reachable = rates.start_yaw + capacity.yaw_acceleration * longest;
        let yaw_rate = targets.end_yaw_rate().map_or(reachable, |rate| rate.abs() + input.settings.goal_tolerance);
        let error = GridError::new(capacity, rates, longest, self.grid).since_start(longest);
        let speed = targets.start_speeds().translation + capacity.acceleration * longest + error;
        let turn = 0.5 * longest / step_count as f64 * yaw_rate;
        targets.turn_end(turn, speed + capacity.center.norm() * yaw_rate);
    }

    /// With the motion of the whole robot's centre of mass along this direction, if there is one.
    fn all(&self, direction: Option<Vector2<f64>>, wanted: Wanted) -> Vec<LowerBound> {
        let mut found = Found { wanted, bounds: Vec::new() };
        if let Some(direction) = direction {
            self.of_center(direction, &mut found);
        }
        self.of_yaw(&mut found);
        found.bounds.extend(self.of_drive_norm(found.floor()));
        found.bounds.extend(self.of_point_place(found.floor()));
        found.bounds.extend(self.of_point_speed(found.floor()));
        self.of_wheels(&mut found);
        found.bounds
    }

    fn error(&self, duration: f64) -> GridError {
        GridError::new(&self.capacity, &self.rates, duration, self.grid)
    }

    /// Unit vectors along which the goal is compared with the start. Any of them gives a bound.
    fn directions(&self) -> Vec<Vector2<f64>> {
        let is_asked = |component| self.targets.value(component).is_some();
        if is_asked(StateComponent::X) && is_asked(StateComponent::Y) {
            self.directions_in_the_plane()
        } else {
            // Along an axis a place or a speed alone may be asked for.
            vec![Vector2::x(), Vector2::y()]
        }
    }

    fn directions_in_the_plane(&self) -> Vec<Vector2<f64>> {
        let middle = |(low, high): (f64, f64)| 0.5 * (low + high);
        let along = |direction| middle(self.targets.displacement(direction));
        let displacement = Vector2::new(along(Vector2::x()), along(Vector2::y()));
        let speed = self.targets.start_velocity();
        let end = |direction| middle(self.targets.end_velocity(direction));
        let change = Vector2::new(end(Vector2::x()), end(Vector2::y())) - speed;
        // Of the maneuver, not of the world: a bound does not depend on how that lies.
        let ahead = [displacement, speed, change].into_iter().find_map(|vector| vector.try_normalize(0.0));
        let Some(ahead) = ahead else { return Vec::new() };
        let mut directions = vec![ahead];
        if speed != Vector2::zeros() || change != Vector2::zeros() {
            let left = |vector: Vector2<f64>| Vector2::new(-vector.y, vector.x);
            let across = left(ahead);
            let further = [across, ahead + across, ahead - across, speed, left(speed), change];
            directions.extend(further.into_iter().filter_map(|vector| vector.try_normalize(0.0)));
        }
        directions.retain(|direction| direction.norm().is_finite());
        directions
    }

    /// Bounds by the motion of the whole robot's centre of mass along a direction: without the torques, with them, and with limits.
    fn of_center(&self, direction: Vector2<f64>, found: &mut Found) {
        let axis = self.axis_along(direction);
        let by_friction = self.bound(&axis.without_drive(), LowerBoundAssumption::Friction, found.floor());
        found.bounds.push(by_friction);
        if axis.drive_scale.is_some() && by_friction.time.is_finite() {
            found.bounds.push(self.bound(&axis, self.of_torques(), found.floor()));
        }
        if let Some(point) = self.point_ceiling() {
            let axis = Axis { ceiling: Ceiling { point: Some(point), ..axis.ceiling }, ..axis };
            found.bounds.push(self.bound(&axis, LowerBoundAssumption::Limits, found.floor()));
        }
    }

    /// The direction along which friction alone gives the largest bound by the motion of the whole robot's centre of mass.
    fn most_promising_direction(&self) -> Option<Vector2<f64>> {
        let promise = |direction: Vector2<f64>, floor| {
            let axis = Axis { law: GridLaw::Exact, ..self.axis_along(direction).without_drive() };
            self.bound(&axis, LowerBoundAssumption::Friction, floor).time
        };
        let mut directions = self.directions().into_iter();
        let mut best = directions.next()?;
        let mut largest_promise = None;
        for next in directions {
            let known = *largest_promise.get_or_insert_with(|| promise(best, Floor::ZERO));
            let promised = promise(next, Floor { time: known, is_proven: false });
            if promised > known {
                (best, largest_promise) = (next, Some(promised));
            }
        }
        Some(best)
    }

    fn bound(&self, axis: &Axis, assumption: LowerBoundAssumption, floor: Floor) -> LowerBound {
        let (time, component) = axis.least_time(&|duration| self.error(duration), floor);
        LowerBound { time, assumption, component }
    }

    /// The whole robot's centre of mass along a direction.
    fn axis_along(&self, direction: Vector2<f64>) -> Axis {
        let level = if self.capacity.rolling.is_some() { SpeedLevel::Center } else { SpeedLevel::None };
        let is_along_x = direction.x.abs() > direction.y.abs();
        Axis {
            acceleration: self.capacity.acceleration,
            start_push: self.start_push(direction),
            end_push: self.end_push(direction),
            start_speed: direction.dot(&self.targets.start_velocity()),
            end_speed: self.targets.end_velocity(direction),
            displacement: self.targets.displacement(direction),
            drive_scale: self.drive_scale(self.capacity.translation_scale()),
            is_damped: false,
            ceiling: Ceiling { level, ..Ceiling::default() },
            law: GridLaw::CenterOfMass,
            components: if is_along_x {
                [StateComponent::X, StateComponent::VelocityX]
            } else {
                [StateComponent::Y, StateComponent::VelocityY]
            },
        }
    }

    /// Accelerations near the start, where the heading is known.
    fn start_push(&self, direction: Vector2<f64>) -> Push {
        let heading = self.targets.start.configuration.heading;
        self.push(direction, heading, 0.0, self.rates.start_yaw)
    }

    /// Accelerations near the end, where the heading is known if the goal asks for it.
    fn end_push(&self, direction: Vector2<f64>) -> Push {
        match (self.targets.value(StateComponent::Heading), self.rates.end_yaw) {
            (Some(heading), Some(yaw_rate)) => {
                let (low, high) = self.targets.component(StateComponent::Heading);
                self.push(direction, heading, (high - heading).max(heading - low), yaw_rate)
            }
            (None, _) | (_, None) => Push::steady(self.capacity.acceleration),
        }
    }

    /// Accelerations while the heading is near a known one.
    fn push(&self, direction: Vector2<f64>, heading: f64, slack: f64, yaw_rate: f64) -> Push {
        if self.grid == Grid::Continuous {
            // Whether it takes hours does not depend on the first and last seconds.
            return Push::steady(self.capacity.acceleration);
        }
        let (sin, cos) = heading.sin_cos();
        let of_body = Vector2::new(cos * direction.y - sin * direction.x, cos * direction.x + sin * direction.y);
        let along = |of_body| self.capacity.accelerations_along(of_body, slack, yaw_rate);
        Push { towards: along(of_body), against: along(-of_body) }
    }

    /// Bounds by the yaw about the whole robot's centre of mass.
    fn of_yaw(&self, found: &mut Found) {
        let is_limited = self.capacity.largest_yaw_rate(0.0).is_finite();
        let yaw_level = if is_limited { SpeedLevel::Yaw } else { SpeedLevel::None };
        let axis = Axis {
            acceleration: self.capacity.yaw_acceleration,
            start_push: Push::steady(self.capacity.yaw_acceleration),
            end_push: Push::steady(self.capacity.yaw_acceleration),
            start_speed: self.targets.start.velocity.yaw_rate,
            end_speed: self.targets.component(StateComponent::YawRate),
            displacement: (f64::NEG_INFINITY, f64::INFINITY),
            drive_scale: self.drive_scale(self.capacity.yaw_scale()),
            is_damped: false,
            ceiling: Ceiling { level: yaw_level, ..Ceiling::default() },
            law: GridLaw::Exact,
            components: [StateComponent::Heading, StateComponent::YawRate],
        };
        // The goal's windings on both sides of the change that takes no time beyond that of the speed. A moving start has passed both at
        // some time, and reaches others: so earlier times count too, also those that another bound excludes.
        let changes = self.targets.heading_changes(axis.displacement_of_fastest_change());
        let of_windings = |axis: &Axis, assumption, floor: Floor| {
            let floor = Floor { is_proven: false, ..floor };
            let axes = changes.iter().map(|change| Axis { displacement: *change, ..axis.clone() });
            let windings = axes.map(|axis| self.bound(&axis, assumption, floor));
            windings.reduce(|a, b| if b.time < a.time { b } else { a })
        };
        let is_limited = self.capacity.is_yaw_limited();
        let assumption = if is_limited { LowerBoundAssumption::Limits } else { LowerBoundAssumption::YawFriction };
        found.bounds.extend(of_windings(&axis.without_drive(), assumption, found.floor()));
        if yaw_level != SpeedLevel::None {
            let axis = Axis { drive_scale: None, ..axis.clone() };
            found.bounds.extend(of_windings(&axis, LowerBoundAssumption::Limits, found.floor()));
        }
        found.bounds.extend(self.of_driven_yaw(&axis, found.floor()));
    }

    /// Bound by the smallest change of heading: the drive line does not depend on the direction, so that one is the
    /// fastest.
    fn of_driven_yaw(&self, axis: &Axis, floor: Floor) -> Option<LowerBound> {
        axis.drive_scale?;
        let start_speed = axis.start_speed.abs();
        let end_speed = axis.end_speed.1.max(-axis.end_speed.0);
        let least = |(low, high): (f64, f64)| low.max(-high);
        let changes = self.targets.heading_changes(0.0).into_iter();
        let change = changes.map(least).reduce(f64::min).unwrap_or(f64::NEG_INFINITY);
        let magnitude = Axis {
            start_speed,
            end_speed: (f64::NEG_INFINITY, end_speed),
            displacement: (change, f64::INFINITY),
            components: [StateComponent::Heading; 2],
            ..axis.clone()
        };
        let is_limited = axis.ceiling.level != SpeedLevel::None;
        let assumption = if is_limited { LowerBoundAssumption::Limits } else { self.of_torques() };
        Some(self.bound(&magnitude, assumption, floor))
    }

    /// What bounds by the torques rest on: where no wheel may slip, on that.
    fn of_torques(&self) -> LowerBoundAssumption {
        if self.capacity.rolling.is_some() { LowerBoundAssumption::Limits } else { LowerBoundAssumption::DriveTorque }
    }

    /// `scale`, unless torques bound nothing.
    fn drive_scale(&self, scale: f64) -> Option<f64> {
        self.capacity.drive_rates.as_ref().map(|_| scale)
    }

    /// Bound by the speeds of the goal, which the torques must build up.
    fn of_drive_norm(&self, floor: Floor) -> Option<LowerBound> {
        self.capacity.drive_rates.as_ref()?;
        let speeds = self.targets.least_end_speeds();
        let rise = self.capacity.norm.at_least(&speeds) - self.rates.start_norm;
        // The norms of start and goal round to a few units in the last place.
        let required = rise - 1e-12 * self.rates.start_norm;
        let cover = |_, duration| {
            if duration <= 0.0 {
                return Cover::growing(0.0);
            }
            let error = self.error(duration);
            let rise = |drive: &Curve| drive.end() - self.rates.start_norm + error.of_end_norm();
            Cover::growing(error.drive.as_ref().map_or(f64::INFINITY, rise))
        };
        let time = first_time_beyond(floor, required, cover);
        let weights = [
            (StateComponent::VelocityX, self.capacity.mass),
            (StateComponent::VelocityY, self.capacity.mass),
            (StateComponent::YawRate, self.capacity.yaw_inertia),
            (StateComponent::WheelRateLeft, self.input.robot.parameters().wheel_spin_inertia),
            (StateComponent::WheelRateRight, self.input.robot.parameters().wheel_spin_inertia),
        ];
        let energy =
            |(component, weight): (StateComponent, f64)| weight * self.targets.value(component).unwrap_or(0.0).powi(2);
        let (component, _) = weights.into_iter().max_by(|a, b| energy(*a).total_cmp(&energy(*b)))?;
        Some(LowerBound { time, assumption: self.of_torques(), component })
    }

    /// Bounds by torque and friction at each wheel.
    fn of_wheels(&self, found: &mut Found) {
        let start = &self.targets.start;
        let PerWheel { left, right } = self.capacity.wheel_acceleration;
        let (angle, rate) = (start.configuration.wheel_angle, start.velocity.wheel_rate);
        let limit = self.capacity.limits.wheel;
        let level = if limit.is_finite() { SpeedLevel::Wheel(limit) } else { SpeedLevel::None };
        let wheels = [
            (left, angle.left, rate.left, [StateComponent::WheelAngleLeft, StateComponent::WheelRateLeft]),
            (right, angle.right, rate.right, [StateComponent::WheelAngleRight, StateComponent::WheelRateRight]),
        ];
        for (acceleration, angle, rate, components) in wheels {
            let [(low, high), end_speed] = components.map(|component| self.targets.component(component));
            let axis = Axis {
                acceleration,
                start_push: Push::steady(acceleration),
                end_push: Push::steady(acceleration),
                start_speed: rate,
                end_speed,
                displacement: (low - angle, high - angle),
                drive_scale: None,
                is_damped: self.input.robot.parameters().wheel_viscous_friction > 0.0,
                ceiling: Ceiling { level, ..Ceiling::default() },
                law: GridLaw::Exact,
                components,
            };
            found.bounds.push(self.bound(&axis.without_limits(), LowerBoundAssumption::WheelDrive, found.floor()));
            if level != SpeedLevel::None {
                found.bounds.push(self.bound(&axis, LowerBoundAssumption::Limits, found.floor()));
            }
        }
    }
}

#[cfg(test)]
mod tests;
