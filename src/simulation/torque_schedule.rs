//! Piecewise constant wheel torques over equal control intervals.

use crate::robot::PerWheel;

/// Torques of both wheels and the time they span.
#[derive(Debug, Clone, PartialEq)]
pub struct TorqueSchedule {
    /// Length of the maneuver, s.
    pub final_time: f64,
    /// Left wheel torque per interval, N m.
    pub left: Vec<f64>,
    /// Right wheel torque per interval, N m; as many as on the left.
    pub right: Vec<f64>,
}

impl TorqueSchedule {
    /// The schedule that takes no time.
    pub fn empty() -> Self {
        Self::without_torque(0.0, 0)
    }

    /// So many intervals without torque.
    pub fn without_torque(final_time: f64, control_count: usize) -> Self {
        Self { final_time, left: vec![0.0; control_count], right: vec![0.0; control_count] }
    }

    /// Number of control intervals per wheel.
    pub fn control_count(&self) -> usize {
        self.left.len()
    }

    /// Length of one control interval, s; 0 for the empty schedule.
    pub fn interval(&self) -> f64 {
        if self.left.is_empty() { 0.0 } else { self.final_time / self.left.len() as f64 }
    }

    /// Torques of one control interval, N m.
    #[inline]
    pub fn torque(&self, interval: usize) -> PerWheel<f64> {
        PerWheel::new(self.left[interval], self.right[interval])
    }
}

/// The control interval that holds the midpoint of `step`.
///
/// In integers, so that a midpoint on a boundary always belongs to the later interval.
#[inline]
pub fn control_interval(step: usize, step_count: usize, control_count: usize) -> usize {
    (2 * step + 1) * control_count / (2 * step_count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn midpoint_on_a_boundary_belongs_to_the_later_interval() {
        // Three steps over two intervals: the second midpoint is the boundary.
        let intervals: Vec<_> = (0..3).map(|step| control_interval(step, 3, 2)).collect();
        assert_eq!(intervals, [0, 1, 1]);
    }

    #[test]
    fn paper_grid_has_five_steps_per_torque() {
        for step in 0..200 {
            assert_eq!(control_interval(step, 200, 40), step / 5);
        }
    }
}
