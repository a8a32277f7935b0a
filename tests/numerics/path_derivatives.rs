//! Derivatives of every path quantity against differences, under every friction law; and the largest value of each on the way.

use nalgebra::Vector2;
use slipdrive::contact::{ContactMode, ContactName};
use slipdrive::robot::{Motor, Robot, RobotParameters, State};
use slipdrive::simulation::{
    ContactMethod, EndSensitivity, FrictionLaw, MotorJudged, PathQuantity, Rollout, Simulator, TorqueSchedule,
};
use slipdrive::stop::Stop;

use crate::random::RandomCases;

const STEP_COUNT: usize = 60;
const CONTROL_COUNT: usize = 4;
/// Near the optimum of truncation (h^2) and rounding (1e-15 / h).
const DIFFERENCE_STEP: f64 = 1e-6;
/// Relative to the largest entry of the row: rounding of the difference.
const TOLERANCE: f64 = 1e-6;
/// Under smoothed friction Newton stops at updates of 1e-9, which the difference divides by its step.
const SMOOTHED_TOLERANCE: f64 = 1e-3;
/// N m s/rad: over a step of 0.02 s a fifth of the reference robot's spin inertia.
const VISCOUS_FRICTION: f64 = 0.03;
/// Quantities are of the order of 1: entries far below it are rounding.
const SMALLEST_ENTRY: f64 = 1.0;

struct Case<'a> {
    simulator: &'a Simulator,
    start: State,
    quantities: &'a [PathQuantity],
    law: FrictionLaw,
}

/// Every quantity, of both wheels and of points off the centre of mass.
fn quantities(cases: &mut RandomCases, robot: &RobotParameters) -> Vec<PathQuantity> {
    let point = Vector2::new(cases.between(-0.3, 0.3), cases.between(-0.3, 0.3));
    let angle = cases.between(-3.0, 3.0);
    let motor = Motor { stall_torque: cases.between(0.5, 3.0), free_speed: cases.between(5.0, 30.0) };
    let of_wheels = [0, 1].into_iter().flat_map(|wheel| {
        let of_motor = |judged| PathQuantity::MotorTorque { wheel, motor, judged };
        [of_motor(MotorJudged::AtNodes), of_motor(MotorJudged::AtEnds), PathQuantity::WheelRate { wheel }]
    });
    let others = [
        PathQuantity::Speed { point },
        PathQuantity::YawRate,
        PathQuantity::Acceleration { point, sign: 1.0 },
        PathQuantity::Acceleration { point, sign: -1.0 },
        PathQuantity::YawAcceleration { sign: 1.0 },
        PathQuantity::GripUtilization {
            friction_coefficient: robot.wheel_friction_coefficient,
            least_normal_force: 0.1 * robot.total_mass(),
        },
        PathQuantity::LengthwiseUtilization {
            wheel: 1,
            sign: -1.0,
            friction_coefficient: robot.wheel_friction_coefficient,
            least_normal_force: 0.1 * robot.total_mass(),
        },
        PathQuantity::Outside {
            point,
            normal: Vector2::new(angle.cos(), angle.sin()),
            distance: 0.5,
            radius: point.norm(),
        },
    ];
    of_wheels.chain(others).collect()
}

/// What a rollout is made of: its path extremes, and what must stay the same for a difference to be a derivative.
fn rolled_out(case: &Case, schedule: &TorqueSchedule) -> (EndSensitivity, Vec<[bool; 3]>) {
    let rollout = Rollout { start: &case.start, schedule, step_count: STEP_COUNT };
    let mut motion = EndSensitivity::watching(case.quantities.to_vec(), CONTROL_COUNT);
    case.simulator.end_sensitivity(&rollout, case.law, &mut motion, Stop::never()).unwrap();
    let modes = if case.law == FrictionLaw::Exact {
        let trajectory = case.simulator.trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap();
        let sticks = |contact: &slipdrive::simulation::ContactSample| contact.mode == ContactMode::Stick;
        trajectory.contact.iter().map(|of| [sticks(&of.left), sticks(&of.right), sticks(&of.front)]).collect()
    } else {
        Vec::new()
    };
    (motion, modes)
}

