//! The goal of a shooting problem: the constrained components of the end state, in one unit.

use nalgebra::DVector;

use super::maneuver::{Maneuver, StateComponent};
use crate::optimizer::largest_magnitude;
use crate::robot::RobotParameters;

/// Wheel rates count this many times as much as the speeds of their rims: their errors are judged in rad/s, which are smaller,
/// so what cannot be met (rates of a goal that are rounded) goes into the velocity.
const WHEEL_SHARE: f64 = 4.0;

/// One constrained component of the end state.
#[derive(Debug, Clone, Copy)]
pub(super) struct GoalRow {
    pub(super) component: usize,
    pub(super) target: f64,
    pub(super) scale: f64,
}

impl GoalRow {
    pub(super) fn is_heading(&self) -> bool {
        self.component == StateComponent::Heading.index()
    }
}

/// Scale of each row: residual = scale * goal error; 1 / m for positions.
#[derive(Debug, Clone, PartialEq)]
pub struct GoalScales(pub(super) Vec<f64>);

impl GoalScales {
    /// Largest magnitude of the goal errors (m, rad, m/s, rad/s) behind scaled residuals; NaN if any is NaN.
    pub fn largest_goal_error(&self, residual: &DVector<f64>) -> f64 {
        largest_magnitude(residual.iter().zip(&self.0).map(|(value, scale)| value / scale))
    }

    /// The largest scale: if every goal error is within `goal_tolerance`, every residual is within
    /// `goal_tolerance * largest`.
    pub fn largest(&self) -> f64 {
        self.0.iter().copied().fold(0.0, f64::max)
    }

    /// The smallest scale: if every residual is within `goal_tolerance * smallest`, every goal error is within
    /// `goal_tolerance`.
    pub fn smallest(&self) -> f64 {
        self.0.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// The rows of a goal, and the unit of length: the sum of the goal errors of the start, m.
pub(super) fn goal_rows(maneuver: &Maneuver, robot: &RobotParameters) -> (Vec<GoalRow>, f64) {
    let nearest_heading = maneuver.nearest_goal_heading();
    let start = maneuver.start.to_vector();
    let row = |(component, value): (StateComponent, f64)| GoalRow {
        component: component.index(),
        target: nearest_heading.filter(|_| component == StateComponent::Heading).unwrap_or(value),
        scale: residual_scale(component, robot),
    };
    let mut rows: Vec<GoalRow> = maneuver.goal.constrained().map(row).collect();
    let missed: f64 = rows.iter().map(|row| row.scale * (start[row.component] - row.target).abs()).sum();
    // A start that meets its goal is no maneuver, but has a problem all the same.
    let length_unit = if missed > 0.0 { missed } else { robot.track_width };
    for row in &mut rows {
        row.scale /= length_unit;
    }
    (rows, length_unit)
}

/// Scales turn every residual into metres.
fn residual_scale(component: StateComponent, robot: &RobotParameters) -> f64 {
    let (length, radius, time) = (robot.track_width, robot.wheel_radius, robot.natural_time());
    match component {
        StateComponent::X | StateComponent::Y => 1.0,
        StateComponent::Heading => length,
        StateComponent::WheelAngleLeft | StateComponent::WheelAngleRight => radius,
        StateComponent::VelocityX | StateComponent::VelocityY => time,
        StateComponent::YawRate => time * length,
        StateComponent::WheelRateLeft | StateComponent::WheelRateRight => WHEEL_SHARE * time * radius,
    }
}
