//! Mass matrix and smooth forces, (3) and (13) of the paper, in the body frame of the chassis centre of mass.
//!
//! In that frame the mass matrix, the tangent Jacobian and the Delassus matrix are constant, so everything that a step
//! needs of them is computed once per robot.

use nalgebra::{Matrix3, SMatrix, SVector};

use super::contact_kinematics::{BodyVector, TangentJacobian};
use super::normal_force::NormalForceProjection;
use super::parameters::RobotParameters;
use super::state::PerWheel;
use crate::rules::Violations;

/// Torques of more than this multiple of the grip are not near it.
const GRIP_MULTIPLE: f64 = 4.0;

/// A validated robot with all constant matrices of its equations of motion.
#[derive(Debug, Clone)]
pub struct Robot {
    parameters: RobotParameters,
    tangent_jacobian: TangentJacobian,
    normal_force_projection: NormalForceProjection,
    mass_matrix: SMatrix<f64, 5, 5>,
    responses: Responses,
    static_moment: [f64; 2],
}

/// How velocities, slip and normal impulses answer to forces.
#[derive(Debug, Clone)]
pub(crate) struct Responses {
    pub(crate) inverse_mass_matrix: SMatrix<f64, 5, 5>,
    pub(crate) delassus: SMatrix<f64, 5, 5>,
    pub(crate) impulse_response: SMatrix<f64, 5, 5>,
    pub(crate) normal_response: SMatrix<f64, 3, 5>,
}

impl Robot {
    /// Derives the constant matrices of a robot.
    ///
    /// # Errors
    /// All rules that the parameters violate.
    ///
    /// # Panics
    /// Never for validated parameters: their mass matrix is positive definite.
    pub fn new(parameters: RobotParameters) -> Result<Self, Violations> {
        parameters.validate()?;
        let tangent_jacobian = TangentJacobian::new(&parameters);
        let normal_force_projection = NormalForceProjection::new(&parameters);
        let static_moment = static_moment(&parameters);
        let mass_matrix = mass_matrix(&parameters, static_moment);
        let responses = Responses::new(&mass_matrix, &tangent_jacobian, &normal_force_projection);
        Ok(Self { parameters, tangent_jacobian, normal_force_projection, mass_matrix, responses, static_moment })
    }

    /// The parameters that the robot was built from.
    pub fn parameters(&self) -> &RobotParameters {
        &self.parameters
    }

    /// `W_T'` by direction.
    pub fn tangent_jacobian(&self) -> &TangentJacobian {
        &self.tangent_jacobian
    }

    /// The affine map from the motion of a step to its normal impulses, (22).
    pub fn normal_force_projection(&self) -> &NormalForceProjection {
        &self.normal_force_projection
    }

    /// M in the body frame (right, forward, yaw, left wheel, right wheel).
    pub fn mass_matrix(&self) -> &SMatrix<f64, 5, 5> {
        &self.mass_matrix
    }

    /// The inverse of [`Robot::mass_matrix`].
    pub fn inverse_mass_matrix(&self) -> &SMatrix<f64, 5, 5> {
        &self.responses.inverse_mass_matrix
    }

    /// `W_T' M^-1 W_T` by direction, 1/kg: slip change per friction impulse.
    pub fn delassus(&self) -> &SMatrix<f64, 5, 5> {
        &self.responses.delassus
    }

    /// `M^-1 W_T`: change of body velocity per friction impulse, columns by direction.
    pub fn impulse_response(&self) -> &SMatrix<f64, 5, 5> {
        &self.responses.impulse_response
    }

    /// Change of the normal impulses (left, right, front) per friction impulse, 3x5.
    pub fn normal_response(&self) -> &SMatrix<f64, 3, 5> {
        &self.responses.normal_response
    }

    /// The responses within a step of this length, s, at whose end viscous friction acts: it adds `c dt` to the inertia of each
    /// wheel. Those of the robot itself at length 0, and without viscous friction.
    pub(crate) fn responses_within(&self, step_length: f64) -> Responses {
        let mut inertia = self.mass_matrix;
        for wheel in [3, 4] {
            inertia[(wheel, wheel)] += self.parameters.wheel_viscous_friction * step_length;
        }
        Responses::new(&inertia, &self.tangent_jacobian, &self.normal_force_projection)
    }

    /// First moment of the wheels' mass about the chassis centre of mass (right, forward), kg m.
    pub fn static_moment(&self) -> [f64; 2] {
        self.static_moment
    }

    /// h in the body frame: centrifugal forces of the wheels' offset, and the wheel torques (N m).
    pub fn smooth_force(&self, yaw_rate: f64, torque: [f64; 2]) -> BodyVector {
        let [right, forward] = self.static_moment;
        let rate_squared = yaw_rate * yaw_rate;
        BodyVector::from([rate_squared * right, rate_squared * forward, 0.0, torque[0], torque[1]])
    }

    /// The torque limits, capped at a multiple of the grip, or at the grip itself where the motors have more.
    pub fn torques_near_grip(&self, limit: PerWheel<f64>) -> PerWheel<f64> {
        let multiple = if self.has_motors_beyond_grip() { 1.0 } else { GRIP_MULTIPLE };
        let cap = multiple * self.grip_torque();
        PerWheel::new(limit.left.min(cap), limit.right.min(cap))
    }

    /// Whether the motors have more torque at standstill than the grip. One that has many times as much turns a wheel from rest to its free
    /// speed within a step.
    pub fn has_motors_beyond_grip(&self) -> bool {
        self.parameters.motor.is_some_and(|motor| motor.stall_torque > self.grip_torque())
    }

