//! Path constraints of the search: what a plan must keep on the way, as inequalities.
//!
//! A constraint is `quantity / unit + offset <= 0` for the values that [`PathExtremes`] has of its quantity: normal forces in weights,
//! limits in [`LIMIT_UNIT`] times what is allowed. Changes of the torques, which no rollout is needed for, follow after these.

use nalgebra::{DVector, Dyn, MatrixViewMut, U1};

use super::maneuver::{ManeuverLimits, static_loads};
use super::path_limits::{PathLimit, PathLimits};
use super::torque_rate::TorqueRateConstraints;
use crate::optimizer::larger;
use crate::robot::Robot;
use crate::simulation::{CONTACT_COUNT, PathDerivative, PathExtremes, TorqueSchedule};

/// How exactly the search keeps its limits, as a share of each, of the weight for normal forces: a thousandth of what counts, and
/// far above the rounding of a rollout.
pub const LIMIT_TOLERANCE: f64 = 1e-6;
/// A limit is violated by 1 where it is exceeded by so many times what it allows. A plan gets slower by at most about the share by
/// which its limits are tightened, all of them together, so that a violation may cost less than one of the goal: steps along limits
/// that are curved are then longer.
const LIMIT_UNIT: f64 = 100.0;
/// Contacts with less than this share of the weight above their least load may fall below it within one step of the search.
const NORMAL_LOAD_MARGIN: f64 = 0.1;
/// What follows speeds and positions changes little within one step of the search.
const SMOOTH_MARGIN: f64 = 0.3;
/// What jumps with the torques may come from anywhere.
const JUMP_MARGIN: f64 = 1.0;
/// The trust radius from which on limits have these margins; smaller regions have smaller ones in proportion.
const WHOLE_MARGIN_RADIUS: f64 = 0.1;

type Row<'a> = MatrixViewMut<'a, f64, U1, Dyn, U1, Dyn>;

/// The path constraints of one maneuver.
#[derive(Debug, Clone)]
pub(super) struct PathConstraints {
    /// In the order of their quantities in [`PathExtremes`].
    path: Vec<PathConstraint>,
    torque_rate: TorqueRateConstraints,
}

#[derive(Debug, Clone, Copy)]
struct PathConstraint {
    /// The field of the limit; none for normal forces.
    field: Option<&'static str>,
    /// What counts as 1, in the unit of the quantity.
    unit: f64,
    /// The same as a share of the weight or of what a limit allows.
    share: f64,
    offset: f64,
    /// By how much it may be missed.
    tolerance: f64,
    /// It may be missed within one step of the search where it holds by less than this.
    margin: f64,
}

impl PathConstraints {
    pub(super) fn new(robot: &Robot, limits: ManeuverLimits, path: &PathLimits) -> Self {
        let mut constraints = least_loads(robot, limits).to_vec();
        constraints.extend(path.path.iter().map(PathConstraint::of_limit));
        Self { path: constraints, torque_rate: TorqueRateConstraints::new(path.torque_rate) }
    }

    /// Keeps further limits from now on.
    pub(super) fn extend(&mut self, limits: &[PathLimit]) {
        self.path.extend(limits.iter().map(PathConstraint::of_limit));
    }

    /// Keeps the limit of a field with a share of it to spare from now on.
    pub(super) fn tighten(&mut self, field: &str, share: f64) {
        for constraint in self.path.iter_mut().filter(|constraint| constraint.field == Some(field)) {
            constraint.offset += share / LIMIT_UNIT;
        }
    }

    /// The smallest tolerance of a limit, or that of normal forces where there is none.
    pub(super) fn tolerance(&self) -> f64 {
        let has_limits = self.path.len() > CONTACT_COUNT || !self.torque_rate.is_empty();
        if has_limits { LIMIT_TOLERANCE / LIMIT_UNIT } else { LIMIT_TOLERANCE }
    }

    /// Number of values for a schedule.
    pub(super) fn count(&self, extremes: &PathExtremes, control_count: usize) -> usize {
        extremes.count() + self.torque_rate.count(control_count)
    }

    pub(super) fn write_values(&self, extremes: &PathExtremes, schedule: &TorqueSchedule, values: &mut DVector<f64>) {
        let (path, torque_rate) = values.as_mut_slice().split_at_mut(extremes.count());
        for (index, value) in path.iter_mut().enumerate() {
            let constraint = &self.path[extremes.place(index)];
            *value = constraint.offset + extremes.value(index) / constraint.unit;
        }
        self.torque_rate.write_values(schedule, torque_rate);
    }

