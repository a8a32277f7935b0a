//! Optimised plans, which exploit whatever the grid lets them, stay above the lower bound.

use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::robot::{Payload, PerWheel, RobotParameters};
use slipdrive::shooting::{Goal, Maneuver, SlipPolicy, StateComponent};
use slipdrive::solver::{Refinement, RunControl, SolveInput, SolveParameters, SolverSettings, Status, solve};

use super::best_known::suite::{Case, Witness, read_cases};

/// Heavy wheels put the whole robot's centre of mass far from the chassis's: the scheme errs the most.
fn random_robot(random: &mut impl Rng) -> RobotParameters {
    RobotParameters {
        wheel_mass: random.random_range(0.1..6.0),
        chassis_yaw_inertia: random.random_range(0.05..0.5),
        wheel_friction_coefficient: random.random_range(0.1..0.9),
        center_of_mass_height: 0.05,
        center_of_mass_forward: random.random_range(0.02..0.15),
        ..RobotParameters::default()
    }
}

fn random_maneuver(random: &mut impl Rng) -> Maneuver {
    let mut within = |limit: f64| random.random_range(-limit..limit);
    let mut maneuver =
        Maneuver { goal: Goal::at_rest(within(0.5), within(2.0), within(3.0)), ..Maneuver::forward_drive() };
    maneuver.start.velocity.y = within(1.0);
    maneuver.start.velocity.yaw_rate = within(3.0);
    maneuver.torque_limit = PerWheel::new(within(4.0).abs(), within(4.0).abs());
    for component in StateComponent::ALL {
        if within(1.0) > 0.6 {
            maneuver.goal.set(component, None);
        }
    }
    maneuver
}

#[test]
fn optimised_coarse_plans_stay_above_the_bound() {
    let mut plans = 0;
    for seed in 0..120 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let step_count = random.random_range(4..16);
        let settings = SolverSettings {
            step_count,
            refinement: Refinement::Fixed,
            control_count: step_count,
            start_count: 2,
            ..SolverSettings::default()
        };
        let (robot, maneuver) = (random_robot(&mut random), random_maneuver(&mut random));
        let Ok(input) = SolveInput::new(SolveParameters { robot, maneuver, settings, ..SolveParameters::default() })
        else {
            continue;
        };
        let solution = solve(&input, &RunControl::unattended()).unwrap();
        if solution.status == Status::NotConverged || !solution.trajectory.separations().is_empty() {
            continue;
        }
        assert_ne!(solution.status, Status::Infeasible, "seed {seed}: {:?}", solution.reason);
        let (bound, time) = (solution.report.lower_bound.unwrap(), solution.schedule.final_time);
        assert!(
            bound <= time,
            "seed {seed}: {bound} s by {:?} exceeds {time} s",
            solution.report.lower_bound_assumption
        );
        plans += 1;
    }
    assert!(plans >= 60, "{plans} plans met their goal");
}

/// Some limits, each near what a plan without it would use.
fn limit(random: &mut impl Rng, parameters: &mut SolveParameters) {
    let maneuver = &mut parameters.maneuver;
    if random.random_bool(0.5) {
        maneuver.slip = SlipPolicy::Forbidden;
    }
    let mut asked = |low: f64, high: f64| random.random_bool(0.4).then(|| random.random_range(low..high));
    let limits = &mut maneuver.limits;
    limits.grip_utilization = asked(0.5, 0.95);
    limits.wheel_rate = asked(8.0, 30.0);
    limits.speed = asked(0.4, 2.0);
    limits.yaw_rate = asked(0.5, 3.0);
    limits.acceleration = asked(0.5, 4.0);
    limits.deceleration = asked(0.5, 4.0);
    limits.yaw_acceleration = asked(2.0, 20.0);
    if random.random_bool(0.3) {
        let mut within = |limit: f64| random.random_range(-limit..limit);
        let (right, forward) = (within(0.05), 0.07 + within(0.05));
        parameters.payload = Some(Payload { mass: 3.0, right, forward, height: 0.1, yaw_inertia: 0.02 });
    }
}

#[test]
fn optimised_plans_with_limits_stay_above_the_bound() {
    let mut plans = 0;
    for seed in 0..40 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let settings = SolverSettings { start_count: 1, refinement: Refinement::Fixed, ..SolverSettings::default() };
        let mut within = |limit: f64| random.random_range(-limit..limit);
        let goal = Goal::at_rest(within(1.0), within(3.0), within(2.0));
        let maneuver = Maneuver { goal, ..Maneuver::forward_drive() };
        let mut parameters = SolveParameters { maneuver, settings, ..SolveParameters::default() };
        limit(&mut random, &mut parameters);
        let solution = solve(&SolveInput::new(parameters).unwrap(), &RunControl::unattended()).unwrap();
        if solution.status != Status::Converged {
            continue;
        }
        let (bound, time) = (solution.report.lower_bound.unwrap(), solution.schedule.final_time);
        assert!(bound <= time, "seed {seed}: {bound} s exceeds {time} s");
        plans += 1;
    }
    assert!(plans >= 25, "{plans} plans met their goal");
}

/// Prints the share of each best known time that the bound proves, and the median share.
#[test]
#[ignore = "slow: a figure for the docs, of all cases of the suite"]
fn shares_of_best_known_times() {
    let mut shares = Vec::new();
    for case in read_cases().unwrap().1 {
        let witness = Witness::read(&case.name).unwrap().unwrap();
        let mut input = case.accepted.input.clone();
        // The bound depends on the maneuver alone: one rollout is enough to be told it.
        (input.settings.start_count, input.settings.rollout_limit) = (1, 1);
        let report = solve(&input, &RunControl::unattended()).unwrap().report;
        let (bound, assumption) = (report.lower_bound.unwrap(), report.lower_bound_assumption.unwrap());
        let share = bound / witness.final_time_s;
        println!("{:<42} {bound:.4} {:.4} {share:.4} {}", case.name, witness.final_time_s, assumption.as_str());
        shares.push(share);
    }
    shares.sort_by(f64::total_cmp);
    println!("median {:.4} of {}", shares[shares.len() / 2], shares.len());
    assert!(shares[shares.len() - 1] < 1.0);
}

/// Prints the bounds of maneuvers with limits, and the times of plans for them.
#[test]
#[ignore = "slow: a figure for the docs, of the maneuvers with limits that are compared with other programs"]
fn shares_of_limited_times() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peer/limited");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    for file in files {
        let body = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
        let mut input = Case::new(file.display().to_string(), body).unwrap().accepted.input;
        input.settings.start_count = 1;
        let solution = solve(&input, &RunControl::unattended()).unwrap();
        let (bound, time) = (solution.report.lower_bound.unwrap(), solution.schedule.final_time);
        let name = file.file_stem().unwrap().to_str().unwrap();
        println!(
            "{name:<32} {bound:.4} {time:.4} {:.4} {} {:?}",
            bound / time,
            solution.report.lower_bound_assumption.unwrap().as_str(),
            solution.status
        );
        assert!(bound <= time);
    }
}
