//! Derivatives of the end state against central differences.

use slipdrive::robot::{Robot, RobotParameters, State};
use slipdrive::simulation::{
    ContactMethod, EndDerivative, EndSensitivity, FrictionLaw, PathDerivative, Rollout, Simulator, TorqueSchedule,
    Trajectory,
};
use slipdrive::stop::Stop;

use crate::random::RandomCases;

/// Near the optimum of truncation (h^2) and rounding (1e-15 / h).
const DIFFERENCE_STEP: f64 = 1e-6;
/// Relative to the larger of 1 and the derivative; the acceptance of the derivatives.
const TOLERANCE: f64 = 1e-6;
/// N m s/rad: over a step of 0.01 s a tenth of the reference robot's spin inertia.
const VISCOUS_FRICTION: f64 = 0.03;

struct Case<'a> {
    simulator: &'a Simulator,
    start: State,
    step_count: usize,
}

impl Case<'_> {
    fn end_and_modes(&self, schedule: &TorqueSchedule) -> (EndDerivative, Vec<[bool; 3]>) {
        let rollout = Rollout { start: &self.start, schedule, step_count: self.step_count };
        let trajectory = self.simulator.trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap();
        let stick = slipdrive::contact::ContactMode::Stick;
        let modes = trajectory.contact.iter().map(|c| [&c.left, &c.right, &c.front].map(|s| s.mode == stick));
        (trajectory.state.last().unwrap().to_vector(), modes.collect())
    }

    /// The central difference along `change`, or none where a step changes its mode between the two points.
    fn difference(
        &self,
        schedule: &TorqueSchedule,
        change: impl Fn(&mut TorqueSchedule, f64),
    ) -> Option<EndDerivative> {
        let [(above, modes_above), (below, modes_below)] = [DIFFERENCE_STEP, -DIFFERENCE_STEP].map(|step| {
            let mut changed = schedule.clone();
            change(&mut changed, step);
            self.end_and_modes(&changed)
        });
        (modes_above == modes_below).then(|| (above - below) / (2.0 * DIFFERENCE_STEP))
    }
}

fn assert_agree(what: &str, derivative: &EndDerivative, difference: &EndDerivative) {
    for (row, (a, b)) in derivative.iter().zip(difference.iter()).enumerate() {
        let scale = b.abs().max(1.0);
        assert!((a - b).abs() <= TOLERANCE * scale, "{what}, component {row}: derivative {a}, difference {b}");
    }
}

/// Compares every derivative of one rollout; returns how many were comparable.
fn compare_all(case: &Case, schedule: &TorqueSchedule, label: &str) -> usize {
    let mut sensitivity = EndSensitivity::default();
    let rollout = Rollout { start: &case.start, schedule, step_count: case.step_count };
    case.simulator.end_sensitivity(&rollout, FrictionLaw::Exact, &mut sensitivity, Stop::never()).unwrap();
    assert_eq!(sensitivity.end, case.simulator.end_state(&rollout, Stop::never()).unwrap());
    let mut compared = 0;
    for interval in 0..schedule.control_count() {
        let sides = [
            (case.difference(schedule, |s, step| s.left[interval] += step), sensitivity.by_left_torque[interval]),
            (case.difference(schedule, |s, step| s.right[interval] += step), sensitivity.by_right_torque[interval]),
        ];
        for (side, (difference, derivative)) in sides.into_iter().enumerate() {
            if let Some(difference) = difference {
                assert_agree(&format!("{label}, wheel {side}, interval {interval}"), &derivative, &difference);
                compared += 1;
            }
        }
    }
    if let Some(difference) = case.difference(schedule, |s, step| s.final_time += step) {
        assert_agree(&format!("{label}, final time"), &sensitivity.by_final_time, &difference);
        compared += 1;
    }
    compared
}

fn compare_random(
    seeds: std::ops::Range<u64>,
    step_count: usize,
    restrict: impl Fn(&mut RobotParameters),
) -> (usize, usize) {
    let (mut compared, mut total) = (0, 0);
    for seed in seeds {
        let mut cases = RandomCases::new(seed);
        let mut parameters = *cases.robot().parameters();
        restrict(&mut parameters);
        let Ok(robot) = Robot::new(parameters) else { continue };
        let simulator = Simulator::new(&robot);
        let start = cases.state(&robot, 1.0);
        let (final_time, torque_limit) = (cases.between(0.5, 2.0), cases.between(0.5, 3.0));
        let schedule = cases.schedule(10, final_time, torque_limit);
        let case = Case { simulator: &simulator, start, step_count };
        compared += compare_all(&case, &schedule, &format!("seed {seed}"));
        total += 2 * schedule.control_count() + 1;
    }
    (compared, total)
}

