//! Plans with limits against closed forms, and what answers say of limits.

use nalgebra::Vector2;
use slipdrive::motion::{SimulateInput, SimulateParameters, simulate};
use slipdrive::robot::{Motor, Payload, PerWheel, RobotParameters, State};
use slipdrive::shooting::{AisleCorners, Goal, ReferencePoint, SlipPolicy, StateComponent};
use slipdrive::simulation::TorqueSchedule;
use slipdrive::solver::{Refinement, RunControl, Solution, SolveInput, SolveParameters, Status, solve};
use slipdrive::stop::Stop;

/// What a plan may exceed a limit by on its own grid, as a share.
const EXCESS: f64 = 1e-6;
/// What the replay may exceed a limit by, as a share.
const TOLERATED_EXCESS: f64 = 5e-3;

/// One start on the paper's grid, without slip, of a robot whose mass is on the centreline.
fn symmetric() -> SolveParameters {
    let mut parameters = SolveParameters::forward_drive();
    parameters.robot.center_of_mass_right = 0.0;
    parameters.maneuver.slip = SlipPolicy::Forbidden;
    parameters
}

/// The inertia of a straight drive: the mass and what the wheels add, kg.
fn rolling_mass(robot: &RobotParameters) -> f64 {
    robot.total_mass() + 2.0 * robot.wheel_spin_inertia / robot.wheel_radius.powi(2)
}

/// Of a straight drive with both torques of this size, m/s2.
fn acceleration(robot: &RobotParameters, torque: f64) -> f64 {
    2.0 * torque / (robot.wheel_radius * rolling_mass(robot))
}

fn solved(parameters: SolveParameters) -> Solution {
    solve(&SolveInput::new(parameters).unwrap(), &RunControl::unattended()).unwrap()
}

/// A converged plan that keeps its limits.
fn converged(parameters: SolveParameters) -> Solution {
    let solution = solved(parameters);
    assert_eq!(solution.status, Status::Converged, "{:?}", solution.reason);
    for used in &solution.report.limits {
        assert!(used.excess <= EXCESS, "{used:?}");
    }
    solution
}

/// Asserts a time of at most `share` above the closed form, and not below it by more than what limits may be exceeded.
fn assert_near(found: f64, expected: f64, share: f64) {
    let gap = found / expected - 1.0;
    assert!(gap > -EXCESS && gap < share, "{found} s, expected {expected} s: {gap:e}");
}

#[test]
fn symmetric_drive_without_slip_rolls_bang_bang() {
    let parameters = symmetric();
    let expected = 2.0 * (5.0 / acceleration(&parameters.robot, 1.0)).sqrt();
    assert!((expected - 2.813_894).abs() < 1e-6, "{expected}");
    let solution = converged(parameters);
    assert!((solution.schedule.final_time - expected).abs() < 1e-5, "{}", solution.schedule.final_time);
    assert!(solution.trajectory.contact_modes().iter().all(|span| span.degrees_of_freedom == 2));
}

#[test]
fn wheel_rate_limits_make_a_trapezoid() {
    for (distance, rate) in [(5.0, 30.0), (2.0, 20.0), (8.0, 35.0)] {
        let mut parameters = symmetric();
        parameters.maneuver.goal = Goal::at_rest(0.0, distance, 0.0);
        parameters.maneuver.limits.wheel_rate = Some(rate);
        let (speed, acceleration) = (rate * parameters.robot.wheel_radius, acceleration(&parameters.robot, 1.0));
        let expected = distance / speed + speed / acceleration;
        // 40 intervals do not switch where the trapezoid does: with n of them in a phase that costs at most 1 / (160 n).
        assert_near(converged(parameters).schedule.final_time, expected, 1e-3);
    }
}

#[test]
fn yaw_rate_limits_make_turns_trapezoids() {
    let mut parameters = symmetric();
    parameters.maneuver.reference_point = ReferencePoint::AxleMidpoint;
    parameters.maneuver.goal = Goal::at_rest(0.0, 0.0, 3.0);
    parameters.maneuver.torque_limit = PerWheel::new(0.5, 0.5);
    // A mass ahead of the axle would take torque to keep it on its circle.
    parameters.robot.center_of_mass_forward = 1e-3;
    parameters.maneuver.limits.yaw_rate = Some(2.5);
    let robot = parameters.robot;
    let half_track = robot.track_width / 2.0;
    let wheels = 2.0 * (robot.wheel_mass + robot.wheel_spin_inertia / robot.wheel_radius.powi(2));
    let inertia = robot.chassis_yaw_inertia
        + robot.chassis_mass * robot.center_of_mass_forward.powi(2)
        + 2.0 * robot.wheel_diametral_inertia
        + wheels * half_track * half_track;
    let acceleration = 2.0 * 0.5 * half_track / robot.wheel_radius / inertia;
    assert_near(converged(parameters).schedule.final_time, 3.0 / 2.5 + 2.5 / acceleration, 1e-3);
}

