//! Whatever validation accepts is answered with finite numbers and without hanging.

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::robot::{PerWheel, RobotParameters, State};
use slipdrive::shooting::{Goal, Maneuver, StateComponent};
use slipdrive::solver::{Method, RunControl, Solution, SolveInput, SolveParameters, SolverSettings, Status, solve};

fn random_parameters(rng: &mut Xoshiro256PlusPlus) -> RobotParameters {
    let mut spread = |value: f64, decades: f64| value * 10.0_f64.powf(rng.random_range(-decades..decades));
    let reference = RobotParameters::default();
    RobotParameters {
        chassis_mass: spread(reference.chassis_mass, 2.5),
        wheel_mass: spread(reference.wheel_mass, 2.5),
        chassis_yaw_inertia: spread(reference.chassis_yaw_inertia, 3.0),
        wheel_spin_inertia: spread(reference.wheel_spin_inertia, 4.0),
        wheel_radius: spread(reference.wheel_radius, 1.0),
        track_width: spread(reference.track_width, 1.0),
        wheel_friction_coefficient: spread(reference.wheel_friction_coefficient, 1.0),
        front_friction_coefficient: if rng.random_bool(0.5) { 0.0 } else { rng.random_range(0.0..0.5) },
        tangential_restitution: if rng.random_bool(0.5) { 0.0 } else { 1.0 },
        ..reference
    }
}

fn random_maneuver(rng: &mut Xoshiro256PlusPlus) -> Maneuver {
    let mut maneuver = Maneuver::forward_drive();
    let mut spread = |largest: f64| {
        let size = largest * 10.0_f64.powf(rng.random_range(-6.0..0.0));
        if rng.random_bool(0.3) { 0.0 } else { size * if rng.random_bool(0.5) { 1.0 } else { -1.0 } }
    };
    maneuver.start = State::from_vector(&nalgebra::SVector::from([
        spread(1e4),
        spread(1e4),
        spread(1e4),
        spread(1e6),
        spread(1e6),
        spread(100.0),
        spread(100.0),
        spread(1e3),
        spread(1e5),
        spread(1e5),
    ]));
    maneuver.goal = Goal::at_rest(spread(1e4), spread(1e4), spread(1e4));
    maneuver.torque_limit = PerWheel::new(spread(1e6).abs(), spread(1e3).abs());
    for component in StateComponent::ALL {
        if rng.random_bool(0.1) {
            maneuver.goal.set(component, None);
        }
    }
    maneuver
}

fn assert_finite(seed: u64, solution: &Solution) {
    let report = &solution.report;
    let schedule = &solution.schedule;
    let numbers = solution
        .trajectory
        .state
        .iter()
        .flat_map(|state| state.to_vector().iter().copied().collect::<Vec<_>>())
        .chain(solution.goal_error.iter().copied())
        .chain(schedule.left.iter().chain(&schedule.right).copied())
        .chain([schedule.final_time, report.predicted_decrease, report.lower_bound.unwrap()])
        .chain(report.replay.iter().flat_map(|replay| [replay.miss_position, replay.miss_heading, replay.miss_speed]));
    // The schedule has the final time of the decision up to rounding.
    let most = schedule.final_time * (1.0 + 1e-12);
    assert!((0.0..=most).contains(&report.predicted_decrease), "seed {seed}: {} of {most}", report.predicted_decrease);
    for number in numbers {
        assert!(number.is_finite(), "seed {seed}: {number}, {:?}", solution.status);
    }
}

#[test]
fn extreme_input_is_answered_with_finite_numbers() {
    let mut accepted = 0;
    for seed in 0..250 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let settings = SolverSettings {
            method: if seed % 7 == 0 { Method::NelderMead } else { Method::SequentialLinear },
            step_count: 20,
            control_count: 5,
            start_count: 4,
            rollout_limit: 100,
            ..SolverSettings::default()
        };
        let (parameters, maneuver) = (random_parameters(&mut rng), random_maneuver(&mut rng));
        let Ok(input) =
            SolveInput::new(SolveParameters { robot: parameters, maneuver, settings, ..SolveParameters::default() })
        else {
            continue;
        };
        accepted += 1;
        assert_finite(seed, &solve(&input, &RunControl::unattended()).unwrap());
    }
    assert!(accepted > 50, "{accepted} inputs were accepted");
}

#[test]
fn a_plan_that_ends_within_the_tolerance_settles_there() {
    // Over 20 um, what a goal tolerance of 1 um leaves gains more time than the last descents.
    let robot = RobotParameters {
        chassis_mass: 33.7,
        wheel_mass: 2.0,
        chassis_yaw_inertia: 1.827,
        wheel_diametral_inertia: 0.0108,
        wheel_spin_inertia: 0.0291,
        wheel_radius: 0.121,
        track_width: 0.636,
        axle_to_front_support: 0.774,
        front_support_right: -0.075,
        center_of_mass_right: 0.0206,
        center_of_mass_forward: 0.387,
        center_of_mass_height: 0.48,
        wheel_friction_coefficient: 0.143,
        ..RobotParameters::default()
    };
    let goal = Goal::at_rest(2.07e-5, -3.33e-6, 0.0);
    for seed in 0..4 {
        let maneuver = Maneuver { goal, torque_limit: PerWheel::new(2.39, 2.39), ..Maneuver::forward_drive() };
        let settings = SolverSettings { start_count: 8, seed, ..SolverSettings::default() };
        let parameters = SolveParameters { robot, maneuver, settings, ..SolveParameters::default() };
        let solution = solve(&SolveInput::new(parameters).unwrap(), &RunControl::unattended()).unwrap();
        assert_eq!(solution.status, Status::Converged, "seed {seed}: {:?}", solution.report.predicted_decrease);
    }
}
