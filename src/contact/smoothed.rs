//! The friction law without kinks: `Lambda_i = -mu_i max(Lambda_N,i, 0) xi_i / sqrt(|xi_i|^2 + s^2)`.
//!
//! Not a contact solver to answer with: sticking becomes a slow creep. The search uses it on the way to the exact law,
//! because its derivatives stay right where a contact changes its mode or reverses its slip.

use nalgebra::SVector;

use super::friction_system::{FrictionProblem, FrictionSystem};
use super::newton::{NEWTON_LIMIT, Newton};
use super::pattern::{ContactPattern, WheelPattern};
use super::solution::{ContactMode, ContactSolution};

/// Newton's update relative to m g dt at which it has converged: the search needs merits to 1e-7, not to rounding.
const SMALL_UPDATE: f64 = 1e-9;
/// Slip at which the smoothing starts when Newton fails from the last step's impulse, m/s.
const COARSE_SMOOTHING: f64 = 10.0;

/// Every contact slips.
const SLIPPING: ContactPattern = ContactPattern { wheels: WheelPattern::BothSlip, front: ContactMode::Slip };

/// Newton on the smoothed law, warm-started from the last step.
#[derive(Debug, Clone)]
pub struct SmoothedSolver<const N: usize> {
    /// s, m/s, > 0.
    slip_smoothing: f64,
    impulse: SVector<f64, N>,
}

impl<const N: usize> SmoothedSolver<N> {
    /// A solver for one smoothing speed, m/s, > 0.
    pub fn new(slip_smoothing: f64) -> Self {
        Self { slip_smoothing, impulse: SVector::zeros() }
    }

    /// Solves one step; the residual of the answer is 0, or NaN where Newton failed.
    #[inline]
    pub fn solve(&mut self, system: &FrictionSystem<N>, problem: &FrictionProblem<N>) -> ContactSolution<N> {
        let newton = |slip_smoothing: f64, start: &SVector<f64, N>| {
            let small_update = SMALL_UPDATE * problem.weight_impulse();
            let newton = Newton { system, problem, pattern: SLIPPING, slip_smoothing, iteration_limit: NEWTON_LIMIT };
            newton.solve(start, small_update, Some)
        };
        let found = newton(self.slip_smoothing, &self.impulse).or_else(|| self.by_continuation(newton));
        self.impulse = found.unwrap_or(self.impulse);
        ContactSolution {
            impulse: self.impulse,
            impact_slip: system.impact_slip(problem, &self.impulse),
            normal_impulse: system.normal_impulse(problem, &self.impulse),
            pattern: SLIPPING,
            residual: if found.is_some() { 0.0 } else { f64::NAN },
        }
    }

    /// Follows the solution from a nearly linear law.
    #[cold]
    fn by_continuation(
        &self,
        newton: impl Fn(f64, &SVector<f64, N>) -> Option<SVector<f64, N>>,
    ) -> Option<SVector<f64, N>> {
        let mut smoothing = COARSE_SMOOTHING;
        let mut impulse = SVector::zeros();
        while smoothing > self.slip_smoothing {
            impulse = newton(smoothing, &impulse)?;
            smoothing *= 0.5;
        }
        newton(self.slip_smoothing, &impulse)
    }
}
