//! Whether friction holds a robot at rest whatever its motors do: a rubbing front support can be more than they move.
//!
//! At rest each wheel passes its torque on to the floor, the axle and the front support balance the forces and their moment, and the
//! normal forces are those of standing still, since all that shifts them are changes of velocity. Rest is a motion where no contact
//! needs more than its friction. The forces are linear in the torques and the friction discs convex, so that two corners of the torque
//! limits, and their opposites, speak for all torques. Rest is the only motion where steps have unique solutions
//! (`docs/model.md`); viscous friction only adds to the inertia there.

use nalgebra::{SMatrix, Vector3};

use crate::contact::DelassusOperator;
use crate::motion::ROUNDING;
use crate::robot::{BodyVector, PerWheel, Robot, Velocity};
use crate::solver::settings::SolveInput;

/// Whether it is proved that the robot starts at rest and stays there whatever its motors do.
pub(super) fn stays_at_start(input: &SolveInput) -> bool {
    starts_at_rest(input) && stands_still(&input.robot, torque_at_rest(input))
}

/// Whether the robot starts at rest and may stay there whatever its motors do; there may be other motions.
pub(in crate::solver) fn may_stay_at_start(input: &SolveInput) -> bool {
    starts_at_rest(input) && may_stand_still(&input.robot, torque_at_rest(input))
}

fn starts_at_rest(input: &SolveInput) -> bool {
    input.maneuver.start.velocity == Velocity::default()
}

/// The largest torques at rest, N m: within their limits and what the motor has there.
fn torque_at_rest(input: &SolveInput) -> PerWheel<f64> {
    let (PerWheel { left, right }, stall) = (input.maneuver.torque_limit, stall_torque(input));
    PerWheel::new(left.min(stall), right.min(stall))
}

/// The fields that bound them.
pub(in crate::solver) fn fields_of_torque_at_rest(input: &SolveInput) -> &'static str {
    let PerWheel { left, right } = input.maneuver.torque_limit;
    if stall_torque(input) <= left.min(right) {
        "`robot.motor_stall_torque_n_m`"
    } else {
        "`maneuver.torque_limit_left_n_m`, `maneuver.torque_limit_right_n_m`"
    }
}

fn stall_torque(input: &SolveInput) -> f64 {
    input.robot.parameters().motor.map_or(f64::INFINITY, |motor| motor.stall_torque)
}

/// Whether it is proved that a robot at rest stays there under all torques within their limits.
fn stands_still(robot: &Robot, torque_limit: PerWheel<f64>) -> bool {
    // Without torque nothing can be gained, however many motions friction allows.
    (torque_limit.left == 0.0 && torque_limit.right == 0.0)
        || may_stand_still(robot, torque_limit) && has_unique_motions(robot)
}

/// Whether rest is a motion under all torques within their limits.
fn may_stand_still(robot: &Robot, PerWheel { left, right }: PerWheel<f64>) -> bool {
    [right, -right].into_iter().all(|right| is_held(robot, [left, right]))
}

/// Whether the contacts can balance these torques at rest.
fn is_held(robot: &Robot, torque: [f64; 2]) -> bool {
    let by_slip: SMatrix<f64, 5, 5> = robot.tangent_jacobian().matrix().transpose();
    let balance: Option<BodyVector> = by_slip.lu().solve(&-robot.smooth_force(0.0, torque));
    let Some(forces) = balance else { return false };
    let [left, right, lateral, front_x, front_y] = forces.data.0[0];
    let normal = robot.normal_force_projection().static_force;
    let grip = Vector3::from(robot.parameters().friction_coefficients()).component_mul(&normal) * (1.0 - ROUNDING);
    // What is left of a wheel's grip beside its lengthwise force; not a number where nothing is.
    let left_over = |grip: f64, force: f64| (grip * grip - force * force).sqrt();
    lateral.abs() <= left_over(grip[0], left) + left_over(grip[1], right) && front_x.hypot(front_y) <= grip[2]
}

