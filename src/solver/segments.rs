//! Torque schedules from segments of constant torque.

use nalgebra::DVector;

use crate::robot::PerWheel;
use crate::shooting::{LONGEST_FINAL_TIME, SHORTEST_FINAL_TIME, decision_from_schedule, schedule_from_decision};
use crate::simulation::TorqueSchedule;

/// Constant torques over a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    /// s
    pub(super) duration: f64,
    /// N m
    pub(super) torque: PerWheel<f64>,
}

/// s
pub(super) fn duration(segments: &[Segment]) -> f64 {
    segments.iter().map(|segment| segment.duration).sum()
}

/// The segments, or no torque for some time, s, where there are none: what asks for no way may ask for a change of speed.
pub(super) fn or_coasting(segments: Vec<Segment>, time: f64) -> Vec<Segment> {
    if duration(&segments) > 0.0 { segments } else { vec![Segment { duration: time, torque: PerWheel::default() }] }
}

/// Equal control intervals that keep the impulse of the segments: each takes the mean over its span.
pub(super) fn schedule_from_segments(segments: &[Segment], control_count: usize) -> TorqueSchedule {
    let final_time = duration(segments);
    let interval = final_time / control_count as f64;
    let mut schedule =
        TorqueSchedule::without_torque(final_time.clamp(SHORTEST_FINAL_TIME, LONGEST_FINAL_TIME), control_count);
    let mut start = 0.0;
    for segment in segments {
        let end = start + segment.duration;
        for index in 0..control_count {
            let (from, to) = (index as f64 * interval, (index + 1) as f64 * interval);
            let share = (end.min(to) - start.max(from)).max(0.0) / interval;
            schedule.left[index] += share * segment.torque.left;
            schedule.right[index] += share * segment.torque.right;
        }
        start = end;
    }
    schedule
}

/// The same torques on another number of equal intervals.
pub(super) fn resampled(schedule: &TorqueSchedule, control_count: usize) -> TorqueSchedule {
    if schedule.control_count() == control_count {
        return schedule.clone();
    }
    let duration = schedule.interval();
    let segment = |index: usize| Segment { duration, torque: schedule.torque(index) };
    let segments: Vec<Segment> = (0..schedule.control_count()).map(segment).collect();
    schedule_from_segments(&segments, control_count)
}

/// The same decision on another number of equal intervals.
pub(super) fn with_intervals(decision: &DVector<f64>, control_count: usize) -> DVector<f64> {
    decision_from_schedule(&resampled(&schedule_from_decision(decision), control_count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impulse_is_kept() {
        let segments = [
            Segment { duration: 0.3, torque: PerWheel::new(1.0, -0.5) },
            Segment { duration: 0.5, torque: PerWheel::new(-0.2, 0.8) },
        ];
        let schedule = schedule_from_segments(&segments, 7);
        let impulse: f64 = schedule.left.iter().sum::<f64>() * schedule.interval();
        // Seven shares of two segments round to a few ulp.
        assert!((impulse - (0.3 - 0.1)).abs() < 1e-15);
    }

    #[test]
    fn resampling_to_the_same_grid_changes_nothing() {
        let schedule = TorqueSchedule { final_time: 2.0, left: vec![0.5, -0.25, 1.0], right: vec![0.0, 1.0, -1.0] };
        assert_eq!(resampled(&schedule, 3), schedule);
    }

    #[test]
    fn resampling_to_a_multiple_repeats_the_torques() {
        let schedule = TorqueSchedule { final_time: 2.0, left: vec![0.5, -0.25], right: vec![0.0, 1.0] };
        let fine = resampled(&schedule, 4);
        assert_eq!(fine.left, [0.5, 0.5, -0.25, -0.25]);
        assert_eq!(fine.final_time, 2.0);
    }
}
