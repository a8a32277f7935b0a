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

/// The penalty of a shooting problem.
pub struct Penalty<'a, 'b> {
    problem: &'a mut ShootingProblem<'b>,
    clamped: DVector<f64>,
    constraints: Constraints,
}

impl<'a, 'b> Penalty<'a, 'b> {
    /// The penalty of `problem`.
    pub fn new(problem: &'a mut ShootingProblem<'b>) -> Self {
        let (clamped, constraints) = (DVector::zeros(problem.cost().len()), problem.constraints());
        Self { problem, clamped, constraints }
    }

    /// The last decision, with torques and final time within their bounds.
    pub fn decision(&self) -> &DVector<f64> {
        &self.clamped
    }

    /// The constraint values of the last decision.
    pub fn constraints(&self) -> &Constraints {
        &self.constraints
    }

    /// Whether the last decision breaks the limits of the maneuver.
    pub fn breaks_limits(&self) -> bool {
        self.problem.breaks_limits(&self.constraints)
    }

    /// The penalty of a decision; one rollout.
    ///
    /// # Errors
    /// When it was stopped.
    pub fn value(&mut self, decision: &DVector<f64>, stop: Stop) -> Result<f64, Stopped> {
        let mut torque_violation = 0.0;
        for (index, value) in decision.iter().enumerate() {
            let (lower, upper) = (self.problem.lower()[index], self.problem.upper()[index]);
            self.clamped[index] = value.clamp(lower, upper);
            if *value != self.clamped[index] {
                torque_violation += ((value - self.clamped[index]) / upper).powi(2);
            }
        }
        self.constraints = self.problem.evaluate(&self.clamped, stop)?;
        let final_time = self.clamped[self.clamped.len() - 1];
        let goal = self.problem.length_unit().powi(2) * self.constraints.residual.norm_squared();
        Ok(final_time
            + GOAL_PENALTY * goal
            + TORQUE_PENALTY * torque_violation
            + PATH_PENALTY * self.problem.squared_path_violation(&self.constraints))
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
            Penalty::new(&mut problem).value(&DVector::from_vec(vec![0.3, 0.3, 1.0]), Stop::never()).unwrap()
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
