//! Each number is where its name says: changes of an assessment, draws, loads, limits with their times.

use serde_json::json;
use slipdrive::assessment::{AssessInput, Distribution, Limited, assess};
use slipdrive::contact::{ContactMode, PerContact};
use slipdrive::motion::{ChangedParameter, Disturbed, SimulateInput, SimulateParameters, Undisturbed, simulate};
use slipdrive::robot::{Motor, Payload, Robot, RobotParameters, State};
use slipdrive::shooting::{ManeuverLimits, ReferencePoint};
use slipdrive::simulation::{ContactSample, TorqueSchedule, Trajectory};
use slipdrive::solver::{RunControl, SolveInput, SolveParameters};
use slipdrive::stop::Stop;

fn undisturbed() -> Undisturbed {
    let robot = RobotParameters { front_friction_coefficient: 0.1, ..RobotParameters::default() };
    let payload = Payload { mass: 2.0, right: 0.01, forward: 0.05, height: 0.1, yaw_inertia: 0.01 };
    let mut start = State::default();
    (start.velocity.x, start.velocity.y) = (0.3, 0.4);
    let schedule = TorqueSchedule { final_time: 0.4, left: vec![1.0, 2.0], right: vec![3.0, 4.0] };
    Undisturbed::new((robot, Some(payload)), (ReferencePoint::AxleMidpoint, &start), (&schedule, 4))
}

#[test]
fn each_change_is_made_where_it_says_and_nowhere_else() {
    let planned = undisturbed();
    let numbers = |of: &Disturbed| {
        let (robot, payload, at, v) = (of.bare_robot, of.payload.unwrap(), of.start.configuration, of.start.velocity);
        vec![
            robot.wheel_friction_coefficient,
            robot.front_friction_coefficient,
            robot.chassis_mass,
            robot.chassis_yaw_inertia,
            robot.center_of_mass_right,
            robot.center_of_mass_forward,
            of.schedule.left[0],
            of.schedule.right[0],
            payload.mass,
            payload.right,
            payload.forward,
            at.x,
            at.y,
            at.heading,
            v.x,
            v.y,
        ]
    };
    let before = numbers(&planned.unchanged());
    let change = 1e-3;
    let scaled = |value: f64| value * change;
    let (friction, front, mass, inertia) = (before[0], before[1], before[2], before[3]);
    let expected: [(ChangedParameter, Vec<(usize, f64)>); 13] = [
        (ChangedParameter::Friction, vec![(0, scaled(friction)), (1, scaled(front))]),
        (ChangedParameter::Mass, vec![(2, scaled(mass)), (3, scaled(inertia))]),
        (ChangedParameter::CenterOfMassRight, vec![(4, change)]),
        (ChangedParameter::CenterOfMassForward, vec![(5, change)]),
        (ChangedParameter::Torque, vec![(6, scaled(1.0)), (7, scaled(3.0))]),
        (ChangedParameter::TorqueLeft, vec![(6, scaled(1.0))]),
        (ChangedParameter::TorqueRight, vec![(7, scaled(3.0))]),
        (ChangedParameter::PayloadMass, vec![(8, change)]),
        (ChangedParameter::PayloadRight, vec![(9, change)]),
        (ChangedParameter::PayloadForward, vec![(10, change)]),
        (ChangedParameter::StartX, vec![(11, change)]),
        (ChangedParameter::StartY, vec![(12, change)]),
        // To first order the velocity turns by (-y, x).
        (ChangedParameter::StartHeading, vec![(13, change), (14, -0.4 * change), (15, 0.3 * change)]),
    ];
    for (parameter, changes) in expected {
        let after = numbers(&planned.under(&[(parameter, change)]).unwrap());
        for (place, (after, before)) in after.iter().zip(&before).enumerate() {
            let by = changes.iter().find(|of| of.0 == place).map_or(0.0, |of| of.1);
            // The second order of a turn.
            assert!((after - before - by).abs() < 1e-6, "{parameter:?} {place}: {} in place of {by}", after - before);
        }
    }
}

