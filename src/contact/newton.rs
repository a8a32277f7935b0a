//! Newton on the equations of one pattern, with a line search.

use nalgebra::{SMatrix, SVector};

use super::friction_system::{FrictionProblem, FrictionSystem};
use super::mode_equations::ModeEquations;
use super::pattern::ContactPattern;

/// Newton takes 2 to 4 steps from the last time step's impulse; one that takes many is in the wrong pattern.
pub(super) const NEWTON_LIMIT: usize = 20;
/// Steps are halved down to this share of themselves: a full one can overshoot where a slip direction turns quickly.
const SMALLEST_SHARE: f64 = 0.1;

/// The equations of one pattern in one friction problem; `slip_smoothing` (m/s) is 0 for the exact law.
pub(super) struct Newton<'a, const N: usize> {
    pub(super) system: &'a FrictionSystem<N>,
    pub(super) problem: &'a FrictionProblem<N>,
    pub(super) pattern: ContactPattern,
    pub(super) slip_smoothing: f64,
    /// Most Newton steps.
    pub(super) iteration_limit: usize,
}

impl<const N: usize> Newton<'_, N> {
    /// Iterates from `start`; each impulse whose update was at most `small_update` (N s) is offered to `accept`.
    ///
    /// None when no offer was accepted or the equations became singular.
    #[inline]
    pub(super) fn solve<T>(
        &self,
        start: &SVector<f64, N>,
        small_update: f64,
        accept: impl Fn(SVector<f64, N>) -> Option<T>,
    ) -> Option<T> {
        let mut impulse = *start;
        let mut equations = self.equations(&impulse)?;
        let mut miss = equations.residual(&impulse);
        for _ in 0..self.iteration_limit {
            let update = solved(equations.jacobian(self.system), miss)?;
            let is_small = update.amax() <= small_update;
            let mut share = 1.0;
            loop {
                let trial = impulse - update * share;
                let trial_equations = self.equations(&trial)?;
                let trial_miss = trial_equations.residual(&trial);
                if is_small || trial_miss.amax() < miss.amax() || share < SMALLEST_SHARE {
                    (impulse, equations, miss) = (trial, trial_equations, trial_miss);
                    break;
                }
                share *= 0.5;
            }
            if is_small {
                let accepted = accept(impulse);
                if accepted.is_some() {
                    return accepted;
                }
            }
        }
        None
    }

    #[inline]
    fn equations(&self, impulse: &SVector<f64, N>) -> Option<ModeEquations<N>> {
        let slip = self.system.impact_slip(self.problem, impulse);
        let normal = self.system.normal_impulse(self.problem, impulse);
        ModeEquations::at(self.system, self.pattern, &slip, &normal, self.slip_smoothing)
    }
}

/// The solution of a small linear system by elimination with row pivoting; none when it is singular.
///
/// Unrolled for its size it takes a third of the library's inverse.
#[inline]
fn solved<const N: usize>(mut matrix: SMatrix<f64, N, N>, mut value: SVector<f64, N>) -> Option<SVector<f64, N>> {
    for column in 0..N {
        let mut pivot = column;
        for row in column + 1..N {
            if matrix[(row, column)].abs() > matrix[(pivot, column)].abs() {
                pivot = row;
            }
        }
        matrix.swap_rows(column, pivot);
        value.swap_rows(column, pivot);
        let diagonal = matrix[(column, column)];
        if diagonal == 0.0 {
            return None;
        }
        for row in column + 1..N {
            let factor = matrix[(row, column)] / diagonal;
            for k in column + 1..N {
                matrix[(row, k)] -= factor * matrix[(column, k)];
            }
            value[row] -= factor * value[column];
        }
    }
    for row in (0..N).rev() {
        for k in row + 1..N {
            value[row] -= matrix[(row, k)] * value[k];
        }
        value[row] /= matrix[(row, row)];
    }
    Some(value)
}
