//! Closed forms, symmetries and invariants of the mechanics.

use nalgebra::SVector;
use slipdrive::contact::{ContactMode, ContactName};
use slipdrive::robot::{BodyVector, PerWheel, Robot, RobotParameters, State, Velocity};
use slipdrive::simulation::{
    ContactMethod, EndSensitivity, FrictionLaw, Rollout, Simulator, TorqueSchedule, Trajectory,
};
use slipdrive::stop::Stop;

use crate::random::RandomCases;

/// A closed form is met to the rounding of some hundred steps.
const ROUNDING: f64 = 1e-11;

/// The reference robot with its centre of mass on the centreline.
fn symmetric() -> RobotParameters {
    RobotParameters { center_of_mass_right: 0.0, ..RobotParameters::default() }
}

fn constant(final_time: f64, left: f64, right: f64) -> TorqueSchedule {
    TorqueSchedule { final_time, left: vec![left], right: vec![right] }
}

fn roll(parameters: RobotParameters, start: &State, schedule: &TorqueSchedule, step_count: usize) -> Trajectory {
    let simulator = Simulator::new(&Robot::new(parameters).unwrap());
    simulator.trajectory(&Rollout { start, schedule, step_count }, ContactMethod::Exact, Stop::never()).unwrap()
}

fn assert_near(actual: f64, expected: f64, tolerance: f64) {
    let scale = expected.abs().max(1.0);
    assert!((actual - expected).abs() <= tolerance * scale, "{actual} instead of {expected}");
}

#[test]
fn rolling_accelerates_as_if_the_wheels_added_to_the_mass() {
    let robot = symmetric();
    let trajectory = roll(robot, &State::default(), &constant(1.0, 0.6, 0.6), 200);
    let rolling_mass = robot.total_mass() + 2.0 * robot.wheel_spin_inertia / robot.wheel_radius.powi(2);
    let acceleration = 1.2 / robot.wheel_radius / rolling_mass;
    let end = trajectory.state.last().unwrap();
    assert_near(end.velocity.y, acceleration, ROUNDING);
    assert_near(end.configuration.y, acceleration / 2.0, ROUNDING);
    assert_near(end.configuration.x, 0.0, ROUNDING);
}

#[test]
fn rolling_forwards_rights_the_course_and_backwards_loses_it() {
    let robot = symmetric();
    let half_track = robot.track_width / 2.0;
    let lever = robot.chassis_mass * robot.center_of_mass_forward;
    let rolling_mass = robot.wheel_mass + robot.wheel_spin_inertia / robot.wheel_radius.powi(2);
    let yaw_inertia = robot.chassis_yaw_inertia
        + lever * robot.center_of_mass_forward
        + 2.0 * (robot.wheel_diametral_inertia + rolling_mass * half_track.powi(2));
    let yaw_rate = 1e-6;
    for speed in [3.0, -3.0] {
        // Steps that right the course of a robot that rolls forwards, that overshoot, and that lose it.
        for share in [0.1, 1.5, 2.5] {
            let rim_speeds = [-1.0, 1.0].map(|side| speed + side * yaw_rate * half_track);
            let [left, right] = rim_speeds.map(|speed| speed / robot.wheel_radius);
            let velocity = Velocity {
                x: -yaw_rate * robot.center_of_mass_forward,
                y: speed,
                yaw_rate,
                wheel_rate: PerWheel::new(left, right),
            };
            let start = State { velocity, ..State::default() };
            let dt = share * yaw_inertia / (lever * speed.abs());
            let trajectory = roll(robot, &start, &constant(6.0 * dt, 0.0, 0.0), 6);
            // The start does not lag its heading yet, so the first step turns by half as much.
            for pair in trajectory.state[1..].windows(2) {
                let factor = pair[1].velocity.yaw_rate / pair[0].velocity.yaw_rate;
                assert_near(factor, 1.0 - share * speed.signum(), 1e-4);
            }
        }
    }
}