/// A robot of a kilogram on a caster that rubs, geared so low that its motors turn the wheels to their free speed within milliseconds.
fn geared_low(stall_torque: f64) -> RobotParameters {
    RobotParameters {
        chassis_mass: 0.94,
        wheel_mass: 0.03,
        chassis_yaw_inertia: 0.003,
        wheel_diametral_inertia: 1e-5,
        wheel_spin_inertia: 5e-4,
        wheel_radius: 0.033,
        track_width: 0.16,
        axle_to_front_support: 0.08,
        center_of_mass_right: 0.0,
        center_of_mass_forward: 0.03,
        center_of_mass_height: 0.06,
        wheel_friction_coefficient: 0.7,
        front_friction_coefficient: 0.1,
        motor: Some(Motor { stall_torque, free_speed: 6.4 }),
        ..RobotParameters::default()
    }
}

#[test]
fn motors_far_stronger_than_the_grip_have_plans() {
    for (stall_torque, distance) in [(0.3, 1.0), (1.0, 1.0), (10.0, 1.0), (1.0, 3.0)] {
        let mut parameters = symmetric();
        parameters.robot = geared_low(stall_torque);
        parameters.maneuver.slip = SlipPolicy::Allowed;
        parameters.maneuver.goal = Goal::at_rest(0.0, distance, 0.0);
        parameters.maneuver.torque_limit = PerWheel::new(stall_torque, stall_torque);
        let final_time = converged(parameters).schedule.final_time;
        // Some 3 % go into getting there, and into the friction of the caster.
        let at_free_speed = distance / (6.4 * 0.033);
        let share = final_time / at_free_speed;
        assert!((1.0..1.08).contains(&share), "{stall_torque} N m, {distance} m: {final_time} s");
    }
}

#[test]
fn wheels_of_strong_motors_gain_by_leave_to_slip() {
    let motor = Motor { stall_torque: 30.0, free_speed: 6.0 };
    for goal in [Goal::at_rest(1.0, 2.0, 0.0), Goal::at_rest(0.5, 0.5, -1.4), Goal::at_rest(0.0, 0.0, 1.5)] {
        let mut parameters = SolveParameters::forward_drive();
        parameters.robot.motor = Some(motor);
        parameters.maneuver.torque_limit = PerWheel::new(motor.stall_torque, motor.stall_torque);
        parameters.maneuver.goal = goal;
        (parameters.settings.step_count, parameters.settings.control_count) = (100, 20);
        let [allowed, forbidden] = [SlipPolicy::Allowed, SlipPolicy::Forbidden].map(|slip| {
            let mut parameters = parameters.clone();
            parameters.maneuver.slip = slip;
            converged(parameters).schedule.final_time
        });
        // A plan without slip is one where wheels may slip. Both are known as closely as searches end.
        assert!(allowed <= 1.001 * forbidden, "{allowed} s, without slip {forbidden} s");
    }
}

/// A search that is cut off while it holds the wheels, or while it judges motors beyond the grip at the ends of steps alone, has a plan.
#[test]
fn plan_of_a_motor_is_not_lost_where_the_search_is_cut_off() {
    let beyond_grip = (10.0, Goal::at_rest(0.3, 1.0, 0.0), 12, [1000, 2500, 5400]);
    let holding = (1.0, Goal::at_rest(-2.0, 3.0, 1.5), 1, [60, 75, 96]);
    for (stall_torque, goal, start_count, limits) in [beyond_grip, holding] {
        let mut parameters = SolveParameters::forward_drive();
        parameters.robot.motor = Some(Motor { stall_torque, free_speed: 40.0 });
        parameters.maneuver.goal = goal;
        (parameters.settings.step_count, parameters.settings.start_count) = (100, start_count);
        for limit in limits {
            parameters.settings.rollout_limit = limit;
            let solution = solved(parameters.clone());
            assert!(matches!(solution.status, Status::Feasible | Status::Converged), "{limit}: {:?}", solution.status);
        }
    }
}

