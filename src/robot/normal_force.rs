//! Normal impulses by projection of the momentum change on lift, pitch and roll, (12) and (22) of the paper.
//!
//! The normal impulses of the three contacts balance the weight and the two tilting moments of a step:
//!
//! ```text
//! sum Lambda_i        = m g dt
//! sum p_f,i Lambda_i  = 2 m_w g p_f,wheel dt + H_x
//! sum p_r,i Lambda_i  = m_w g (p_r,L + p_r,R) dt - H_y
//! ```
//!
//! `H_x`, `H_y` are the changes of angular momentum at floor height (`docs/model.md`). They are linear in the velocity
//! change `du` and quadratic in the rates at the start of the step, so the impulses are
//!
//! ```text
//! Lambda_N = dt (static + omega^2 centrifugal + omega (psidot_L + psidot_R) gyroscopic) + velocity_change_map du
//! ```

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::parameters::RobotParameters;

/// The affine map from one step's motion to its normal impulses; contacts in the order left, right, front.
#[derive(Debug, Clone)]
pub struct NormalForceProjection {
    /// Normal forces at rest, N.
    pub static_force: Vector3<f64>,
    /// Normal force per squared yaw rate, N s2.
    pub centrifugal: Vector3<f64>,
    /// Normal force per yaw rate times sum of wheel rates, N s2.
    pub gyroscopic: Vector3<f64>,
    /// Normal impulse per change of body velocity, 3x5.
    pub velocity_change_map: SMatrix<f64, 3, 5>,
}

impl NormalForceProjection {
    pub(super) fn new(parameters: &RobotParameters) -> Self {
        let points = parameters.contact_points();
        let equilibrium = Matrix3::from_fn(|row, contact| match row {
            0 => 1.0,
            1 => points[contact].y,
            _ => points[contact].x,
        });
        let forces_from_moments =
            equilibrium.try_inverse().expect("validated parameters have contacts that are not on one line");

        let wheel_weight = parameters.wheel_mass * parameters.gravity;
        let wheel_forward = points[0].y;
        let wheels_right = points[0].x + points[1].x;
        let weight = Vector3::new(parameters.weight(), 2.0 * wheel_weight * wheel_forward, wheel_weight * wheels_right);

        // Pitch: H_x = -tilt du_f - product_right domega - J (dpsi_L + dpsi_R) + product_forward omega^2 dt.
        // Roll:  H_y = tilt du_r - product_forward domega - product_right omega^2 dt - J (psidot_L + psidot_R) omega dt,
        //              and it enters with a minus sign.
        let lever = parameters.wheel_mass * parameters.wheel_radius;
        let tilt = parameters.chassis_mass * parameters.center_of_mass_height + 2.0 * lever;
        let product_right = lever * wheels_right + parameters.product_of_inertia.x;
        let product_forward = 2.0 * lever * wheel_forward + parameters.product_of_inertia.y;
        let spin = parameters.wheel_spin_inertia;
        #[rustfmt::skip]
        let moment_from_change = SMatrix::<f64, 3, 5>::from_row_slice(&[
            0.0, 0.0, 0.0, 0.0, 0.0,
            0.0, -tilt, -product_right, -spin, -spin,
            -tilt, 0.0, product_forward, 0.0, 0.0,
        ]);
        let moment_from_centrifugal = Vector3::new(0.0, product_forward, product_right);
        let moment_from_gyroscopic = Vector3::new(0.0, 0.0, spin);

        Self {
            static_force: forces_from_moments * weight,
            centrifugal: forces_from_moments * moment_from_centrifugal,
            gyroscopic: forces_from_moments * moment_from_gyroscopic,
            velocity_change_map: forces_from_moments * moment_from_change,
        }
    }
}
