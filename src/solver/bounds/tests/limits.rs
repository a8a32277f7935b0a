//! Bounds by the limits of a maneuver.

use nalgebra::Complex;

use super::*;
use crate::contact::ContactName;
use crate::motion::limit_uses;
use crate::robot::Payload;
use crate::shooting::{LIMIT_TOLERANCE, PathLimits, SlipPolicy};
use crate::solver::bounds::excluded_ends::excluded_end;

impl Case {
    /// Every other one brakes all the way.
    fn with_full_brakes(mut self) -> Self {
        let Maneuver { torque_limit, start, .. } = &self.input.maneuver;
        let brakes = |limit: f64, rate: f64| vec![-limit * rate.signum()];
        if self.seed.is_multiple_of(2) {
            self.schedule.left = brakes(torque_limit.left, start.velocity.wheel_rate.left);
            self.schedule.right = brakes(torque_limit.right, start.velocity.wheel_rate.right);
        }
        self
    }

    /// With limits that it uses up.
    fn with_limits(mut self) -> Option<Self> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.seed ^ 0x5eed);
        let parameters = *self.input.robot.parameters();
        let simulator = Simulator::new(&self.input.robot);
        let start = self.input.maneuver.start_at_center_of_mass(&parameters);
        let rollout = Rollout { start: &start, schedule: &self.schedule, step_count: self.step_count };
        let trajectory = simulator.trajectory(&rollout, ContactMethod::Exact, Stop::never()).unwrap();
        let sticks = [ContactName::Left, ContactName::Right].iter().all(|wheel| trajectory.slip_time(*wheel) == 0.0);
        if rng.random_bool(0.5) {
            // A mass that rounds away only says which point is limited.
            let mut within = || rng.random_range(-0.2..0.2);
            self.input.payload = Some(Payload {
                mass: f64::MIN_POSITIVE,
                right: within(),
                forward: within(),
                height: 0.1,
                yaw_inertia: 0.0,
            });
        }
        let maneuver = &mut self.input.maneuver;
        maneuver.slip = if sticks && rng.random_bool(0.8) { SlipPolicy::Forbidden } else { SlipPolicy::Allowed };
        let asked = |rng: &mut Xoshiro256PlusPlus| rng.random_bool(0.4).then_some(1.0);
        let limits = &mut maneuver.limits;
        limits.wheel_rate = asked(&mut rng);
        limits.speed = asked(&mut rng);
        limits.yaw_rate = asked(&mut rng);
        limits.acceleration = asked(&mut rng);
        limits.deceleration = asked(&mut rng);
        limits.yaw_acceleration = asked(&mut rng);
        limits.grip_utilization = if maneuver.slip == SlipPolicy::Forbidden { asked(&mut rng) } else { None };
        let path_limits = PathLimits { forbids_slip: false, ..self.input.path_limits() };
        let uses = limit_uses(&simulator, &path_limits, &rollout, Stop::never()).unwrap();
        let limits = &mut self.input.maneuver.limits;
        for used in uses {
            // What counts as kept.
            let largest = Some(used.largest / (1.0 + LIMIT_TOLERANCE));
            match used.limit.rsplit('.').next().unwrap() {
                "wheel_rate_rad_s" => limits.wheel_rate = largest,
                "speed_m_s" => limits.speed = largest,
                "yaw_rate_rad_s" => limits.yaw_rate = largest,
                "acceleration_m_s2" => limits.acceleration = largest,
                "deceleration_m_s2" => limits.deceleration = largest,
                "yaw_acceleration_rad_s2" => limits.yaw_acceleration = largest,
                "grip_utilization" => limits.grip_utilization = largest,
                field => assert_eq!(field, "slip"),
            }
        }
        let excludes_start = excluded_end(&self.input).is_some();
        let is_unlimited = self.input.path_limits().is_empty();
        (!excludes_start && !is_unlimited).then_some(self)
    }
}

/// Rollouts that are tried, of which a third stays in the model with a limit.
const SEEDS: u64 = 3_000;

