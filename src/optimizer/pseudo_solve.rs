//! Least-norm solutions of small linear systems that may be singular, by their Gram matrix.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

/// Rows are dependent where a singular value is below this share of the largest one, or a pivot below this share of the largest entry:
/// those of a plan that ends sticking are.
pub(super) const DEPENDENT: f64 = 1e-7;

/// The least-norm solution of `gram w = residual` for a positive semidefinite matrix; none when it is empty or not
/// finite.
///
/// With few rows m the Gram matrix keeps the cost at m^2 n. Where no pivot of a Cholesky decomposition is small, the solution is the only
/// one, for a sixth of what eigenvalues take.
pub(super) fn pseudo_solve(gram: &DMatrix<f64>, residual: &DVector<f64>) -> Option<DVector<f64>> {
    if gram.is_empty() || !gram.iter().chain(residual.iter()).all(|value| value.is_finite()) {
        return None;
    }
    let decomposed = Cholesky::new(gram.clone());
    if let Some(cholesky) = decomposed.filter(|cholesky| is_regular(&cholesky.l_dirty().diagonal())) {
        return Some(cholesky.solve(residual));
    }
    by_eigenvalues(gram, residual)
}

/// Whether no pivot is small, given their roots.
fn is_regular(roots: &DVector<f64>) -> bool {
    let (smallest, largest) = (roots.min(), roots.max());
    smallest * smallest > DEPENDENT * (largest * largest)
}

/// The iteration has a limit, since nalgebra's pseudo-inverse does not terminate for a NaN.
fn by_eigenvalues(gram: &DMatrix<f64>, residual: &DVector<f64>) -> Option<DVector<f64>> {
    // More than one sweep per eigenvalue and digit is none that converges; an 8x8 matrix takes some 20.
    let sweep_limit = f64::MANTISSA_DIGITS as usize * gram.nrows();
    let eigen = SymmetricEigen::try_new(gram.clone(), f64::EPSILON, sweep_limit)?;
    let smallest = DEPENDENT * DEPENDENT * eigen.eigenvalues.amax();
    let mut weights = eigen.eigenvectors.tr_mul(residual);
    for (weight, eigenvalue) in weights.iter_mut().zip(eigen.eigenvalues.iter()) {
        *weight = if *eigenvalue > smallest { *weight / eigenvalue } else { 0.0 };
    }
    Some(eigen.eigenvectors * weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dependent_rows_get_the_least_solution() {
        let gram = DMatrix::from_row_slice(2, 2, &[2.0, 2.0, 2.0, 2.0]);
        let weights = pseudo_solve(&gram, &DVector::from_vec(vec![1.0, 1.0])).unwrap();
        // Eigenvectors of a 2x2 matrix round to an ulp.
        assert!((weights - DVector::from_vec(vec![0.25, 0.25])).amax() < 1e-15);
    }

    #[test]
    fn both_ways_agree_where_rows_are_independent() {
        let rows = DMatrix::from_fn(5, 9, |row, column| ((3 * row + 7 * column) as f64).sin());
        let (gram, residual) = (&rows * rows.transpose(), DVector::from_fn(5, |row, _| row as f64 - 1.5));
        let weights = pseudo_solve(&gram, &residual).unwrap();
        assert!((weights - by_eigenvalues(&gram, &residual).unwrap()).amax() < 1e-12);
    }

    #[test]
    fn matrices_that_are_not_finite_have_no_solution() {
        let gram = DMatrix::from_row_slice(1, 1, &[f64::NAN]);
        assert_eq!(pseudo_solve(&gram, &DVector::from_vec(vec![1.0])), None);
    }

    #[test]
    fn without_rows_there_is_no_solution() {
        assert_eq!(pseudo_solve(&DMatrix::zeros(0, 0), &DVector::zeros(0)), None);
    }
}