#[test]
fn derivatives_agree_with_differences_with_a_frictionless_front() {
    let (compared, total) = compare_random(0..60, 100, |robot| robot.front_friction_coefficient = 0.0);
    println!("{compared} of {total} derivatives were comparable");
    assert!(compared * 2 > total, "most rollouts keep their modes: {compared} of {total}");
}

#[test]
fn derivatives_agree_with_differences_with_viscous_friction() {
    for front in [0.0, 0.15] {
        let (compared, total) = compare_random(400..430, 100, |robot| {
            robot.front_friction_coefficient = front;
            robot.wheel_viscous_friction = VISCOUS_FRICTION;
        });
        println!("{compared} of {total} derivatives were comparable");
        assert!(compared * 2 > total, "most rollouts keep their modes: {compared} of {total}");
    }
}

#[test]
fn derivatives_agree_with_differences_with_a_gripping_front() {
    let (compared, total) = compare_random(100..140, 100, |robot| robot.front_friction_coefficient = 0.15);
    println!("{compared} of {total} derivatives were comparable");
    assert!(compared * 2 > total, "most rollouts keep their modes: {compared} of {total}");
}

/// The law of the comparisons under smoothed friction.
const SMOOTHED: FrictionLaw = FrictionLaw::Smoothed(0.05);
/// Newton stops at updates of 1e-9, which the difference divides by its step.
const SMOOTHED_TOLERANCE: f64 = 1e-4;

/// A rollout under smoothed friction: end state and least normal forces.
fn smoothed(case: &Case, schedule: &TorqueSchedule) -> EndSensitivity {
    let mut sensitivity = EndSensitivity::default();
    let rollout = Rollout { start: &case.start, schedule, step_count: case.step_count };
    case.simulator.record(&rollout, SMOOTHED, &mut sensitivity, Stop::never()).unwrap();
    sensitivity
}

/// Compares the derivatives of the end state and of every least normal force by every variable of one rollout under smoothed
/// friction; returns how many of the normal forces' were comparable.
fn compare_smoothed(case: &Case, schedule: &TorqueSchedule, label: &str) -> usize {
    let mut sensitivity = EndSensitivity::default();
    let rollout = Rollout { start: &case.start, schedule, step_count: case.step_count };
    case.simulator.end_sensitivity(&rollout, SMOOTHED, &mut sensitivity, Stop::never()).unwrap();
    let chosen: Vec<usize> = (0..sensitivity.path.count()).collect();
    let forces = case.simulator.path_sensitivity(&rollout, SMOOTHED, &sensitivity, &chosen, Stop::never()).unwrap();
    let least = &sensitivity.path;
    let mut compared = 0;
    let mut compare = |what: &str,
                       change: &dyn Fn(&mut TorqueSchedule, f64),
                       of_end: &EndDerivative,
                       of_force: &dyn Fn(&PathDerivative) -> f64| {
        let [above, below] = [DIFFERENCE_STEP, -DIFFERENCE_STEP].map(|step| {
            let mut changed = schedule.clone();
            change(&mut changed, step);
            smoothed(case, &changed)
        });
        let difference = (above.end.to_vector() - below.end.to_vector()) / (2.0 * DIFFERENCE_STEP);
        let gap = (of_end - difference).amax();
        assert!(gap <= SMOOTHED_TOLERANCE * difference.amax().max(1.0), "{label}, {what}: {gap}");
        for (index, derivative) in forces.iter().enumerate() {
            let moved = [&above, &below].map(|moved| &moved.path);
            // Where the least force moves to another step, its derivative jumps.
            if moved.iter().any(|moved| moved.step(index) != least.step(index)) {
                continue;
            }
            let difference = (moved[0].value(index) - moved[1].value(index)) / (2.0 * DIFFERENCE_STEP);
            let gap = (of_force(derivative) - difference).abs();
            // Forces are 100 times as large as the components of the state, and so is their rounding.
            assert!(
                gap <= 10.0 * SMOOTHED_TOLERANCE * difference.abs().max(1.0),
                "{label}, {what}, normal force {index}: {gap}"
            );
            compared += 1;
        }
    };
    for interval in 0..schedule.control_count() {
        let (left, right) = (&sensitivity.by_left_torque[interval], &sensitivity.by_right_torque[interval]);
        compare(&format!("left {interval}"), &|s, step| s.left[interval] += step, left, &|f| {
            f.by_left_torque[interval]
        });
        compare(&format!("right {interval}"), &|s, step| s.right[interval] += step, right, &|f| {
            f.by_right_torque[interval]
        });
    }
    compare("final time", &|s, step| s.final_time += step, &sensitivity.by_final_time, &|f| f.by_final_time);
    compared
}

