//! Steps in which the front support slips while the wheels' pattern is linear: all of them follows from the direction of its slip.
//!
//! The wheels answer the front support's friction linearly. With their answer its slip and its normal impulse are
//!
//! ```text
//! xi     = a + B Lambda,    Lambda_N = n + c' Lambda
//! Lambda = -rho d,          rho      = mu Lambda_N = mu n / (1 + mu c' d)
//! ```
//!
//! with the direction d of the slip, `xi = s d`, `s >= 0`. What of the slip is across d vanishes; times `1 + mu c' d` that is
//!
//! ```text
//! (d x a) (1 + mu c' d) - mu n (d x B d) = 0,
//! ```
//!
//! a trigonometric polynomial of degree two in the angle of d, with four roots at most. Newton in five directions takes three times as long,
//! and may come to none.

use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::SVector;

use super::delassus::{DelassusOperator, ImpulseDerivative};
use super::directions::ROWS;
use super::one_step_problem::OneStepProblem;

/// Where the polynomial is looked at for changes of its sign. Of two roots between neighbours none is found: of 80,000 such steps of drawn
/// robots some 30 are left to the interior point, with twice as many directions one.
const DIRECTIONS: [[f64; 2]; 8] = [
    [1.0, 0.0],
    [FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [0.0, 1.0],
    [-FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [-1.0, 0.0],
    [-FRAC_1_SQRT_2, -FRAC_1_SQRT_2],
    [0.0, -1.0],
    [FRAC_1_SQRT_2, -FRAC_1_SQRT_2],
];
const NEWTON_LIMIT: usize = 8;
/// Below this turn, rad, quadratic convergence has arrived at rounding.
const SMALL_TURN: f64 = 1e-8;

/// How wheels in a linear pattern answer: a constant of the robot.
#[derive(Debug, Clone, Copy)]
pub(super) struct WheelResponse<const N: usize> {
    /// The solution map without friction of the front support.
    map: ImpulseDerivative<N>,
    /// All impulses by either of the front support's.
    by_front: [SVector<f64, N>; 2],
    /// B, by rows.
    slip_by_front: [[f64; 2]; 2],
    /// c.
    normal_by_front: [f64; 2],
}

impl<const N: usize> WheelResponse<N> {
    /// From the solution map without friction of the front support.
    pub(super) fn new(operator: &DelassusOperator<N>, map: ImpulseDerivative<N>) -> Self {
        let by_front = ROWS[2].map(|row| {
            let mut impulse = map.by_free_slip * operator.delassus().column(row)
                + map.by_free_normal * operator.normal_response().column(row);
            impulse[row] += 1.0;
            impulse
        });
        let slip_by_front = ROWS[2].map(|row| by_front.map(|impulse| (operator.delassus().row(row) * impulse)[0]));
        let normal_by_front = by_front.map(|impulse| (operator.normal_response().row(2) * impulse)[0]);
        Self { map, by_front, slip_by_front, normal_by_front }
    }
}

/// What one step asks of the front support.
pub(super) struct SlippingFront<'a, const N: usize> {
    wheels: &'a WheelResponse<N>,
    /// All impulses without friction of the front support.
    without_front: SVector<f64, N>,
    /// a, m/s.
    free_slip: [f64; 2],
    /// mu n, N s.
    free_radius: f64,
    /// mu c.
    radius_by_front: [f64; 2],
    /// The polynomial's coefficients of x and y, and of x x, x y and y y, with d = (x, y).
    linear: [f64; 2],
    quadratic: [f64; 3],
}

impl<'a, const N: usize> SlippingFront<'a, N> {
    #[inline]
    pub(super) fn new(
        operator: &DelassusOperator<N>,
        problem: &OneStepProblem<N>,
        wheels: &'a WheelResponse<N>,
    ) -> Self {
        let without_front = wheels.map.impulse(problem);
        let slip = operator.impact_slip(problem, &without_front);
        let [a, b] = [slip[ROWS[2][0]], slip[ROWS[2][1]]];
        let friction = operator.friction_coefficient()[2];
        let free_radius = friction * operator.normal_impulse(problem, &without_front)[2];
        let [c, d] = [friction * wheels.normal_by_front[0], friction * wheels.normal_by_front[1]];
        let [[xx, xy], [yx, yy]] = wheels.slip_by_front;
        Self {
            wheels,
            without_front,
            free_slip: [a, b],
            free_radius,
            radius_by_front: [c, d],
            linear: [b, -a],
            quadratic: [b * c - free_radius * yx, b * d - a * c + free_radius * (xx - yy), free_radius * xy - a * d],
        }
    }

    /// The impulses where the front support has no friction, or else those of the root that Newton comes to from the direction of a slip.
    #[inline]
    pub(super) fn nearest(&self, slip: [f64; 2]) -> Option<SVector<f64, N>> {
        self.lifted().or_else(|| self.near(slip))
    }

    /// The impulses of all that solves the step.
    pub(super) fn all(&self) -> impl Iterator<Item = SVector<f64, N>> {
        let looked_at = DIRECTIONS.map(|direction| (direction, self.value(direction)));
        let count = looked_at.len();
        let roots = (0..count).filter_map(move |index| {
            let [(from, before), (to, after)] = [looked_at[(index + count - 1) % count], looked_at[index]];
            let share = before / (before - after);
            let between = [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
            ((before < 0.0) != (after < 0.0)).then(|| self.near(between))?
        });
        self.lifted().into_iter().chain(roots)
    }

    /// The impulses where the front support has no normal force, if that may be.
    #[inline]
    fn lifted(&self) -> Option<SVector<f64, N>> {
        (self.free_radius <= 0.0).then_some(self.without_front)
    }

    #[inline]
    fn near(&self, [x, y]: [f64; 2]) -> Option<SVector<f64, N>> {
        let size = (x * x + y * y).sqrt();
        let mut direction = [x / size, y / size];
        for _ in 0..NEWTON_LIMIT {
            let [x, y] = direction;
            let turn = -self.value(direction) / self.derivative(direction);
            let shrinking = 1.0 / (1.0 + turn * turn).sqrt();
            direction = [(x - turn * y) * shrinking, (y + turn * x) * shrinking];
            if turn.abs() <= SMALL_TURN {
                return self.with_slip_along(direction);
            }
        }
        None
    }

    #[inline]
    fn value(&self, [x, y]: [f64; 2]) -> f64 {
        let ([by_x, by_y], [xx, xy, yy]) = (self.linear, self.quadratic);
        by_x * x + by_y * y + xx * x * x + xy * x * y + yy * y * y
    }

    /// By the angle.
    #[inline]
    fn derivative(&self, [x, y]: [f64; 2]) -> f64 {
        let ([by_x, by_y], [xx, xy, yy]) = (self.linear, self.quadratic);
        by_y * x - by_x * y + 2.0 * (yy - xx) * x * y + xy * (x * x - y * y)
    }

    /// The impulses with friction against a slip in a direction that is a root; none where the slip is the other way.
    #[inline]
    fn with_slip_along(&self, [x, y]: [f64; 2]) -> Option<SVector<f64, N>> {
        let radius = self.free_radius / (1.0 + self.radius_by_front[0] * x + self.radius_by_front[1] * y);
        let [[xx, xy], [yx, yy]] = self.wheels.slip_by_front;
        let slip = [self.free_slip[0] - radius * (xx * x + xy * y), self.free_slip[1] - radius * (yx * x + yy * y)];
        let is_along = slip[0] * x + slip[1] * y >= 0.0;
        let [by_x, by_y] = &self.wheels.by_front;
        (radius > 0.0 && is_along).then(|| self.without_front - by_x * (radius * x) - by_y * (radius * y))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, Vector3};
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::super::mode_equations::ModeEquations;
    use super::super::pattern::{ContactMode, ContactPattern, WheelPattern};
    use super::*;

    const CASES: usize = 2_000;

    fn drawn<const ROW_COUNT: usize, const COUNT: usize>(
        rng: &mut Xoshiro256PlusPlus,
        scale: f64,
    ) -> SMatrix<f64, ROW_COUNT, COUNT> {
        SMatrix::from_fn(|_, _| scale * rng.random_range(-1.0..1.0))
    }

    fn drawn_step(rng: &mut Xoshiro256PlusPlus) -> (DelassusOperator<5>, OneStepProblem<5>) {
        let root = drawn::<5, 5>(rng, 1.0);
        let delassus = root * root.transpose() + SMatrix::identity() * 0.1;
        let friction = [0.6, 0.6, rng.random_range(0.1..1.5)];
        let operator = DelassusOperator::new(delassus, drawn(rng, 0.5), friction);
        let free_normal = drawn::<3, 1>(rng, 1.0) + Vector3::repeat(0.7);
        (operator, OneStepProblem { free_slip: drawn(rng, 2.0), free_normal })
    }

    /// Every wheels' pattern of a drawn step, with what it asks of the front support.
    fn for_each_front(
        rng: &mut Xoshiro256PlusPlus,
        mut run: impl FnMut(&DelassusOperator<5>, &OneStepProblem<5>, WheelPattern, &SlippingFront<5>),
    ) {
        for _ in 0..CASES {
            let (operator, problem) = drawn_step(rng);
            let responses = operator.wheel_responses.as_ref().expect("all contacts have friction");
            for (response, wheels) in responses.iter().zip(WheelPattern::LINEAR) {
                run(&operator, &problem, wheels, &SlippingFront::new(&operator, &problem, response));
            }
        }
    }

    #[test]
    fn solutions_keep_the_equations_of_their_pattern() {
        let mut count = 0;
        for_each_front(&mut Xoshiro256PlusPlus::seed_from_u64(1), |operator, problem, wheels, front| {
            for impulse in front.all() {
                let (slip, normal) =
                    (operator.impact_slip(problem, &impulse), operator.normal_impulse(problem, &impulse));
                let pattern = ContactPattern { wheels, front: ContactMode::Slip };
                let equations = ModeEquations::at(operator, pattern, &slip, &normal, 0.0).expect("a slip");
                let scale = 1.0 + impulse.amax() + slip.amax();
                assert!(equations.residual(&impulse).amax() <= 1e-9 * scale, "{wheels:?} {impulse} {slip}");
                count += 1;
            }
        });
        assert!(count >= 5 * CASES, "{count}");
    }

    /// Directions that solve the step, of very many.
    fn on_a_fine_scan(front: &SlippingFront<5>) -> usize {
        const COUNT: u32 = 4_000;
        let direction = |index: u32| {
            let (y, x) = (std::f64::consts::TAU * f64::from(index) / f64::from(COUNT)).sin_cos();
            [x, y]
        };
        let is_root = |index: &u32| {
            (front.value(direction(*index)) < 0.0) != (front.value(direction(*index + 1)) < 0.0)
                && front.with_slip_along(direction(*index)).is_some()
        };
        (0..COUNT).filter(is_root).count()
    }

    #[test]
    fn nearly_all_directions_are_found() {
        let (mut patterns, mut differing, mut number) = (0, 0, 0);
        for_each_front(&mut Xoshiro256PlusPlus::seed_from_u64(2), |_, _, _, front| {
            number += 1;
            if number % 20 == 0 {
                let found = front.all().count() - usize::from(front.lifted().is_some());
                differing += usize::from(found != on_a_fine_scan(front));
                patterns += 1;
            }
        });
        assert!(100 * differing <= patterns, "{differing} of {patterns}");
    }

    #[test]
    fn newton_from_the_slip_itself_stays_there() {
        for_each_front(&mut Xoshiro256PlusPlus::seed_from_u64(3), |operator, problem, _, front| {
            for impulse in front.all().skip(usize::from(front.lifted().is_some())) {
                let slip = operator.impact_slip(problem, &impulse);
                let again = front.near([slip[3], slip[4]]);
                assert!(again.is_some_and(|again| (again - impulse).amax() <= 1e-6 * (1.0 + impulse.amax())));
            }
        });
    }
}