#[test]
fn run_up_follows_the_motor() {
    let mut parameters = symmetric();
    let motor = Motor { stall_torque: 1.5, free_speed: 40.0 };
    parameters.robot.motor = Some(motor);
    let (speed, robot) = (1.8, parameters.robot);
    let rate = speed / robot.wheel_radius;
    let goal = &mut parameters.maneuver.goal;
    goal.set(StateComponent::Y, None);
    goal.set(StateComponent::VelocityY, Some(speed));
    goal.set(StateComponent::WheelRateLeft, Some(rate));
    goal.set(StateComponent::WheelRateRight, Some(rate));
    // In each interval the torque that the motor still has at its end: omega' = omega + a dt M(omega').
    let per_torque = acceleration(&robot, 1.0) / robot.wheel_radius;
    let reached = |time: f64| {
        let interval = time / 40.0;
        (0..40).fold(0.0, |omega: f64, _| {
            let on_curve = (omega + per_torque * interval * motor.stall_torque)
                / (1.0 + per_torque * interval * motor.stall_torque / motor.free_speed);
            on_curve.min(omega + per_torque * interval * 1.0)
        })
    };
    let (mut below, mut above) = (0.1, 10.0);
    for _ in 0..60 {
        let middle = 0.5 * (below + above);
        if reached(middle) < rate { below = middle } else { above = middle }
    }
    let found = converged(parameters).schedule.final_time;
    assert!((found / above - 1.0).abs() < 2e-6, "{found} s, expected {above} s");
}

#[test]
fn grip_margins_are_kept_and_cost_time() {
    let plan = |share: Option<f64>| {
        let mut parameters = SolveParameters::forward_drive();
        parameters.maneuver.slip = SlipPolicy::Forbidden;
        parameters.maneuver.limits.grip_utilization = share;
        converged(parameters)
    };
    let (whole, half) = (plan(None), plan(Some(0.5)));
    assert!(half.schedule.final_time > whole.schedule.final_time + 1e-3);
    let used = half.report.limits.iter().find(|used| used.limit.ends_with("grip_utilization")).unwrap();
    // The limit binds: the plan of the whole grip uses more.
    assert!((used.largest - 0.5).abs() < 1e-5, "{used:?}");
    assert!(half.trajectory.contact_modes().iter().all(|span| span.degrees_of_freedom == 2));
}

#[test]
fn a_limit_that_the_finest_grid_hides_is_backed_off_from() {
    let mut parameters = SolveParameters::forward_drive();
    parameters.maneuver.goal = Goal::at_rest(1.0, 2.0, 0.0);
    parameters.maneuver.limits.grip_utilization = Some(0.9);
    parameters.settings.step_count = 80;
    parameters.settings.refinement = Refinement::UntilConfirmed { step_limit: 160 };
    // A local optimum among the plans that keep what was backed off by.
    let solution = converged(parameters);
    let used = solution.report.limits.iter().find(|used| used.limit.ends_with("grip_utilization")).unwrap();
    assert!(used.excess < -TOLERATED_EXCESS && used.replay_excess.unwrap() <= TOLERATED_EXCESS, "{used:?}");
}

#[test]
fn one_start_does_where_the_front_support_rubs() {
    let mut parameters = symmetric();
    parameters.robot.front_friction_coefficient = 0.2;
    parameters.maneuver.torque_limit = PerWheel::new(0.6, 0.95);
    parameters.maneuver.limits.speed = Some(0.5);
    parameters.maneuver.goal = Goal::at_rest(0.0, 2.5, 0.0);
    let solution = converged(parameters);
    // As far at the speed limit, and a little to start and to brake.
    assert_near(solution.schedule.final_time, 2.5 / 0.5, 0.1);
}

#[test]
fn accelerations_and_torque_rates_are_kept() {
    let mut parameters = symmetric();
    let limits = &mut parameters.maneuver.limits;
    (limits.acceleration, limits.deceleration) = (Some(1.5), Some(1.0));
    limits.torque_rate = Some(20.0);
    (parameters.settings.step_count, parameters.settings.control_count) = (60, 12);
    let solution = converged(parameters);
    // Without the torque rate: v = sqrt(2 d a b / (a + b)), t = v / a + v / b.
    let speed = (2.0_f64 * 5.0 * 1.5 * 1.0 / 2.5).sqrt();
    assert_near(solution.schedule.final_time, speed / 1.5 + speed / 1.0, 0.1);
    assert_eq!(solution.report.limits.len(), 4);
}

