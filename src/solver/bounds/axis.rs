//! One coordinate of a motion, as a double integrator: its speed stays below curves over time, which bounds the distance
//! covered.
//!
//! The speed grows by at most the acceleration from the start, and must fall back by at most as much to the end; the
//! torques bound it by a curve of their own. The distance covered in a time T is then at most the area under the lowest
//! curve, plus what the grid's errors add to the one that is the lowest.
//!
//! Viscous friction of the coordinate brakes it beyond its acceleration, but never drives it: then only what takes the speed away
//! from zero needs time.

use super::ceiling::Ceiling;
use super::curve::{Curve, Level};
use super::envelope::{Envelope, Piece};
use super::first_time::{Cover, Floor, first_time};
use super::grid_error::GridError;
use crate::shooting::StateComponent;

/// Spans of a motion on which the grid's errors are bounded by their largest value.
const ERROR_SPANS: f64 = 64.0;

/// Largest accelerations by time, where they are smaller near one end of the motion.
#[derive(Debug, Clone)]
pub(super) struct Push {
    /// In the positive direction.
    pub(super) towards: Vec<Level>,
    /// In the negative direction.
    pub(super) against: Vec<Level>,
}

impl Push {
    /// The same acceleration at all times.
    pub(super) fn steady(acceleration: f64) -> Self {
        let levels = vec![Level { until: f64::INFINITY, rate: acceleration }];
        Self { towards: levels.clone(), against: levels }
    }

    fn reversed(&self) -> Self {
        Self { towards: self.against.clone(), against: self.towards.clone() }
    }
}

/// The requirements on a coordinate, in its positive direction.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    /// At all times.
    pub(super) acceleration: f64,
    /// By the time since the start.
    pub(super) start_push: Push,
    /// By the time that is left.
    pub(super) end_push: Push,
    pub(super) start_speed: f64,
    /// Lowest and highest speed at the end; infinite where it is free.
    pub(super) end_speed: (f64, f64),
    /// Lowest and highest displacement that meets the goal; infinite where it is free.
    pub(super) displacement: (f64, f64),
    /// Speed per unit of the drive norm, at most; none where the torques are not asked.
    pub(super) drive_scale: Option<f64>,
    /// Whether viscous friction acts on the coordinate beside the acceleration.
    pub(super) is_damped: bool,
    /// Limits of its speed.
    pub(super) ceiling: Ceiling,
    pub(super) law: GridLaw,
    /// The goal components of displacement and speed.
    pub(super) components: [StateComponent; 2],
}

/// How the grid's errors enter the curves; that of the torques has its errors in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GridLaw {
    /// The scheme keeps acceleration and displacement exactly.
    Exact,
    /// The coordinate is one of the whole robot's centre of mass.
    CenterOfMass,
}

impl GridLaw {
    fn error_of_curve(self, curve: usize, (from, to): (f64, f64), error: &GridError) -> f64 {
        match (self, curve) {
            (Self::CenterOfMass, FORWARD) => error.since_start(to),
            (Self::CenterOfMass, BACKWARD) => error.until_end(from),
            (Self::Exact | Self::CenterOfMass, _) => 0.0,
        }
    }

    fn error_of_displacement(self, error: &GridError) -> f64 {
        match self {
            Self::Exact => 0.0,
            Self::CenterOfMass => error.of_displacement(),
        }
    }

    fn error_of_velocity(self, error: &GridError) -> f64 {
        match self {
            Self::Exact => 0.0,
            Self::CenterOfMass => error.since_start(f64::INFINITY),
        }
    }
}

/// Order of the curves; between these is that of the torques.
const FORWARD: usize = 0;
const BACKWARD: usize = 1;
const LIMITS: usize = 3;

impl Axis {
    /// The same coordinate with the opposite sign.
    fn reversed(&self) -> Self {
        Self {
            start_speed: -self.start_speed,
            end_speed: (-self.end_speed.1, -self.end_speed.0),
            displacement: (-self.displacement.1, -self.displacement.0),
            start_push: self.start_push.reversed(),
            end_push: self.end_push.reversed(),
            ..*self
        }
    }

    /// The same coordinate without the torques' bound and limits.
    pub(super) fn without_drive(&self) -> Self {
        Self { drive_scale: None, ..self.without_limits() }
    }

    /// The same coordinate without limits of its speed.
    pub(super) fn without_limits(&self) -> Self {
        Self { ceiling: Ceiling::default(), ..self.clone() }
    }

    /// A time before which the coordinate cannot meet its goal, s, with the component that takes it; infinite where it never can, and
    /// zero where it is no later than `floor`.
    pub(super) fn least_time(&self, error: &impl Fn(f64) -> GridError, floor: Floor) -> (f64, StateComponent) {
        let [of_displacement, of_velocity] = self.components;
        let reversed = self.reversed();
        let at_floor = error(floor.time);
        if !self.excludes(floor.time, &at_floor) && !reversed.excludes(floor.time, &at_floor) {
            return (0.0, of_velocity);
        }
        let velocity = self.least_time_of_velocity(error);
        let one_way = |axis: &Self| axis.least_time_of_displacement(velocity, error, floor);
        let displacement = one_way(self).max(one_way(&reversed));
        if displacement > velocity { (displacement, of_displacement) } else { (velocity, of_velocity) }
    }

