//! The paper's penalty (section 4): weighted squared end-state errors, time, and squared torque violations; and squared
//! violations of the normal forces' lower limits and of the limits on the way, which the paper's case does not have.
//!
//! ```text
//! penalty(y) = t_f + goal_penalty sum (length_unit scale_i error_i)^2 + torque_penalty sum (violation_j / limit_j)^2
//!            + path_penalty sum max(share_k, 0)^2
//! ```
//!
//! The rollout itself runs with torques clamped to their limits, so that every iterate is a plan within the limits.

use nalgebra::DVector;

use super::problem::ShootingProblem;
use crate::optimizer::{Constraints, Problem};
use crate::stop::{Stop, Stopped};

/// Penalty parameter of squared scaled goal errors, s per m2: at the optimum a millimetre of error saves 0.3 ms.
const GOAL_PENALTY: f64 = 150.0;
/// Penalty parameter of squared torque violations relative to the limit, s.
const TORQUE_PENALTY: f64 = 1.0;
/// Penalty parameter of squared violations on the way, of normal forces relative to the weight, of limits to what they allow, s.
const PATH_PENALTY: f64 = 10.0;

impl ShootingProblem<'_> {
    /// The penalty of a decision, with what was rolled out for it, torques and final time within their bounds, and the constraint values of
    /// that.
    ///
    /// # Errors
    /// When it was stopped.
    pub fn penalised(
        &mut self,
        decision: &DVector<f64>,
        stop: Stop,
    ) -> Result<(f64, DVector<f64>, Constraints), Stopped> {
        let clamped = decision.zip_zip_map(self.lower(), self.upper(), f64::clamp);
        let mut torque_violation = 0.0;
        for (index, (value, clamped)) in decision.iter().zip(&clamped).enumerate() {
            if value != clamped {
                torque_violation += ((value - clamped) / self.upper()[index]).powi(2);
            }
        }
        let constraints = self.evaluate(&clamped, stop)?;
        let final_time = clamped[clamped.len() - 1];
        let goal = self.length_unit().powi(2) * constraints.residual.norm_squared();
        let penalty = final_time
            + GOAL_PENALTY * goal
            + TORQUE_PENALTY * torque_violation
            + PATH_PENALTY * self.squared_path_violation(&constraints);
        Ok((penalty, clamped, constraints))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, RobotParameters};
    use crate::shooting::path_limits::PathLimit;
    use crate::shooting::{Maneuver, PathLimits};
    use crate::simulation::{PathQuantity, Simulator};

    #[test]
    fn limits_are_penalised_by_the_share_that_exceeds_them() {
        let simulator = Simulator::new(&Robot::new(RobotParameters::default()).unwrap());
        let penalty = |limits: &PathLimits| {
            let mut problem = ShootingProblem::new(&simulator, (&Maneuver::forward_drive(), limits), (20, 1), 1.0);
            problem.penalised(&DVector::from_vec(vec![0.3, 0.3, 1.0]), Stop::never()).unwrap().0
        };
        let free = penalty(&PathLimits::default());
        // The rate grows all the time: only its last value counts, and any limit below it tells it.
        let rate = |largest: f64| {
            let quantity = PathQuantity::WheelRate { wheel: 0 };
            let limit = PathLimit { field: "maneuver.limits.wheel_rate_rad_s", quantity, largest, unit: largest };
            let limits = PathLimits { path: vec![limit], ..PathLimits::default() };
            largest * (1.0 + ((penalty(&limits) - free) / PATH_PENALTY).sqrt())
        };
        let found = rate(0.5);
        assert!(found > 1.0 && (found / rate(0.4 * found) - 1.0).abs() < 1e-5, "{found}");
    }
}
