//! Limits of how fast torques change: `|M_k+1 - M_k| <= rate interval` for each wheel and each pair of neighbouring intervals.
//!
//! Values are shares of what is allowed, `(M_k+1 - M_k) / (rate interval) - 1 <= 0` and the same with the other sign: both signs
//! are constraints, since a linear model must not step over the opposite one.

use nalgebra::{Dyn, MatrixViewMut, U1};

use super::path_constraints::LIMIT_TOLERANCE;
use crate::simulation::TorqueSchedule;

/// The constraints of one maneuver; none where no rate is given.
#[derive(Debug, Clone)]
pub(super) struct TorqueRateConstraints(Option<f64>);

impl TorqueRateConstraints {
    /// With the largest change of a torque per time, N m/s.
    pub(super) fn new(rate: Option<f64>) -> Self {
        Self(rate)
    }

    /// Whether no rate is given.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_none()
    }

    /// Number of values for a schedule: by wheel, then by boundary, then by sign.
    pub(super) fn count(&self, control_count: usize) -> usize {
        if self.0.is_some() { 4 * (control_count - 1) } else { 0 }
    }

    pub(super) fn write_values(&self, schedule: &TorqueSchedule, values: &mut [f64]) {
        let Some(rate) = self.0 else { return };
        let allowed = rate * schedule.interval();
        let changes = [&schedule.left, &schedule.right].into_iter().flat_map(|torques| torques.windows(2));
        for (pair, torques) in values.chunks_exact_mut(2).zip(changes) {
            let share = (torques[1] - torques[0]) / allowed;
            pair.copy_from_slice(&[share - 1.0 + LIMIT_TOLERANCE, -share - 1.0 + LIMIT_TOLERANCE]);
        }
    }

    /// The derivatives of a value by all torques and the final time.
    pub(super) fn write_row(
        &self,
        index: usize,
        schedule: &TorqueSchedule,
        mut row: MatrixViewMut<f64, U1, Dyn, U1, Dyn>,
    ) {
        row.fill(0.0);
        let Some(rate) = self.0 else { return };
        let count = schedule.control_count();
        let (boundary, sign) = (index / 2, if index.is_multiple_of(2) { 1.0 } else { -1.0 });
        let (wheel, interval) = (boundary / (count - 1), boundary % (count - 1));
        let torques = if wheel == 0 { &schedule.left } else { &schedule.right };
        let by_change = sign / (rate * schedule.interval());
        let first = wheel * count + interval;
        row[first] = -by_change;
        row[first + 1] = by_change;
        row[2 * count] = -by_change * (torques[interval + 1] - torques[interval]) / schedule.final_time;
    }
}
