//! Bounds by the limits of the speed and the accelerations of one point of the robot.

use nalgebra::Vector2;

use super::ceiling::{PointCeiling, kept};
use super::first_time::{Cover, Floor, first_time_beyond};
use super::{Bounds, LowerBound};
use crate::shooting::StateComponent;
use crate::solver::solution::LowerBoundAssumption;

impl Bounds<'_> {
    /// The limits of the speed and the accelerations of a point, where there are any.
    pub(super) fn point_ceiling(&self) -> Option<PointCeiling> {
        let limits = &self.input.maneuver.limits;
        let is_limited = limits.speed.is_some() || limits.acceleration.is_some() || limits.deceleration.is_some();
        is_limited.then(|| {
            let point = self.input.limited_point();
            let from_center = point - self.capacity.center;
            let end_speed = self.targets.end_speed_at(self.distance_of_point());
            PointCeiling {
                lever: point.norm(),
                distance: from_center.norm(),
                start_speed: self.targets.start_speed_at(from_center),
                end_speed: end_speed.map_or(f64::INFINITY, |(_, largest)| largest),
                speed: kept(limits.speed),
                growth: kept(limits.acceleration),
                fall: kept(limits.deceleration),
            }
        })
    }

    /// Bound by the way of a limited point, from start to goal.
    pub(super) fn of_point_place(&self, floor: Floor) -> Option<LowerBound> {
        let point = self.point_ceiling()?;
        let from_center = self.input.limited_point() - self.capacity.center;
        let way = |direction: Vector2<f64>| {
            let (low, high) = self.targets.displacement_of(from_center, direction);
            (direction, low.max(-high))
        };
        let (direction, way) = self.directions().into_iter().map(way).max_by(|a, b| a.1.total_cmp(&b.1))?;
        let cover = |_, duration| Cover::growing(point.furthest(&self.error(duration), duration));
        let time = first_time_beyond(floor, way, cover);
        let is_x = direction.x.abs() > direction.y.abs();
        let component = if is_x { StateComponent::X } else { StateComponent::Y };
        Some(LowerBound { time, assumption: LowerBoundAssumption::Limits, component })
    }

    /// Bound by the speeds of a limited point, from start to goal.
    pub(super) fn of_point_speed(&self, floor: Floor) -> Option<LowerBound> {
        let point = self.point_ceiling()?;
        let (least, largest) = self.targets.end_speed_at(self.distance_of_point())?;
        let least_time = |required: f64, change: fn((f64, f64)) -> f64| {
            let cover = |_, duration| Cover::growing(change(point.largest_changes(&self.error(duration), duration)));
            first_time_beyond(floor, required, cover)
        };
        let rise = least_time(least - point.start_speed, |(growth, _)| growth);
        let fall = least_time(point.start_speed - largest, |(_, fall)| fall);
        let along = |component| self.targets.value(component).unwrap_or(0.0).abs();
        let is_x = along(StateComponent::VelocityX) > along(StateComponent::VelocityY);
        let component = if is_x { StateComponent::VelocityX } else { StateComponent::VelocityY };
        Some(LowerBound { time: rise.max(fall), assumption: LowerBoundAssumption::Limits, component })
    }

    /// Distance of the point from the reference point, m.
    fn distance_of_point(&self) -> f64 {
        let reference = self.input.maneuver.reference_point.offset(self.input.robot.parameters());
        (self.input.limited_point() - reference).norm()
    }
}