#[test]
fn a_payload_at_the_centre_of_mass_is_a_heavier_chassis() {
    let robot = RobotParameters::default();
    let payload = Payload {
        mass: 5.0,
        right: robot.center_of_mass_right,
        forward: robot.center_of_mass_forward,
        height: robot.center_of_mass_height,
        yaw_inertia: 0.1,
    };
    let loaded = SolveParameters { payload: Some(payload), ..SolveParameters::forward_drive() };
    let mut heavier = SolveParameters::forward_drive();
    heavier.robot.chassis_mass += 5.0;
    heavier.robot.chassis_yaw_inertia += 0.1;
    let [loaded, heavier] = [loaded, heavier].map(solved);
    // The joined parameters round differently, and the search may take any other way from there.
    assert!((loaded.schedule.final_time / heavier.schedule.final_time - 1.0).abs() < 1e-3);
}

fn rectangle((left, right): (f64, f64), (low, high): (f64, f64)) -> Vec<Vector2<f64>> {
    [(left, low), (right, low), (right, high), (left, high)].map(|(x, y)| Vector2::new(x, y)).to_vec()
}

/// Half a metre to the side on 3 m, in an aisle from 0.3 m on the left to this on the right.
fn shift_in_aisle(right: f64) -> SolveParameters {
    let mut parameters = SolveParameters::forward_drive();
    parameters.maneuver.goal = Goal::at_rest(0.5, 3.0, 0.0);
    let footprint = rectangle((-0.2, 0.2), (-0.1, 0.35));
    parameters.aisle = AisleCorners { keep_in: rectangle((-0.3, right), (-1.0, 4.0)), footprint };
    parameters
}

#[test]
fn held_wheels_roll_on_without_friction_and_stop_nowhere() {
    let to_speed = |speed: f64| {
        let mut parameters = SolveParameters::forward_drive();
        parameters.robot.wheel_friction_coefficient = 0.0;
        let maneuver = &mut parameters.maneuver;
        maneuver.slip = SlipPolicy::Forbidden;
        let rate = 1.0 / parameters.robot.wheel_radius;
        maneuver.start.velocity.y = 1.0;
        maneuver.start.velocity.wheel_rate = PerWheel::new(rate, rate);
        maneuver.goal = Goal::at_rest(0.0, 2.0, 0.0);
        maneuver.goal.set(StateComponent::VelocityY, Some(speed));
        for wheel in [StateComponent::WheelRateLeft, StateComponent::WheelRateRight] {
            maneuver.goal.set(wheel, None);
        }
        solved(parameters)
    };
    let rolled = to_speed(1.0);
    // Nothing is left to be faster with, which makes it hard to show that it is the fastest.
    assert!(matches!(rolled.status, Status::Converged | Status::Feasible), "{:?}", rolled.reason);
    assert!((rolled.schedule.final_time - 2.0).abs() < 1e-5, "{}", rolled.schedule.final_time);
    assert!(rolled.report.limits[0].largest < 1e-6, "{:?}", rolled.report.limits);
    assert_eq!(to_speed(0.0).status, Status::Infeasible);
}

#[test]
fn narrow_aisles_are_kept() {
    let wide = converged(shift_in_aisle(5.0));
    let narrow = converged(shift_in_aisle(0.73));
    assert!(narrow.schedule.final_time > wide.schedule.final_time);
    let used = narrow.report.limits.iter().find(|used| used.limit == "maneuver.keep_in").unwrap();
    assert!(used.largest.abs() < 1e-5, "the aisle does not bind: {used:?}");
}

#[test]
fn a_plan_through_the_wall_is_none() {
    let mut parameters = shift_in_aisle(0.22);
    // Start and goal fit into the aisle, a robot that turns does not.
    parameters.aisle.keep_in = rectangle((-0.22, 0.22), (-1.0, 4.0));
    parameters.maneuver.goal = Goal::at_rest(0.0, 0.2, std::f64::consts::PI);
    parameters.maneuver.reference_point = ReferencePoint::AxleMidpoint;
    let solution = solved(parameters);
    assert!(solution.goal_error.amax() <= 1e-6, "the goal is missed too: {}", solution.goal_error);
    assert_eq!((solution.status, solution.replay_confirmed), (Status::NotConverged, false));
    let reason = solution.reason.unwrap();
    assert_eq!((reason.code, reason.field.as_str()), ("limit_exceeded", "maneuver.keep_in"));
    assert!(reason.value > 0.1 && reason.limit == 0.0 && reason.message.contains("`maneuver.keep_in`"), "{reason:?}");
}