    /// The displacement of the fastest change of speed.
    pub(super) fn displacement_of_fastest_change(&self) -> f64 {
        let end = self.start_speed.clamp(self.end_speed.0, self.end_speed.1);
        let change = (end - self.start_speed).abs();
        if change == 0.0 { 0.0 } else { 0.5 * (self.start_speed + end) * change / self.acceleration }
    }

    /// Whether a plan of a duration, s, cannot meet the goal in the positive direction.
    fn excludes(&self, duration: f64, error: &GridError) -> bool {
        self.largest_change(duration, || self.law.error_of_velocity(error)) < self.change_of_speed()
            || self.asks_for_displacement() && self.furthest(duration, duration, error).within < self.displacement.0
    }

    fn least_time_of_velocity(&self, error: &impl Fn(f64) -> GridError) -> f64 {
        let grid_error = |duration| match self.law {
            GridLaw::Exact => 0.0,
            GridLaw::CenterOfMass => self.law.error_of_velocity(&error(duration)),
        };
        let change = |_, duration| Cover::growing(self.largest_change(duration, || grid_error(duration)));
        first_time(0.0, self.change_of_speed(), Floor::ZERO, change)
    }

    /// What the goal asks for, in either direction.
    fn change_of_speed(&self) -> f64 {
        (self.end_speed.0 - self.rise_from()).max(self.fall_from() - self.end_speed.1)
    }

    /// The speed from which a rise takes time: viscous friction may stop the coordinate in no time.
    fn rise_from(&self) -> f64 {
        if self.is_damped { self.start_speed.max(0.0) } else { self.start_speed }
    }

    /// The speed from which a fall takes time.
    fn fall_from(&self) -> f64 {
        if self.is_damped { self.start_speed.min(0.0) } else { self.start_speed }
    }

    /// The largest change of speed within a duration.
    fn largest_change(&self, duration: f64, grid_error: impl FnOnce() -> f64) -> f64 {
        if duration <= 0.0 { 0.0 } else { self.acceleration * duration + grid_error() }
    }

    fn asks_for_displacement(&self) -> bool {
        self.displacement.0 > f64::NEG_INFINITY
    }

    fn least_time_of_displacement(&self, not_before: f64, error: &impl Fn(f64) -> GridError, floor: Floor) -> f64 {
        if !self.asks_for_displacement() {
            return not_before;
        }
        first_time(not_before, self.displacement.0, floor, |from, to| self.furthest(from, to, &error(to)))
    }

    /// The furthest displacement in any time between two.
    ///
    /// With more time every line lies higher, so the lines of the longest time hold for all of them.
    fn furthest(&self, from: f64, to: f64, error: &GridError) -> Cover {
        if to <= 0.0 {
            return Cover::growing(0.0);
        }
        let forward = Curve::by_time(&self.start_push.towards, self.rise_from(), error.dt, to);
        let backward = match self.end_speed.1 {
            speed if speed.is_finite() && !self.is_damped => {
                Curve::by_time(&self.end_push.against, speed, error.dt, to).reversed()
            }
            _ => Curve::above_all(to),
        };
        let drive = self.drive_scale.and_then(|scale| Some(error.drive.as_ref()?.scaled(scale)));
        let drive = drive.unwrap_or_else(|| Curve::above_all(to));
        let lines = self.ceiling.lines(error, self.drive_scale, to);
        let mut curves = vec![&forward, &backward, &drive];
        curves.extend(&lines.curves);
        let envelope = Envelope::new(&curves);
        let convexity = error.of_convexity(&curves);
        let error_area: f64 = envelope.pieces().iter().map(|piece| self.law.error_area(piece, error)).sum();
        let excess = lines.excess(envelope.pieces(), LIMITS, self.start_speed);
        let further = error_area + convexity + self.law.error_of_displacement(error) + excess;
        Cover { at_end: envelope.area(to) + further, within: largest_area(envelope.pieces(), from) + further }
    }
}

/// The largest area up to any time from `from` on.
fn largest_area(pieces: &[Piece], from: f64) -> f64 {
    let (mut area, mut largest) = (0.0, f64::NEG_INFINITY);
    for piece in pieces {
        let (before, after) = (piece.value_from, piece.value_to);
        // Where the speed falls through zero the area is the largest.
        let turn = if before > 0.0 && after < 0.0 {
            piece.from + (piece.to - piece.from) * before / (before - after)
        } else {
            piece.to
        };
        for time in [from, turn, piece.to] {
            if time >= from && time >= piece.from && time <= piece.to {
                largest = largest.max(area + piece.until(time).area());
            }
        }
        area += piece.area();
    }
    largest
}

impl GridLaw {
    /// Area that the error of a piece's line may add.
    fn error_area(self, piece: &Piece, error: &GridError) -> f64 {
        let length = piece.to - piece.from;
        let count = (ERROR_SPANS * length / error.duration).ceil().max(1.0);
        let span = length / count;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole, and no more than all spans"
        )]
        let count = count as u32;
        let start = |index: u32| piece.from + span * f64::from(index);
        let largest = |index: u32| self.error_of_curve(piece.curve, (start(index), start(index + 1)), error);
        span * (0..count).map(largest).sum::<f64>()
    }
}
