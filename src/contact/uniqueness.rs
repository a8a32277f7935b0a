//! A sufficient condition for the one-step friction problem to have exactly one solution, whatever the step's data; derived
//! here, also in `docs/model.md`.
//!
//! Let `x` be the difference of two solutions' impulses, `A` the Delassus matrix, `A_i` its rows of contact i, and `b_i x`
//! the difference of contact i's normal impulses. Each solution dissipates at least as much as any other admissible impulse
//! would; the two statements, added, are
//!
//! ```text
//! x' A x  <=  -sum_i mu_i (difference of max(Lambda_N,i, 0)) (difference of |xi_i|)  <=  sum_i mu_i |b_i x| |A_i x|
//! ```
//!
//! With `A = L L'`, `z = L' x`, `A_i x = L_i z` and `b_i x = c_i' z`, the right side is at most
//! `z' (sum_i mu_i / 2 (s_i c_i c_i' + L_i' L_i / s_i)) z` for any weights `s_i > 0`. Where the largest eigenvalue of that
//! matrix is below 1, the two sides contradict each other unless `x = 0`.

use nalgebra::{SMatrix, SVector};

use super::delassus::DelassusOperator;
use super::directions::{ROWS, contact_count};

/// Weights that are tried, relative to those that balance the two terms of each contact.
const WEIGHTS: [f64; 3] = [1.0, 0.6, 0.4];
/// Eigenvalues below this are below 1 in spite of rounding.
const CERTAINLY_BELOW_ONE: f64 = 1.0 - 1e-9;

/// A sufficient condition for every one-step problem with this operator to have exactly one solution.
pub(super) fn solutions_are_unique<const N: usize>(operator: &DelassusOperator<N>) -> bool {
    WEIGHTS.into_iter().any(|weight| {
        coupling(operator, weight).is_some_and(|coupling| {
            let identity = SMatrix::<f64, N, N>::identity();
            (identity * CERTAINLY_BELOW_ONE - coupling).cholesky().is_some()
        })
    })
}

/// The module's matrix; none where the Delassus matrix is not positive definite.
fn coupling<const N: usize>(operator: &DelassusOperator<N>, weight: f64) -> Option<SMatrix<f64, N, N>> {
    let root = operator.delassus().cholesky()?.l();
    let mut coupling = SMatrix::zeros();
    for (contact, rows) in ROWS.into_iter().enumerate().take(contact_count::<N>()) {
        let normal: SVector<f64, N> = operator.normal_response().row(contact).transpose();
        let normal = root.solve_lower_triangular(&normal)?;
        let slip: [SVector<f64, N>; 2] = rows.map(|row| root.row(row).transpose());
        let slips = slip[0] * slip[0].transpose() + slip[1] * slip[1].transpose();
        // The square root of the trace is the norm of both rows.
        let balance = weight * slips.trace().sqrt() / normal.norm();
        // A normal force that does not depend on friction cannot make a problem ambiguous.
        if balance.is_finite() {
            coupling += (normal * normal.transpose() * balance + slips / balance)
                * (0.5 * operator.friction_coefficient()[contact]);
        }
    }
    Some(coupling)
}
