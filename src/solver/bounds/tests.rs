mod limits;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::first_time::WIDTH;
use super::*;
use crate::robot::{RobotParameters, State, Velocity};
use crate::shooting::{Goal, LONGEST_FINAL_TIME, Maneuver, ReferencePoint};
use crate::simulation::{ContactMethod, Rollout, Simulator, TorqueSchedule};
use crate::solver::SolveParameters;
use crate::stop::Stop;

fn input(maneuver: &Maneuver, parameters: RobotParameters) -> SolveInput {
    SolveInput::new(SolveParameters { robot: parameters, maneuver: *maneuver, ..SolveParameters::default() }).unwrap()
}

fn bound(maneuver: &Maneuver) -> LowerBound {
    largest_lower_bound(&input(maneuver, RobotParameters::default()), Grid::Steps(200))
}

fn by_friction(maneuver: &Maneuver, parameters: RobotParameters, step_count: usize) -> f64 {
    let input = input(maneuver, parameters);
    let bounds = Bounds::new(&input, Grid::Steps(step_count));
    bounds.all(bounds.most_promising_direction(), Wanted::Largest)[0].time
}

/// Hollow wheels on the chassis centre of mass: the scheme keeps every law exactly. The front support rubs like the wheels,
/// so friction is the same wherever the weight is.
fn centered() -> RobotParameters {
    RobotParameters { wheel_mass: 1e-4, ..rubbing() }
}

fn rubbing() -> RobotParameters {
    RobotParameters { front_friction_coefficient: 0.45, ..RobotParameters::default() }
}

#[test]
fn from_rest_to_rest_friction_alone_gives_the_closed_form() {
    let time = by_friction(&Maneuver::forward_drive(), centered(), 10_000);
    let expected = 2.0 * (5.0_f64 / (0.45 * 9.81)).sqrt();
    // Mostly the width of the search.
    assert!(time <= expected && time > expected * (1.0 - 2e-5), "{time} {expected}");
}

#[test]
fn weak_torque_makes_the_forward_drive_longer_than_friction() {
    let maneuver = Maneuver { torque_limit: PerWheel::new(0.2, 0.2), ..Maneuver::forward_drive() };
    let bound = bound(&maneuver);
    assert_eq!(bound.assumption, LowerBoundAssumption::DriveTorque);
    assert!(bound.time > 1.25 * by_friction(&maneuver, RobotParameters::default(), 200), "{bound:?}");
}

#[test]
fn speed_takes_its_drive_time() {
    let mut maneuver =
        Maneuver { torque_limit: PerWheel::new(0.1, 0.1), goal: Goal::default(), ..Maneuver::forward_drive() };
    maneuver.goal.set(StateComponent::VelocityY, Some(2.0));
    maneuver.goal.set(StateComponent::YawRate, Some(0.0));
    let bound = bound(&maneuver);
    assert_eq!((bound.assumption, bound.component), (LowerBoundAssumption::DriveTorque, StateComponent::VelocityY));
    // Rolling straight would take m v R / (2 M) = 6.9 s and more; the norm allows for yaw and stored spin.
    assert!(bound.time > 2.5 && bound.time < 6.9, "{bound:?}");
}

#[test]
fn stopping_takes_its_friction_time() {
    let mut maneuver = Maneuver::forward_drive();
    maneuver.start.velocity.y = 3.0;
    maneuver.goal = Goal::default();
    maneuver.goal.set(StateComponent::VelocityX, Some(0.0));
    maneuver.goal.set(StateComponent::VelocityY, Some(0.0));
    maneuver.goal.set(StateComponent::YawRate, Some(0.0));
    let (time, expected) = (by_friction(&maneuver, centered(), 10_000), 3.0 / (0.45 * 9.81));
    assert!(time <= expected && time > expected * (1.0 - 2e-5), "{time} {expected}");
}