    /// What a wheel could use if it carried the whole weight, N m: what moves the robot by friction, and what speeds up the wheel itself as
    /// fast as gravity times the friction coefficient. Infinite with viscous friction, against which a fast wheel may need any torque, and
    /// without grip.
    fn grip_torque(&self) -> f64 {
        let robot = &self.parameters;
        let acceleration = robot.wheel_friction_coefficient * robot.gravity;
        let grip =
            (robot.total_mass() * robot.wheel_radius + robot.wheel_spin_inertia / robot.wheel_radius) * acceleration;
        let is_capped = grip > 0.0 && robot.wheel_viscous_friction == 0.0;
        if is_capped { grip } else { f64::INFINITY }
    }

    /// Kinetic energy of a body velocity, J.
    pub fn kinetic_energy(&self, velocity: &BodyVector) -> f64 {
        0.5 * velocity.dot(&(self.mass_matrix * velocity))
    }
}

impl Responses {
    fn new(
        inertia: &SMatrix<f64, 5, 5>,
        tangent_jacobian: &TangentJacobian,
        normal_force_projection: &NormalForceProjection,
    ) -> Self {
        let inverse_mass_matrix = inverse_mass_matrix(inertia);
        let impulse_response = inverse_mass_matrix * tangent_jacobian.matrix().transpose();
        let delassus = symmetric_part(&(tangent_jacobian.matrix() * impulse_response));
        let normal_response = normal_force_projection.velocity_change_map * impulse_response;
        Self { inverse_mass_matrix, delassus, impulse_response, normal_response }
    }
}

fn static_moment(parameters: &RobotParameters) -> [f64; 2] {
    let [left, right, _] = parameters.contact_points();
    let moment = (left + right) * parameters.wheel_mass;
    [moment.x, moment.y]
}

fn mass_matrix(parameters: &RobotParameters, [moment_right, moment_forward]: [f64; 2]) -> SMatrix<f64, 5, 5> {
    let [left, right, _] = parameters.contact_points();
    let mass = parameters.total_mass();
    let yaw_inertia = parameters.chassis_yaw_inertia
        + 2.0 * parameters.wheel_diametral_inertia
        + parameters.wheel_mass * (left.norm_squared() + right.norm_squared());
    let spin = parameters.wheel_spin_inertia;
    #[rustfmt::skip]
    let matrix = SMatrix::from_row_slice(&[
        mass, 0.0, -moment_forward, 0.0, 0.0,
        0.0, mass, moment_right, 0.0, 0.0,
        -moment_forward, moment_right, yaw_inertia, 0.0, 0.0,
        0.0, 0.0, 0.0, spin, 0.0,
        0.0, 0.0, 0.0, 0.0, spin,
    ]);
    matrix
}

/// Inverts the planar block and the wheels apart, so that their coupling stays exactly zero.
fn inverse_mass_matrix(mass_matrix: &SMatrix<f64, 5, 5>) -> SMatrix<f64, 5, 5> {
    let planar: Matrix3<f64> = mass_matrix.fixed_view::<3, 3>(0, 0).into_owned();
    let planar_inverse = planar.try_inverse().expect("validated masses and inertias are positive");
    let mut inverse = SMatrix::from_diagonal(&SVector::<f64, 5>::repeat(1.0).component_div(&mass_matrix.diagonal()));
    inverse.fixed_view_mut::<3, 3>(0, 0).copy_from(&planar_inverse);
    inverse
}

fn symmetric_part(matrix: &SMatrix<f64, 5, 5>) -> SMatrix<f64, 5, 5> {
    0.5 * (matrix + matrix.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference() -> Robot {
        Robot::new(RobotParameters::default()).unwrap()
    }

    #[test]
    fn inverse_mass_matrix_inverts() {
        let robot = reference();
        let product = robot.mass_matrix() * robot.inverse_mass_matrix();
        assert!((product - SMatrix::<f64, 5, 5>::identity()).amax() < 1e-13);
    }

    #[test]
    fn kinetic_energy_is_that_of_the_bodies() {
        let robot = reference();
        let p = robot.parameters();
        let velocity = BodyVector::from([0.3, 1.1, -0.7, 12.0, 9.0]);
        let [left, right, _] = p.contact_points();
        let wheel = |point: nalgebra::Vector2<f64>, rate: f64| {
            let (v_r, v_f) = (velocity[0] - point.y * velocity[2], velocity[1] + point.x * velocity[2]);
            0.5 * p.wheel_mass * (v_r * v_r + v_f * v_f)
                + 0.5 * p.wheel_diametral_inertia * velocity[2] * velocity[2]
                + 0.5 * p.wheel_spin_inertia * rate * rate
        };
        let chassis = 0.5 * p.chassis_mass * (velocity[0] * velocity[0] + velocity[1] * velocity[1])
            + 0.5 * p.chassis_yaw_inertia * velocity[2] * velocity[2];
        let expected = chassis + wheel(left, velocity[3]) + wheel(right, velocity[4]);
        assert!((robot.kinetic_energy(&velocity) - expected).abs() < 1e-13);
    }

    #[test]
    fn lengthwise_friction_does_not_change_the_total_normal_force() {
        let response = reference().normal_response().row_sum();
        // Weights are 100 N: a sum of three responses cancels to rounding.
        assert!(response.amax() < 1e-14);
    }

    #[test]
    fn accelerating_moves_normal_force_to_the_rear_axle() {
        let force =
            reference().normal_force_projection().velocity_change_map * BodyVector::from([0.0, 1.0, 0.0, 0.0, 0.0]);
        assert!(force[0] > 0.0 && force[1] > 0.0 && force[2] < 0.0);
    }
}