/// Compares every row of one rollout; returns how many entries were comparable.
fn compare(case: &Case, schedule: &TorqueSchedule, tolerance: f64, label: &str) -> usize {
    let (here, modes) = rolled_out(case, schedule);
    let chosen: Vec<usize> = (0..here.path.count()).collect();
    let rollout = Rollout { start: &case.start, schedule, step_count: STEP_COUNT };
    let rows = case.simulator.path_sensitivity(&rollout, case.law, &here, &chosen, Stop::never()).unwrap();
    let mut compared = 0;
    for variable in 0..=2 * CONTROL_COUNT {
        let moved = [DIFFERENCE_STEP, -DIFFERENCE_STEP].map(|step| {
            let mut moved = schedule.clone();
            match variable {
                _ if variable < CONTROL_COUNT => moved.left[variable] += step,
                _ if variable < 2 * CONTROL_COUNT => moved.right[variable - CONTROL_COUNT] += step,
                _ => moved.final_time += step,
            }
            rolled_out(case, &moved)
        });
        if moved.iter().any(|(_, moved)| *moved != modes) {
            continue;
        }
        for (index, row) in rows.iter().enumerate() {
            let is_elsewhere = |moved: &EndSensitivity| moved.path.step(index) != here.path.step(index);
            // A place without a value has no step of its own.
            let is_missing = |of: &EndSensitivity| !of.path.value(index).is_finite();
            if is_missing(&here) || moved.iter().any(|(moved, _)| is_elsewhere(moved) || is_missing(moved)) {
                continue;
            }
            let entries: Vec<f64> = row.by_left_torque.iter().chain(&row.by_right_torque).copied().collect();
            let derivative = entries.get(variable).copied().unwrap_or(row.by_final_time);
            let scale =
                entries.iter().chain([&row.by_final_time]).fold(SMALLEST_ENTRY, |most, entry| most.max(entry.abs()));
            let [above, below] = &moved;
            let sides = [&above.0, &below.0].map(|side| (side.path.value(index) - here.path.value(index)).abs());
            let difference = (above.0.path.value(index) - below.0.path.value(index)) / (2.0 * DIFFERENCE_STEP);
            // A magnitude that is next to zero has a corner there.
            let has_corner = (sides[0] - sides[1]).abs() > 1e-3 * (sides[0] + sides[1]);
            if has_corner && sides[0] + sides[1] > 1e-10 * scale {
                continue;
            }
            let quantity = here.path.quantity(index);
            assert!(
                (derivative - difference).abs() <= tolerance * scale,
                "{label}, {quantity:?}, value {index}, variable {variable}: {derivative}, difference {difference}, row {scale}"
            );
            compared += 1;
        }
    }
    compared
}

fn compare_random(law: FrictionLaw, tolerance: f64, front: bool) {
    let (mut compared, mut total) = (0, 0);
    for seed in 0..30 {
        let mut cases = RandomCases::new(seed);
        let mut parameters = *cases.robot().parameters();
        parameters.front_friction_coefficient = if front { 0.1 } else { 0.0 };
        parameters.wheel_viscous_friction = if seed % 2 == 0 { 0.0 } else { VISCOUS_FRICTION };
        let Ok(robot) = Robot::new(parameters) else { continue };
        let simulator = Simulator::new(&robot);
        let quantities = quantities(&mut cases, &parameters);
        let start = cases.state(&robot, 1.0);
        let case = Case { simulator: &simulator, start, quantities: &quantities, law };
        let schedule = cases.schedule(CONTROL_COUNT, 1.0, 2.0);
        compared += compare(&case, &schedule, tolerance, &format!("{law:?}, front {front}, seed {seed}"));
        total += (2 * CONTROL_COUNT + 1) * (3 + quantities.len()) * CONTROL_COUNT;
    }
    println!("{law:?}: {compared} of {total} entries were comparable");
    assert!(3 * compared > total, "{compared} of {total}");
}

#[test]
fn rows_agree_with_differences_under_the_exact_law() {
    compare_random(FrictionLaw::Exact, TOLERANCE, false);
    compare_random(FrictionLaw::Exact, TOLERANCE, true);
}

#[test]
fn rows_agree_with_differences_with_held_wheels() {
    compare_random(FrictionLaw::Held(0.0), TOLERANCE, false);
    compare_random(FrictionLaw::Held(0.0), TOLERANCE, true);
}

#[test]
fn rows_agree_with_differences_under_smoothed_friction() {
    compare_random(FrictionLaw::Smoothed(0.05), SMOOTHED_TOLERANCE, false);
    compare_random(FrictionLaw::Held(0.05), SMOOTHED_TOLERANCE, false);
}

#[test]
fn maxima_are_the_largest_values_that_are_noted_for_derivatives() {
    for seed in 0..200 {
        let mut cases = RandomCases::new(seed);
        let robot = cases.robot();
        let simulator = Simulator::new(&robot);
        let quantities = quantities(&mut cases, robot.parameters());
        let (start, schedule) = (cases.state(&robot, 1.0), cases.schedule(CONTROL_COUNT, 1.0, 2.0));
        let rollout = Rollout { start: &start, schedule: &schedule, step_count: STEP_COUNT };
        for law in [FrictionLaw::Exact, FrictionLaw::Held(0.0), FrictionLaw::Smoothed(0.05)] {
            let maxima = simulator.path_maxima(&rollout, law, &quantities, Stop::never()).unwrap();
            let mut noted = EndSensitivity::watching(quantities.clone(), CONTROL_COUNT);
            simulator.record(&rollout, law, &mut noted, Stop::never()).unwrap();
            assert_eq!(maxima.end, noted.end, "seed {seed}, {law:?}");
            for (place, (quantity, found)) in quantities.iter().zip(&maxima.maxima).enumerate() {
                let values = noted.path.of_others().filter(|(of, _)| *of == place);
                let largest = values.map(|(_, index)| noted.path.value(index)).fold(f64::NEG_INFINITY, f64::max);
                // Values that hardly exceed those at the ends of their interval are not noted.
                let above = found.value - largest;
                assert!((0.0..=1e-6 * (1.0 + largest.abs())).contains(&above), "seed {seed}, {quantity:?}: {above}");
            }
        }
        let trajectory = simulator.trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap();
        let exact = simulator.path_maxima(&rollout, FrictionLaw::Exact, &[], Stop::never()).unwrap();
        let slips = [ContactName::Left, ContactName::Right].map(|wheel| trajectory.slip_time(wheel) > 0.0);
        assert_eq!(exact.slips, slips.contains(&true), "seed {seed}");
        assert_eq!(exact.separations, trajectory.separations().len(), "seed {seed}");
        assert_eq!(Ok(exact.end), simulator.end_state(&rollout, Stop::never()));
    }
}