#[test]
fn draws_of_two_parameters_have_no_number_in_common() {
    let all = [
        ChangedParameter::Friction,
        ChangedParameter::Mass,
        ChangedParameter::CenterOfMassRight,
        ChangedParameter::CenterOfMassForward,
        ChangedParameter::Torque,
        ChangedParameter::TorqueLeft,
        ChangedParameter::StartHeading,
        ChangedParameter::TorqueRight,
        ChangedParameter::PayloadMass,
        ChangedParameter::PayloadRight,
        ChangedParameter::PayloadForward,
        ChangedParameter::StartX,
        ChangedParameter::StartY,
        ChangedParameter::DelayLeft,
        ChangedParameter::DelayRight,
    ];
    let normal = Distribution::Normal { mean: 0.0, standard_deviation: 1.0 };
    let uniform = Distribution::Uniform { low: 0.0, high: 1.0 };
    for one in all {
        for other in all.into_iter().filter(|other| *other != one) {
            for wave in [|turn: f64| turn.cos(), |turn: f64| turn.sin()] {
                let of = |sample: usize| {
                    normal.draw(7, sample, one) * wave(std::f64::consts::TAU * uniform.draw(7, sample, other))
                };
                let mean = (0..4_000).map(of).sum::<f64>() / 4_000.0;
                // Five standard errors of a product with variance 1/2.
                assert!(mean.abs() < 0.056, "{one:?} and {other:?}: {mean}");
            }
        }
    }
}

fn assessed(uncertain: Vec<(ChangedParameter, Distribution)>, torque: f64, limits: ManeuverLimits) -> AssessInput {
    let robot = RobotParameters { center_of_mass_right: 0.0, ..RobotParameters::default() };
    let schedule = TorqueSchedule { final_time: 1.0, left: vec![torque], right: vec![torque] };
    let planned = Undisturbed::new((robot, None), (ReferencePoint::AxleMidpoint, &State::default()), (&schedule, 20));
    AssessInput {
        driven: planned.clone(),
        planned,
        goal: None,
        limited: Limited::Motion(ReferencePoint::AxleMidpoint, limits),
        aisle: None,
        uncertain,
        tolerances: [None, None, Some(100.0), None, None],
        sample_count: 1_000,
        seed: 3,
    }
}

#[test]
fn a_limit_counts_as_exceeded_from_half_a_per_cent_on() {
    let torque = vec![(ChangedParameter::Torque, Distribution::Uniform { low: -0.01, high: 0.01 })];
    let input = assessed(torque, 0.3, ManeuverLimits::default());
    let (end, _) = input.planned.unchanged().end(Stop::never()).unwrap();
    let limits = ManeuverLimits { speed: Some(end.velocity.y), ..ManeuverLimits::default() };
    let input = AssessInput { limited: Limited::Motion(ReferencePoint::AxleMidpoint, limits), ..input };
    let count = assess(&input, &RunControl::unattended()).unwrap().excesses[0].sample_count;
    // Speed goes with torque: a quarter of the samples, five standard errors.
    assert!((180..320).contains(&count), "{count}");
}

#[test]
fn samples_whose_contacts_lift_fail_and_are_the_worst() {
    let uncertain = vec![
        (ChangedParameter::Torque, Distribution::Uniform { low: -0.5, high: 0.5 }),
        (ChangedParameter::StartX, Distribution::Uniform { low: -9.0, high: 9.0 }),
    ];
    let found = assess(&assessed(uncertain, 4.0, ManeuverLimits::default()), &RunControl::unattended()).unwrap();
    assert!((100..900).contains(&found.separated_count), "{}", found.separated_count);
    assert_eq!(found.success_count, found.sample_count - found.separated_count);
    let worst = found.worst.unwrap();
    assert!(worst.separates && worst.error[2] < found.quantiles[5][2], "{} {:?}", worst.error[2], found.quantiles[5]);
}

fn sample(mode: ContactMode, [lateral, longitudinal]: [f64; 2], normal_force: f64) -> ContactSample {
    ContactSample {
        normal_force,
        lateral_force: -lateral,
        longitudinal_force: -longitudinal,
        lateral_slip: lateral,
        longitudinal_slip: longitudinal,
        mode,
    }
}

fn trajectory(left: Vec<ContactSample>) -> Trajectory {
    let rest = sample(ContactMode::Stick, [0.0; 2], 1.0);
    Trajectory {
        time: (0..=left.len()).map(|node| node as f64).collect(),
        contact: left.into_iter().map(|left| PerContact { left, right: rest, front: rest }).collect(),
        ..Trajectory::default()
    }
}