#[test]
fn a_robot_that_cannot_turn_in_time_brakes_with_its_wheels_relieved() {
    // Braking backwards shifts load from the wheels to the front support, which has no friction.
    let robot = RobotParameters { wheel_mass: 1e-4, chassis_yaw_inertia: 1e4, ..RobotParameters::default() };
    let (distance, length, gravity) = (0.05, robot.axle_to_front_support, robot.gravity);
    let maneuver = Maneuver { goal: Goal::at_rest(0.0, distance, 0.0), ..Maneuver::forward_drive() };
    let on_wheels = gravity * (1.0 - robot.center_of_mass_forward / length) + 2.0 / length / robot.total_mass();
    let shift = 0.45 * (robot.center_of_mass_height - robot.wheel_radius) / length;
    let acceleration = |shift: f64| 0.45 * on_wheels / (1.0 - shift);
    let expected = (2.0 * distance * (1.0 / acceleration(shift) + 1.0 / acceleration(-shift))).sqrt();
    let time = by_friction(&maneuver, robot, 10_000);
    // The first step of turns is a sixteenth of half a turn, which costs a thousandth of the braking.
    assert!(time < expected && time > 0.999 * expected, "{time} {expected}");
}

#[test]
fn stopping_anywhere_on_a_line_takes_its_friction_time() {
    let mut maneuver = Maneuver::forward_drive();
    maneuver.start.velocity.y = 3.0;
    maneuver.goal.set(StateComponent::Y, None);
    let (time, expected) = (by_friction(&maneuver, centered(), 10_000), 3.0 / (0.45 * 9.81));
    assert!(time <= expected && time > expected * (1.0 - 2e-5), "{time} {expected}");
}

#[test]
fn a_free_heading_frees_the_center_by_its_lever() {
    let mut maneuver = Maneuver::forward_drive();
    maneuver.goal.set(StateComponent::Heading, None);
    let robot = rubbing();
    let lever = robot.whole_center_of_mass().norm();
    let time = by_friction(&maneuver, robot, 1_000_000);
    // The start's offset points somewhere: the centre may come nearer by at most twice the lever.
    let acceleration = 0.45 * 9.81;
    assert!(time < 2.0 * (5.0_f64 / acceleration).sqrt());
    assert!(time > 2.0 * ((5.0 - 2.0 * lever - 1e-3) / acceleration).sqrt());
}

#[test]
fn turning_about_the_whole_center_of_mass_is_bounded_by_yaw_alone() {
    let mut maneuver = Maneuver::forward_drive();
    let center = RobotParameters::default().whole_center_of_mass();
    // A half turn about the whole centre of mass takes the chassis to the other side of it.
    maneuver.goal = Goal::at_rest(2.0 * center.x, 2.0 * center.y, std::f64::consts::PI);
    assert_eq!(by_friction(&maneuver, RobotParameters::default(), 200), 0.0);
    assert_eq!(bound(&maneuver).component, StateComponent::Heading);
}

#[test]
fn the_nearest_winding_bounds_the_turn() {
    let mut maneuver = Maneuver::forward_drive();
    maneuver.goal = Goal::at_rest(0.0, 0.0, 0.5);
    let near = bound(&maneuver).time;
    maneuver.goal = Goal::at_rest(0.0, 0.0, 0.5 + 4.0 * std::f64::consts::PI);
    assert!((bound(&maneuver).time - near).abs() < 1e-9 && near > 0.1, "{near}");
}

#[test]
fn a_start_that_turns_passes_windings_before_it_can_be_at_the_place() {
    let robot = RobotParameters {
        center_of_mass_right: 0.0,
        center_of_mass_forward: 0.02,
        wheel_friction_coefficient: 0.6,
        ..RobotParameters::default()
    };
    let mut maneuver = Maneuver::forward_drive();
    maneuver.limits.yaw_acceleration = Some(0.06);
    maneuver.start.velocity =
        Velocity { x: -0.01035, y: 0.2001, yaw_rate: 0.6, wheel_rate: PerWheel::new(1.8333, 4.8333) };
    // After 2 pi and 0.42 rad: it is past 0.42 rad within a second, and far from the place.
    maneuver.goal = Goal::at_rest(-1.5692, -1.7454, 6.7035);
    for (component, value) in [
        (StateComponent::VelocityX, -0.085),
        (StateComponent::VelocityY, 0.159),
        (StateComponent::YawRate, 0.6338),
        (StateComponent::WheelRateLeft, 1.4138),
        (StateComponent::WheelRateRight, 4.5827),
    ] {
        maneuver.goal.set(component, Some(value));
    }
    // A motion whose wheels roll throughout takes so long.
    let time = largest_lower_bound(&input(&maneuver, robot), Grid::Steps(400)).time;
    assert!(time < 10.972, "{time}");
}

