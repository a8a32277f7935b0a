//! Contact kinematics, (4) of the paper, in the body frame.
//!
//! With `v_r`, `v_f` the body components of the velocity of the chassis centre of mass and a contact at `p`:
//!
//! ```text
//! lateral slip      = v_r - p_f omega
//! longitudinal slip = v_f + p_r omega - R psidot      (no wheel term at the front support)
//! ```
//!
//! Both driven wheels share one lateral slip, since their contacts have the same `p_f`. The six rows of `W_T'` thus
//! have five different ones; they are kept as five *directions*: left longitudinal, right longitudinal, axle lateral,
//! front longitudinal, front lateral.

use nalgebra::{SMatrix, SVector};

use super::parameters::RobotParameters;

/// (right, forward, yaw, left wheel, right wheel): a generalized velocity or force in the body frame.
pub type BodyVector = SVector<f64, 5>;

/// The rows of `W_T'`: slip per direction = `matrix * body velocity`.
#[derive(Debug, Clone)]
pub struct TangentJacobian(SMatrix<f64, 5, 5>);

impl TangentJacobian {
    pub(super) fn new(parameters: &RobotParameters) -> Self {
        let [left, right, front] = parameters.contact_points();
        let radius = parameters.wheel_radius;
        #[rustfmt::skip]
        let rows = SMatrix::from_row_slice(&[
            0.0, 1.0, left.x, -radius, 0.0,
            0.0, 1.0, right.x, 0.0, -radius,
            1.0, 0.0, -left.y, 0.0, 0.0,
            0.0, 1.0, front.x, 0.0, 0.0,
            1.0, 0.0, -front.y, 0.0, 0.0,
        ]);
        Self(rows)
    }

    /// `W_T'` as a 5x5 matrix, rows by direction, columns by body velocity.
    pub fn matrix(&self) -> &SMatrix<f64, 5, 5> {
        &self.0
    }

    /// Slip of the wheel directions (left longitudinal, right longitudinal, axle lateral), m/s.
    #[inline]
    pub fn wheel_slip(&self, velocity: &BodyVector) -> [f64; 3] {
        let rows = &self.0;
        [
            velocity[1] + rows[(0, 2)] * velocity[2] + rows[(0, 3)] * velocity[3],
            velocity[1] + rows[(1, 2)] * velocity[2] + rows[(1, 4)] * velocity[4],
            velocity[0] + rows[(2, 2)] * velocity[2],
        ]
    }

    /// Slip of the front support (longitudinal, lateral), m/s.
    #[inline]
    pub fn front_slip(&self, velocity: &BodyVector) -> [f64; 2] {
        let rows = &self.0;
        [velocity[1] + rows[(3, 2)] * velocity[2], velocity[0] + rows[(4, 2)] * velocity[2]]
    }
}