#[test]
fn all_derivatives_agree_under_smoothed_friction() {
    let (mut compared, mut total) = (0, 0);
    for (seed, front) in (300..330).flat_map(|seed| [(seed, 0.0), (seed, 0.15)]) {
        let mut cases = RandomCases::new(seed);
        let parameters = RobotParameters {
            front_friction_coefficient: front,
            wheel_viscous_friction: if seed % 2 == 0 { 0.0 } else { VISCOUS_FRICTION },
            ..*cases.robot().parameters()
        };
        let Ok(robot) = Robot::new(parameters) else { continue };
        let simulator = Simulator::new(&robot);
        let start = cases.state(&robot, 1.0);
        let schedule = cases.schedule(4, 1.0, 2.0);
        let case = Case { simulator: &simulator, start, step_count: 100 };
        compared += compare_smoothed(&case, &schedule, &format!("seed {seed}, front {front}"));
        let force_count = 3 * schedule.control_count();
        total += (2 * schedule.control_count() + 1) * force_count;
    }
    println!("{compared} of {total} derivatives of normal forces were comparable");
    assert!(compared * 2 > total, "most least forces stay in their steps: {compared} of {total}");
}

#[test]
fn derivatives_agree_on_the_reference_robot_and_grid() {
    let (compared, total) = compare_random(200..210, 200, |robot| *robot = RobotParameters::default());
    println!("{compared} of {total} derivatives were comparable");
    assert!(compared * 2 > total, "most rollouts keep their modes: {compared} of {total}");
}

/// Compares the derivatives of every least normal force of one rollout; returns how many were comparable.
fn compare_normal_forces(case: &Case, schedule: &TorqueSchedule, label: &str) -> usize {
    let mut sensitivity = EndSensitivity::default();
    let rollout = Rollout { start: &case.start, schedule, step_count: case.step_count };
    case.simulator.end_sensitivity(&rollout, FrictionLaw::Exact, &mut sensitivity, Stop::never()).unwrap();
    let chosen: Vec<usize> = (0..sensitivity.path.count()).collect();
    let derivatives =
        case.simulator.path_sensitivity(&rollout, FrictionLaw::Exact, &sensitivity, &chosen, Stop::never()).unwrap();
    let mut compared = 0;
    let mut compare = |what: &str, change: &dyn Fn(&mut TorqueSchedule, f64), of: &dyn Fn(&PathDerivative) -> f64| {
        let [(above, modes_above), (below, modes_below)] = [DIFFERENCE_STEP, -DIFFERENCE_STEP].map(|step| {
            let mut changed = schedule.clone();
            change(&mut changed, step);
            let rollout = Rollout { schedule: &changed, ..rollout };
            (
                case.simulator.trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap(),
                case.end_and_modes(&changed).1,
            )
        });
        if modes_above != modes_below {
            return;
        }
        for (index, derivative) in derivatives.iter().enumerate() {
            let force = |trajectory: &Trajectory| {
                let sample = &trajectory.contact[sensitivity.path.step(index)];
                let contact = sensitivity.path.place(index);
                -[sample.left, sample.right, sample.front][contact].normal_force
            };
            let difference = (force(&above) - force(&below)) / (2.0 * DIFFERENCE_STEP);
            let scale = difference.abs().max(1.0);
            // Forces of some 100 N round to 1e-14 of that, and the difference to 1e-6 of it.
            assert!(
                (of(derivative) - difference).abs() <= 10.0 * TOLERANCE * scale,
                "{label}, {what}, normal force {index}"
            );
            compared += 1;
        }
    };
    for interval in 0..schedule.control_count() {
        compare("left", &|s, step| s.left[interval] += step, &|d| d.by_left_torque[interval]);
        compare("right", &|s, step| s.right[interval] += step, &|d| d.by_right_torque[interval]);
    }
    compare("final time", &|s, step| s.final_time += step, &|d| d.by_final_time);
    compared
}

#[test]
fn normal_forces_are_differentiated_like_the_end() {
    let mut compared = 0;
    for seed in 0..20 {
        let mut cases = RandomCases::new(seed);
        let wheel_viscous_friction = if seed % 2 == 0 { 0.0 } else { VISCOUS_FRICTION };
        let robot = Robot::new(RobotParameters { wheel_viscous_friction, ..*cases.robot().parameters() }).unwrap();
        let simulator = Simulator::new(&robot);
        let start = cases.state(&robot, 1.0);
        let schedule = cases.schedule(5, 1.0, 2.0);
        compared += compare_normal_forces(
            &Case { simulator: &simulator, start, step_count: 50 },
            &schedule,
            &format!("{seed}"),
        );
    }
    assert!(compared > 1000, "{compared} comparable derivatives");
}
