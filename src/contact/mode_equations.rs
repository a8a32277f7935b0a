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
//! where xi and the normal impulses are affine in Lambda. Each slipping contact is linearised by itself: its equations
//! contain its own two slips and its own normal impulse. With a slip smoothing s > 0, `|xi_i|` becomes
//! `sqrt(|xi_i|^2 + s^2)`: the regularised law, in which every contact slips.

use nalgebra::{SMatrix, SVector, Vector3};

use super::delassus::{DelassusOperator, ImpulseDerivative};
use super::directions::{LEFT, RIGHT, ROWS, contact_count, sticking};
use super::pattern::{ContactMode, ContactPattern, SlipSign, WheelPattern};
use super::prox::project_onto_half_line;
use super::small_systems::solved;

/// The equations of one pattern, linearised at one point.
#[derive(Debug, Clone, Copy)]
pub(super) struct ModeEquations<const N: usize> {
    sticks: [bool; N],
    /// Slip of the sticking directions, friction of the slipping ones with its sign reversed.
    term: SVector<f64, N>,
    slipping: [SlippingContact; 3],
}

/// The friction `-radius direction` of a slipping contact, linearised; all zero where a contact sticks or has no normal
/// force.
#[derive(Debug, Clone, Copy, Default)]
struct SlippingContact {
    /// Of the slip.
    direction: [f64; 2],
    /// Radius of the friction disc over the slip speed, kg.
    stiffness: f64,
    /// Derivative of the radius by the normal impulse.
    coefficient: f64,
}

impl<const N: usize> ModeEquations<N> {
    /// Linearises at an impact slip and normal impulses; none where a slip direction is undefined.
    #[expect(clippy::inline_always, reason = "a call would copy the equations and hide a pattern that is known")]
    #[inline(always)]
    pub(super) fn at(
        operator: &DelassusOperator<N>,
        pattern: ContactPattern,
        impact_slip: &SVector<f64, N>,
        normal_impulse: &Vector3<f64>,
        slip_smoothing: f64,
    ) -> Option<Self> {
        let sticks = sticking::<N>(pattern);
        let term = SVector::from_fn(|row, _| if sticks[row] { impact_slip[row] } else { 0.0 });
        let mut equations = Self { sticks, term, slipping: [SlippingContact::default(); 3] };
        match pattern.wheels {
            WheelPattern::BothStick => {}
            WheelPattern::RightSlips(sign) => equations.add_lengthwise_slip(operator, RIGHT, sign, normal_impulse),
            WheelPattern::LeftSlips(sign) => equations.add_lengthwise_slip(operator, LEFT, sign, normal_impulse),
            WheelPattern::BothSlip => {
                equations.add_spatial_slip(operator, 0, impact_slip, normal_impulse, slip_smoothing)?;
                equations.add_spatial_slip(operator, 1, impact_slip, normal_impulse, slip_smoothing)?;
            }
        }
        if contact_count::<N>() == 3 && pattern.front == ContactMode::Slip {
            equations.add_spatial_slip(operator, 2, impact_slip, normal_impulse, slip_smoothing)?;
        }
        Some(equations)
    }

    /// Value of the equations at `impulse`.
    #[inline]
    pub(super) fn residual(&self, impulse: &SVector<f64, N>) -> SVector<f64, N> {
        SVector::from_fn(|row, _| if self.sticks[row] { self.term[row] } else { impulse[row] + self.term[row] })
    }

    /// Rows of the Jacobian of the equations by the friction impulse.
    #[expect(clippy::inline_always, reason = "a call would copy the equations and hide a pattern that is known")]
    #[inline(always)]
    pub(super) fn jacobian(&self, operator: &DelassusOperator<N>) -> [[f64; N]; N] {
        // The Delassus matrix is symmetric: its columns are its rows.
        let by_impulse = &operator.delassus().data.0;
        let mut jacobian = [[0.0; N]; N];
        for row in 0..N {
            if self.sticks[row] {
                jacobian[row] = by_impulse[row];
            } else {
                jacobian[row][row] = 1.0;
            }
        }
        for (contact, slipping) in self.slipping.iter().enumerate().take(contact_count::<N>()) {
            let rows = ROWS[contact];
            let by_slip = slipping.by_slip();
            let by_normal = slipping.by_normal();
            for a in 0..2 {
                let row = &mut jacobian[rows[a]];
                for column in 0..N {
                    row[column] += by_slip[a][0] * by_impulse[rows[0]][column]
                        + by_slip[a][1] * by_impulse[rows[1]][column]
                        + by_normal[a] * operator.normal_response()[(contact, column)];
                }
            }
        }
        jacobian
    }

