//! The Delassus operator of a robot, and the data that one time step adds to it: together the one-step friction problem.

use nalgebra::{Matrix2, SMatrix, SVector, Vector3};

use super::directions::{ROWS, contact_count};
use super::mode_equations::ModeEquations;
use super::pattern::{ContactPattern, WheelPattern};
use super::solution::ContactMode;
use super::uniqueness::solutions_are_unique;

/// The data of one time step: impact slip and normal impulses as they would be without friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneStepProblem<const N: usize> {
    /// Impact slip without friction, `(1 + e) gamma_A + W' M^-1 h dt`, m/s.
    pub free_slip: SVector<f64, N>,
    /// Normal impulses without friction (left, right, front), N s.
    pub free_normal: Vector3<f64>,
}

impl<const N: usize> OneStepProblem<N> {
    /// The weight's impulse m g dt, N s: friction never changes the sum of the normal impulses.
    #[inline]
    pub fn weight_impulse(&self) -> f64 {
        self.free_normal[0] + self.free_normal[1] + self.free_normal[2]
    }
}

/// Derivatives of the friction impulse with respect to the data of the problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpulseDerivative<const N: usize> {
    /// By the free slip, kg.
    pub by_free_slip: SMatrix<f64, N, N>,
    /// By the free normal impulses.
    pub by_free_normal: SMatrix<f64, N, 3>,
}

/// How friction impulses change the slip and the normal impulses of a robot, in `N` = 3 or 5 directions (see the
/// [module](super)); the same in every time step.
#[derive(Debug, Clone)]
pub struct DelassusOperator<const N: usize> {
    delassus: SMatrix<f64, N, N>,
    normal_response: SMatrix<f64, 3, N>,
    friction_coefficient: [f64; 3],
    prox_step: [f64; 3],
    linear_modes: Option<[ImpulseDerivative<N>; WheelPattern::LINEAR.len()]>,
    has_unique_solutions: bool,
}

impl<const N: usize> DelassusOperator<N> {
    /// Prepares the solvers.
    ///
    /// `delassus` (1/kg) is positive definite, `normal_response` maps friction impulses to normal impulses (left,
    /// right, front), and `friction_coefficient` has the same order.
    ///
    /// # Panics
    /// When `N` is neither 3 nor 5.
    pub fn new(
        delassus: SMatrix<f64, N, N>,
        normal_response: SMatrix<f64, 3, N>,
        friction_coefficient: [f64; 3],
    ) -> Self {
        assert!(N == 3 || N == 5, "the wheels have 3 directions, with the front support 5");
        let mut prox_step = [1.0; 3];
        for (step, rows) in prox_step.iter_mut().zip(ROWS).take(contact_count::<N>()) {
            *step = safe_prox_step(&delassus, rows);
        }
        let (linear_modes, has_unique_solutions) = (None, false);
        let mut operator =
            Self { delassus, normal_response, friction_coefficient, prox_step, linear_modes, has_unique_solutions };
        operator.linear_modes = operator.solve_linear_modes();
        operator.has_unique_solutions = solutions_are_unique(&operator);
        operator
    }

    /// Whether every one-step problem with this operator is proved to have exactly one solution. Where it is not proved, a
    /// problem may still have only one.
    pub fn has_unique_solutions(&self) -> bool {
        self.has_unique_solutions
    }

    /// The Delassus matrix `W_T' M^-1 W_T`: slip change per friction impulse, 1/kg.
    pub fn delassus(&self) -> &SMatrix<f64, N, N> {
        &self.delassus
    }

    /// Change of normal impulse per friction impulse.
    pub fn normal_response(&self) -> &SMatrix<f64, 3, N> {
        &self.normal_response
    }

    /// Coulomb coefficients of left wheel, right wheel and front support.
    pub fn friction_coefficient(&self) -> [f64; 3] {
        self.friction_coefficient
    }

