//! Newton on the equations of one pattern, with a backtracking line search.
//!
//! The pattern stays fixed, so these equations are smooth where the slips are not zero; a semismooth Newton on the
//! [natural map](super::natural_map) would choose the pattern within the iteration.

use nalgebra::{SVector, Vector3};

use super::delassus::DelassusOperator;
use super::mode_equations::ModeEquations;
use super::one_step_problem::OneStepProblem;
use super::pattern::ContactPattern;
use super::small_systems::solved;
use super::solution::ContactSolution;

/// Most Newton steps. Two to four are usual; more mean that the pattern is wrong.
const NEWTON_LIMIT: usize = 20;
/// Steps are halved down to this share of themselves: a full one can overshoot where a slip direction turns quickly.
const SMALLEST_SHARE: f64 = 0.1;

/// The equations of one pattern in one friction problem; `slip_smoothing` (m/s) is 0 for the exact law.
pub(super) struct Newton<'a, const N: usize> {
    pub(super) operator: &'a DelassusOperator<N>,
    pub(super) problem: &'a OneStepProblem<N>,
    pub(super) pattern: ContactPattern,
    pub(super) slip_smoothing: f64,
    /// Whether steps that overshoot, and miss no less than before, are halved. Where they are not the pattern is given up: another one, or
    /// a better start, takes less.
    pub(super) backtracks: bool,
}

/// A step, of which the first share is taken that misses less than where it starts, or the smallest one.
struct Step<const N: usize> {
    from: SVector<f64, N>,
    missed: f64,
    update: SVector<f64, N>,
    share: f64,
}

/// An impulse with the equations linearised there, and what it misses them by.
struct Point<const N: usize> {
    impulse: SVector<f64, N>,
    impact_slip: SVector<f64, N>,
    normal_impulse: Vector3<f64>,
    equations: ModeEquations<N>,
    miss: SVector<f64, N>,
}

impl<const N: usize> Newton<'_, N> {
    /// Iterates from `start` to a solution, which it writes, and says whether there is one: an impulse that misses the law by at most
    /// `tolerance`, or else one whose update was at most `small_update` (all N s) if `accept` says so, which is sure of the impulse alone.
    ///
    /// There is none when the equations became singular, nothing converged, a step overshot that is not to be halved, or two impulses were
    /// refused: the first may lack digits, the second shows that the pattern is wrong.
    #[expect(clippy::inline_always, reason = "a call would hide a pattern that is known")]
    #[inline(always)]
    pub(super) fn solve(
        &self,
        start: &SVector<f64, N>,
        (tolerance, small_update): (f64, f64),
        solution: &mut ContactSolution<N>,
        accept: impl Fn(&mut ContactSolution<N>) -> bool,
    ) -> bool {
        // Points are made in one place, which they need not be copied from.
        let mut step = Step { from: *start, missed: f64::INFINITY, update: SVector::zeros(), share: 0.0 };
        let (mut iterations, mut is_refused, mut is_close) = (0, false, false);
        loop {
            let impulse = step.from - step.update * step.share;
            let Some(point) = self.at(impulse) else {
                // Where there is no slip at all its direction may not matter.
                solution.impulse = impulse;
                return is_close && accept(solution);
            };
            let miss = self.miss_of_law(&point);
            if miss <= tolerance {
                *solution = point.solution(self.pattern, miss / self.problem.weight_impulse());
                return true;
            }
            if is_close {
                *solution = point.solution(self.pattern, 0.0);
                if accept(solution) {
                    return true;
                }
                if is_refused {
                    return false;
                }
                (is_refused, step.share) = (true, 0.0);
            }
            let missed = largest(&point.miss);
            let misses_less = missed < step.missed;
            if !misses_less && step.share >= SMALLEST_SHARE {
                if !self.backtracks {
                    return false;
                }
                step.share *= 0.5;
                continue;
            }
            if iterations == NEWTON_LIMIT {
                return false;
            }
            iterations += 1;
            let Some(update) = solved(&point.equations.jacobian(self.operator), &point.miss) else { return false };
            is_close = largest(&update) <= small_update;
            step = Step { from: point.impulse, missed, update, share: 1.0 };
        }
    }

    #[expect(clippy::inline_always, reason = "a call would copy the equations and hide a pattern that is known")]
    #[inline(always)]
    fn at(&self, impulse: SVector<f64, N>) -> Option<Point<N>> {
        let impact_slip = self.operator.impact_slip(self.problem, &impulse);
        let normal_impulse = self.operator.normal_impulse(self.problem, &impulse);
        let equations =
            ModeEquations::at(self.operator, self.pattern, &impact_slip, &normal_impulse, self.slip_smoothing)?;
        Some(Point { impulse, impact_slip, normal_impulse, equations, miss: equations.residual(&impulse) })
    }

    /// Upper bound of what a point misses the law by, N s, under a smoothed law twice what it misses the equations by; infinite in patterns
    /// with inequalities.
    ///
    /// A contact that slips misses nothing at full friction against its slip. From there to the point is what it misses its equations by,
    /// and the prox map does not stretch that.
    #[inline]
    fn miss_of_law(&self, point: &Point<N>) -> f64 {
        if self.pattern == ContactPattern::ALL_SLIP { 2.0 * point.miss.lp_norm(1) } else { f64::INFINITY }
    }
}

impl<const N: usize> Point<N> {
    #[inline]
    fn solution(&self, pattern: ContactPattern, residual: f64) -> ContactSolution<N> {
        let Self { impulse, impact_slip, normal_impulse, .. } = *self;
        ContactSolution { impulse, impact_slip, normal_impulse, pattern, residual }
    }
}

/// The impulse at which the impact slip is a given one; none where rounding hides that the Delassus matrix is positive definite.
///
/// Newton overshoots where a slip turns quickly. From the last impulse, changed torques turn it at once, from the last slip only as far
/// as friction lets them.
#[cold]
pub(super) fn impulse_at<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    impact_slip: &SVector<f64, N>,
) -> Option<SVector<f64, N>> {
    solved(&operator.delassus().data.0, &(impact_slip - problem.free_slip))
}

/// The largest magnitude: one instruction per component, where nalgebra's `amax` takes six.
#[inline]
fn largest<const N: usize>(vector: &SVector<f64, N>) -> f64 {
    vector.as_slice().iter().fold(0.0, |largest, value| if largest > value.abs() { largest } else { value.abs() })
}