/// Strong grip, so that torques rarely break it.
fn gripping(rng: &mut Xoshiro256PlusPlus, robot: RobotParameters) -> RobotParameters {
    RobotParameters {
        wheel_friction_coefficient: rng.random_range(0.5..3.0),
        center_of_mass_height: 0.02,
        tangential_restitution: 0.0,
        gravity: rng.random_range(10.0..100.0),
        wheel_viscous_friction: if rng.random_bool(0.8) { 0.0 } else { robot.wheel_spin_inertia },
        ..robot
    }
}

#[test]
fn no_rollout_is_faster_than_any_bound_with_the_limits_it_uses() {
    let limited = |seed| random_case(seed, |_, robot| robot).and_then(Case::with_goal).and_then(Case::with_limits);
    let (cases, near) = compare_cases((0..SEEDS).filter_map(limited));
    assert!(cases > 800 && near[4] > 400, "{near:?} of {cases}");
}

#[test]
fn no_rollout_without_slip_is_faster_than_any_bound_with_the_limits_it_uses() {
    let of_seed = |seed| random_case(seed, gripping).map(Case::with_full_brakes);
    let limited = |seed| of_seed(seed).and_then(Case::with_goal).and_then(Case::with_limits);
    let holds = |case: &Case| case.input.maneuver.forbids_slip();
    let (cases, near) = compare_cases((0..SEEDS).filter_map(limited).filter(holds));
    assert!(cases > 800 && near[4] > 400, "{near:?} of {cases}");
}

/// From rest to rest over a distance with a speed limit and an acceleration.
fn trapezoid(distance: f64, speed: f64, acceleration: f64) -> f64 {
    assert!(distance >= speed * speed / acceleration);
    distance / speed + speed / acceleration
}

/// Asserts a bound by the limits that is below a time by at most a share.
fn assert_near(bound: LowerBound, expected: f64, share: f64) {
    assert_eq!(bound.assumption, LowerBoundAssumption::Limits);
    assert!(bound.time <= expected && bound.time > expected * (1.0 - share), "{bound:?} {expected}");
}

#[test]
fn limited_speed_makes_a_trapezoid() {
    let mut maneuver = Maneuver { torque_limit: PerWheel::new(1e3, 1e3), ..Maneuver::forward_drive() };
    for speed in [0.5, 1.5, 4.0] {
        maneuver.limits.speed = Some(speed);
        let bound = largest_lower_bound(&input(&maneuver, centered()), Grid::Steps(10_000));
        // The search, what limits may be exceeded by, and a lever of some micrometres.
        assert_near(bound, trapezoid(5.0, speed, 0.45 * 9.81), 1e-4);
    }
}

#[test]
fn a_limited_point_takes_its_way_whatever_the_yaw() {
    let mut maneuver = Maneuver { goal: Goal::at_rest(6.0, 8.0, 0.0), ..Maneuver::forward_drive() };
    maneuver.limits.speed = Some(0.5);
    assert_near(bound(&maneuver), 20.0, 1e-4);
    // From a start above the limit, which judges no first node.
    (maneuver.start.velocity.x, maneuver.start.velocity.y) = (1.2, 1.6);
    assert_near(bound(&maneuver), 20.0, 0.01);
    // A point off the centre of mass goes along chords.
    maneuver.start = State::default();
    maneuver.reference_point = ReferencePoint::AxleMidpoint;
    let on = |steps| largest_lower_bound(&input(&maneuver, RobotParameters::default()), Grid::Steps(steps));
    assert_near(on(2_000), 20.0, 0.1);
    maneuver.limits.yaw_rate = Some(1.0);
    let on = |steps| largest_lower_bound(&input(&maneuver, RobotParameters::default()), Grid::Steps(steps));
    assert_near(on(200), 20.6, 0.05);
}

