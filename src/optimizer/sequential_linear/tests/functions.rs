//! Objectives and constraints with known minima, each as a row with its gradient; the last variable is t.

/// A hundredth of Rosenbrock's function, `(y - x^2)^2 + (1 - x)^2 / 100 - t`.
pub(super) fn rosenbrock(x: &[f64]) -> (f64, Vec<f64>) {
    let (bend, rest) = (x[1] - x[0] * x[0], 1.0 - x[0]);
    (bend * bend + 0.01 * rest * rest - x[2], vec![-4.0 * x[0] * bend - 0.02 * rest, 2.0 * bend, -1.0])
}

/// `x^2 + y^2 - 1`.
pub(super) fn circle(x: &[f64]) -> (f64, Vec<f64>) {
    (x[0] * x[0] + x[1] * x[1] - 1.0, vec![2.0 * x[0], 2.0 * x[1], 0.0])
}

/// Outside the unit circle.
pub(super) fn outside_circle(x: &[f64]) -> (f64, Vec<f64>) {
    let (value, gradient) = circle(x);
    (-value, gradient.iter().map(|slope| -slope).collect())
}

/// Maratos' objective, `2 (x^2 + y^2 - 1) - x - t`: on the circle it falls along the tangent, off the circle it rises as fast.
pub(super) fn maratos(x: &[f64]) -> (f64, Vec<f64>) {
    (2.0 * circle(x).0 - x[0] - x[2], vec![4.0 * x[0] - 1.0, 4.0 * x[1], -1.0])
}

/// Problem 71 of Hock & Schittkowski, a tenth of the objective.
pub(super) fn product_objective(x: &[f64]) -> (f64, Vec<f64>) {
    let (sum, ends) = (x[0] + x[1] + x[2], x[0] * x[3]);
    let gradient = [x[3] * sum + ends, ends, ends + 1.0, x[0] * sum].map(|slope| 0.1 * slope);
    (0.1 * (ends * sum + x[2]) - x[4], [&gradient[..], &[-1.0]].concat())
}

/// A product of at least 25, as a share of that.
pub(super) fn product_limit(x: &[f64]) -> (f64, Vec<f64>) {
    let product: f64 = x[..4].iter().product::<f64>() / 25.0;
    let slopes = x[..4].iter().map(|value| -product / value);
    (1.0 - product, slopes.chain([0.0]).collect())
}

/// A sum of squares of 40, as a share of that.
pub(super) fn sphere(x: &[f64]) -> (f64, Vec<f64>) {
    let square: f64 = x[..4].iter().map(|value| value * value).sum();
    (square / 40.0 - 1.0, x[..4].iter().map(|value| value / 20.0).chain([0.0]).collect())
}

/// One of the three pieces of Charalambous & Bandler's third minimax problem.
fn minimax_piece(piece: usize, x: &[f64]) -> (f64, Vec<f64>) {
    let (value, by_x, by_y) = match piece {
        0 => (x[0].powi(4) + x[1] * x[1], 4.0 * x[0].powi(3), 2.0 * x[1]),
        1 => ((2.0 - x[0]).powi(2) + (2.0 - x[1]).powi(2), 2.0 * x[0] - 4.0, 2.0 * x[1] - 4.0),
        _ => (2.0 * (x[1] - x[0]).exp(), -2.0 * (x[1] - x[0]).exp(), 2.0 * (x[1] - x[0]).exp()),
    };
    (value - x[2], vec![by_x, by_y, -1.0])
}

/// One of the three pieces of Charalambous & Bandler's third minimax problem, minus t.
pub(super) fn minimax<const PIECE: usize>(x: &[f64]) -> (f64, Vec<f64>) {
    minimax_piece(PIECE, x)
}

/// The largest of the three pieces, with the gradient of that piece alone.
pub(super) fn largest_minimax_piece(x: &[f64]) -> (f64, Vec<f64>) {
    let pieces = (0..3).map(|piece| minimax_piece(piece, x));
    pieces.reduce(|largest, piece| if piece.0 > largest.0 { piece } else { largest }).unwrap()
}

/// `|x| - t`, with the slope of the right side at 0.
pub(super) fn magnitude(x: &[f64]) -> (f64, Vec<f64>) {
    (x[0].abs() - x[1], vec![if x[0] >= 0.0 { 1.0 } else { -1.0 }, -1.0])
}

/// `|x| + x / 2 - t`, with the slope of the left side at 0.
pub(super) fn leaning_magnitude(x: &[f64]) -> (f64, Vec<f64>) {
    (x[0].abs() + 0.5 * x[0] - x[1], vec![if x[0] > 0.0 { 1.5 } else { -0.5 }, -1.0])
}

/// The piecewise quadratic minimax problem of Makela: `-x - y - t`, and outside the unit circle its value there on top.
pub(super) fn falling(x: &[f64]) -> (f64, Vec<f64>) {
    (-x[0] - x[1] - x[2], vec![-1.0; 3])
}

/// Its other piece.
pub(super) fn falling_and_rising(x: &[f64]) -> (f64, Vec<f64>) {
    (falling(x).0 + circle(x).0, vec![2.0 * x[0] - 1.0, 2.0 * x[1] - 1.0, -1.0])
}

/// One of the planes through (1, 2, 0), in directions a radian apart.
pub(super) fn plane<const DIRECTION: usize>(x: &[f64]) -> (f64, Vec<f64>) {
    let (sin, cos) = (DIRECTION as f64).sin_cos();
    (cos * (x[0] - 1.0) + sin * (x[1] - 2.0) - x[2], vec![cos, sin, -1.0])
}

/// A unit disc about (CENTRE, 0).
pub(super) fn disc<const CENTRE: i32>(x: &[f64]) -> (f64, Vec<f64>) {
    let right = x[0] - f64::from(CENTRE);
    (right * right + x[1] * x[1] - 1.0, vec![2.0 * right, 2.0 * x[1], 0.0])
}

/// `SHARE (x + y - 1)`.
pub(super) fn sum<const SHARE: i32>(x: &[f64]) -> (f64, Vec<f64>) {
    let share = f64::from(SHARE);
    (share * (x[0] + x[1] - 1.0), vec![share, share, 0.0])
}

/// `x^2 + y^2 - t`.
pub(super) fn square(x: &[f64]) -> (f64, Vec<f64>) {
    (x[0] * x[0] + x[1] * x[1] - x[2], vec![2.0 * x[0], 2.0 * x[1], -1.0])
}

/// `x - VALUE`.
pub(super) fn exactly<const VALUE: i32>(x: &[f64]) -> (f64, Vec<f64>) {
    (x[0] - f64::from(VALUE), vec![1.0, 0.0])
}

/// `-t`.
pub(super) fn nothing_to_gain(x: &[f64]) -> (f64, Vec<f64>) {
    let mut gradient = vec![0.0; x.len()];
    gradient[x.len() - 1] = -1.0;
    (-x[x.len() - 1], gradient)
}

/// `ln x`, without a value for x < 0.
pub(super) fn logarithm(x: &[f64]) -> (f64, Vec<f64>) {
    (x[0].ln(), vec![1.0 / x[0], 0.0])
}

/// `x - ln(x) / 10 - t`, without a value for x < 0.
pub(super) fn barrier(x: &[f64]) -> (f64, Vec<f64>) {
    (x[0] - 0.1 * x[0].ln() - x[1], vec![1.0 - 0.1 / x[0], -1.0])
}

/// `x^2 / 2 - t`.
pub(super) fn parabola(x: &[f64]) -> (f64, Vec<f64>) {
    (0.5 * x[0] * x[0] - x[1], vec![x[0], -1.0])
}