    /// Derivatives of the impulse by the data, by the implicit function theorem.
    #[expect(clippy::inline_always, reason = "a call would take derivatives through memory")]
    #[inline(always)]
    pub(super) fn impulse_derivative(&self, operator: &DelassusOperator<N>) -> Option<ImpulseDerivative<N>> {
        let jacobian = self.jacobian(operator);
        let mut by_slip = SMatrix::<f64, N, N>::zeros();
        let mut by_normal = SMatrix::<f64, N, 3>::zeros();
        for row in 0..N {
            by_slip[(row, row)] = if self.sticks[row] { 1.0 } else { 0.0 };
        }
        for (contact, slipping) in self.slipping.iter().enumerate().take(contact_count::<N>()) {
            let rows = ROWS[contact];
            for a in 0..2 {
                by_normal[(rows[a], contact)] = slipping.by_normal()[a];
                for b in 0..2 {
                    by_slip[(rows[a], rows[b])] += slipping.by_slip()[a][b];
                }
            }
        }
        Some(ImpulseDerivative {
            by_free_slip: solved(&jacobian, &-by_slip)?,
            by_free_normal: solved(&jacobian, &-by_normal)?,
        })
    }

    /// The contact index of a wheel equals the row of its longitudinal direction.
    #[inline]
    fn add_lengthwise_slip(
        &mut self,
        operator: &DelassusOperator<N>,
        wheel: usize,
        sign: SlipSign,
        normal_impulse: &Vector3<f64>,
    ) {
        let coefficient = operator.friction_coefficient()[wheel];
        self.term[wheel] = sign.value() * coefficient * normal_impulse[wheel];
        self.slipping[wheel] = SlippingContact { direction: [sign.value(), 0.0], stiffness: 0.0, coefficient };
    }

    #[inline]
    fn add_spatial_slip(
        &mut self,
        operator: &DelassusOperator<N>,
        contact: usize,
        impact_slip: &SVector<f64, N>,
        normal_impulse: &Vector3<f64>,
        slip_smoothing: f64,
    ) -> Option<()> {
        let rows = ROWS[contact];
        let slip = [impact_slip[rows[0]], impact_slip[rows[1]]];
        let coefficient = operator.friction_coefficient()[contact];
        let radius = coefficient * project_onto_half_line(normal_impulse[contact]);
        if radius <= 0.0 {
            return Some(());
        }
        let squared_speed = slip[0] * slip[0] + slip[1] * slip[1] + slip_smoothing * slip_smoothing;
        if squared_speed <= f64::MIN_POSITIVE {
            return None;
        }
        // Root and division do not wait for each other.
        let inverse_speed = squared_speed.sqrt() * (1.0 / squared_speed);
        let direction = [slip[0] * inverse_speed, slip[1] * inverse_speed];
        for (row, direction) in rows.into_iter().zip(direction) {
            self.term[row] += radius * direction;
        }
        self.slipping[contact] = SlippingContact { direction, stiffness: radius * inverse_speed, coefficient };
        Some(())
    }
}

impl SlippingContact {
    /// `stiffness (1 - d d')`.
    #[inline]
    fn by_slip(&self) -> [[f64; 2]; 2] {
        let [x, y] = self.direction;
        let mixed = -self.stiffness * x * y;
        [[self.stiffness * (1.0 - x * x), mixed], [mixed, self.stiffness * (1.0 - y * y)]]
    }

    #[inline]
    fn by_normal(&self) -> [f64; 2] {
        self.direction.map(|direction| self.coefficient * direction)
    }
}
