//! One coordinate of a motion, as a double integrator: its speed stays below straight lines over time, which bounds the
//! distance covered.
//!
//! The speed grows by at most the acceleration from the start, and must fall back by at most as much to the end; the
//! torques bound it by a line of their own. The distance covered in a time T is then at most the area under the lowest
//! line, plus what the grid's errors add to the line that is the lowest.

use super::envelope::{Envelope, Line, Piece};
use super::first_time::first_time;
use super::grid_error::GridError;

/// Spans on which the grid's errors are bounded by their largest value.
const ERROR_SPANS: u32 = 4;

/// The requirements on a coordinate, in its positive direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    pub(super) acceleration: f64,
    pub(super) start_speed: f64,
    /// Lowest and highest speed at the end; infinite where it is free.
    pub(super) end_speed: (f64, f64),
    /// Lowest and highest displacement that meets the goal; infinite where it is free.
    pub(super) displacement: (f64, f64),
    /// Bound on the magnitude of the speed by the torques.
    pub(super) drive: Option<Line>,
}

/// Which part of a goal takes the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Demand {
    Displacement,
    Velocity,
}

/// How the grid's errors enter the lines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum GridLaw {
    /// The scheme keeps acceleration and displacement exactly; the drive line is off by this multiple of its error.
    Exact { drive_scale: f64 },
    /// The coordinate is one of the whole robot's centre of mass.
    CenterOfMass,
}

impl GridLaw {
    /// Whether no line of the axis is in error.
    fn is_exact(self, axis: &Axis) -> bool {
        matches!(self, Self::Exact { .. }) && axis.drive.is_none()
    }

    fn error_of_line(self, line: usize, (from, to): (f64, f64), error: &GridError) -> f64 {
        match (self, line) {
            (Self::Exact { .. }, FORWARD | BACKWARD) => 0.0,
            (Self::Exact { drive_scale }, _) => drive_scale * error.of_drive(to),
            (Self::CenterOfMass, FORWARD) => error.since_start(to),
            (Self::CenterOfMass, BACKWARD) => error.until_end(from),
            (Self::CenterOfMass, _) => error.of_drive(to),
        }
    }

    fn error_of_displacement(self, error: &GridError) -> f64 {
        match self {
            Self::Exact { drive_scale } => drive_scale * error.dt() * error.of_drive(f64::INFINITY),
            Self::CenterOfMass => error.of_displacement(),
        }
    }

    fn error_of_velocity(self, error: &GridError) -> f64 {
        match self {
            Self::Exact { .. } => 0.0,
            Self::CenterOfMass => error.since_start(f64::INFINITY),
        }
    }
}

/// Order of the lines.
const FORWARD: usize = 0;
const BACKWARD: usize = 1;
const DRIVE: usize = 2;

impl Axis {
    /// The same coordinate with the opposite sign.
    fn reversed(&self) -> Self {
        Self {
            start_speed: -self.start_speed,
            end_speed: (-self.end_speed.1, -self.end_speed.0),
            displacement: (-self.displacement.1, -self.displacement.0),
            ..*self
        }
    }

    /// The same coordinate without the torques' bound.
    pub(super) fn without_drive(&self) -> Self {
        Self { drive: None, ..*self }
    }

    /// A time before which the coordinate cannot meet its goal, s; infinite where it never can.
    pub(super) fn least_time(&self, law: GridLaw, error: &impl Fn(f64) -> GridError) -> (f64, Demand) {
        let velocity = self.least_time_of_velocity(law, error);
        let one_way = |axis: &Self| axis.least_time_of_displacement(velocity, law, error);
        let displacement = one_way(self).max(one_way(&self.reversed()));
        if displacement > velocity { (displacement, Demand::Displacement) } else { (velocity, Demand::Velocity) }
    }

    /// The displacement of the fastest change of speed.
    pub(super) fn displacement_of_fastest_change(&self) -> f64 {
        let end = self.start_speed.clamp(self.end_speed.0, self.end_speed.1);
        let change = (end - self.start_speed).abs();
        if change == 0.0 { 0.0 } else { 0.5 * (self.start_speed + end) * change / self.acceleration }
    }

    fn least_time_of_velocity(&self, law: GridLaw, error: &impl Fn(f64) -> GridError) -> f64 {
        let change = (self.end_speed.0 - self.start_speed).max(self.start_speed - self.end_speed.1);
        first_time(0.0, change, |_, duration| {
            let is_exact = duration <= 0.0 || law.is_exact(self);
            self.acceleration * duration + if is_exact { 0.0 } else { law.error_of_velocity(&error(duration)) }
        })
    }

    fn least_time_of_displacement(&self, not_before: f64, law: GridLaw, error: &impl Fn(f64) -> GridError) -> f64 {
        if self.displacement.0 == f64::NEG_INFINITY {
            return not_before;
        }
        first_time(not_before, self.displacement.0, |from, to| self.furthest(from, to, law, error))
    }

    /// The furthest displacement in any time between two.
    ///
    /// With more time every line lies higher, so the lines of the longest time hold for all of them.
    fn furthest(&self, from: f64, to: f64, law: GridLaw, error: &impl Fn(f64) -> GridError) -> f64 {
        if to <= 0.0 {
            return 0.0;
        }
        let envelope = Envelope::new(&self.lines(to), to);
        let area = largest_area(envelope.pieces(), from);
        if law.is_exact(self) {
            return area;
        }
        let error = error(to);
        let error_area: f64 = envelope.pieces().iter().map(|piece| law.error_area(piece, &error)).sum();
        area + error_area + law.error_of_displacement(&error)
    }

    fn lines(&self, duration: f64) -> [Line; 3] {
        let mut lines = [Line::ABOVE_ALL; 3];
        lines[FORWARD] = Line { start: self.start_speed, slope: self.acceleration };
        if self.end_speed.1.is_finite() {
            lines[BACKWARD] =
                Line { start: self.end_speed.1 + self.acceleration * duration, slope: -self.acceleration };
        }
        lines[DRIVE] = self.drive.unwrap_or(Line::ABOVE_ALL);
        lines
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
        let span = (piece.to - piece.from) / f64::from(ERROR_SPANS);
        let start = |index: u32| piece.from + span * f64::from(index);
        let largest = |index: u32| self.error_of_line(piece.line, (start(index), start(index + 1)), error);
        span * (0..ERROR_SPANS).map(largest).sum::<f64>()
    }
}