#[test]
fn ends_that_limits_exclude_are_infeasible() {
    let code = |parameters| {
        let solution = solved(parameters);
        assert_eq!(solution.status, Status::Infeasible);
        solution.reason.unwrap().code
    };
    assert_eq!(code(shift_in_aisle(0.6)), "goal_outside");
    let mut wide = shift_in_aisle(5.0);
    wide.aisle.keep_in = rectangle((-0.15, 0.15), (-1.0, 4.0));
    assert_eq!(code(wide), "start_outside");
    let mut fast = symmetric();
    fast.maneuver.start.velocity.y = 1.0;
    assert_eq!(code(fast.clone()), "start_slips");
    let rate = 1.0 / fast.robot.wheel_radius;
    fast.maneuver.start.velocity.wheel_rate = PerWheel::new(rate, rate);
    fast.maneuver.limits.speed = Some(0.9);
    assert_eq!(code(fast.clone()), "start_exceeds_limit");
    fast.maneuver.limits.speed = Some(1.5);
    fast.maneuver.goal.set(StateComponent::WheelRateLeft, Some(1.0));
    assert_eq!(code(fast), "goal_slips");
}

#[test]
fn plans_on_long_steps_that_lose_much_are_not_excluded() {
    // A narrow robot that turns by more than a radian in each of two steps: what the first one loses goes by the speed before it.
    let (torque, final_time) = (0.044_887_838_642_219_034, 0.453_388_879_109_756_1);
    let mut parameters = SolveParameters::forward_drive();
    parameters.robot = RobotParameters {
        chassis_mass: 10.0,
        wheel_mass: 0.001,
        chassis_yaw_inertia: 0.002_911_777_290_723_005,
        wheel_diametral_inertia: 1e-9,
        wheel_spin_inertia: 1e-6,
        wheel_radius: 0.05,
        track_width: 0.1,
        axle_to_front_support: 0.2,
        center_of_mass_right: 0.0,
        center_of_mass_forward: 0.002_069_940_850_897_993_3,
        center_of_mass_height: 0.0,
        wheel_friction_coefficient: 3.0,
        ..parameters.robot
    };
    let start = &mut parameters.maneuver.start.velocity;
    (start.y, start.wheel_rate) = (1.262_111_225_883_858, PerWheel::new(25.242_224_517_677_16, 25.242_224_517_677_16));
    let schedule = TorqueSchedule { final_time, left: vec![-torque, 0.0], right: vec![torque, 0.0] };
    let motion = simulate(
        &SimulateInput::new(SimulateParameters {
            robot: parameters.robot,
            start: parameters.maneuver.start,
            schedule: schedule.clone(),
            step_count: 2,
            ..SimulateParameters::default()
        })
        .unwrap(),
        Stop::never(),
    )
    .unwrap();
    let maneuver = &mut parameters.maneuver;
    for component in StateComponent::ALL {
        let is_angle = matches!(component, StateComponent::WheelAngleLeft | StateComponent::WheelAngleRight);
        let value = motion.trajectory.end_state.to_vector()[component.index()];
        maneuver.goal.set(component, (!is_angle).then_some(value));
    }
    (maneuver.torque_limit, maneuver.limits.yaw_rate) = (PerWheel::new(torque, torque), Some(6.871_781_897_342_458_5));
    (maneuver.slip, maneuver.limits.normal_load_share) = (SlipPolicy::Forbidden, 0.0);
    (parameters.initial_guess, parameters.settings.control_count) = (Some(schedule), 2);
    (parameters.settings.refinement, parameters.settings.step_count) = (Refinement::Fixed, 2);
    let solution = solved(parameters);
    assert!(solution.report.lower_bound.is_some_and(|bound| bound <= final_time), "{:?}", solution.report.lower_bound);
    assert!(solution.goal_error.amax() <= 1e-6, "{:?}", solution.reason);
}

