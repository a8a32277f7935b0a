//! Robots that a random search has found, whose friction is hard to resolve: for tests and benches of stopping.

use super::RobotParameters;

/// Its fixed point takes thousands of sweeps.
pub(crate) fn short_track() -> RobotParameters {
    RobotParameters {
        chassis_mass: 2.374,
        wheel_mass: 3.573,
        chassis_yaw_inertia: 0.01702,
        wheel_diametral_inertia: 0.002_001,
        wheel_spin_inertia: 0.001_218,
        wheel_radius: 0.006_426,
        track_width: 0.01935,
        axle_to_front_support: 0.1229,
        center_of_mass_height: 0.002_739,
        wheel_friction_coefficient: 2.861,
        front_friction_coefficient: 1.584,
        ..RobotParameters::default()
    }
}

/// The exact solver needs its interior point in many of its steps.
pub(crate) fn heavy_wheels() -> RobotParameters {
    RobotParameters {
        chassis_mass: 7.413,
        wheel_mass: 8.257,
        chassis_yaw_inertia: 0.01234,
        wheel_diametral_inertia: 1.27,
        wheel_spin_inertia: 0.004_612,
        wheel_radius: 0.3388,
        track_width: 3.017,
        axle_to_front_support: 0.03469,
        center_of_mass_height: 0.008_886,
        wheel_friction_coefficient: 0.695,
        front_friction_coefficient: 1.757,
        ..RobotParameters::default()
    }
}