#[test]
fn sideways_sliding_stops_by_friction_alone() {
    // Over the axle the lateral friction has no yaw moment, and the wheels carry the whole weight.
    let robot = RobotParameters { center_of_mass_forward: 0.0, ..symmetric() };
    let mut start = State::default();
    start.velocity.x = 2.0;
    let deceleration = robot.wheel_friction_coefficient * robot.gravity;
    let stop_time = 2.0 / deceleration;
    let sliding = roll(robot, &start, &constant(0.5 * stop_time, 0.0, 0.0), 100);
    assert_near(sliding.state.last().unwrap().velocity.x, 1.0, ROUNDING);
    // A hair beyond the stopping time the robot rests, after v^2 / (2 mu g).
    let stopped = roll(robot, &start, &constant(1.01 * stop_time, 0.0, 0.0), 101);
    let end = stopped.state.last().unwrap();
    assert_near(end.velocity.x, 0.0, ROUNDING);
    assert_near(end.configuration.x, 4.0 / (2.0 * deceleration), ROUNDING);
}

#[test]
fn wheel_without_friction_spins_up_on_the_spot() {
    let robot = RobotParameters { wheel_friction_coefficient: 0.0, ..RobotParameters::default() };
    let end = *roll(robot, &State::default(), &constant(0.5, 0.3, 0.0), 50).state.last().unwrap();
    assert_near(end.velocity.wheel_rate.left, 0.5 * 0.3 / robot.wheel_spin_inertia, ROUNDING);
    assert_eq!((end.velocity.wheel_rate.right, end.configuration.y, end.configuration.heading), (0.0, 0.0, 0.0));
}

#[test]
fn viscous_friction_brakes_a_free_wheel_at_the_end_of_each_step() {
    let robot =
        RobotParameters { wheel_friction_coefficient: 0.0, wheel_viscous_friction: 0.05, ..RobotParameters::default() };
    let (torque, dt) = (0.3, 0.01);
    let mut start = State::default();
    start.velocity.wheel_rate = PerWheel::new(-20.0, 30.0);
    let trajectory = roll(robot, &start, &constant(50.0 * dt, torque, 0.0), 50);
    let (mut left, mut right) = (-20.0, 30.0);
    let inertia = robot.wheel_spin_inertia + robot.wheel_viscous_friction * dt;
    let static_load = trajectory.contact[49].front.normal_force;
    for (state, contact) in trajectory.state[1..].iter().zip(&trajectory.contact) {
        let before = left + right;
        left = (robot.wheel_spin_inertia * left + torque * dt) / inertia;
        right = robot.wheel_spin_inertia * right / inertia;
        assert_near(state.velocity.wheel_rate.left, left, ROUNDING);
        assert_near(state.velocity.wheel_rate.right, right, ROUNDING);
        // The chassis carries what spins the wheels up, and nothing else.
        let spin_up = robot.wheel_spin_inertia * (left + right - before) / dt;
        let front = robot.chassis_mass * robot.gravity * robot.center_of_mass_forward - spin_up;
        assert_near(contact.front.normal_force, front / robot.axle_to_front_support, ROUNDING);
    }
    // Near the rate at which friction balances the torque.
    assert_near(left, torque / robot.wheel_viscous_friction, 1e-2);
    assert!(static_load > 0.0);
}

#[test]
fn a_rolling_drive_loses_to_viscous_friction_what_both_wheels_do() {
    let robot = RobotParameters { wheel_viscous_friction: 0.04, ..symmetric() };
    let (torque, dt, radius) = (0.4, 0.005, robot.wheel_radius);
    let trajectory = roll(robot, &State::default(), &constant(200.0 * dt, torque, torque), 200);
    let mass = robot.total_mass() + 2.0 * robot.wheel_spin_inertia / radius.powi(2);
    let (mut speed, mut place) = (0.0, 0.0);
    for state in &trajectory.state[1..] {
        let before = speed;
        // Implicit Euler of m v' = 2 (M - c v / R) / R.
        speed = (mass * speed + 2.0 * torque / radius * dt)
            / (mass + 2.0 * robot.wheel_viscous_friction / radius.powi(2) * dt);
        place += 0.5 * dt * (before + speed);
        assert_near(state.velocity.y, speed, ROUNDING);
        assert_near(state.configuration.y, place, ROUNDING);
    }
    assert!(speed < 0.95 * 2.0 * torque / radius / mass, "the friction counts");
}