#[test]
fn goals_that_the_start_meets_take_no_time() {
    let maneuver = Maneuver { goal: Goal::at_rest(0.0, 0.0, 0.0), ..Maneuver::forward_drive() };
    assert_eq!(bound(&maneuver).time, 0.0);
}

#[test]
fn without_friction_only_coasting_goals_have_a_time() {
    let robot = RobotParameters { wheel_friction_coefficient: 0.0, ..RobotParameters::default() };
    let mut maneuver = Maneuver::forward_drive();
    let time_on = |maneuver: &Maneuver, grid| largest_lower_bound(&input(maneuver, robot), grid).time;
    let time = |maneuver: &Maneuver| time_on(maneuver, Grid::Steps(200));
    for speed in [0.0, 2.0] {
        maneuver.start.velocity.y = speed;
        assert_eq!(time_on(&maneuver, Grid::Continuous), f64::INFINITY);
        // The contact solver may err by a force that is tiny, but not zero.
        assert!(time(&maneuver) > LONGEST_FINAL_TIME);
    }
    maneuver.goal.set(StateComponent::VelocityY, Some(2.0));
    // 5 m at 2 m/s, but for the tolerance.
    assert!((time(&maneuver) - 2.5).abs() < 5e-5, "{}", time(&maneuver));
}

/// A feasible plan: its end state is the goal.
struct Case {
    seed: u64,
    input: SolveInput,
    schedule: TorqueSchedule,
    step_count: usize,
}

fn signed(rng: &mut Xoshiro256PlusPlus, largest: f64) -> f64 {
    // Rest, slow and fast are equally frequent.
    let size = largest * 10.0_f64.powf(rng.random_range(-3.0..0.0));
    if rng.random_bool(0.3) { 0.0 } else { size * if rng.random_bool(0.5) { 1.0 } else { -1.0 } }
}

fn random_robot(rng: &mut Xoshiro256PlusPlus) -> RobotParameters {
    let reference = RobotParameters::default();
    let mut spread = |value: f64, decades: f64| value * 10.0_f64.powf(rng.random_range(-decades..decades));
    let robot = RobotParameters {
        chassis_mass: spread(reference.chassis_mass, 1.0),
        wheel_mass: spread(reference.wheel_mass, 1.5),
        chassis_yaw_inertia: spread(reference.chassis_yaw_inertia, 1.0),
        wheel_spin_inertia: spread(reference.wheel_spin_inertia, 1.5),
        wheel_radius: spread(reference.wheel_radius, 0.3),
        track_width: spread(reference.track_width, 0.3),
        center_of_mass_height: spread(0.03, 0.7),
        center_of_mass_forward: spread(0.06, 0.6),
        wheel_friction_coefficient: spread(reference.wheel_friction_coefficient, 0.7),
        ..reference
    };
    RobotParameters {
        center_of_mass_right: rng.random_range(-0.1..0.1),
        front_support_right: rng.random_range(-0.1..0.1),
        front_friction_coefficient: if rng.random_bool(0.8) { 0.0 } else { rng.random_range(0.0..0.8) },
        tangential_restitution: if rng.random_bool(0.7) { 0.0 } else { rng.random_range(0.0..1.0) },
        ..robot
    }
}

/// Viscous friction that slows a free wheel within 0.01 s to 10 s.
fn with_viscous_friction(rng: &mut Xoshiro256PlusPlus, robot: RobotParameters) -> RobotParameters {
    let wheel_viscous_friction = robot.wheel_spin_inertia * 10.0_f64.powf(rng.random_range(-1.0..2.0));
    RobotParameters { wheel_viscous_friction, ..robot }
}

