//! Regularised Coulomb friction: `Lambda_i = -mu_i max(Lambda_N,i, 0) xi_i / sqrt(|xi_i|^2 + s^2)`.
//!
//! The law has no kinks, but sticking contacts creep slowly, so no answer is computed with it. The search uses it on the
//! way to the exact law (continuation in s), because its derivatives are correct also where a contact changes its mode or
//! reverses its slip.

use std::iter::successors;

use nalgebra::SVector;

use super::delassus::DelassusOperator;
use super::newton::{NEWTON_LIMIT, Newton};
use super::one_step_problem::OneStepProblem;
use super::pattern::ContactPattern;
use super::solution::ContactSolution;

/// Newton's update relative to m g dt at which it has converged: the search needs merits to 1e-7, not to rounding.
const SMALL_UPDATE: f64 = 1e-9;
/// First slip smoothing of a continuation, m/s: the law is nearly linear, and Newton converges from any start.
const COARSE_SMOOTHING: f64 = 10.0;
/// Factor from one smoothing of the continuation to the next.
const SMOOTHING_FACTOR: f64 = 0.5;

/// Newton on the smoothed law.
#[derive(Debug, Clone)]
pub struct SmoothedSolver {
    /// s, m/s, > 0.
    slip_smoothing: f64,
}

impl SmoothedSolver {
    /// A solver for one smoothing speed, m/s, > 0.
    pub fn new(slip_smoothing: f64) -> Self {
        Self { slip_smoothing }
    }

    /// Solves one step; `solution` is the last step's, from whose impulse Newton starts, and then this one's. Its residual is 0, or NaN
    /// where Newton failed.
    #[inline]
    pub fn solve<const N: usize>(
        &self,
        operator: &DelassusOperator<N>,
        problem: &OneStepProblem<N>,
        solution: &mut ContactSolution<N>,
    ) {
        let newton = |slip_smoothing: f64, start: &SVector<f64, N>| {
            let small_update = SMALL_UPDATE * problem.weight_impulse();
            let newton = Newton {
                operator,
                problem,
                pattern: ContactPattern::ALL_SLIP,
                slip_smoothing,
                iteration_limit: NEWTON_LIMIT,
            };
            newton.solve(start, small_update, Some)
        };
        let found = newton(self.slip_smoothing, &solution.impulse).or_else(|| self.by_continuation(newton));
        let impulse = found.unwrap_or(solution.impulse);
        *solution = ContactSolution {
            impulse,
            impact_slip: operator.impact_slip(problem, &impulse),
            normal_impulse: operator.normal_impulse(problem, &impulse),
            pattern: ContactPattern::ALL_SLIP,
            residual: if found.is_some() { 0.0 } else { f64::NAN },
        };
    }

    /// Continuation from a nearly linear law.
    #[cold]
    fn by_continuation<const N: usize>(
        &self,
        newton: impl Fn(f64, &SVector<f64, N>) -> Option<SVector<f64, N>>,
    ) -> Option<SVector<f64, N>> {
        let mut impulse = SVector::zeros();
        for slip_smoothing in falling_smoothings(self.slip_smoothing) {
            impulse = newton(slip_smoothing, &impulse)?;
        }
        newton(self.slip_smoothing, &impulse)
    }
}

/// Slip smoothings of a continuation, m/s: from a nearly linear law down to `last`, which is excluded.
fn falling_smoothings(last: f64) -> impl Iterator<Item = f64> {
    successors(Some(COARSE_SMOOTHING), move |smoothing| Some(smoothing * SMOOTHING_FACTOR))
        .take_while(move |smoothing| *smoothing > last)
}