#[test]
fn fixed_point_agrees_with_viscous_friction() {
    for seed in 0..40 {
        let mut cases = RandomCases::new(seed);
        let wheel_viscous_friction = cases.between(0.0, 0.2);
        let robot = Robot::new(RobotParameters { wheel_viscous_friction, ..*cases.robot().parameters() }).unwrap();
        let (start, schedule) = (cases.state(&robot, 1.0), cases.schedule(5, 0.5, 2.0));
        let rollout = Rollout { start: &start, schedule: &schedule, step_count: 50 };
        let simulator = Simulator::new(&robot);
        let exact = simulator.end_state(&rollout, Stop::never()).unwrap();
        let fixed_point = simulator.end_state_by_fixed_point(&rollout, Stop::never()).unwrap();
        // Sweeps end at residuals of 1e-10, which some dozen steps add up and slip modes spread.
        let difference = (exact.to_vector() - fixed_point.to_vector()).amax();
        assert!(difference <= 1e-6, "seed {seed}: {difference}");
    }
}

#[test]
fn spinning_wheels_push_with_friction_times_load() {
    let robot = symmetric();
    let torque = 5.0;
    let trajectory = roll(robot, &State::default(), &constant(0.2, torque, torque), 40);
    // m a = 2 mu N;   J psidd = M - R mu N;   l N_F = m_c g c_f - (m_c h + 2 m_w R) a - 2 J psidd;   2 N + N_F = m g.
    let (mu, mass, radius) = (robot.wheel_friction_coefficient, robot.total_mass(), robot.wheel_radius);
    let tilt = robot.chassis_mass * robot.center_of_mass_height + 2.0 * robot.wheel_mass * radius;
    let length = robot.axle_to_front_support;
    let weight_moment = robot.chassis_mass * robot.gravity * robot.center_of_mass_forward;
    let per_load = 2.0 * length - tilt * 2.0 * mu / mass + 2.0 * radius * mu;
    let load = (mass * robot.gravity * length - weight_moment + 2.0 * torque) / per_load;
    let sample = trajectory.contact[20];
    assert_eq!((sample.left.mode, sample.right.mode), (ContactMode::Slip, ContactMode::Slip));
    assert_near(sample.left.normal_force, load, ROUNDING);
    assert_near(sample.right.longitudinal_force, mu * load, ROUNDING);
    assert_near(trajectory.state[40].velocity.y, 0.2 * 2.0 * mu * load / mass, ROUNDING);
    assert!(sample.left.longitudinal_slip < 0.0, "the contact point slides backwards");
}

#[test]
fn loads_at_rest_are_those_of_statics() {
    let robot = RobotParameters::default();
    let sample = roll(robot, &State::default(), &constant(0.1, 0.0, 0.0), 1).contact[0];
    let chassis = robot.chassis_mass * robot.gravity;
    let front = chassis * robot.center_of_mass_forward / robot.axle_to_front_support;
    let total = robot.total_mass() * robot.gravity;
    let shift = chassis * robot.center_of_mass_right / robot.track_width;
    assert_near(sample.front.normal_force, front, ROUNDING);
    assert_near(sample.left.normal_force, (total - front) / 2.0 - shift, ROUNDING);
    assert_near(sample.right.normal_force, (total - front) / 2.0 + shift, ROUNDING);
}