    /// r of the prox map per contact, kg: 1 / `lambda_max` of the contact's own Delassus block.
    pub fn prox_step(&self) -> [f64; 3] {
        self.prox_step
    }

    /// Impact slip at a friction impulse.
    #[inline]
    pub fn impact_slip(&self, problem: &OneStepProblem<N>, impulse: &SVector<f64, N>) -> SVector<f64, N> {
        problem.free_slip + self.delassus * impulse
    }

    /// Raw normal impulses at a friction impulse.
    #[inline]
    pub fn normal_impulse(&self, problem: &OneStepProblem<N>, impulse: &SVector<f64, N>) -> Vector3<f64> {
        problem.free_normal + self.normal_response * impulse
    }

    /// The affine solution map of a linear pattern (with sticking front support when N = 5).
    ///
    /// None without wheel friction, when no wheel can stick.
    #[inline]
    pub(super) fn linear_mode(&self, index: usize) -> Option<&ImpulseDerivative<N>> {
        self.linear_modes.as_ref().map(|modes| &modes[index])
    }

    /// Derivatives of the friction impulse in a linear pattern, the same at each solution; none in other patterns, and none
    /// without wheel friction.
    pub fn linear_derivative(&self, pattern: ContactPattern) -> Option<&ImpulseDerivative<N>> {
        self.linear_mode(Self::linear_index(pattern)?)
    }

    /// Derivatives of the friction impulse at a solution, by the implicit function theorem in its pattern.
    ///
    /// None where the pattern's equations are singular.
    #[inline]
    pub fn impulse_derivative(
        &self,
        pattern: ContactPattern,
        impact_slip: &SVector<f64, N>,
        normal_impulse: &Vector3<f64>,
        slip_smoothing: f64,
    ) -> Option<ImpulseDerivative<N>> {
        if let Some(index) = Self::linear_index(pattern) {
            return self.linear_mode(index).copied();
        }
        ModeEquations::at(self, pattern, impact_slip, normal_impulse, slip_smoothing)?.impulse_derivative(self)
    }

    /// The patterns with constant solution maps, by their index.
    pub fn linear_patterns() -> [ContactPattern; WheelPattern::LINEAR.len()] {
        let front = if N == 5 { ContactMode::Stick } else { ContactMode::Slip };
        WheelPattern::LINEAR.map(|wheels| ContactPattern { wheels, front })
    }

    /// Index of the precomputed solution map of a pattern, if it has one.
    #[inline]
    pub fn linear_index(pattern: ContactPattern) -> Option<usize> {
        if N == 5 && pattern.front == ContactMode::Slip { None } else { pattern.wheels.linear_index() }
    }

    fn solve_linear_modes(&self) -> Option<[ImpulseDerivative<N>; WheelPattern::LINEAR.len()]> {
        if self.friction_coefficient[0] <= 0.0 {
            return None;
        }
        let zero = ImpulseDerivative { by_free_slip: SMatrix::zeros(), by_free_normal: SMatrix::zeros() };
        let mut modes = [zero; WheelPattern::LINEAR.len()];
        for (mode, pattern) in modes.iter_mut().zip(Self::linear_patterns()) {
            // In a linear pattern the coefficients depend on neither slip nor load: any values do.
            let equations = ModeEquations::at(self, pattern, &SVector::zeros(), &Vector3::repeat(1.0), 0.0)?;
            *mode = equations.impulse_derivative(self)?;
        }
        Some(modes)
    }
}

/// 1 / `lambda_max` of the 2x2 block of one contact: the largest step for which the prox sweep surely contracts.
fn safe_prox_step<const N: usize>(delassus: &SMatrix<f64, N, N>, [a, b]: [usize; 2]) -> f64 {
    let block = Matrix2::new(delassus[(a, a)], delassus[(a, b)], delassus[(b, a)], delassus[(b, b)]);
    1.0 / block.symmetric_eigenvalues().max()
}
