//! Small linear systems and products, unrolled for their size: nalgebra's take several times as long.

#![expect(clippy::inline_always, reason = "a call would take matrices through memory")]

use nalgebra::{SMatrix, SVector};

/// The solution of a small linear system, given by its rows; none when it is singular.
#[inline]
pub(super) fn solved<const N: usize>(rows: [[f64; N]; N], value: SVector<f64, N>) -> Option<SVector<f64, N>> {
    if N == 3 { by_cofactors(&rows, &value) } else { by_elimination(rows, value) }
}

/// By Cramer's rule: one division, where elimination has six that depend on each other. Later Newton steps correct its
/// larger rounding.
#[inline]
fn by_cofactors<const N: usize>(rows: &[[f64; N]; N], value: &SVector<f64, N>) -> Option<SVector<f64, N>> {
    let column = |index: usize| [rows[0][index], rows[1][index], rows[2][index]];
    let value = [value[0], value[1], value[2]];
    let (a, b, c) = (column(0), column(1), column(2));
    let b_cross_c = cross(b, c);
    let determinant = dot(a, b_cross_c);
    if determinant == 0.0 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let value_cross_a = cross(value, a);
    let solution = [dot(value, b_cross_c) * inverse, -dot(c, value_cross_a) * inverse, dot(b, value_cross_a) * inverse];
    Some(SVector::from_fn(|row, _| solution[row]))
}

#[inline]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The inverse of a small matrix, given by its rows; none when it is singular.
#[inline(always)]
pub(super) fn inverse<const N: usize>(rows: &[[f64; N]; N]) -> Option<SMatrix<f64, N, N>> {
    if N != 3 {
        return by_elimination(*rows, SMatrix::identity());
    }
    let row = |index: usize| [rows[index][0], rows[index][1], rows[index][2]];
    let (a, b, c) = (row(0), row(1), row(2));
    let columns = [cross(b, c), cross(c, a), cross(a, b)];
    let determinant = dot(a, columns[0]);
    (determinant != 0.0).then(|| {
        let inverse = 1.0 / determinant;
        SMatrix::from_fn(|row, column| columns[column][row] * inverse)
    })
}

/// Gaussian elimination with partial pivoting.
#[inline]
pub(super) fn by_elimination<const N: usize, const M: usize>(
    mut rows: [[f64; N]; N],
    mut value: SMatrix<f64, N, M>,
) -> Option<SMatrix<f64, N, M>> {
    for column in 0..N {
        let mut pivot = column;
        for row in column + 1..N {
            if rows[row][column].abs() > rows[pivot][column].abs() {
                pivot = row;
            }
        }
        rows.swap(column, pivot);
        value.swap_rows(column, pivot);
        let pivot_row = rows[column];
        if pivot_row[column] == 0.0 {
            return None;
        }
        let inverse = 1.0 / pivot_row[column];
        for row in column + 1..N {
            let factor = rows[row][column] * inverse;
            for k in column + 1..N {
                rows[row][k] -= factor * pivot_row[k];
            }
            for value in &mut value.data.0 {
                value[row] -= factor * value[column];
            }
        }
    }
    for value in &mut value.data.0 {
        for row in (0..N).rev() {
            for k in row + 1..N {
                value[row] -= rows[row][k] * value[k];
            }
            value[row] /= rows[row][row];
        }
    }
    Some(value)
}

/// The matrix product, one column of the result at a time.
#[inline(always)]
pub(crate) fn product<const R: usize, const K: usize, const C: usize>(
    left: &SMatrix<f64, R, K>,
    right: &SMatrix<f64, K, C>,
) -> SMatrix<f64, R, C> {
    let mut result = SMatrix::<f64, R, C>::zeros();
    for (column, factors) in result.data.0.iter_mut().zip(&right.data.0) {
        for (&factor, addend) in factors.iter().zip(&left.data.0) {
            for (sum, value) in column.iter_mut().zip(addend) {
                *sum += value * factor;
            }
        }
    }
    result
}