#[test]
fn goals_within_the_tolerances_of_a_long_robot_that_rolls_are_not_excluded() {
    let mut parameters = symmetric();
    // The centre of mass, of which the goal speaks, is far from the wheels.
    (parameters.robot.center_of_mass_forward, parameters.robot.axle_to_front_support) = (5.0, 10.0);
    let (tolerance, yaw_rate, speed) = (0.01, 0.5, 1.0);
    parameters.settings.goal_tolerance = tolerance;
    let goal = &mut parameters.maneuver.goal;
    let rate =
        |side: f64| (speed + side * 0.5 * parameters.robot.track_width * yaw_rate) / parameters.robot.wheel_radius;
    for (component, value) in [
        (StateComponent::Heading, 0.99 * tolerance),
        (StateComponent::VelocityX, -5.0 * yaw_rate + 0.99 * tolerance),
        (StateComponent::VelocityY, speed),
        (StateComponent::YawRate, yaw_rate + 0.99 * tolerance),
        (StateComponent::WheelRateLeft, rate(-1.0)),
        (StateComponent::WheelRateRight, rate(1.0)),
    ] {
        goal.set(component, Some(value));
    }
    parameters.settings.rollout_limit = 1;
    let solution = solved(parameters);
    assert_ne!(solution.status, Status::Infeasible, "{:?}", solution.reason);
}

#[test]
fn no_wheel_rates_are_advised_where_the_goal_moves_sideways() {
    let mut parameters = symmetric();
    let goal = &mut parameters.maneuver.goal;
    goal.set(StateComponent::VelocityX, Some(1.0));
    goal.set(StateComponent::WheelRateLeft, None);
    goal.set(StateComponent::WheelRateRight, None);
    let reason = solved(parameters).reason.unwrap();
    assert_eq!((reason.code, reason.value), ("goal_slips", 1.0));
    assert!(reason.message.contains("the wheels slip sideways by 1 m/s"), "{}", reason.message);
    assert!(
        reason.message.contains("a heading along the velocity, or a free one at the goal would help"),
        "{}",
        reason.message
    );
}

#[test]
fn a_start_at_the_goal_is_excluded_as_any_other() {
    let at_goal = |mut parameters: SolveParameters| {
        let maneuver = &mut parameters.maneuver;
        for (component, value) in StateComponent::ALL.into_iter().zip(maneuver.start.to_vector().iter()) {
            if maneuver.goal.value(component).is_some() {
                maneuver.goal.set(component, Some(*value));
            }
        }
        let solution = solved(parameters);
        assert_eq!((solution.schedule.final_time, solution.report.rollouts), (0.0, 0));
        (solution.status, solution.replay_confirmed, solution.reason.map(|reason| reason.code))
    };
    let stays = (Status::Converged, true, None);
    let excluded = |code| (Status::Infeasible, false, Some(code));
    let mut wide = shift_in_aisle(5.0);
    assert_eq!(at_goal(wide.clone()), stays);
    wide.aisle.keep_in = rectangle((-0.15, 0.15), (-1.0, 4.0));
    assert_eq!(at_goal(wide), excluded("start_outside"));
    // No motion is needed, so that no torque is.
    let mut fast = SolveParameters::forward_drive();
    fast.maneuver.torque_limit = PerWheel::new(0.0, 0.0);
    assert_eq!(at_goal(fast.clone()), stays);
    fast.maneuver.start.velocity.y = 1.0;
    fast.maneuver.limits.speed = Some(1.0);
    assert_eq!(at_goal(fast.clone()), stays);
    fast.maneuver.limits.speed = Some(0.5);
    assert_eq!(at_goal(fast.clone()), excluded("start_exceeds_limit"));
    fast.maneuver.limits.speed = None;
    fast.maneuver.start.velocity.yaw_rate = 100.0;
    assert_eq!(at_goal(fast), excluded("start_separates"));
}

#[test]
fn a_simulation_reports_the_same_uses() {
    let mut parameters = symmetric();
    parameters.maneuver.slip = SlipPolicy::Allowed;
    parameters.maneuver.limits.speed = Some(1.5);
    parameters.maneuver.limits.yaw_rate = Some(2.0);
    let limits = parameters.maneuver.limits;
    let robot = parameters.robot;
    let solution = converged(parameters);
    let simulation = simulate(
        &SimulateInput::new(SimulateParameters {
            robot,
            limits,
            schedule: solution.schedule.clone(),
            ..SimulateParameters::default()
        })
        .unwrap(),
        Stop::never(),
    )
    .unwrap();
    assert_eq!(simulation.limits.len(), 2);
    for (planned, simulated) in solution.report.limits.iter().zip(&simulation.limits) {
        assert_eq!(
            (planned.limit, planned.largest, planned.time),
            (simulated.limit, simulated.largest, simulated.time)
        );
    }
}

