//! Small linear systems, unrolled for their size: nalgebra's solutions take several times as long. No pivots are chosen, which would wait for
//! each other.

#![expect(clippy::inline_always, reason = "a call would take matrices through memory")]

use nalgebra::SMatrix;

/// Below this share of the products that it is the difference of, the determinant of the front support's block has too few digits.
const REGULAR: f64 = 1e-6;

/// The solutions of small linear systems with the same matrix, given by its rows; none when it is singular.
#[inline(always)]
pub(super) fn solved<const N: usize, const M: usize>(
    rows: &[[f64; N]; N],
    values: &SMatrix<f64, N, M>,
) -> Option<SMatrix<f64, N, M>> {
    if N == 5 { by_blocks(rows, values) } else { by_cofactors(rows, values) }
}

/// Of three equations, by Cramer's rule: one division, where elimination has six that depend on each other. Later Newton steps
/// correct its larger rounding.
#[inline(always)]
fn by_cofactors<const N: usize, const M: usize>(
    rows: &[[f64; N]; N],
    values: &SMatrix<f64, N, M>,
) -> Option<SMatrix<f64, N, M>> {
    let row = |index: usize| [rows[index][0], rows[index][1], rows[index][2]];
    let (a, b, c) = (row(0), row(1), row(2));
    let cofactors = [cross(b, c), cross(c, a), cross(a, b)];
    let determinant = dot(a, cofactors[0]);
    if determinant == 0.0 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let mut solutions = SMatrix::<f64, N, M>::zeros();
    for (solution, value) in solutions.data.0.iter_mut().zip(&values.data.0) {
        for row in 0..3 {
            solution[row] =
                (cofactors[0][row] * value[0] + cofactors[1][row] * value[1] + cofactors[2][row] * value[2]) * inverse;
        }
    }
    Some(solutions)
}

/// Of five equations: those of the front support give its two unknowns by the other three.
#[inline(always)]
fn by_blocks<const N: usize, const M: usize>(
    rows: &[[f64; N]; N],
    values: &SMatrix<f64, N, M>,
) -> Option<SMatrix<f64, N, M>> {
    let (a, b, c, d) = (rows[3][3], rows[3][4], rows[4][3], rows[4][4]);
    let determinant = a * d - b * c;
    if determinant.abs() <= REGULAR * ((a * d).abs() + (b * c).abs()) {
        return by_library(rows, values);
    }
    let inverse = 1.0 / determinant;
    let front = |value: [f64; 2]| [(d * value[0] - b * value[1]) * inverse, (a * value[1] - c * value[0]) * inverse];
    let without_front = |row: usize, value: f64, [x, y]: [f64; 2]| value - rows[row][3] * x - rows[row][4] * y;

    let of_wheel = |column: usize| front([rows[3][column], rows[4][column]]);
    let of_wheels = [of_wheel(0), of_wheel(1), of_wheel(2)];
    let mut wheels = [[0.0; 3]; 3];
    for (row, entries) in wheels.iter_mut().enumerate() {
        for column in 0..3 {
            entries[column] = without_front(row, rows[row][column], of_wheels[column]);
        }
    }
    let mut of_front = [[0.0; 2]; M];
    let mut wheel_values = SMatrix::<f64, 3, M>::zeros();
    for (index, value) in values.data.0.iter().enumerate() {
        of_front[index] = front([value[3], value[4]]);
        for row in 0..3 {
            wheel_values[(row, index)] = without_front(row, value[row], of_front[index]);
        }
    }
    let wheel_solutions = by_cofactors(&wheels, &wheel_values)?;
    let mut solutions = SMatrix::<f64, N, M>::zeros();
    for (index, solution) in solutions.data.0.iter_mut().enumerate() {
        let x = &wheel_solutions.data.0[index];
        solution[..3].copy_from_slice(x);
        for axis in 0..2 {
            let by_wheels = of_wheels[0][axis] * x[0] + of_wheels[1][axis] * x[1] + of_wheels[2][axis] * x[2];
            solution[3 + axis] = of_front[index][axis] - by_wheels;
        }
    }
    Some(solutions)
}

#[inline]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// With a choice of pivots.
#[cold]
fn by_library<const N: usize, const M: usize>(
    rows: &[[f64; N]; N],
    values: &SMatrix<f64, N, M>,
) -> Option<SMatrix<f64, N, M>> {
    let matrix = SMatrix::<f64, N, N>::from_fn(|row, column| rows[row][column]);
    matrix.try_inverse().map(|inverse| inverse * values)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;

    fn drawn<const N: usize, const M: usize>(rng: &mut Xoshiro256PlusPlus) -> SMatrix<f64, N, M> {
        SMatrix::from_fn(|_, _| rng.random_range(-1.0..1.0))
    }

    /// What both ways miss, of a drawn system with some entries of the front support's block replaced.
    fn misses<const N: usize>(rng: &mut Xoshiro256PlusPlus, replaced: &[((usize, usize), f64)]) -> [f64; 2] {
        let (mut matrix, values) = (drawn::<N, N>(rng), drawn::<N, 2>(rng));
        for (place, entry) in replaced {
            matrix[*place] = *entry;
        }
        let rows: [[f64; N]; N] = std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]));
        [solved(&rows, &values), by_library(&rows, &values)]
            .map(|solutions| (matrix * solutions.expect("a regular matrix") - values).amax())
    }

    #[test]
    fn systems_are_solved_as_by_the_library() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        let singular = [((3, 3), 0.5), ((3, 4), 1.0), ((4, 3), -0.25), ((4, 4), -0.5)];
        for _ in 0..1_000 {
            for [miss, other] in
                [misses::<3>(&mut rng, &[]), misses::<5>(&mut rng, &[]), misses::<5>(&mut rng, &singular)]
            {
                // Without a choice of pivots some digits go: Newton brings them back.
                assert!(miss <= 1e-7 && other <= 1e-9, "{miss}, {other}");
            }
        }
    }

    #[test]
    fn singular_systems_have_no_solution() {
        let value = SMatrix::<f64, 5, 1>::repeat(1.0);
        assert_eq!(solved(&[[0.0; 5]; 5], &value), None);
        let rows =
            std::array::from_fn(|row| std::array::from_fn(|column| if row == column && row > 0 { 1.0 } else { 0.0 }));
        assert_eq!(solved(&rows, &value), None);
        assert_eq!(solved(&[[1.0; 3]; 3], &SMatrix::<f64, 3, 1>::repeat(1.0)), None);
    }
}
