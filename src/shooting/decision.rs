//! The unknowns of a shooting problem: y = (left torques, right torques, final time), section 4 of the paper.
//!
//! The paper lists the right wheel first; here the order is left, right everywhere.

use nalgebra::DVector;

use crate::simulation::TorqueSchedule;

/// Number of unknowns with `control_count` torques per wheel.
pub fn decision_len(control_count: usize) -> usize {
    2 * control_count + 1
}

/// The decision vector of a schedule.
pub fn decision_from_schedule(schedule: &TorqueSchedule) -> DVector<f64> {
    let torques = schedule.left.iter().chain(&schedule.right).copied();
    DVector::from_iterator(decision_len(schedule.control_count()), torques.chain([schedule.final_time]))
}

/// The schedule of a decision vector; the inverse of [`decision_from_schedule`] up to one or two units in the last place of
/// the final time: that is recomputed from the interval, so that a schedule given by its interval has the same rollout.
pub fn schedule_from_decision(decision: &DVector<f64>) -> TorqueSchedule {
    let mut schedule = TorqueSchedule::without_torque(0.0, (decision.len() - 1) / 2);
    write_schedule(decision, &mut schedule);
    schedule
}

/// Writes a decision vector into a schedule of the same number of intervals.
pub(super) fn write_schedule(decision: &DVector<f64>, schedule: &mut TorqueSchedule) {
    let control_count = schedule.control_count();
    let torques = decision.as_slice();
    schedule.left.copy_from_slice(&torques[..control_count]);
    schedule.right.copy_from_slice(&torques[control_count..2 * control_count]);
    let interval = torques[2 * control_count] / control_count as f64;
    schedule.final_time = interval * control_count as f64;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedule_round_trips() {
        let schedule = TorqueSchedule { final_time: 2.5, left: vec![1.0, 2.0], right: vec![-3.0, 4.0] };
        let decision = decision_from_schedule(&schedule);
        assert_eq!(decision.as_slice(), [1.0, 2.0, -3.0, 4.0, 2.5]);
        assert_eq!(schedule_from_decision(&decision), schedule);
    }

    #[test]
    fn the_interval_gives_the_final_time_to_the_last_bit() {
        for control_count in 1..500 {
            let mut decision = DVector::zeros(decision_len(control_count));
            for tenths in 1..100 {
                decision[2 * control_count] = f64::from(tenths) * 0.1;
                let schedule = schedule_from_decision(&decision);
                assert_eq!(schedule.interval() * control_count as f64, schedule.final_time);
            }
        }
    }
}