fn has_unique_motions(robot: &Robot) -> bool {
    let friction = robot.parameters().friction_coefficients();
    DelassusOperator::<5>::new(*robot.delassus(), *robot.normal_response(), friction).has_unique_solutions()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::*;
    use crate::robot::{RobotParameters, State};
    use crate::simulation::{Rollout, Simulator, TorqueSchedule};
    use crate::stop::Stop;

    fn rubbing() -> RobotParameters {
        RobotParameters { front_friction_coefficient: 0.3, ..RobotParameters::default() }
    }

    /// The largest rate after some steps under a torque.
    fn motion(robot: &Robot, [left, right]: [f64; 2]) -> f64 {
        let schedule = TorqueSchedule { final_time: 0.1, left: vec![left], right: vec![right] };
        let rollout = Rollout { start: &State::default(), schedule: &schedule, step_count: 4 };
        let end = Simulator::new(robot).end_state(&rollout, Stop::never()).unwrap();
        end.to_vector().rows(5, 5).amax()
    }

    #[test]
    fn the_front_support_holds_what_its_friction_carries() {
        let robot = Robot::new(rubbing()).unwrap();
        let (parameters, normal) = (robot.parameters(), robot.normal_force_projection().static_force);
        let grip = parameters.front_friction_coefficient * normal[2];
        // Turning on the spot pushes the front support sideways, by a lever of the axle's distance in place of half the track width.
        let straight = 0.5 * grip * parameters.wheel_radius;
        let turning = straight * 2.0 * parameters.axle_to_front_support / parameters.track_width;
        let most = straight.min(turning);
        assert!(stands_still(&robot, PerWheel::new(0.999 * most, 0.999 * most)));
        assert!(!stands_still(&robot, PerWheel::new(1.001 * most, 1.001 * most)));
        assert!(motion(&robot, [1.001 * straight; 2]) > 1e-6 && motion(&robot, [0.999 * straight; 2]) < 1e-12);
    }

    #[test]
    fn nothing_holds_a_robot_on_a_frictionless_front_support_but_want_of_torque() {
        let robot = Robot::new(RobotParameters::default()).unwrap();
        assert!(!stands_still(&robot, PerWheel::new(1e-6, 0.0)));
        assert!(stands_still(&robot, PerWheel::new(0.0, 0.0)));
    }

    #[test]
    fn drawn_robots_that_stand_still_do_so_in_rollouts_and_the_others_move_at_a_corner() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
        let mut held = 0;
        for _ in 0..400 {
            let mut parameters =
                RobotParameters { front_friction_coefficient: 0.7, wheel_viscous_friction: 0.02, ..rubbing() };
            for value in [
                &mut parameters.front_friction_coefficient,
                &mut parameters.wheel_friction_coefficient,
                &mut parameters.axle_to_front_support,
                &mut parameters.wheel_viscous_friction,
            ] {
                *value *= random.random_range(0.5..1.5);
            }
            parameters.front_support_right = random.random_range(-0.02..0.02);
            let robot = Robot::new(parameters).unwrap();
            let limit = PerWheel::new(random.random_range(0.0..0.5), random.random_range(0.0..0.5));
            if !has_unique_motions(&robot) {
                continue;
            }
            if stands_still(&robot, limit) {
                held += 1;
                for _ in 0..10 {
                    let torque = [limit.left, limit.right].map(|limit| limit * random.random_range(-1.0..1.0));
                    assert!(motion(&robot, torque) < 1e-12, "{torque:?} of {limit:?}: {robot:?}");
                }
            } else {
                let corners = [[limit.left, limit.right], [limit.left, -limit.right]];
                assert!(corners.iter().any(|corner| motion(&robot, *corner) > 1e-9), "{limit:?}: {robot:?}");
            }
        }
        assert!((50..350).contains(&held), "{held}");
    }
}
