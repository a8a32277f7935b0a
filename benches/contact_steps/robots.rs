//! Random robots, log-uniform over decades about the reference robot.

use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::robot::{Robot, RobotParameters};

/// Parameters that a robot may not be accepted with; `reach` scales the decades, and so many fronts have no friction.
pub(crate) fn spread(random: &mut Xoshiro256PlusPlus, reach: f64, frictionless_front: f64) -> RobotParameters {
    let reference = RobotParameters::default();
    let mut spread = |value: f64, decades: f64| value * 10.0_f64.powf(reach * random.random_range(-decades..decades));
    RobotParameters {
        chassis_mass: spread(reference.chassis_mass, 1.5),
        wheel_mass: spread(reference.wheel_mass, 1.5),
        chassis_yaw_inertia: spread(reference.chassis_yaw_inertia, 1.5),
        wheel_diametral_inertia: spread(0.05, 2.0),
        wheel_spin_inertia: spread(reference.wheel_spin_inertia, 1.5),
        wheel_radius: spread(reference.wheel_radius, 1.0),
        track_width: spread(reference.track_width, 1.0),
        axle_to_front_support: spread(reference.axle_to_front_support, 1.0),
        center_of_mass_height: spread(0.02, 1.5),
        wheel_friction_coefficient: spread(reference.wheel_friction_coefficient, 1.0),
        front_friction_coefficient: if random.random_bool(frictionless_front) {
            0.0
        } else {
            random.random_range(0.0..2.0) * reach
        },
        ..reference
    }
}

/// The first robot that is accepted.
pub(crate) fn accepted(mut parameters: impl FnMut() -> RobotParameters) -> Robot {
    loop {
        if let Ok(robot) = Robot::new(parameters()) {
            return robot;
        }
    }
}