#[test]
fn limited_accelerations_make_a_triangle() {
    let mut maneuver = Maneuver { torque_limit: PerWheel::new(1e3, 1e3), ..Maneuver::forward_drive() };
    (maneuver.limits.acceleration, maneuver.limits.deceleration) = (Some(1.5), Some(1.0));
    let triangle = (2.0_f64 * 5.0 * (1.0 / 1.5 + 1.0 / 1.0)).sqrt();
    assert_near(largest_lower_bound(&input(&maneuver, centered()), Grid::Steps(10_000)), triangle, 1e-4);
    maneuver.limits.deceleration = None;
    let triangle = (2.0_f64 * 5.0 * (1.0 / 1.5 + 1.0 / (0.45 * 9.81))).sqrt();
    assert_near(largest_lower_bound(&input(&maneuver, centered()), Grid::Steps(10_000)), triangle, 1e-4);
    // To a speed, the place is free.
    maneuver.goal = Goal::default();
    for (component, value) in
        [(StateComponent::VelocityX, 0.0), (StateComponent::VelocityY, 2.0), (StateComponent::YawRate, 0.0)]
    {
        maneuver.goal.set(component, Some(value));
    }
    assert_near(largest_lower_bound(&input(&maneuver, centered()), Grid::Steps(10_000)), 2.0 / 1.5, 1e-4);
}

#[test]
fn limited_yaw_makes_a_trapezoid() {
    let mut maneuver = Maneuver { torque_limit: PerWheel::new(1e3, 1e3), ..Maneuver::forward_drive() };
    maneuver.goal = Goal::at_rest(0.0, 0.0, 3.0);
    maneuver.limits.yaw_rate = Some(2.5);
    let of = |maneuver: &Maneuver| {
        let input = input(maneuver, RobotParameters::default());
        let acceleration = Capacity::new(&input, Grid::Steps(200)).yaw_acceleration;
        (largest_lower_bound(&input, Grid::Steps(200)), trapezoid(3.0, 2.5, acceleration))
    };
    let (bound, expected) = of(&maneuver);
    assert_near(bound, expected, 3e-5);
    maneuver.limits.yaw_acceleration = Some(4.0);
    let (bound, expected) = of(&maneuver);
    assert!((expected - trapezoid(3.0, 2.5, 4.0)).abs() < 1e-5);
    assert_near(bound, expected, 3e-5);
}

#[test]
fn limited_wheels_turn_no_further() {
    let mut maneuver = Maneuver { goal: Goal::default(), ..Maneuver::forward_drive() };
    maneuver.goal.set(StateComponent::WheelAngleLeft, Some(100.0));
    maneuver.limits.wheel_rate = Some(20.0);
    let bound = bound(&maneuver);
    assert_eq!((bound.assumption, bound.component), (LowerBoundAssumption::Limits, StateComponent::WheelAngleLeft));
    assert!(bound.time > 5.0 && bound.time < 5.2, "{bound:?}");
}

#[test]
fn wheels_that_hold_make_the_times_of_straight_drives() {
    let robot = RobotParameters { center_of_mass_right: 0.0, ..RobotParameters::default() };
    let (radius, rim) = (robot.wheel_radius, 2.0 * robot.wheel_spin_inertia / robot.wheel_radius.powi(2));
    let acceleration = 2.0 / radius / (robot.total_mass() + rim);
    let mut maneuver = Maneuver { slip: SlipPolicy::Forbidden, ..Maneuver::forward_drive() };
    let on = |maneuver: &Maneuver, steps| largest_lower_bound(&input(maneuver, robot), Grid::Steps(steps));
    // Frames that turn take what torque need not; it vanishes with the step.
    assert_near(on(&maneuver, 10_000), 2.0 * (5.0 / acceleration).sqrt(), 0.02);
    for rate in [10.0, 20.0, 30.0] {
        maneuver.limits.wheel_rate = Some(rate);
        let expected = trapezoid(5.0, radius * rate, acceleration);
        assert_near(on(&maneuver, 200), expected, 0.03);
        assert_near(on(&maneuver, 10_000), expected, 2e-3);
    }
}

