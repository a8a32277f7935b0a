//! Derivatives of the friction impulse at a solution, by the implicit function theorem in its contact pattern.
//!
//! In a linear pattern they are the same at every solution, and they are also its solution map: they are computed once,
//! when the operator is made.

use nalgebra::{SMatrix, SVector, Vector3};

use super::delassus::{DelassusOperator, ImpulseDerivative};
use super::directions::ROWS;
use super::mode_equations::ModeEquations;
use super::natural_map::friction_radius;
use super::pattern::{ContactMode, ContactPattern, SlipSign, WheelPattern};
use super::slipping_front::WheelResponse;

impl<const N: usize> DelassusOperator<N> {
    /// Derivatives of the friction impulse at a solution, by the implicit function theorem in its pattern.
    ///
    /// A contact that slips in the pattern without any slip has no direction: there the derivatives are those of its sticking,
    /// which slip ends in. Where the equations are singular otherwise, all contacts with normal force stick.
    ///
    /// # Panics
    /// Never: with sticking contacts, and those without normal force, the equations are regular.
    #[expect(clippy::inline_always, reason = "a call would take derivatives through memory")]
    #[inline(always)]
    pub fn impulse_derivative(
        &self,
        pattern: ContactPattern,
        impact_slip: &SVector<f64, N>,
        normal_impulse: &Vector3<f64>,
        slip_smoothing: f64,
    ) -> ImpulseDerivative<N> {
        if let Some(derivative) = self.linear_derivative(pattern) {
            return *derivative;
        }
        ModeEquations::at(self, pattern, impact_slip, normal_impulse, slip_smoothing)
            .and_then(|equations| equations.impulse_derivative(self))
            .unwrap_or_else(|| self.sticking_derivative(pattern, impact_slip, normal_impulse, slip_smoothing))
    }

    /// In a pattern in which contacts without slip stick, or else in one in which all that have friction do.
    #[cold]
    fn sticking_derivative(
        &self,
        pattern: ContactPattern,
        impact_slip: &SVector<f64, N>,
        normal_impulse: &Vector3<f64>,
        slip_smoothing: f64,
    ) -> ImpulseDerivative<N> {
        let has_friction = |contact: usize| friction_radius(self, contact, normal_impulse) > 0.0;
        let rests = |contact: usize| ROWS[contact].into_iter().all(|row| impact_slip[row] == 0.0);
        let modes = pattern.modes();
        let sign = |wheel: usize| SlipSign::of(impact_slip[wheel], normal_impulse[wheel]);
        let derivative = |all: bool| {
            let sticks = |contact: usize| {
                modes[contact] == ContactMode::Stick || has_friction(contact) && (all || rests(contact))
            };
            let front = if N == 5 && sticks(2) { ContactMode::Stick } else { ContactMode::Slip };
            let pattern = ContactPattern { wheels: WheelPattern::of_sticking([sticks(0), sticks(1)], sign), front };
            ModeEquations::at(self, pattern, impact_slip, normal_impulse, slip_smoothing)?.impulse_derivative(self)
        };
        [false, true].into_iter().find_map(derivative).expect("the equations of sticking contacts are regular")
    }

    /// None without a front support that has friction.
    pub(super) fn solve_wheel_responses(&self) -> Option<[WheelResponse<N>; WheelPattern::LINEAR.len()]> {
        if N == 3 {
            return None;
        }
        let patterns = WheelPattern::LINEAR.map(|wheels| ContactPattern { wheels, front: ContactMode::Slip });
        Some(self.solution_maps(patterns)?.map(|map| WheelResponse::new(self, map)))
    }

    /// Solution maps of patterns with linear equations, where a front support that slips has no normal force; none without wheel friction.
    pub(super) fn solution_maps(
        &self,
        patterns: [ContactPattern; WheelPattern::LINEAR.len()],
    ) -> Option<[ImpulseDerivative<N>; WheelPattern::LINEAR.len()]> {
        if self.friction_coefficient()[0] <= 0.0 {
            return None;
        }
        let zero = ImpulseDerivative { by_free_slip: SMatrix::zeros(), by_free_normal: SMatrix::zeros() };
        let mut maps = patterns.map(|_| zero);
        for (map, pattern) in maps.iter_mut().zip(patterns) {
            // The coefficients of wheels depend on neither slip nor normal impulse here: any values do.
            let normal_impulse = Vector3::new(1.0, 1.0, 0.0);
            let equations = ModeEquations::at(self, pattern, &SVector::zeros(), &normal_impulse, 0.0)?;
            *map = equations.impulse_derivative(self)?;
        }
        Some(maps)
    }
}
