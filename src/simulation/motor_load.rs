//! What the curve of a motor leaves of a torque.

/// Torque and rate of a wheel against its motor's curve, as shares of stall torque and free speed.
pub(super) struct MotorLoad {
    pub(super) excess: f64,
    pub(super) by_torque: f64,
    /// By the rates at the start and the end of the step.
    pub(super) by_rate: [f64; 2],
}

impl MotorLoad {
    /// At the worse of two nodes: `M <= max(0, 1 - omega)` and `M >= -max(0, 1 + omega)`.
    pub(super) fn worst(torque: f64, rate: [f64; 2]) -> Self {
        let mut worst = Self { excess: f64::NEG_INFINITY, by_torque: 0.0, by_rate: [0.0; 2] };
        for (node, rate) in rate.into_iter().enumerate() {
            for sign in [1.0, -1.0] {
                let room = 1.0 - sign * rate;
                let excess = sign * torque - room.max(0.0);
                if excess > worst.excess {
                    let mut by_rate = [0.0; 2];
                    by_rate[node] = if room > 0.0 { sign } else { 0.0 };
                    worst = Self { excess, by_torque: sign, by_rate };
                }
            }
        }
        worst
    }
}
