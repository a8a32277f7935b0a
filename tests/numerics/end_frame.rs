//! Goals at speed on a curve, judged in the frame in which the scheme rolls.

use slipdrive::contact::ContactName;
use slipdrive::motion::{SimulateInput, SimulateParameters, simulate};
use slipdrive::robot::{PerWheel, RobotParameters, State, Velocity};
use slipdrive::shooting::{Goal, Maneuver, ReferencePoint, StateComponent};
use slipdrive::simulation::TorqueSchedule;
use slipdrive::solver::{RunControl, SolveInput, SolveParameters, Status, solve};
use slipdrive::stop::Stop;

/// A goal that rolls exactly at its heading, in numbers rounded to six decimals as people write them.
fn rolling_goal(point: ReferencePoint, speed: f64, yaw_rate: f64) -> Goal {
    let robot = RobotParameters::default();
    let heading: f64 = 0.7;
    let offset = point.offset(&robot) - robot.axle_midpoint();
    let (right, forward) = (-yaw_rate * offset.y, speed + yaw_rate * offset.x);
    let swing = yaw_rate * robot.track_width / 2.0;
    let mut goal = Goal::at_rest(-1.5, 1.0, heading);
    for (component, value) in [
        (StateComponent::VelocityX, right * heading.cos() - forward * heading.sin()),
        (StateComponent::VelocityY, right * heading.sin() + forward * heading.cos()),
        (StateComponent::YawRate, yaw_rate),
        (StateComponent::WheelRateLeft, (speed - swing) / robot.wheel_radius),
        (StateComponent::WheelRateRight, (speed + swing) / robot.wheel_radius),
    ] {
        goal.set(component, Some((value * 1e6).round() / 1e6));
    }
    goal
}

#[test]
fn goals_at_speed_on_a_curve_are_met_and_simulated_to_the_bit() {
    for point in [ReferencePoint::ChassisCenterOfMass, ReferencePoint::AxleMidpoint] {
        let goal = rolling_goal(point, 0.6, 0.8);
        let maneuver = Maneuver { reference_point: point, goal, ..Maneuver::forward_drive() };
        let mut parameters = SolveParameters { maneuver, ..SolveParameters::forward_drive() };
        parameters.settings.start_count = 6;
        let input = SolveInput::new(parameters).unwrap();
        let solution = solve(&input, &RunControl::unattended()).unwrap();
        assert_eq!(solution.status, Status::Converged, "{point:?} {:?}", solution.reason);

        let simulation = input.motion_of(solution.schedule.clone(), solution.report.step_count);
        let end = simulate(&simulation, Stop::never()).unwrap().trajectory.end_state;
        assert_eq!(end, solution.trajectory.end_state);
        assert_eq!(maneuver.goal_error(&end), solution.goal_error);
    }
}

/// A robot whose centre of mass lies on the axle goes on along its curve without torque; what its start disturbs, the steps forget.
#[test]
fn a_steady_curve_ends_rolling_with_any_restitution() {
    for tangential_restitution in [0.0, 0.3, 0.9] {
        let robot = RobotParameters {
            center_of_mass_forward: 0.0,
            center_of_mass_right: 0.0,
            tangential_restitution,
            ..RobotParameters::default()
        };
        let swing = 0.8 * robot.track_width / 2.0;
        let wheel_rate = PerWheel::new((0.6 - swing) / robot.wheel_radius, (0.6 + swing) / robot.wheel_radius);
        let velocity = Velocity { x: 0.0, y: 0.6, yaw_rate: 0.8, wheel_rate };
        let parameters = SimulateParameters {
            robot,
            start: State { velocity, ..State::default() },
            schedule: TorqueSchedule { final_time: 4.0, left: vec![0.0], right: vec![0.0] },
            step_count: 400,
            ..SimulateParameters::default()
        };
        let input = SimulateInput::new(parameters).unwrap();
        let end = simulate(&input, Stop::never()).unwrap().trajectory.end_state;
        let (sin, cos) = end.configuration.heading.sin_cos();
        let lateral = cos * end.velocity.x + sin * end.velocity.y;
        // Turned as without restitution it would be up to 2.4 mm/s; the rest is of third order in the step.
        assert!(lateral.abs() < 1e-6, "{lateral} m/s with restitution {tangential_restitution}");
    }
}

#[test]
fn plans_keep_the_least_load_of_every_contact() {
    // High above a short track: full torque would lift the front.
    let robot = RobotParameters { center_of_mass_height: 0.27, ..RobotParameters::default() };
    for share in [0.05, 0.0] {
        let mut parameters = SolveParameters { robot, ..SolveParameters::forward_drive() };
        parameters.maneuver.torque_limit.left = 3.0;
        parameters.maneuver.torque_limit.right = 3.0;
        parameters.maneuver.limits.normal_load_share = share;
        parameters.settings.start_count = 2;
        let input = SolveInput::new(parameters).unwrap();
        let solution = solve(&input, &RunControl::unattended()).unwrap();
        let load = solution.trajectory.least_normal_load().unwrap();
        // The search keeps loads to a millionth of the weight; a fast plan uses what is allowed.
        assert!(load.share >= share - 1e-6 && load.share < share + 0.02, "{load:?} of {share}");
        assert_eq!(load.contact, ContactName::Front);
    }
}
