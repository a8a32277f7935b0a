//! Regularised Coulomb friction: `Lambda_i = -mu_i max(Lambda_N,i, 0) xi_i / sqrt(|xi_i|^2 + s^2)`.
//!
//! The law has no kinks, but sticking contacts creep slowly, so no answer is computed with it. The search uses it on the
//! way to the exact law (continuation in s), because its derivatives are correct also where a contact changes its mode or
//! reverses its slip.

use std::iter::successors;

use super::delassus::DelassusOperator;
use super::newton::{Newton, impulse_at};
use super::one_step_problem::OneStepProblem;
use super::pattern::ContactPattern;
use super::solution::ContactSolution;

/// What is missed, relative to m g dt, where Newton has converged, or its update: the search needs merits to 1e-7, not to rounding.
const SMALL_MISS: f64 = 1e-8;
const SMALL_UPDATE: f64 = 1e-9;
/// First slip smoothing of a continuation, m/s: the law is nearly linear, and Newton converges from any start.
const COARSE_SMOOTHING: f64 = 10.0;
/// Factor from one smoothing of the continuation to the next.
const SMOOTHING_FACTOR: f64 = 0.5;

/// Solves one step by Newton under the law with a slip smoothing, m/s, > 0; `solution` is the last step's, from whose impulse Newton
/// starts, or else from its slip, and then this one's. Its residual, of this law, is at most 1e-8, or counts as 0 where the last update
/// was small, or is NaN where Newton failed.
#[expect(clippy::inline_always, reason = "a call would take the solution through memory")]
#[inline(always)]
pub fn solve_smoothed<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    slip_smoothing: f64,
    solution: &mut ContactSolution<N>,
) {
    let (start, slip) = (solution.impulse, solution.impact_slip);
    if by_newton(operator, problem, (slip_smoothing, false), solution) {
        return;
    }
    solution.impulse = impulse_at(operator, problem, &slip).unwrap_or(start);
    let is_solved = by_newton(operator, problem, (slip_smoothing, true), solution)
        || by_continuation(operator, problem, slip_smoothing, solution);
    if !is_solved {
        let last = operator.solution_at(problem, (ContactPattern::ALL_SLIP, start));
        *solution = ContactSolution { residual: f64::NAN, ..last };
    }
}

/// Continuation from a nearly linear law.
#[cold]
fn by_continuation<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    slip_smoothing: f64,
    solution: &mut ContactSolution<N>,
) -> bool {
    *solution = ContactSolution::default();
    falling_smoothings(slip_smoothing)
        .all(|slip_smoothing| by_newton(operator, problem, (slip_smoothing, true), solution))
}

/// From the impulse of `solution`.
#[inline]
fn by_newton<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    (slip_smoothing, backtracks): (f64, bool),
    solution: &mut ContactSolution<N>,
) -> bool {
    let unit = problem.weight_impulse();
    let pattern = ContactPattern::ALL_SLIP;
    let newton = Newton { operator, problem, pattern, slip_smoothing, backtracks };
    let start = solution.impulse;
    newton.solve(&start, (SMALL_MISS * unit, SMALL_UPDATE * unit), solution, |_| true)
}

/// Slip smoothings of a continuation, m/s: from a nearly linear law down to `last`.
fn falling_smoothings(last: f64) -> impl Iterator<Item = f64> {
    successors(Some(COARSE_SMOOTHING), move |smoothing| Some(smoothing * SMOOTHING_FACTOR))
        .take_while(move |smoothing| *smoothing > last)
        .chain([last])
}
