//! Figures of plans as SVG: the paper's figures 3 to 5, loads, wheel rates, friction and the path from above.
//!
//! Up to four plans lie over each other: a colour and a dash per plan, the same in all figures. The colours are those of Okabe
//! and Ito, which the colour-blind tell apart. Each figure says where the data of its axes lie, for cursors.

mod contours;
mod heat_map;
mod panel;
mod path;
mod sheet;
mod simplify;
mod svg;
mod time;

use nalgebra::Vector2;

use crate::contact::ContactMode;
use crate::robot::{PerWheel, Robot, State};
use crate::shooting::{Goal, ManeuverLimits, ReferencePoint};
use crate::simulation::{ContactSample, TorqueSchedule, Trajectory};

pub use heat_map::{HeatMap, MapAxis, MapCell};
pub use svg::escaped;

/// How far a curve in a figure may be from its data, px.
pub const TOLERANCE: f64 = 0.25;
/// A figure that would be larger has coarser curves, bytes.
pub const LARGEST_FIGURE: usize = 100_000;
/// How many figures there are at most.
pub const MOST_FIGURES: usize = 7;

/// Rules for a page in light and dark that holds these figures.
pub const STYLE: &str = include_str!("figures.css");

/// What is drawn of one plan.
#[derive(Debug, Clone)]
pub struct Plan<'a> {
    /// Its name, a letter.
    pub name: &'a str,
    /// What came out in two or three words, for legends.
    pub outcome: String,
    /// Why it misses its goal or cannot be drawn, in sentences.
    pub fault: Option<String>,
    /// The robot that moves.
    pub robot: &'a Robot,
    /// The point that start, goal and trajectory speak of.
    pub reference_point: ReferencePoint,
    /// Where it starts.
    pub start: State,
    /// Where it should end, if anywhere.
    pub goal: Option<&'a Goal>,
    /// Largest torque magnitudes, if there are any, N m.
    pub torque_limit: Option<PerWheel<f64>>,
    /// What it must keep.
    pub limits: &'a ManeuverLimits,
    /// Corners of the robot's outline (right, forward) from the axle midpoint, m; may be empty.
    pub footprint: &'a [Vector2<f64>],
    /// Corners of the aisle, m; may be empty.
    pub keep_in: &'a [Vector2<f64>],
    /// The torques.
    pub schedule: &'a TorqueSchedule,
    /// The motion of the reference point; one node where nothing moves.
    pub trajectory: &'a Trajectory,
}

impl Plan<'_> {
    /// What legends say.
    fn label(&self) -> String {
        format!("{}: {}", self.name, self.outcome)
    }

    /// Whether a wheel of its motion slips anywhere.
    fn slips(&self) -> bool {
        let is_slip = |wheel: &ContactSample| wheel.mode == ContactMode::Slip;
        self.moves() && self.trajectory.contact.iter().any(|step| is_slip(&step.left) || is_slip(&step.right))
    }

    /// Whether there is a motion that can be drawn.
    fn moves(&self) -> bool {
        self.trajectory.step_count() > 0 && !self.trajectory.diverges()
    }
}

/// A figure, complete by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Its stable name.
    pub name: &'static str,
    /// Its title.
    pub title: &'static str,
    /// What it shows.
    pub caption: String,
    /// Width and height of its viewBox, px.
    pub size: [f64; 2],
    /// The document.
    pub svg: String,
    /// Where the data lie, one entry per axes.
    pub maps: Vec<AxesMap>,
}

/// Where the data of one pair of axes lie.
#[derive(Debug, Clone, PartialEq)]
pub struct AxesMap {
    /// Its name, unique in the figure.
    pub axes: &'static str,
    /// Across.
    pub x: AxisMap,
    /// Up.
    pub y: AxisMap,
}

/// One axis: linear between its ends.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisMap {
    /// What it measures, with its unit, such as `time_s`.
    pub quantity: &'static str,
    /// The values at its ends.
    pub data: [f64; 2],
    /// Where its ends are, px of the viewBox.
    pub px: [f64; 2],
}

/// All figures of these plans, in the order in which they are read. Where none of them moves, the path alone says so.
pub fn figures(plans: &[Plan]) -> Vec<Figure> {
    let path = path::path(plans);
    if !plans.iter().any(Plan::moves) {
        return vec![path];
    }
    let over_time = [
        time::contact(plans),
        time::motion(plans),
        time::torques(plans),
        time::normal_forces(plans),
        time::wheel_rates(plans),
    ];
    std::iter::once(path).chain(over_time).chain(path::friction(plans)).collect()
}

#[cfg(test)]
mod tests;