/// Rolling and sliding starts.
fn random_start(rng: &mut Xoshiro256PlusPlus, robot: &RobotParameters) -> State {
    let mut vector = nalgebra::SVector::<f64, 10>::from_fn(|row, _| signed(rng, if row < 5 { 3.0 } else { 4.0 }));
    let rolls = rng.random_bool(0.5);
    let (speed, yaw_rate) = (vector[5], vector[7]);
    if rolls {
        let heading: f64 = vector[2];
        let forward = speed + robot.center_of_mass_right * yaw_rate;
        let right = -robot.center_of_mass_forward * yaw_rate;
        vector[5] = heading.cos() * right - heading.sin() * forward;
        vector[6] = heading.sin() * right + heading.cos() * forward;
    }
    for (row, side) in [(8, -0.5), (9, 0.5)] {
        let rolling = (speed + side * robot.track_width * yaw_rate) / robot.wheel_radius;
        vector[row] = if rolls { rolling } else { signed(rng, 100.0) };
    }
    State::from_vector(&vector)
}

/// Full effort, one way or the other, most of the time: plans that come near the bounds.
fn random_torques(rng: &mut Xoshiro256PlusPlus, limit: f64, count: usize) -> Vec<f64> {
    let steady = rng.random_bool(0.4);
    let first = if rng.random_bool(0.5) { limit } else { -limit };
    let torque = |index: usize| match rng.random_range(0..4) {
        _ if steady => {
            if 2 * index < count {
                first
            } else {
                -first
            }
        }
        0 => limit,
        1 => -limit,
        _ => limit * rng.random_range(-1.0..1.0),
    };
    (0..count).map(torque).collect()
}

fn random_case(seed: u64, adapt: impl Fn(&mut Xoshiro256PlusPlus, RobotParameters) -> RobotParameters) -> Option<Case> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let parameters = random_robot(&mut rng);
    let parameters = adapt(&mut rng, parameters);
    let mut maneuver = Maneuver::forward_drive();
    if rng.random_bool(0.5) {
        maneuver.reference_point = ReferencePoint::AxleMidpoint;
    }
    maneuver.start = if rng.random_bool(0.3) { State::default() } else { random_start(&mut rng, &parameters) };
    let effort = |rng: &mut Xoshiro256PlusPlus| 10.0_f64.powf(rng.random_range(-1.5..1.0));
    maneuver.torque_limit = PerWheel::new(effort(&mut rng), effort(&mut rng));
    let step_count = rng.random_range(1..25);
    let controls = rng.random_range(1..=step_count.min(6));
    let schedule = TorqueSchedule {
        final_time: 10.0_f64.powf(rng.random_range(-2.5..0.3)),
        left: random_torques(&mut rng, maneuver.torque_limit.left, controls),
        right: random_torques(&mut rng, maneuver.torque_limit.right, controls),
    };
    let input = SolveInput::new(SolveParameters { robot: parameters, maneuver, ..SolveParameters::default() }).ok()?;
    Some(Case { seed, input, schedule, step_count })
}

impl Case {
    /// Its end as the goal, or what is within a tolerance of that, where the motion stays in the model.
    fn with_goal(mut self) -> Option<Self> {
        let simulator = Simulator::new(&self.input.robot);
        let parameters = *self.input.robot.parameters();
        let start = self.input.maneuver.start_at_center_of_mass(&parameters);
        let rollout = Rollout { start: &start, schedule: &self.schedule, step_count: self.step_count };
        let trajectory = simulator.trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap();
        if !trajectory.separations().is_empty() || trajectory.worst_contact_residual > 1e-10 {
            return None;
        }
        let end = trajectory.end_state.moved_by(self.input.maneuver.reference_point.offset(&parameters));
        // These plans keep no loads but positive ones.
        self.input.maneuver.limits.normal_load_share = 0.0;
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(!self.seed);
        let free = if rng.random_bool(0.5) { 0.0 } else { 0.4 };
        let tolerance = if rng.random_bool(0.5) { 1e-6 } else { 10.0_f64.powf(rng.random_range(-3.0..0.0)) };
        self.input.settings.goal_tolerance = tolerance;
        for component in StateComponent::ALL {
            let mut value = end.to_vector()[component.index()] + 0.99 * tolerance * rng.random_range(-1.0..1.0);
            if component == StateComponent::Heading {
                value += std::f64::consts::TAU * f64::from(rng.random_range(-2..3));
            }
            self.input.maneuver.goal.set(component, (!rng.random_bool(free)).then_some(value));
        }
        Some(self)
    }
}

