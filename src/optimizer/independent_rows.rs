//! Small linear systems whose rows may be dependent, by their Gram matrix.

use nalgebra::{DMatrix, DVector};

/// Rows are dependent where less than this share of a squared length is independent of other rows, or where a pivot is below this share of
/// the largest entry: those of a plan that ends sticking are.
pub(super) const DEPENDENT: f64 = 1e-7;

/// Weights with which `gram weights = residual` holds in each row that is independent of those before it; the others have none. No
/// weights when the matrix is empty or anything is not finite.
///
/// With few rows m the Gram matrix keeps the cost at m^2 n. This is its Cholesky decomposition, which leaves the dependent rows out.
pub(super) fn weights_of_independent(gram: &DMatrix<f64>, residual: &DVector<f64>) -> Option<DVector<f64>> {
    if gram.is_empty() || !gram.iter().chain(residual.iter()).all(|value| value.is_finite()) {
        return None;
    }
    let mut factor = DMatrix::zeros(gram.nrows(), gram.nrows());
    let mut independent = Vec::with_capacity(gram.nrows());
    for row in 0..gram.nrows() {
        let size = independent.len();
        let along = gram.column(row).select_rows(&independent);
        let along = factor.view((0, 0), (size, size)).solve_lower_triangular(&along)?;
        let rest = gram[(row, row)] - along.norm_squared();
        if rest > DEPENDENT * gram[(row, row)] {
            factor.view_mut((size, 0), (1, size)).copy_from(&along.transpose());
            factor[(size, size)] = rest.sqrt();
            independent.push(row);
        }
    }
    let factor = factor.view((0, 0), (independent.len(), independent.len()));
    let solution = factor.solve_lower_triangular(&residual.select_rows(&independent))?;
    let solution = factor.tr_solve_lower_triangular(&solution)?;
    let mut weights = DVector::zeros(gram.nrows());
    for (row, weight) in independent.into_iter().zip(solution.iter()) {
        weights[row] = *weight;
    }
    Some(weights)
}

#[cfg(test)]
mod tests {
    use nalgebra::Cholesky;

    use super::*;

    #[test]
    fn dependent_rows_have_no_weight() {
        let rows = DMatrix::from_row_slice(4, 3, &[1.0, 2.0, 0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0]);
        let residual = DVector::from_row_slice(&[3.0, 6.0, 0.0, 2.0]);
        let weights = weights_of_independent(&(&rows * rows.transpose()), &residual).unwrap();
        assert_eq!((weights[1], weights[2]), (0.0, 0.0));
        // The change that meets the others meets them as well.
        assert!((&rows * (rows.transpose() * weights) - residual).amax() < 1e-14);
    }

    #[test]
    fn independent_rows_have_the_weights_of_the_inverse() {
        let rows = DMatrix::from_fn(5, 9, |row, column| (((row + 1) * (7 * column + 3)) as f64).sin());
        let (gram, residual) = (&rows * rows.transpose(), DVector::from_fn(5, |row, _| row as f64 - 1.5));
        let weights = weights_of_independent(&gram, &residual).unwrap();
        assert!((weights - Cholesky::new(gram).unwrap().solve(&residual)).amax() < 1e-12);
    }

    #[test]
    fn matrices_that_are_not_finite_have_no_weights() {
        let gram = DMatrix::from_row_slice(1, 1, &[f64::NAN]);
        assert_eq!(weights_of_independent(&gram, &DVector::from_vec(vec![1.0])), None);
    }

    #[test]
    fn without_rows_there_are_no_weights() {
        assert_eq!(weights_of_independent(&DMatrix::zeros(0, 0), &DVector::zeros(0)), None);
    }
}
