//! Rollouts of an independent implementation, for several robots and regimes, matched by both contact solvers.

use std::{fs, path::PathBuf};

use serde_json::Value;
use slipdrive::contact::PerContact;
use slipdrive::robot::{Robot, RobotParameters, State};
use slipdrive::simulation::{ContactMethod, ContactSample, Rollout, Simulator, TorqueSchedule, Trajectory};
use slipdrive::stop::Stop;

/// Relative to the larger of 1 and the value: the reference was computed to 1e-10 and printed to 12 digits.
const MOTION_TOLERANCE: f64 = 1e-7;
/// Forces are differences over one step, hence one digit less.
const FORCE_TOLERANCE: f64 = 1e-6;

struct ReferenceRollout {
    name: String,
    robot: Robot,
    start: State,
    schedule: TorqueSchedule,
    step_count: usize,
    samples: Value,
    contacts: Value,
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn steps(value: &Value) -> impl Iterator<Item = (usize, usize)> {
    let steps = value.as_array().expect("an array");
    steps.iter().map(|step| usize::try_from(step.as_u64().expect("a count")).expect("a small count")).enumerate()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("an array").iter().map(number).collect()
}

fn read_all() -> Vec<ReferenceRollout> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/rollouts");
    let mut paths: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| parse(&serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap())).collect()
}

fn parse(file: &Value) -> ReferenceRollout {
    let robot = |field: &str| number(&file["robot"][field]);
    let parameters = RobotParameters {
        chassis_mass: robot("chassis_mass_kg"),
        wheel_mass: robot("wheel_mass_kg"),
        chassis_yaw_inertia: robot("chassis_yaw_inertia_kg_m2"),
        wheel_diametral_inertia: robot("wheel_diametral_inertia_kg_m2"),
        wheel_spin_inertia: robot("wheel_spin_inertia_kg_m2"),
        wheel_radius: robot("wheel_radius_m"),
        track_width: robot("track_width_m"),
        axle_to_front_support: robot("axle_to_front_support_m"),
        front_support_right: robot("front_support_right_m"),
        center_of_mass_right: robot("center_of_mass_right_m"),
        center_of_mass_forward: robot("center_of_mass_forward_m"),
        center_of_mass_height: robot("center_of_mass_height_m"),
        wheel_friction_coefficient: robot("wheel_friction_coefficient"),
        front_friction_coefficient: robot("front_friction_coefficient"),
        tangential_restitution: robot("tangential_restitution"),
        gravity: robot("gravity_m_s2"),
        ..RobotParameters::default()
    };
    let start = [numbers(&file["start"]["configuration"]), numbers(&file["start"]["velocity"])].concat();
    ReferenceRollout {
        name: file["name"].as_str().unwrap().to_owned(),
        robot: Robot::new(parameters).unwrap(),
        start: State::from_vector(&nalgebra::SVector::from_column_slice(&start)),
        schedule: TorqueSchedule {
            final_time: number(&file["final_time_s"]),
            left: numbers(&file["torque_left_n_m"]),
            right: numbers(&file["torque_right_n_m"]),
        },
        step_count: usize::try_from(file["steps"].as_u64().unwrap()).unwrap(),
        samples: file["samples"].clone(),
        contacts: file["contacts"].clone(),
    }
}

fn assert_close(case: &str, what: &str, actual: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(actual.len(), expected.len());
    for (a, e) in actual.iter().zip(expected) {
        let scale = e.abs().max(1.0);
        assert!((a - e).abs() <= tolerance * scale, "{case}: {what} is {a}, expected {e}");
    }
}

fn assert_samples_match(reference: &ReferenceRollout, case: &str, trajectory: &Trajectory) {
    for (index, step) in steps(&reference.samples["step"]) {
        let actual = trajectory.state[step].to_vector();
        let configuration = numbers(&reference.samples["configuration"][index]);
        let velocity = numbers(&reference.samples["velocity"][index]);
        assert_close(case, "configuration", &actual.as_slice()[..5], &configuration, MOTION_TOLERANCE);
        assert_close(case, "velocity", &actual.as_slice()[5..], &velocity, MOTION_TOLERANCE);
    }
}

fn assert_contacts_match(reference: &ReferenceRollout, case: &str, trajectory: &Trajectory) {
    for (index, step) in steps(&reference.contacts["step"]) {
        let sample: &PerContact<ContactSample> = &trajectory.contact[step - 1];
        let of = |value: fn(&ContactSample) -> f64| [value(&sample.left), value(&sample.right), value(&sample.front)];
        let expected = |field: &str| numbers(&reference.contacts[field][index]);
        let pairs = [
            (of(|s| s.normal_force), expected("normal_force_n_left_right_front"), FORCE_TOLERANCE),
            (of(|s| s.longitudinal_force), expected("longitudinal_force_n_left_right_front"), FORCE_TOLERANCE),
            (of(|s| s.lateral_slip), expected("slip_m_s_lateral_left_right_front"), MOTION_TOLERANCE),
            (of(|s| s.longitudinal_slip), expected("slip_m_s_longitudinal_left_right_front"), MOTION_TOLERANCE),
        ];
        for (actual, expected, tolerance) in pairs {
            assert_close(case, "contact", &actual, &expected, tolerance);
        }
        let lateral_sum = sample.left.lateral_force + sample.right.lateral_force;
        let expected_sum = number(&reference.contacts["lateral_force_sum_of_wheels_n"][index]);
        assert_close(case, "lateral sum", &[lateral_sum], &[expected_sum], FORCE_TOLERANCE);
    }
}

fn assert_all_match(method: ContactMethod) {
    let references = read_all();
    assert!(references.len() >= 7, "the data files are in place");
    for reference in &references {
        let case = format!("{} with {method:?}", reference.name);
        let rollout =
            Rollout { start: &reference.start, schedule: &reference.schedule, step_count: reference.step_count };
        let simulator = Simulator::new(&reference.robot);
        let trajectory = simulator.trajectory(&rollout, method, Stop::never()).unwrap();
        println!(
            "{case}: residual {:.1e}, indeterminate {}, separations {}, reversals {}",
            trajectory.worst_contact_residual,
            simulator.indeterminate_steps(&rollout, Stop::never()).unwrap(),
            trajectory.separations().len(),
            trajectory.slip_reversals()
        );
        assert_samples_match(reference, &case, &trajectory);
        assert_contacts_match(reference, &case, &trajectory);
    }
}

#[test]
fn exact_solver_matches_the_independent_rollouts() {
    assert_all_match(ContactMethod::Exact);
}

#[test]
fn fixed_point_matches_the_independent_rollouts() {
    assert_all_match(ContactMethod::FixedPoint);
}

#[test]
fn front_support_of_the_tall_robot_separates() {
    let references = read_all();
    let tall = references.iter().find(|reference| reference.name == "tall_front_lifts").unwrap();
    let rollout = Rollout { start: &tall.start, schedule: &tall.schedule, step_count: tall.step_count };
    let separations =
        Simulator::new(&tall.robot).trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap().separations();
    assert!(separations.iter().any(|separation| separation.contact == slipdrive::contact::ContactName::Front));
}
