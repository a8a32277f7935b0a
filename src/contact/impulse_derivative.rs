//! Derivatives of the friction impulse at a solution, by the implicit function theorem in its contact pattern.
//!
//! In a linear pattern they are the same at every solution, and they are also its solution map: they are computed once,
//! when the operator is made.

use nalgebra::{SMatrix, SVector, Vector3};

use super::delassus::{DelassusOperator, ImpulseDerivative};
use super::mode_equations::ModeEquations;
use super::pattern::{ContactPattern, WheelPattern};
use super::uniqueness::solutions_are_unique;

impl<const N: usize> DelassusOperator<N> {
    /// The operator of a robot, with the solution maps of the linear patterns and the uniqueness test.
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
        let mut operator = Self::unprepared(delassus, normal_response, friction_coefficient);
        operator.linear_modes = operator.solve_linear_modes();
        operator.has_unique_solutions = solutions_are_unique(&operator);
        operator
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

    fn solve_linear_modes(&self) -> Option<[ImpulseDerivative<N>; WheelPattern::LINEAR.len()]> {
        if self.friction_coefficient()[0] <= 0.0 {
            return None;
        }
        let zero = ImpulseDerivative { by_free_slip: SMatrix::zeros(), by_free_normal: SMatrix::zeros() };
        let mut modes = [zero; WheelPattern::LINEAR.len()];
        for (mode, pattern) in modes.iter_mut().zip(Self::linear_patterns()) {
            // In a linear pattern the coefficients depend on neither slip nor normal impulse: any values do.
            let equations = ModeEquations::at(self, pattern, &SVector::zeros(), &Vector3::repeat(1.0), 0.0)?;
            *mode = equations.impulse_derivative(self)?;
        }
        Some(modes)
    }
}