#[test]
fn tighter_limits_raise_the_bounds() {
    let mut maneuver = Maneuver { goal: Goal::at_rest(1.0, 3.0, 2.0), ..Maneuver::forward_drive() };
    let sets: [fn(&mut Maneuver, f64); 7] = [
        |maneuver, share| maneuver.limits.speed = Some(3.0 * share),
        |maneuver, share| maneuver.limits.wheel_rate = Some(50.0 * share),
        |maneuver, share| maneuver.limits.yaw_rate = Some(4.0 * share),
        |maneuver, share| maneuver.limits.acceleration = Some(5.0 * share),
        |maneuver, share| maneuver.limits.deceleration = Some(5.0 * share),
        |maneuver, share| maneuver.limits.yaw_acceleration = Some(20.0 * share),
        |maneuver, share| maneuver.limits.grip_utilization = Some(0.9 * share),
    ];
    for slip in [SlipPolicy::Allowed, SlipPolicy::Forbidden] {
        maneuver.slip = slip;
        for (index, set) in sets.into_iter().enumerate() {
            let mut last = 0.0;
            for share in [1.0, 0.7, 0.4, 0.2, 0.1, 0.05] {
                let mut limited = maneuver;
                set(&mut limited, share);
                let time = bound(&limited).time;
                // The search ends within a share of 1e-5.
                assert!(time >= last * (1.0 - 2e-5), "{index} {slip:?} {share}: {time} {last}");
                last = time;
            }
        }
    }
}

/// A point at rest at every node, for which the chassis centre of mass goes round it: how far it comes nevertheless, per distance.
fn way_along_chords(rates: &[f64], dt: f64) -> f64 {
    let turn = |angle: f64| Complex::from_polar(1.0, angle);
    let (mut heading, mut place, mut velocity) = (0.0, Complex::<f64>::ZERO, -Complex::I * rates[0]);
    for pair in rates.windows(2) {
        let middle = heading + 0.5 * dt * pair[0];
        let next = -Complex::I * pair[1] * turn(middle);
        place += 0.5 * dt * (velocity + next);
        (heading, velocity) = (middle + 0.5 * dt * pair[1], next);
    }
    let way: Complex<f64> = place + turn(heading) - turn(0.0);
    way.norm()
}

#[test]
fn a_point_at_rest_comes_no_further_than_along_chords() {
    let (mut nearest_each, mut nearest_by_parts) = (0.0_f64, 0.0_f64);
    for seed in 0..2_000 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let (steps, duration) = (rng.random_range(1..400), 10.0_f64.powf(rng.random_range(-2.0..1.0)));
        let dt = duration / steps as f64;
        let mut maneuver = Maneuver { goal: Goal::default(), ..Maneuver::forward_drive() };
        maneuver.goal.set(StateComponent::X, Some(1.0));
        maneuver.start.velocity.yaw_rate = (signed(&mut rng, 3.0) / dt).clamp(-1e3, 1e3);
        let input = input(&maneuver, RobotParameters::default());
        let bounds = Bounds::new(&input, Grid::Steps(steps));
        let (error, change) = (bounds.error(duration), bounds.capacity.yaw_acceleration * dt);
        let (mut rate, mut heading) = (maneuver.start.velocity.yaw_rate, 0.0_f64);
        let mut rates = vec![rate];
        let kind = rng.random_range(0..3);
        for _ in 0..steps {
            // Slower and faster by turns gains most.
            let growth = [0.0, rng.random_range(-1.0..1.0), heading.sin().signum()][kind];
            rate = (rate + change * growth).clamp(-error.peak_yaw_rate, error.peak_yaw_rate);
            heading += rate * dt;
            rates.push(rate);
        }
        let (way, bound) = (way_along_chords(&rates, dt), error.of_chords());
        assert!(way <= bound * (1.0 + 1e-9) + 1e-12, "{seed}: {way} {bound}");
        let each = 0.5 * dt * error.peak_yaw_rate.powi(2) * duration;
        let nearest = if bound < each { &mut nearest_by_parts } else { &mut nearest_each };
        *nearest = nearest.max(way / bound);
    }
    assert!(nearest_each > 0.9 && nearest_by_parts > 0.9, "{nearest_each} {nearest_by_parts}");
}