#[test]
fn acceleration_moves_load_from_the_front_to_the_axle() {
    let robot = symmetric();
    let trajectory = roll(robot, &State::default(), &constant(0.5, 0.5, 0.5), 50);
    let acceleration = trajectory.state[50].velocity.y / 0.5;
    let wheel_terms = 2.0 * robot.wheel_mass * robot.wheel_radius * acceleration
        + 2.0 * robot.wheel_spin_inertia * acceleration / robot.wheel_radius;
    let moment = robot.chassis_mass * robot.center_of_mass_height * acceleration + wheel_terms;
    let at_rest = robot.chassis_mass * robot.gravity * robot.center_of_mass_forward / robot.axle_to_front_support;
    let expected = at_rest - moment / robot.axle_to_front_support;
    assert_near(trajectory.contact[30].front.normal_force, expected, ROUNDING);
}

#[test]
fn turning_left_loads_the_right_wheel() {
    let robot = symmetric();
    let mut start = State::default();
    let (speed, yaw_rate) = (1.0, 0.8);
    // Rolling on a circle: the chassis centre of mass, ahead of the axle, moves sideways with p_f omega.
    start.velocity.y = speed;
    start.velocity.x = -robot.center_of_mass_forward * yaw_rate;
    start.velocity.yaw_rate = yaw_rate;
    let rate = |side: f64| (speed + side * robot.track_width / 2.0 * yaw_rate) / robot.wheel_radius;
    start.velocity.wheel_rate = PerWheel::new(rate(-1.0), rate(1.0));
    let sample = roll(robot, &start, &constant(0.01, 0.0, 0.0), 1).contact[0];
    assert_eq!(sample.left.mode, ContactMode::Stick);
    assert!(sample.right.normal_force > sample.left.normal_force + 1.0);
}

fn kinetic_energy(robot: &Robot, state: &State) -> f64 {
    let (sin, cos) = state.configuration.heading.sin_cos();
    let u = state.velocity;
    robot.kinetic_energy(&BodyVector::from([
        cos * u.x + sin * u.y,
        cos * u.y - sin * u.x,
        u.yaw_rate,
        u.wheel_rate.left,
        u.wheel_rate.right,
    ]))
}

#[test]
fn zero_torque_never_gains_energy() {
    for seed in 0..300 {
        let mut cases = RandomCases::new(seed);
        let parameters = RobotParameters {
            tangential_restitution: 0.0,
            wheel_viscous_friction: if seed % 3 == 0 { 0.05 } else { 0.0 },
            ..*cases.robot().parameters()
        };
        let robot = Robot::new(parameters).unwrap();
        let start = cases.state(&robot, 1.5);
        let trajectory = roll(parameters, &start, &constant(1.0, 0.0, 0.0), 1000);
        let energy: Vec<f64> = trajectory.state.iter().map(|state| kinetic_energy(&robot, state)).collect();
        for pair in energy.windows(2) {
            // The centrifugal term of the midpoint step balances to third order in omega dt.
            assert!(pair[1] <= pair[0] * (1.0 + 1e-6) + 1e-12, "seed {seed}: from {} J to {} J", pair[0], pair[1]);
        }
        assert!(energy[1000] < energy[0], "seed {seed}");
    }
}

#[test]
fn viscous_friction_stops_wheels_at_any_step_length() {
    let parameters = RobotParameters { wheel_viscous_friction: 1e3, ..RobotParameters::default() };
    let robot = Robot::new(parameters).unwrap();
    let mut start = State::default();
    start.velocity.wheel_rate = PerWheel::new(40.0, -25.0);
    let trajectory = roll(parameters, &start, &constant(10.0, 0.0, 0.0), 10);
    let energy: Vec<f64> = trajectory.state.iter().map(|state| kinetic_energy(&robot, state)).collect();
    assert!(energy.windows(2).all(|pair| pair[1] <= pair[0]), "{energy:?}");
    assert!(energy[10] < 1e-9 * energy[0], "{energy:?}");
}

