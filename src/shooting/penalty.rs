//! The paper's penalty (section 4): weighted squared end-state errors, time, and squared torque excess.
//!
//! ```text
//! penalty(y) = t_f + weight_goal sum (scale_i error_i)^2 + weight_torque sum (excess_j / limit_j)^2
//! ```
//!
//! The rollout itself runs with torques cut to their limits, so that every iterate is a plan the robot can follow.

use nalgebra::DVector;

use super::problem::ShootingProblem;
use crate::optimizer::Problem;

/// Price of a squared scaled goal error, s per m2: at the optimum a millimetre of error pays for 0.3 ms.
const WEIGHT_GOAL: f64 = 150.0;
/// Price of a squared relative torque excess, s.
const WEIGHT_TORQUE: f64 = 1.0;

/// The penalty of a shooting problem.
pub struct Penalty<'a, 'b> {
    problem: &'a mut ShootingProblem<'b>,
    clamped: DVector<f64>,
    residual: DVector<f64>,
}

impl<'a, 'b> Penalty<'a, 'b> {
    /// The penalty of `problem`.
    pub fn new(problem: &'a mut ShootingProblem<'b>) -> Self {
        let (dimension, rows) = (problem.cost().len(), problem.residual_count());
        Self { problem, clamped: DVector::zeros(dimension), residual: DVector::zeros(rows) }
    }

    /// The scaled goal errors of the last decision.
    pub fn residual(&self) -> &DVector<f64> {
        &self.residual
    }

    /// The penalty of a decision; one rollout.
    pub fn value(&mut self, decision: &DVector<f64>) -> f64 {
        let mut excess = 0.0;
        for (index, value) in decision.iter().enumerate() {
            let (lower, upper) = (self.problem.lower()[index], self.problem.upper()[index]);
            self.clamped[index] = value.clamp(lower, upper);
            excess += ((value - self.clamped[index]) / upper).powi(2);
        }
        self.problem.residual(&self.clamped, &mut self.residual);
        let final_time = self.clamped[self.clamped.len() - 1];
        final_time + WEIGHT_GOAL * self.residual.norm_squared() + WEIGHT_TORQUE * excess
    }
}
