//! What the curve of a motor leaves of a torque.

use super::tape::TapeEntry;
use crate::robot::PerWheel;

/// Torque and rate of a wheel against its motor's curve, as shares of stall torque and free speed.
pub(super) struct MotorLoad {
    pub(super) excess: f64,
    /// The worse node: 0 is the start of the step, 1 its end.
    pub(super) node: usize,
    pub(super) by_torque: f64,
    /// By the rates at the start and the end of the step.
    pub(super) by_rate: [f64; 2],
}

impl MotorLoad {
    /// Of a wheel (0 left, 1 right) with the stall torque, N m, and the free speed, rad/s, of its motor.
    pub(super) fn of_step(
        (wheel, stall_torque, free_speed): (usize, f64, f64),
        entry: &TapeEntry,
        torque: PerWheel<f64>,
    ) -> Self {
        let torque = if wheel == 0 { torque.left } else { torque.right };
        let rate = [&entry.start_velocity, &entry.end_velocity].map(|velocity| velocity[3 + wheel] / free_speed);
        Self::worst(torque / stall_torque, rate)
    }

    /// At the worse of two nodes: `M <= max(0, 1 - omega)` and `M >= -max(0, 1 + omega)`.
    fn worst(torque: f64, rate: [f64; 2]) -> Self {
        let mut worst = Self { excess: f64::NEG_INFINITY, node: 1, by_torque: 0.0, by_rate: [0.0; 2] };
        for (node, rate) in rate.into_iter().enumerate() {
            for sign in [1.0, -1.0] {
                let room = 1.0 - sign * rate;
                // What is not a number stays, which `max` would drop.
                let excess = if room < 0.0 { sign * torque } else { sign * torque - room };
                if excess > worst.excess || excess.is_nan() {
                    let mut by_rate = [0.0; 2];
                    by_rate[node] = if room > 0.0 { sign } else { 0.0 };
                    worst = Self { excess, node, by_torque: sign, by_rate };
                }
            }
        }
        worst
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_number_is_the_worst() {
        for rate in [[f64::NAN, 0.5], [0.5, f64::NAN]] {
            assert!(MotorLoad::worst(0.5, rate).excess.is_nan());
        }
        assert!(MotorLoad::worst(f64::NAN, [0.5, 0.5]).excess.is_nan());
        assert_eq!(MotorLoad::worst(0.5, [1.5, 0.75]).excess, 0.5);
    }
}