#[test]
fn reversals_count_in_both_directions_across_at_most_one_step_that_sticks() {
    use ContactMode::{Slip, Stick};
    let stick = sample(Stick, [0.0; 2], 1.0);
    for direction in [[1.0, 0.0], [0.0, 1.0]] {
        let ahead = sample(Slip, direction, 1.0);
        let back = sample(Slip, direction.map(|of| -of), 1.0);
        for (samples, count) in [
            (vec![ahead, back], 1),
            (vec![ahead, stick, back], 1),
            (vec![ahead, stick, stick, back], 0),
            (vec![ahead, ahead, stick, ahead], 0),
            (vec![ahead, back, ahead], 2),
        ] {
            assert_eq!(trajectory(samples.clone()).slip_reversals(), count, "{samples:?}");
        }
    }
}

#[test]
fn a_contact_that_pulls_by_a_millionth_of_the_weight_separates() {
    use ContactMode::Stick;
    let of = |normal| trajectory(vec![sample(Stick, [0.0; 2], normal)]).separations().len();
    assert_eq!([1.0, 0.0, -1e-13, -2e-6].map(of), [0, 0, 0, 1]);
}

/// The uses of limits of a motion of the reference robot.
fn uses(robot: RobotParameters, limits: ManeuverLimits, left: Vec<f64>, right: Vec<f64>) -> Vec<(String, f64, f64)> {
    let schedule = TorqueSchedule { final_time: 0.4, left, right };
    let parameters = SimulateParameters { robot, limits, schedule, step_count: 40, ..SimulateParameters::default() };
    let found = simulate(&SimulateInput::new(parameters).unwrap(), Stop::never()).unwrap();
    found.limits.into_iter().map(|of| (of.limit.to_owned(), of.largest, of.time)).collect()
}

#[test]
fn both_wheels_and_both_sides_are_judged() {
    let robot = RobotParameters { center_of_mass_right: 0.0, ..RobotParameters::default() };
    let limits = ManeuverLimits {
        wheel_rate: Some(1.0),
        yaw_rate: Some(1.0),
        yaw_acceleration: Some(1.0),
        ..ManeuverLimits::default()
    };
    let with_motor = RobotParameters { motor: Some(Motor { stall_torque: 1.0, free_speed: 1e4 }), ..robot };
    let [a, b] = [vec![0.2], vec![0.8]];
    let mirrored = [(a.clone(), b.clone()), (b, a)].map(|(left, right)| uses(with_motor, limits, left, right));
    let [one, other] = &mirrored;
    assert_eq!(one.len(), 4, "{one:?}");
    for (one, other) in one.iter().zip(other) {
        // A mirror image, but for rounding.
        assert!((one.1 - other.1).abs() < 1e-9 && one.1 > 0.1, "{one:?} {other:?}");
    }
    assert!((one[0].1 - 0.8).abs() < 1e-2, "{one:?}");
}

#[test]
fn uses_are_told_with_the_time_at_which_they_are_there() {
    let robot = RobotParameters { center_of_mass_right: 0.0, ..RobotParameters::default() };
    let limits = ManeuverLimits { speed: Some(1.0), torque_rate: Some(1.0), ..ManeuverLimits::default() };
    let found = uses(robot, limits, vec![0.2; 4], vec![0.2; 4]);
    // It gets faster to the end.
    assert!((found[0].2 - 0.4).abs() < 1e-12, "{found:?}");
    let found = uses(robot, limits, vec![0.2, 0.2, 0.5, 0.5], vec![0.2; 4]);
    assert!((found[1].2 - 0.2).abs() < 1e-12 && (found[1].1 - 3.0).abs() < 1e-12, "{found:?}");
}

#[test]
fn acceleration_and_deceleration_have_limits_of_their_own() {
    let robot = RobotParameters { center_of_mass_right: 0.0, ..RobotParameters::default() };
    let limits = ManeuverLimits { acceleration: Some(5.0), deceleration: Some(7.0), ..ManeuverLimits::default() };
    let schedule = TorqueSchedule { final_time: 0.4, left: vec![0.6, -0.3], right: vec![0.6, -0.3] };
    let parameters = SimulateParameters { robot, limits, schedule, step_count: 40, ..SimulateParameters::default() };
    let found = simulate(&SimulateInput::new(parameters).unwrap(), Stop::never()).unwrap().limits;
    let by_field: Vec<_> = found.iter().map(|of| (of.limit.rsplit('.').next().unwrap(), of.value)).collect();
    assert_eq!(by_field, [("acceleration_m_s2", 5.0), ("deceleration_m_s2", 7.0)]);
    assert!((found[0].largest / found[1].largest - 2.0).abs() < 1e-6, "{found:?}");
}