#[test]
fn accelerations_are_those_of_the_point() {
    for payload in [None, Some(Payload { mass: 2.0, right: -0.1, forward: 0.3, height: 0.15, yaw_inertia: 0.0 })] {
        let mut parameters = SimulateParameters { payload, step_count: 4000, ..SimulateParameters::default() };
        parameters.reference_point = ReferencePoint::AxleMidpoint;
        parameters.schedule =
            TorqueSchedule { final_time: 1.5, left: vec![-1.0, 1.0, 0.5], right: vec![1.0, -0.2, -1.0] };
        (parameters.limits.acceleration, parameters.limits.deceleration) = (Some(1e4), Some(1e4));
        let simulation = simulate(&SimulateInput::new(parameters.clone()).unwrap(), Stop::never()).unwrap();
        let point = payload.map_or_else(Vector2::zeros, |payload| Vector2::new(payload.right, payload.forward));
        let states = &simulation.trajectory.state;
        let velocities: Vec<_> = states.iter().map(|state| velocity_of(point, state)).collect();
        let dt = parameters.schedule.final_time / parameters.step_count as f64;
        let largest = velocities.windows(2).map(|pair| (pair[1] - pair[0]).norm() / dt).fold(0.0, f64::max);
        let used = simulation.limits.iter().map(|used| used.largest).fold(0.0, f64::max);
        assert!((used / largest - 1.0).abs() < 5e-3, "{used} m/s2 in place of {largest} m/s2");
    }
}

#[test]
fn speed_that_rises_is_no_deceleration_however_coarse_the_grid() {
    // A left turn of a point far out on the right, which gets faster by less than its grid turns it.
    let point = Payload { mass: 1e-6, right: 0.3, forward: 0.02, height: 0.1, yaw_inertia: 0.0 };
    let robot =
        RobotParameters { center_of_mass_right: 0.0, center_of_mass_forward: 0.02, ..RobotParameters::default() };
    for step_count in [30, 60, 600] {
        let mut parameters =
            SimulateParameters { robot, payload: Some(point), step_count, ..SimulateParameters::default() };
        let (yaw_rate, speed) = (3.0, 1.0);
        // Turned back by half a step, as the nodes of a plan are.
        let back = 0.5 * yaw_rate * 0.6 / step_count as f64;
        let velocity = &mut parameters.start.velocity;
        (velocity.x, velocity.y, velocity.yaw_rate) = (-0.02 * yaw_rate, speed, yaw_rate);
        (velocity.x, velocity.y) =
            (velocity.x * back.cos() + velocity.y * back.sin(), velocity.y * back.cos() - velocity.x * back.sin());
        let rate = |side: f64| (speed + side * yaw_rate * 0.5 * robot.track_width) / robot.wheel_radius;
        velocity.wheel_rate = PerWheel::new(rate(-1.0), rate(1.0));
        parameters.schedule = TorqueSchedule { final_time: 0.6, left: vec![-0.119_742], right: vec![0.128_178] };
        (parameters.limits.acceleration, parameters.limits.deceleration) = (Some(1.0), Some(1.0));
        let simulation = simulate(&SimulateInput::new(parameters).unwrap(), Stop::never()).unwrap();
        let [up, down] = [0, 1].map(|limit| simulation.limits[limit].largest);
        assert!((5.0..7.0).contains(&up) && down <= 0.0, "{step_count} steps: {up} and {down} m/s2");
    }
}

/// Velocity in the world of a point (right, forward) of the robot from the point that a state speaks of.
fn velocity_of(point: Vector2<f64>, state: &State) -> Vector2<f64> {
    let (sin, cos) = state.configuration.heading.sin_cos();
    let arm = Vector2::new(cos * point.x - sin * point.y, sin * point.x + cos * point.y);
    Vector2::new(state.velocity.x, state.velocity.y) + state.velocity.yaw_rate * Vector2::new(-arm.y, arm.x)
}