fn mirrored_state(state: &State) -> State {
    let v = state.to_vector();
    State::from_vector(&SVector::from([-v[0], v[1], -v[2], v[4], v[3], -v[5], v[6], -v[7], v[9], v[8]]))
}

#[test]
fn mirrored_robot_drives_the_mirrored_path() {
    for seed in 0..100 {
        let mut cases = RandomCases::new(seed);
        let robot = cases.robot();
        let parameters = *robot.parameters();
        let mirrored = RobotParameters {
            center_of_mass_right: -parameters.center_of_mass_right,
            front_support_right: -parameters.front_support_right,
            ..parameters
        };
        let start = cases.state(&robot, 1.0);
        let schedule = cases.schedule(10, 1.0, 2.0);
        let swapped = TorqueSchedule {
            left: schedule.right.clone(),
            right: schedule.left.clone(),
            final_time: schedule.final_time,
        };
        let end = *roll(parameters, &start, &schedule, 200).state.last().unwrap();
        let mirror_end = *roll(mirrored, &mirrored_state(&start), &swapped, 200).state.last().unwrap();
        let difference = mirrored_state(&mirror_end).to_vector() - end.to_vector();
        let scale = end.to_vector().amax().max(1.0);
        assert!(difference.amax() <= ROUNDING * scale, "seed {seed}: {}", difference.amax());
    }
}

/// From rest the front support has no slip of its own: it begins with that of wheels that stick.
#[test]
fn held_wheels_move_off_as_sticking_ones_do() {
    let mut compared = 0;
    for seed in 0..300 {
        let mut cases = RandomCases::new(seed);
        let parameters = RobotParameters {
            front_friction_coefficient: cases.between(0.02, 0.5),
            tangential_restitution: 0.0,
            ..*cases.robot().parameters()
        };
        let Ok(robot) = Robot::new(parameters) else { continue };
        let schedule = cases.schedule(5, 0.5, 2.0);
        let exact = roll(parameters, &State::default(), &schedule, 100);
        if [ContactName::Left, ContactName::Right].iter().any(|wheel| exact.slip_time(*wheel) > 0.0) {
            continue;
        }
        let (mut held, simulator) = (EndSensitivity::default(), Simulator::new(&robot));
        let rollout = Rollout { start: &State::default(), schedule: &schedule, step_count: 100 };
        simulator.record(&rollout, FrictionLaw::Held(0.0), &mut held, Stop::never()).unwrap();
        let end = exact.state.last().unwrap().to_vector();
        let difference = held.end.to_vector() - end;
        assert!(difference.amax() <= 1e-9 * end.amax().max(1.0), "seed {seed}: {difference}");
        compared += 1;
    }
    assert!(compared > 50, "{compared}");
}

#[test]
fn wheels_that_turned_for_long_change_nothing_but_their_angles() {
    let ends = [0.0, 1e6].map(|angle| {
        let mut start = State::default();
        start.configuration.wheel_angle = PerWheel::new(angle, -angle);
        let trajectory = roll(RobotParameters::default(), &start, &constant(1.0, 1.0, -0.4), 200);
        let mut end = *trajectory.state.last().unwrap();
        let turned = end.configuration.wheel_angle;
        end.configuration.wheel_angle = PerWheel::new(0.0, 0.0);
        (end, turned.left - angle, turned.right + angle)
    });
    assert_eq!(ends[0].0, ends[1].0);
    // 200 steps, each rounded by half of the distance of numbers near 1e6.
    let rounding = 200.0 * 2.0_f64.powi(-34);
    assert!((ends[0].1 - ends[1].1).abs() <= rounding && (ends[0].2 - ends[1].2).abs() <= rounding, "{ends:?}");
}

#[test]
fn resting_robot_stays_at_rest() {
    let trajectory = roll(RobotParameters::default(), &State::default(), &constant(1.0, 0.0, 0.0), 100);
    assert_eq!(*trajectory.state.last().unwrap(), State::default());
    assert_eq!(trajectory.slip_time(ContactName::Left), 0.0);
}
