//! Robots that the suite does not have: one for each maneuver, from toys to carriers.
//!
//! Lengths follow the mass as those of similar robots do, and scatter around that. Inertias follow masses and lengths.

use rand::RngExt as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::robot::RobotParameters;

use crate::draw::{log_uniform, within};
use crate::rounding::rounded;

/// Gravity on Earth and on the Moon, m/s2.
const GRAVITY: [f64; 2] = [9.81, 1.62];
/// Share of the robots that are on the Moon.
const LUNAR_SHARE: f64 = 0.1;
/// Share of the robots whose front support rubs.
const RUBBING_SHARE: f64 = 0.2;
/// Share of the robots whose contacts have restitution.
const RESTITUTION_SHARE: f64 = 0.1;
/// Share of the robots with a front support off the centreline.
const ASKEW_SHARE: f64 = 0.2;
/// Chassis mass (kg) and track width (m) of a robot of usual proportions, near the reference robot's.
const USUAL: (f64, f64) = (10.0, 0.32);

/// Draws a robot; the rules for requests may refuse it.
pub(crate) fn drawn_robot(rng: &mut Xoshiro256PlusPlus) -> RobotParameters {
    let chassis_mass = log_uniform(rng, 2.0..200.0);
    let (usual_mass, usual_track) = USUAL;
    let track_width = usual_track * (chassis_mass / usual_mass).cbrt() * log_uniform(rng, 0.7..1.4);
    let wheel_radius = track_width * log_uniform(rng, 0.1..0.35);
    let wheel_mass = chassis_mass * log_uniform(rng, 0.01..0.1);
    let disc_inertia = 0.5 * wheel_mass * wheel_radius * wheel_radius;
    let axle_to_front_support = track_width * log_uniform(rng, 0.5..1.5);
    let gyration_radius = track_width * rng.random_range(0.3..0.6);
    with_rounded_fields(RobotParameters {
        chassis_mass,
        wheel_mass,
        chassis_yaw_inertia: chassis_mass * gyration_radius * gyration_radius,
        // Half of the spin inertia is that of a thin disc; wide tyres add to it.
        wheel_diametral_inertia: disc_inertia * rng.random_range(0.5..0.8),
        // A rim adds up to as much as the disc has, rotor and gear a few times as much.
        wheel_spin_inertia: disc_inertia * log_uniform(rng, 1.0..6.0),
        wheel_radius,
        track_width,
        axle_to_front_support,
        front_support_right: share_of(rng, ASKEW_SHARE, |rng| track_width * within(rng, 0.2)),
        center_of_mass_right: track_width * within(rng, 0.15),
        center_of_mass_forward: axle_to_front_support * rng.random_range(0.1..0.5),
        center_of_mass_height: track_width * log_uniform(rng, 0.15..0.9),
        wheel_friction_coefficient: rng.random_range(0.1..1.0),
        front_friction_coefficient: share_of(rng, RUBBING_SHARE, |rng| rng.random_range(0.05..0.3)),
        tangential_restitution: share_of(rng, RESTITUTION_SHARE, |rng| rng.random_range(0.1..0.5)),
        gravity: GRAVITY[usize::from(rng.random_bool(LUNAR_SHARE))],
        ..RobotParameters::default()
    })
}

/// A draw for some share of the robots, zero for the others.
fn share_of(rng: &mut Xoshiro256PlusPlus, share: f64, draw: impl Fn(&mut Xoshiro256PlusPlus) -> f64) -> f64 {
    if rng.random_bool(share) { draw(rng) } else { 0.0 }
}

/// The robot of the request: what follows from its parameters must follow from the numbers that are sent.
fn with_rounded_fields(robot: RobotParameters) -> RobotParameters {
    RobotParameters {
        chassis_mass: rounded(robot.chassis_mass),
        wheel_mass: rounded(robot.wheel_mass),
        chassis_yaw_inertia: rounded(robot.chassis_yaw_inertia),
        wheel_diametral_inertia: rounded(robot.wheel_diametral_inertia),
        wheel_spin_inertia: rounded(robot.wheel_spin_inertia),
        wheel_radius: rounded(robot.wheel_radius),
        track_width: rounded(robot.track_width),
        axle_to_front_support: rounded(robot.axle_to_front_support),
        front_support_right: rounded(robot.front_support_right),
        center_of_mass_right: rounded(robot.center_of_mass_right),
        center_of_mass_forward: rounded(robot.center_of_mass_forward),
        center_of_mass_height: rounded(robot.center_of_mass_height),
        wheel_friction_coefficient: rounded(robot.wheel_friction_coefficient),
        front_friction_coefficient: rounded(robot.front_friction_coefficient),
        tangential_restitution: rounded(robot.tangential_restitution),
        gravity: robot.gravity,
        ..robot
    }
}
