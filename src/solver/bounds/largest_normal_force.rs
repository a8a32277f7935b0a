//! The largest normal force that a contact can have in a state of motion, whatever torques and friction do.
//!
//! At a yaw rate omega and a sum Psi of the wheel rates the normal force of a contact is
//!
//! ```text
//! N = static + omega^2 centrifugal + omega Psi gyroscopic + by_torque' torque + by_friction' friction
//! ```
//!
//! (`docs/model.md`). Viscous friction c takes `c psidot` from the torque of a wheel, and both wheels' torques tilt the chassis alike:
//! that adds `-by_torque c Psi`. Without separation the friction forces obey `|F_c| <= mu_c N_c` with normal forces that add up to the
//! weight, so their part is at most `max_c(mu_c |by_friction_c|) m g`. Where the sum stays negative, no plan keeps the
//! contact closed.

use crate::robot::{PerWheel, Robot};

/// Rates between a lowest and a highest value, rad/s.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates {
    pub(super) yaw: (f64, f64),
    /// Left plus right.
    pub(super) wheels: (f64, f64),
}

/// The largest normal force of each contact (left, right, front), N, with this viscous friction of the wheels, N m s.
pub(super) fn largest_normal_forces(
    robot: &Robot,
    (torque_limit, viscous_friction): (PerWheel<f64>, f64),
    rates: &Rates,
) -> [f64; 3] {
    let (parameters, projection) = (robot.parameters(), robot.normal_force_projection());
    let unit_rate = robot.inverse_mass_matrix() * robot.smooth_force(1.0, [0.0, 0.0]);
    let inertia = parameters.wheel_spin_inertia;
    std::array::from_fn(|contact| {
        let by_change = projection.velocity_change_map.row(contact);
        let centrifugal = projection.centrifugal[contact] + (by_change * unit_rate)[0];
        let [.., by_left, by_right] = by_change.transpose().data.0[0];
        let by_torque = by_left.abs() * torque_limit.left + by_right.abs() * torque_limit.right;
        let viscous = -by_left / inertia * viscous_friction;
        projection.static_force[contact]
            + largest_by_rates(centrifugal, projection.gyroscopic[contact], rates)
            + by_torque / inertia
            + (viscous * rates.wheels.0).max(viscous * rates.wheels.1)
            + largest_by_friction(robot, contact)
    })
}

/// Largest value of a omega^2 + b omega Psi: at a corner, or where the parabola in omega turns.
fn largest_by_rates(a: f64, b: f64, rates: &Rates) -> f64 {
    let (low, high) = rates.yaw;
    let mut largest = f64::NEG_INFINITY;
    for wheels in [rates.wheels.0, rates.wheels.1] {
        let turn = -b * wheels / (2.0 * a);
        for yaw in [low, high, turn.clamp(low, high)] {
            largest = largest.max(a * yaw * yaw + b * yaw * wheels);
        }
    }
    largest
}

fn largest_by_friction(robot: &Robot, contact: usize) -> f64 {
    let parameters = robot.parameters();
    let response = robot.normal_response().row(contact);
    let (wheel, front) = (parameters.wheel_friction_coefficient, parameters.front_friction_coefficient);
    let [left, right, lateral, front_x, front_y] = response.transpose().data.0[0];
    let of_wheels = left.abs().max(right.abs()).hypot(lateral);
    let of_front = front_x.hypot(front_y);
    (wheel * of_wheels).max(front * of_front) * parameters.total_mass() * parameters.gravity
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::RobotParameters;

    fn robot() -> Robot {
        Robot::new(RobotParameters::default()).unwrap()
    }

    #[test]
    fn at_rest_every_contact_reaches_its_static_normal_force() {
        let rates = Rates { yaw: (0.0, 0.0), wheels: (-100.0, 100.0) };
        let forces = largest_normal_forces(&robot(), (PerWheel::new(0.0, 0.0), 0.0), &rates);
        let at_rest = robot().normal_force_projection().static_force;
        assert!(forces.iter().zip(at_rest.iter()).all(|(force, at_rest)| force > at_rest), "{forces:?}");
    }

    #[test]
    fn a_fast_spin_separates_a_contact() {
        let rates = Rates { yaw: (200.0, 200.0), wheels: (0.0, 0.0) };
        assert!(
            largest_normal_forces(&robot(), (PerWheel::new(1.0, 1.0), 0.0), &rates).iter().any(|force| *force < 0.0)
        );
    }

    #[test]
    fn viscous_friction_shifts_load_as_a_torque_does() {
        let (viscous, rate) = (0.02, 30.0);
        let (robot, no_torque) = (robot(), PerWheel::new(0.0, 0.0));
        let rates = Rates { yaw: (0.0, 0.0), wheels: (2.0 * rate, 2.0 * rate) };
        let without = largest_normal_forces(&robot, (no_torque, 0.0), &rates);
        let with = largest_normal_forces(&robot, (no_torque, viscous), &rates);
        let shift = 2.0 * viscous * rate / robot.parameters().axle_to_front_support;
        // Braked wheels press the front support down.
        assert!((with[2] - without[2] - shift).abs() < 1e-12 && with[0] < without[0], "{with:?} {without:?}");
    }

    #[test]
    fn the_parabola_is_largest_at_its_turn() {
        let rates = Rates { yaw: (0.0, 10.0), wheels: (4.0, 4.0) };
        // -omega^2 + 4 omega at omega = 2.
        assert_eq!(largest_by_rates(-1.0, 1.0, &rates), 4.0);
    }
}
