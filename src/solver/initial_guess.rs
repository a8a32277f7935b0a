//! Where the search starts.

use crate::robot::RobotParameters;
use crate::shooting::{LONGEST_FINAL_TIME, Maneuver, SHORTEST_FINAL_TIME, StateComponent};
use crate::simulation::TorqueSchedule;

/// Share of the torque limit: off the limit, every torque can move both ways.
const AMPLITUDE: f64 = 0.8;

/// Full effort towards the goal in the first half, full braking in the second, as if the goal lay straight ahead.
///
/// The final time is that of rolling without slip over the distance to the goal,
/// `2 sqrt(d R (m + 2 J / R^2) / (sum of the torques))`.
pub(super) fn straight_bang_bang(maneuver: &Maneuver, robot: &RobotParameters, control_count: usize) -> TorqueSchedule {
    let distance = distance_ahead(maneuver);
    let left = AMPLITUDE * maneuver.torque_limit.left * distance.signum();
    let right = AMPLITUDE * maneuver.torque_limit.right * distance.signum();
    let radius = robot.wheel_radius;
    let rolling_mass = robot.total_mass() + 2.0 * robot.wheel_spin_inertia / (radius * radius);
    let final_time = 2.0 * (distance * radius * rolling_mass / (left + right)).sqrt();
    let bang_bang = |torque: f64| {
        (0..control_count).map(|interval| if 2 * interval < control_count { torque } else { -torque }).collect()
    };
    TorqueSchedule {
        final_time: final_time.clamp(SHORTEST_FINAL_TIME, LONGEST_FINAL_TIME),
        left: bang_bang(left),
        right: bang_bang(right),
    }
}

/// Distance from start to goal, negative when the goal lies behind.
fn distance_ahead(maneuver: &Maneuver) -> f64 {
    let start = &maneuver.start.configuration;
    let x = maneuver.goal.value(StateComponent::X).unwrap_or(start.x) - start.x;
    let y = maneuver.goal.value(StateComponent::Y).unwrap_or(start.y) - start.y;
    let ahead = y * start.heading.cos() - x * start.heading.sin();
    x.hypot(y).copysign(ahead)
}

/// The same torques on another number of equal intervals: each takes the mean of what it covers.
pub(super) fn resampled(schedule: &TorqueSchedule, control_count: usize) -> TorqueSchedule {
    let resample =
        |torques: &[f64]| (0..control_count).map(|interval| mean_over(torques, interval, control_count)).collect();
    TorqueSchedule {
        final_time: schedule.final_time.clamp(SHORTEST_FINAL_TIME, LONGEST_FINAL_TIME),
        left: resample(&schedule.left),
        right: resample(&schedule.right),
    }
}

/// Mean of a piecewise constant function over one of `count` equal parts of its span.
fn mean_over(values: &[f64], part: usize, count: usize) -> f64 {
    // In units of 1 / (count * len) of the span, boundaries are integers.
    let (from, to) = (part * values.len(), (part + 1) * values.len());
    let mut sum = 0.0;
    for (index, value) in values.iter().enumerate() {
        let overlap = ((index + 1) * count).min(to).saturating_sub((index * count).max(from));
        sum += value * overlap as f64;
    }
    sum / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampling_to_the_same_grid_changes_nothing() {
        let schedule = TorqueSchedule { final_time: 2.0, left: vec![0.5, -0.25, 1.0], right: vec![0.0, 1.0, -1.0] };
        assert_eq!(resampled(&schedule, 3), schedule);
    }

    #[test]
    fn resampling_keeps_the_impulse() {
        let values = [1.0, 3.0, -2.0, 0.5, 4.0];
        let mean: f64 = (0..3).map(|part| mean_over(&values, part, 3)).sum::<f64>() / 3.0;
        // Three sums of at most five terms round to a few ulp.
        assert!((mean - values.iter().sum::<f64>() / 5.0).abs() < 1e-15);
    }

    #[test]
    fn goal_behind_is_approached_backwards() {
        let mut maneuver = Maneuver::forward_drive();
        maneuver.goal.set(StateComponent::Y, Some(-2.0));
        let guess = straight_bang_bang(&maneuver, &RobotParameters::default(), 10);
        assert!(guess.left[0] < 0.0 && guess.left[9] > 0.0);
    }
}
