//! The Delassus operator of a robot: how friction impulses change slip and normal impulses, the same in every time step.

use nalgebra::{Matrix2, SMatrix, SVector, Vector3};

use super::directions::{ROWS, contact_count};
use super::one_step_problem::OneStepProblem;
use super::pattern::{ContactMode, ContactPattern, WheelPattern};
use super::slipping_front::WheelResponse;
use super::solution::ContactSolution;
use super::uniqueness::solutions_are_unique;

/// Derivatives of the friction impulse with respect to the data of the problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpulseDerivative<const N: usize> {
    /// By the free slip, kg.
    pub by_free_slip: SMatrix<f64, N, N>,
    /// By the free normal impulses.
    pub by_free_normal: SMatrix<f64, N, 3>,
}

impl<const N: usize> ImpulseDerivative<N> {
    /// The impulse of a linear pattern, whose solution map this is.
    #[inline]
    pub(super) fn impulse(&self, problem: &OneStepProblem<N>) -> SVector<f64, N> {
        self.by_free_slip * problem.free_slip + self.by_free_normal * problem.free_normal
    }
}

/// How friction impulses change the slip and the normal impulses of a robot, in `N` = 3 or 5 directions (see the
/// [module](super)); the same in every time step.
#[derive(Debug, Clone)]
pub struct DelassusOperator<const N: usize> {
    delassus: SMatrix<f64, N, N>,
    normal_response: SMatrix<f64, 3, N>,
    friction_coefficient: [f64; 3],
    prox_step: [f64; 3],
    /// Solution maps of the linear patterns; none without wheel friction.
    linear_modes: Option<[ImpulseDerivative<N>; WheelPattern::LINEAR.len()]>,
    /// How the wheels answer a slipping front support in their linear patterns; none without its friction or theirs.
    pub(super) wheel_responses: Option<[WheelResponse<N>; WheelPattern::LINEAR.len()]>,
    has_unique_solutions: bool,
}

impl<const N: usize> DelassusOperator<N> {
    /// The operator of a robot, with the solution maps of the linear patterns.
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
        let mut operator = Self {
            delassus,
            normal_response,
            friction_coefficient,
            prox_step,
            linear_modes: None,
            wheel_responses: None,
            has_unique_solutions: false,
        };
        operator.linear_modes = operator.solution_maps(Self::linear_patterns());
        operator.wheel_responses = operator.solve_wheel_responses();
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

    /// The solution with an impulse of a pattern, which counts as keeping the law.
    pub(super) fn solution_at(
        &self,
        problem: &OneStepProblem<N>,
        (pattern, impulse): (ContactPattern, SVector<f64, N>),
    ) -> ContactSolution<N> {
        let impact_slip = self.impact_slip(problem, &impulse);
        let normal_impulse = self.normal_impulse(problem, &impulse);
        ContactSolution { impulse, impact_slip, normal_impulse, pattern, residual: 0.0 }
    }

    /// Derivatives of the friction impulse in a linear pattern, the same at each solution and so its solution map; none in other
    /// patterns, and none without wheel friction, when no wheel can stick.
    #[inline]
    pub fn linear_derivative(&self, pattern: ContactPattern) -> Option<&ImpulseDerivative<N>> {
        if N == 5 && pattern.front == ContactMode::Slip {
            return None;
        }
        Some(&self.linear_modes.as_ref()?[pattern.wheels.linear_index()?])
    }

    /// The patterns with constant solution maps, by their index.
    pub fn linear_patterns() -> [ContactPattern; WheelPattern::LINEAR.len()] {
        let front = if N == 5 { ContactMode::Stick } else { ContactMode::Slip };
        WheelPattern::LINEAR.map(|wheels| ContactPattern { wheels, front })
    }
}

/// 1 / `lambda_max` of the 2x2 block of one contact: the largest step for which the prox sweep surely contracts.
fn safe_prox_step<const N: usize>(delassus: &SMatrix<f64, N, N>, [a, b]: [usize; 2]) -> f64 {
    let block = Matrix2::new(delassus[(a, a)], delassus[(a, b)], delassus[(b, a)], delassus[(b, b)]);
    1.0 / block.symmetric_eigenvalues().max()
}
