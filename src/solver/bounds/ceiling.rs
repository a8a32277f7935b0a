//! What limits on the way leave of the speed of a coordinate: further lines over the area, below which its node values stay
//! (`docs/bounds.md`).

use super::curve::Curve;
use super::envelope::{Envelope, Piece};
use super::grid_error::GridError;
use crate::shooting::LIMIT_TOLERANCE;

/// What a plan may exceed a limit by, as a factor: twice the tolerance, since of values within half of it the larger one need not
/// be noted.
pub(super) const KEPT: f64 = 1.0 + 2.0 * LIMIT_TOLERANCE;

/// The most that a plan reaches under a limit; infinite without.
pub(super) fn kept(limit: Option<f64>) -> f64 {
    limit.map_or(f64::INFINITY, |limit| KEPT * limit)
}

/// Limits of the speed of a coordinate.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ceiling {
    pub(super) level: SpeedLevel,
    /// Limits of a point of the chassis, where the coordinate is one of G.
    pub(super) point: Option<PointCeiling>,
}

/// The largest speed at all nodes but the first, which no limit judges.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) enum SpeedLevel {
    #[default]
    None,
    /// That of a wheel, rad/s.
    Wheel(f64),
    /// That of the yaw.
    Yaw,
    /// That of G by wheels that hold.
    Center,
}

/// Limits of the speed of a point of the chassis.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointCeiling {
    /// Distance from the chassis centre of mass, m.
    pub(super) lever: f64,
    /// Distance from G, m.
    pub(super) distance: f64,
    /// m/s
    pub(super) start_speed: f64,
    /// Largest speed at the end, m/s; infinite where it is free.
    pub(super) end_speed: f64,
    /// Largest speed, m/s; infinite without limit.
    pub(super) speed: f64,
    /// Largest rate at which the speed grows and falls, m/s2; infinite without limit.
    pub(super) growth: f64,
    pub(super) fall: f64,
}

/// The lines of a ceiling over a motion of known duration.
#[derive(Debug, Clone)]
pub(super) struct Lines<'a> {
    error: &'a GridError,
    point: Option<PointCeiling>,
    /// Of the point after the others.
    pub(super) curves: Vec<Curve>,
    point_count: usize,
}

impl Ceiling {
    /// The lines; `drive_scale` is the speed per norm.
    pub(super) fn lines<'a>(&self, error: &'a GridError, drive_scale: Option<f64>, duration: f64) -> Lines<'a> {
        let brake = drive_scale.and_then(|scale| Some(error.brake.as_ref()?.scaled(scale).reversed()));
        let level = match self.level {
            SpeedLevel::None => f64::INFINITY,
            SpeedLevel::Wheel(rate) => rate,
            SpeedLevel::Yaw => error.yaw_level,
            SpeedLevel::Center => error.center_level,
        };
        let level = level.is_finite().then(|| Curve::straight(level, 0.0, duration));
        let mut curves: Vec<_> = brake.into_iter().chain(level).collect();
        let others = curves.len();
        curves.extend(self.point.iter().flat_map(|point| point.curves(error, duration)));
        Lines { error, point: self.point, point_count: curves.len() - others, curves }
    }
}

impl PointCeiling {
    /// Change of the speed by which frames half a step apart differ, m/s.
    fn half_turn(&self, error: &GridError) -> f64 {
        if self.lever == 0.0 { 0.0 } else { 0.5 * error.dt * self.lever * error.peak_yaw_rate.powi(2) }
    }

    /// Growth of the speed per second that no limit judges: from step to step the frame turns in a circle, the point in its chord.
    fn drift(&self, error: &GridError) -> f64 {
        if self.lever == 0.0 { 0.0 } else { error.peak_yaw_rate * self.half_turn(error) }
    }

    fn curves(&self, error: &GridError, duration: f64) -> Vec<Curve> {
        let (half_turn, drift) = (self.half_turn(error), self.drift(error));
        let rise = (self.start_speed + half_turn, self.growth + drift);
        let fall = (self.end_speed + half_turn, self.fall + drift);
        let straight = |(start, slope): (f64, f64)| {
            (start.is_finite() && slope.is_finite()).then(|| Curve::straight(start, slope, duration))
        };
        [straight(rise), straight((self.speed, 0.0)), straight(fall).map(|curve| curve.reversed())]
            .into_iter()
            .flatten()
            .collect()
    }

    /// How far the point may come, m.
    pub(super) fn furthest(&self, error: &GridError, duration: f64) -> f64 {
        let curves = self.curves(error, duration);
        let Some(lowest) = curves.iter().map(Curve::at_start).reduce(f64::min) else { return f64::INFINITY };
        if duration <= 0.0 {
            return 0.0;
        }
        let envelope = Envelope::new(&curves.iter().collect::<Vec<_>>());
        let chords = if self.lever == 0.0 { 0.0 } else { self.lever * error.of_chords() };
        envelope.area(duration) + half_step_above(lowest, self.start_speed, error) + chords
    }

    /// How much the speed may change over a duration upwards and downwards, m/s.
    pub(super) fn largest_changes(&self, error: &GridError, duration: f64) -> (f64, f64) {
        let of = |rate: f64| (rate + self.drift(error)) * duration + 2.0 * self.half_turn(error);
        (of(self.growth), of(self.fall))
    }

    /// How much further G may come than the point while the point's lines are the lowest for some time, m.
    fn swing(&self, error: &GridError, duration: f64) -> f64 {
        let peak = error.peak_yaw_rate;
        let of_distance =
            if self.distance == 0.0 { 0.0 } else { self.distance * ((peak * duration).min(2.0) + error.dt * peak) };
        of_distance + self.half_turn(error) * (duration + error.dt)
    }
}

/// How far the half step of the first node leads beyond the lowest line: no limit judges the speed there, m or rad.
fn half_step_above(lowest: f64, start_speed: f64, error: &GridError) -> f64 {
    0.5 * error.dt * (start_speed - lowest).max(0.0)
}

impl Lines<'_> {
    /// What the displacement may exceed the area under the lowest lines by, m or rad: `pieces` of the envelope whose curves from
    /// `first` on are these, for a coordinate with this speed at the start.
    pub(super) fn excess(&self, pieces: &[Piece], first: usize, start_speed: f64) -> f64 {
        if self.curves.is_empty() {
            return 0.0;
        }
        let lowest = self.curves.iter().map(Curve::at_start).fold(f64::INFINITY, f64::min);
        let start = self.point.map_or(start_speed, |point| point.start_speed.max(start_speed));
        half_step_above(lowest, start, self.error) + self.swing(pieces, first + self.curves.len() - self.point_count)
    }

    fn swing(&self, pieces: &[Piece], first: usize) -> f64 {
        let Some(point) = self.point else { return 0.0 };
        let stretches = pieces.chunk_by(|one, next| (one.curve >= first) == (next.curve >= first));
        let of_point = stretches.filter(|stretch| stretch[0].curve >= first);
        let durations = of_point.map(|stretch| stretch[stretch.len() - 1].to - stretch[0].from);
        let swing: f64 = durations.map(|duration| point.swing(self.error, duration)).sum();
        let quadrature = if point.distance == 0.0 { 0.0 } else { point.distance * self.error.of_quadrature() };
        swing + quadrature
    }
}
