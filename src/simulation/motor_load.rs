//! What the curve of a motor leaves of a torque.

use super::tape::TapeEntry;
use crate::robot::{Motor, PerWheel};

/// Where the torque of a motor is judged by its curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotorJudged {
    /// At the worse node of each step: `M <= max(0, stall (1 - omega / free))` and `M >= -max(0, stall (1 + omega / free))`.
    AtNodes,
    /// At the end of each step, and as if the curve went on beyond the free speed: where the torque jumps up while the wheel is at its
    /// curve it may exceed that at first, but no two steps limit the same rate, and nothing has a corner at the free speed.
    AtEnds,
}

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
    /// Of a wheel (0 left, 1 right) with its motor.
    pub(super) fn of_step(
        (wheel, motor, judged): (usize, Motor, MotorJudged),
        entry: &TapeEntry,
        torque: PerWheel<f64>,
    ) -> Self {
        let torque = if wheel == 0 { torque.left } else { torque.right } / motor.stall_torque;
        let rate = [&entry.start_velocity, &entry.end_velocity].map(|velocity| velocity[3 + wheel] / motor.free_speed);
        match judged {
            MotorJudged::AtNodes => Self::worst(torque, rate),
            MotorJudged::AtEnds => Self::at_end(torque, rate[1]),
        }
    }

    /// `|M + omega| <= 1` at the end.
    fn at_end(torque: f64, rate: f64) -> Self {
        let sum = torque + rate;
        let sign = sum.signum();
        Self { excess: sum.abs() - 1.0, node: 1, by_torque: sign, by_rate: [0.0, sign] }
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
    fn ends_count_as_nodes_do_but_beyond_the_free_speed() {
        for (torque, rate) in [(0.5, 0.75), (-0.5, -0.75), (0.5, -1.0), (0.2, 0.0), (0.5, 0.5)] {
            let (at_end, worst) = (MotorLoad::at_end(torque, rate), MotorLoad::worst(torque, [rate; 2]));
            assert_eq!(at_end.excess, worst.excess, "{torque} at {rate}");
        }
        // Beyond it a motor that gives nothing keeps its curve, and brakes on its line.
        assert_eq!((MotorLoad::worst(0.0, [1.5; 2]).excess, MotorLoad::at_end(0.0, 1.5).excess), (0.0, 0.5));
        assert!(MotorLoad::at_end(f64::NAN, 0.5).excess.is_nan());
    }

    #[test]
    fn what_is_not_a_number_is_the_worst() {
        for rate in [[f64::NAN, 0.5], [0.5, f64::NAN]] {
            assert!(MotorLoad::worst(0.5, rate).excess.is_nan());
        }
        assert!(MotorLoad::worst(f64::NAN, [0.5, 0.5]).excess.is_nan());
        assert_eq!(MotorLoad::worst(0.5, [1.5, 0.75]).excess, 0.5);
    }
}
