//! Optimised plans, which exploit whatever the grid lets them, stay above the lower bound.

use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::robot::{PerWheel, RobotParameters};
use slipdrive::shooting::{Goal, Maneuver, StateComponent};
use slipdrive::solver::{RunControl, SolveInput, SolveParameters, SolverSettings, Status, solve};

use super::best_known::suite::{Witness, read_cases};

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
    for seed in 0..60 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let step_count = random.random_range(4..16);
        let settings =
            SolverSettings { step_count, control_count: step_count, start_count: 2, ..SolverSettings::default() };
        let (robot, maneuver) = (random_robot(&mut random), random_maneuver(&mut random));
        let Ok(input) = SolveInput::new(SolveParameters { robot, maneuver, settings, ..SolveParameters::default() })
        else {
            continue;
        };
        let solution = solve(&input, &RunControl::unattended()).unwrap();
        if solution.status == Status::NotConverged || !solution.report.separations.is_empty() {
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
    assert!(plans >= 20, "{plans} plans met their goal");
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