    /// The constraints that are violated or nearly active, ascending; and how many of them are of the path.
    pub(super) fn select_working_set(
        &self,
        extremes: &PathExtremes,
        (values, radius): (&DVector<f64>, f64),
        working_set: &mut Vec<usize>,
    ) -> usize {
        working_set.clear();
        let path_count = extremes.count();
        let is_near = |index: &usize| {
            let place = extremes.place(*index);
            let share = if place < CONTACT_COUNT { 1.0 } else { (radius / WHOLE_MARGIN_RADIUS).min(1.0) };
            values[*index] > -share * self.path[place].margin
        };
        working_set.extend((0..path_count).filter(is_near));
        let near_path_count = working_set.len();
        working_set.extend(path_count..values.len());
        near_path_count
    }

    /// A row of the Jacobian: the derivatives of the value of a quantity.
    pub(super) fn write_path_row(&self, place: usize, derivative: &PathDerivative, mut row: Row) {
        let unit = self.path[place].unit;
        let torques = derivative.by_left_torque.iter().chain(&derivative.by_right_torque);
        for (value, derivative) in row.iter_mut().zip(torques.chain([&derivative.by_final_time])) {
            *value = derivative / unit;
        }
    }

    /// A row of the Jacobian: the derivatives of a change of torque.
    pub(super) fn write_torque_rate_row(
        &self,
        (index, extremes): (usize, &PathExtremes),
        schedule: &TorqueSchedule,
        row: Row,
    ) {
        self.torque_rate.write_row(index - extremes.count(), schedule, row);
    }

    /// Sum of the squared violations, as shares of the weight and of what limits allow.
    pub(super) fn squared_violation(&self, extremes: &PathExtremes, values: &DVector<f64>) -> f64 {
        let share = |index| self.of_path(extremes, index).map_or(1.0, |constraint| constraint.share);
        values.iter().enumerate().map(|(index, value)| (share(index) * larger(0.0, *value)).powi(2)).sum()
    }

    /// Whether any is missed by more than its tolerance, or is not a number.
    pub(super) fn are_broken(&self, extremes: &PathExtremes, values: &DVector<f64>) -> bool {
        let tolerance =
            |index| self.of_path(extremes, index).map_or(LIMIT_TOLERANCE, |constraint| constraint.tolerance);
        values.iter().enumerate().any(|(index, value)| *value > tolerance(index) || value.is_nan())
    }

    /// The constraint of a value, unless that is of a change of torque.
    fn of_path(&self, extremes: &PathExtremes, index: usize) -> Option<&PathConstraint> {
        (index < extremes.count()).then(|| &self.path[extremes.place(index)])
    }
}

impl PathConstraint {
    /// Kept with a margin of the tolerance, so that what the search accepts exceeds no limit.
    fn of_limit(limit: &PathLimit) -> Self {
        let margin = if limit.quantity.jumps_with_torque() { JUMP_MARGIN } else { SMOOTH_MARGIN };
        let offset = (LIMIT_TOLERANCE - limit.largest / limit.unit) / LIMIT_UNIT;
        let [tolerance, margin] = [LIMIT_TOLERANCE, margin].map(|share| share / LIMIT_UNIT);
        Self { field: Some(limit.field), unit: LIMIT_UNIT * limit.unit, share: LIMIT_UNIT, offset, tolerance, margin }
    }
}

/// `least load - normal force / weight <= 0` for each contact.
fn least_loads(robot: &Robot, limits: ManeuverLimits) -> [PathConstraint; CONTACT_COUNT] {
    let unit = robot.parameters().weight();
    // Without a least load the search keeps its tolerance away from separation; a contact that carries next to nothing has a
    // smaller one.
    let tolerance = static_loads(robot).map(|load| (0.5 * load).clamp(0.0, LIMIT_TOLERANCE));
    let least = limits.least_normal_loads(robot).sup(&tolerance);
    std::array::from_fn(|contact| PathConstraint {
        field: None,
        unit,
        share: 1.0,
        offset: least[contact],
        tolerance: tolerance[contact],
        margin: NORMAL_LOAD_MARGIN,
    })
}