/// Compares all bounds with random rollouts; returns how many there were, and how many came near each kind of bound.
fn compare_rollouts(
    seeds: std::ops::Range<u64>,
    adapt: impl Fn(&mut Xoshiro256PlusPlus, RobotParameters) -> RobotParameters,
) -> (usize, [usize; 5]) {
    compare_cases(seeds.filter_map(|seed| random_case(seed, &adapt).and_then(Case::with_goal)))
}

fn compare_cases(all: impl Iterator<Item = Case>) -> (usize, [usize; 5]) {
    let (mut cases, mut near) = (0, [0; 5]);
    for case in all {
        let seed = case.seed;
        cases += 1;
        if let Some(reason) = impossibility(&case.input) {
            // At the end state a contact may separate in the step that would follow; so may at the start one that a coarse step
            // keeps closed, at whose end viscous friction has fallen.
            let is_damped = case.input.robot.parameters().wheel_viscous_friction > 0.0;
            let is_expected = reason.code == "goal_separates" || is_damped && reason.code == "start_separates";
            assert!(
                is_expected,
                "seed {seed}: {} {:?} {:?} {} steps {}",
                reason.message, case.input.maneuver, case.input.payload, case.schedule.final_time, case.step_count
            );
        }
        let bounds = lower_bounds(&case.input, Grid::Steps(case.step_count), Wanted::Above(0.0));
        // What one bound excludes, another one need not: together they may say more.
        let together = largest_lower_bound(&case.input, Grid::Steps(case.step_count)).time;
        // The search for a bound that begins at another one ends elsewhere, by about its resolution; with limits the steps in which
        // curves are bounded lie elsewhere at other durations.
        let least = if case.input.path_limits().is_empty() { 1.0 - 10.0 * WIDTH } else { 0.98 };
        assert!(together >= least * largest(&bounds).time, "seed {seed}: {together} {bounds:?}");
        assert!(together <= case.schedule.final_time, "seed {seed}: {together} exceeds {} s", case.schedule.final_time);
        for bound in bounds {
            let ratio = bound.time / case.schedule.final_time;
            assert!(ratio <= 1.0, "seed {seed}: {bound:?} exceeds {} s", case.schedule.final_time);
            near[bound.assumption as usize] += usize::from(ratio > 0.9);
        }
    }
    (cases, near)
}

#[test]
fn no_feasible_rollout_is_faster_than_any_bound() {
    let (cases, near) = compare_rollouts(0..8_000, |_, robot| robot);
    // The test bites: many plans come close to each kind of bound.
    assert!(cases > 3_000, "{cases}");
    assert!(near[..4].iter().all(|&count| count > 50), "{near:?} of {cases}");
}

#[test]
fn no_rollout_with_viscous_friction_is_faster_than_any_bound() {
    let (cases, near) = compare_rollouts(0..8_000, with_viscous_friction);
    assert!(cases > 3_000, "{cases}");
    assert!(near[..4].iter().all(|&count| count > 20), "{near:?} of {cases}");
}

#[test]
fn a_wheel_without_torque_and_grip_stops_by_viscous_friction_alone() {
    let robot =
        RobotParameters { wheel_friction_coefficient: 0.0, wheel_viscous_friction: 0.01, ..RobotParameters::default() };
    let mut maneuver = Maneuver { torque_limit: PerWheel::new(0.0, 0.0), ..Maneuver::forward_drive() };
    maneuver.start.velocity.wheel_rate.left = 10.0;
    maneuver.goal = Goal::default();
    let claim = |maneuver: &Maneuver| impossibility(&input(maneuver, robot)).map(|reason| reason.code);
    for (rate, expected) in [(1.0, None), (0.0, None), (11.0, Some("no_torque")), (-1.0, Some("no_torque"))] {
        maneuver.goal.set(StateComponent::WheelRateLeft, Some(rate));
        assert_eq!(claim(&maneuver), expected, "{rate} rad/s");
    }
    maneuver.start.velocity.wheel_rate.left = 0.0;
    maneuver.goal.set(StateComponent::WheelRateLeft, Some(1.0));
    assert_eq!(claim(&maneuver), Some("no_torque"));
}
