//! The turn from the frame of one step to that of the next, mostly a small one: sine and cosine by their series, for which a step waits
//! a sixth less of its time than for those of the heading by the library.

use nalgebra::Vector2;

use crate::robot::BodyVector;

/// Turns up to this, rad, are those of the series.
const SMALL_TURN: f64 = 0.5;
/// Coefficients of the series of sine and cosine after the first terms: what is left out is below rounding.
const SINE: [f64; 6] =
    [-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5_040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0, 1.0 / 6_227_020_800.0];
const COSINE: [f64; 6] =
    [1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0, -1.0 / 3_628_800.0, 1.0 / 479_001_600.0, -1.0 / 87_178_291_200.0];

/// A vector turned by this sine and cosine: by those of a heading one of the body frame (right, forward) in the world.
#[inline]
pub(super) fn turned(vector: Vector2<f64>, (sin, cos): (f64, f64)) -> Vector2<f64> {
    Vector2::new(cos * vector.x - sin * vector.y, sin * vector.x + cos * vector.y)
}

/// A velocity in a frame that is turned by this sine and cosine.
#[inline]
pub(super) fn seen_from((sin, cos): (f64, f64), velocity: &BodyVector) -> BodyVector {
    let mut seen = *velocity;
    seen[0] = cos * velocity[0] + sin * velocity[1];
    seen[1] = cos * velocity[1] - sin * velocity[0];
    seen
}

/// Of a turn in rad, to rounding; half the terms do not wait for the others (Estrin's scheme).
#[inline]
pub(super) fn sine_and_cosine(turn: f64) -> (f64, f64) {
    // What is not a number is no small turn.
    if turn.abs() <= SMALL_TURN {
        let square = turn * turn;
        let fourth = square * square;
        let sum =
            |[a, b, c, d, e, f]: [f64; 6]| (a + b * square) + fourth * ((c + d * square) + fourth * (e + f * square));
        (turn + turn * square * sum(SINE), 1.0 - (0.5 * square - fourth * sum(COSINE)))
    } else {
        turn.sin_cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_those_of_the_library() {
        for index in -2_000..=2_000 {
            let turn = f64::from(index) * 4e-4;
            let ((sin, cos), expected) = (sine_and_cosine(turn), turn.sin_cos());
            assert!((sin - expected.0).abs() <= 2.0 * f64::EPSILON * expected.0.abs(), "{turn}: {sin}");
            assert!((cos - expected.1).abs() <= f64::EPSILON, "{turn}: {cos}");
        }
        assert!(sine_and_cosine(f64::NAN).0.is_nan());
    }
}
