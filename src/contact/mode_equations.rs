//! The equations that hold in one contact pattern, and their derivatives.
//!
//! In a pattern the friction law becomes one equation per direction:
//!
//! ```text
//! sticking direction:          xi = 0
//! slipping contact i:          Lambda_i + mu_i max(Lambda_N,i, 0) xi_i / |xi_i| = 0
//! one wheel slips lengthwise:  Lambda_i + sign mu_i Lambda_N,i = 0
//! ```
//!
//! With a slip smoothing s > 0, `|xi_i|` becomes `sqrt(|xi_i|^2 + s^2)`: a contact then always slips a little, and
//! the law has no kinks.
//!
//! Linearised: `own dLambda + by_slip dxi + by_normal dLambda_N = 0`, where xi and the normal impulses
//! are affine in Lambda.

use nalgebra::{SMatrix, SVector, Vector3};

use super::directions::{LEFT, RIGHT, ROWS, contact_count, sticking};
use super::friction_system::{FrictionSystem, ImpulseDerivative};
use super::pattern::{ContactPattern, SlipSign, WheelPattern};
use super::prox::project_onto_half_line;
use super::solution::ContactMode;

/// The equations of one pattern, linearised at one point.
#[derive(Debug, Clone, Copy)]
pub(super) struct ModeEquations<const N: usize> {
    /// 1 where the impulse itself enters (slipping directions), else 0.
    own: SVector<f64, N>,
    by_slip: SMatrix<f64, N, N>,
    by_normal: SMatrix<f64, N, 3>,
    /// Friction force of the slipping contacts, so that the residual is `own Lambda + slip_term`.
    slip_term: SVector<f64, N>,
}

impl<const N: usize> ModeEquations<N> {
    /// Linearises at an impact slip and normal impulses; none where a slip direction is undefined.
    #[inline]
    pub(super) fn at(
        system: &FrictionSystem<N>,
        pattern: ContactPattern,
        impact_slip: &SVector<f64, N>,
        normal_impulse: &Vector3<f64>,
        slip_smoothing: f64,
    ) -> Option<Self> {
        let mut equations = Self {
            own: SVector::repeat(1.0),
            by_slip: SMatrix::zeros(),
            by_normal: SMatrix::zeros(),
            slip_term: SVector::zeros(),
        };
        for (row, sticks) in sticking::<N>(pattern).into_iter().enumerate() {
            if sticks {
                equations.own[row] = 0.0;
                equations.by_slip[(row, row)] = 1.0;
                equations.slip_term[row] = impact_slip[row];
            }
        }
        match pattern.wheels {
            WheelPattern::BothStick => {}
            WheelPattern::RightSlips(sign) => equations.add_lengthwise_slip(system, RIGHT, sign, normal_impulse),
            WheelPattern::LeftSlips(sign) => equations.add_lengthwise_slip(system, LEFT, sign, normal_impulse),
            WheelPattern::BothSlip => {
                equations.add_spatial_slip(system, 0, impact_slip, normal_impulse, slip_smoothing)?;
                equations.add_spatial_slip(system, 1, impact_slip, normal_impulse, slip_smoothing)?;
            }
        }
        if contact_count::<N>() == 3 && pattern.front == ContactMode::Slip {
            equations.add_spatial_slip(system, 2, impact_slip, normal_impulse, slip_smoothing)?;
        }
        Some(equations)
    }

    /// Value of the equations at `impulse`.
    #[inline]
    pub(super) fn residual(&self, impulse: &SVector<f64, N>) -> SVector<f64, N> {
        self.own.component_mul(impulse) + self.slip_term
    }

    /// Jacobian of the equations by the friction impulse.
    ///
    /// Entry by entry: an equation knows one or two slips and one normal impulse, and a library's product of full small
    /// matrices takes three times as long.
    #[inline]
    pub(super) fn jacobian(&self, system: &FrictionSystem<N>) -> SMatrix<f64, N, N> {
        let mut jacobian = SMatrix::from_diagonal(&self.own);
        for row in 0..N {
            for slip in 0..N {
                let by_slip = self.by_slip[(row, slip)];
                if by_slip != 0.0 {
                    for column in 0..N {
                        jacobian[(row, column)] += by_slip * system.delassus()[(slip, column)];
                    }
                }
            }
            for contact in 0..contact_count::<N>() {
                let by_normal = self.by_normal[(row, contact)];
                if by_normal != 0.0 {
                    for column in 0..N {
                        jacobian[(row, column)] += by_normal * system.normal_response()[(contact, column)];
                    }
                }
            }
        }
        jacobian
    }

    /// Derivatives of the impulse by the data, by the implicit function theorem.
    #[inline]
    pub(super) fn impulse_derivative(&self, system: &FrictionSystem<N>) -> Option<ImpulseDerivative<N>> {
        let inverse = self.jacobian(system).try_inverse()?;
        Some(ImpulseDerivative { by_free_slip: -(inverse * self.by_slip), by_free_normal: -(inverse * self.by_normal) })
    }

    /// The contact index of a wheel equals the row of its longitudinal direction.
    #[inline]
    fn add_lengthwise_slip(
        &mut self,
        system: &FrictionSystem<N>,
        wheel: usize,
        sign: SlipSign,
        normal_impulse: &Vector3<f64>,
    ) {
        let signed_coefficient = sign.value() * system.friction_coefficient()[wheel];
        self.by_normal[(wheel, wheel)] = signed_coefficient;
        self.slip_term[wheel] = signed_coefficient * normal_impulse[wheel];
    }

    #[inline]
    fn add_spatial_slip(
        &mut self,
        system: &FrictionSystem<N>,
        contact: usize,
        impact_slip: &SVector<f64, N>,
        normal_impulse: &Vector3<f64>,
        slip_smoothing: f64,
    ) -> Option<()> {
        let rows = ROWS[contact];
        let slip = [impact_slip[rows[0]], impact_slip[rows[1]]];
        let coefficient = system.friction_coefficient()[contact];
        let radius = coefficient * project_onto_half_line(normal_impulse[contact]);
        if radius <= 0.0 {
            return Some(());
        }
        let speed = (slip[0] * slip[0] + slip[1] * slip[1] + slip_smoothing * slip_smoothing).sqrt();
        if speed <= f64::MIN_POSITIVE {
            return None;
        }
        let direction = [slip[0] / speed, slip[1] / speed];
        let stiffness = radius / speed;
        for a in 0..2 {
            self.slip_term[rows[a]] += radius * direction[a];
            self.by_normal[(rows[a], contact)] += coefficient * direction[a];
            for b in 0..2 {
                let identity = if a == b { 1.0 } else { 0.0 };
                self.by_slip[(rows[a], rows[b])] += stiffness * (identity - direction[a] * direction[b]);
            }
        }
        Some(())
    }
}