#[test]
fn a_front_support_off_the_centreline_shifts_the_loads() {
    let off = |front_support_right| RobotParameters {
        center_of_mass_right: 0.0,
        front_support_right,
        ..RobotParameters::default()
    };
    // Of the 113 N the front support carries 25.3 N: beyond this much to the left the right wheel carries the rest alone.
    let axle = RobotParameters::default().total_mass() * 9.81 - 10.33 * 9.81 * 0.25;
    let most = 0.15 * axle / (10.33 * 9.81 * 0.25);
    let robot = Robot::new(off(-0.999 * most)).unwrap();
    let at_rest = robot.normal_force_projection().static_force;
    assert!(at_rest[0] > 0.0 && at_rest[0] < 0.2 && at_rest[1] > 80.0, "{at_rest}");
    let message = off(-1.001 * most).validate().unwrap_err().to_string();
    assert!(message.contains("the left wheel carries load at rest"), "{message}");
    let message = off(1.001 * most).validate().unwrap_err().to_string();
    assert!(message.contains("the right wheel carries load at rest"), "{message}");
}

#[test]
fn half_of_the_track_bounds_the_height() {
    let high = |center_of_mass_height| RobotParameters { center_of_mass_height, ..RobotParameters::default() };
    let most = 0.9 * 0.15 / 0.45;
    assert!(high(0.999 * most).validate().is_ok());
    assert!(high(1.001 * most).validate().is_err());
}

#[test]
fn a_guess_may_exceed_the_torque_limit_by_rounding_alone() {
    let guess = |torque: f64| {
        let mut parameters = SolveParameters::forward_drive();
        let limit = parameters.maneuver.torque_limit.left;
        let torques = vec![torque * limit; parameters.settings.control_count];
        parameters.initial_guess = Some(TorqueSchedule { final_time: 3.0, left: torques.clone(), right: torques });
        SolveInput::new(parameters).is_ok()
    };
    assert!(guess(1.0) && guess(1.0 + 1e-12) && !guess(1.001));
}

#[test]
fn torques_rise_and_fall_no_faster_than_they_may() {
    let mut parameters = SolveParameters::forward_drive();
    parameters.robot.center_of_mass_right = 0.0;
    parameters.maneuver.slip = slipdrive::shooting::SlipPolicy::Forbidden;
    parameters.maneuver.limits.torque_rate = Some(2.0);
    (parameters.settings.step_count, parameters.settings.control_count) = (60, 12);
    let solution = slipdrive::solver::solve(&SolveInput::new(parameters).unwrap(), &RunControl::unattended()).unwrap();
    assert_eq!(solution.status, slipdrive::solver::Status::Converged, "{:?}", solution.reason);
    let interval = solution.schedule.interval();
    for torques in [&solution.schedule.left, &solution.schedule.right] {
        let rates = torques.windows(2).map(|pair| (pair[1] - pair[0]) / interval);
        let (low, high) = rates.fold((0.0_f64, 0.0_f64), |(low, high), rate| (low.min(rate), high.max(rate)));
        // The limit binds where the torques fall from one bound to the other.
        assert!(high <= 2.0 * (1.0 + 1e-6) && (low / -2.0 - 1.0).abs() < 1e-5, "{low} {high}");
    }
}

#[test]
fn rows_of_a_motion_have_the_torques_of_their_steps() {
    use slipdrive::jobs::plan::AcceptedPlan;
    use slipdrive::jobs::present::Present;
    use slipdrive::jobs::{InProcessSolver, Kind as _, Limits};
    let torques = json!({"interval_s": 0.2, "left_n_m": [0.1, 0.2], "right_n_m": [0.3, 0.4]});
    let plan = json!({"simulate": {"request": {"torque_schedule": torques, "grid": {"steps": 4}}, "answer": {}}});
    let accepted = Present::read(json!({"plans": [plan]}).to_string().as_bytes(), &Limits::default()).unwrap();
    let text = AcceptedPlan::csv(&accepted.plans, &InProcessSolver, Stop::never()).unwrap();
    let mut rows = text.lines().map(|row| row.split(',').map(str::to_owned).collect::<Vec<_>>());
    let names = rows.next().unwrap();
    let at = |name: &str| names.iter().position(|of| of == name).unwrap();
    let columns = [at("torque_left_n_m"), at("torque_right_n_m")];
    let found: Vec<_> = rows.map(|row| columns.map(|column| row[column].clone())).collect();
    let of = |left: &str, right: &str| [left.to_owned(), right.to_owned()];
    let (first, second) = (of("0.1", "0.3"), of("0.2", "0.4"));
    assert_eq!(found, [first.clone(), first, second.clone(), second, of("", "")]);
}
