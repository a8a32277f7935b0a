//! A simulation that takes minutes, for tests and benches of stopping.

use serde_json::{Value, json};

/// The fixed point takes thousands of sweeps in each of 10,000 steps.
pub(crate) fn slow_simulation() -> Value {
    let repeated = |torques: [f64; 4]| (0..100).flat_map(|_| torques).collect::<Vec<_>>();
    json!({
        "robot": {
            "chassis_mass_kg": 2.374, "wheel_mass_kg": 3.573, "chassis_yaw_inertia_kg_m2": 0.01702,
            "wheel_diametral_inertia_kg_m2": 0.002_001, "wheel_spin_inertia_kg_m2": 0.001_218,
            "wheel_radius_m": 0.006_426, "track_width_m": 0.01935, "axle_to_front_support_m": 0.1229,
            "center_of_mass_height_m": 0.002_739, "wheel_friction_coefficient": 2.861,
            "front_friction_coefficient": 1.584,
        },
        "torque_schedule": {
            "interval_s": 8.71,
            "left_n_m": repeated([-0.252, 0.169, 0.551, 0.803]),
            "right_n_m": repeated([1.893, 1.769, -1.166, -1.366]),
        },
        "grid": {"steps": 10_000},
        "contact_solver": "fixed_point",
    })
}
