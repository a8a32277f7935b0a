//! Maneuvers with limits: random ones of five robots, each against the same maneuver without limits.
//!
//! Limits are drawn as shares of what the plan without limits uses, so that they bind:
//!
//! | limit | in one of | drawn |
//! |---|---|---|
//! | `slip: forbidden` | 3 | - |
//! | `grip_utilization` | 5 | 0.6 to 0.95 |
//! | motor | 3 | stall torque 1 to 2 times the torque limit, free speed 0.7 to 1.5 times the largest wheel rate |
//! | wheel rate, speed, yaw rate | 4 each | 0.5 to 0.95 of the largest |
//! | acceleration and deceleration, yaw acceleration | 6 each | 0.4 to 0.9 of the largest |
//! | torque rate | 8 | from one limit to the other in 0.03 to 0.2 of the plan |
//! | payload | 5 | up to half of the chassis mass, near its centre |
//! | aisle | 6 | a rectangle in which the robot can turn at start and goal, with 2 to 30 % to spare |
//!
//! The maneuvers are those of `draw.rs` from rest to rest; `no-slip` has all of them without slip, with speed and motor limits.

use anyhow::Result;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Value, json};
use slipdrive::motion::{LimitUse, SimulateInput, simulate};
use slipdrive::shooting::ManeuverLimits;
use slipdrive::simulation::{EndSensitivity, FrictionLaw, Rollout, Simulator};
use slipdrive::solver::{RunControl, Solution, SolveInput, Status, solve};
use slipdrive::stop::Stop;

use crate::arguments::{Effort, LimitedArguments};
use crate::draw::{Draw, log_uniform, within};
use crate::report::quantile;
use crate::suite::{CONTROL_COUNT, Case, read_cases};
use crate::timing::shortest_ms;

const ROBOTS: [&str; 5] = ["reference", "warehouse", "grippy", "offset", "tall"];
/// Kinds whose start and goal are at rest.
const KINDS: [&str; 7] = ["nudge", "straight", "turn", "pose", "free", "unequal", "axle"];
/// What other maneuvers are measured by.
const FORWARD_DRIVE: &str = "reference/forward-5m";
/// A limit is active where a plan uses all but this share of it.
const ACTIVE: f64 = 0.01;
/// What a plan may exceed a limit by on its own grid and on that of the replay, as a share.
const EXCESS: (f64, f64) = (1e-6, 5e-3);

/// One maneuver with and without limits.
struct Comparison {
    name: String,
    limited: Solution,
    limited_ms: f64,
    free: Solution,
    free_ms: f64,
    active_share: f64,
}

/// Solves random maneuvers with limits and prints a line for each that is not as it should be, and a summary.
///
/// # Errors
/// Files that cannot be read, or a request that the service would refuse.
pub(crate) fn run(arguments: &LimitedArguments, effort: &Effort) -> Result<()> {
    let (robots, suite) = read_cases()?;
    let mut comparisons = Vec::new();
    for (number, name) in (0_u64..).zip(ROBOTS) {
        let prefix = format!("{name}/");
        let parameters = suite.iter().find(|case| case.name.starts_with(&prefix));
        let parameters = parameters.map(|case| *case.accepted.input.robot.parameters()).unwrap_or_default();
        let torque_limit = robots[name].torque_limit();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(arguments.seed.wrapping_mul(5) + number);
        for index in 0..arguments.per_robot {
            let kind = KINDS[index % KINDS.len()];
            let maneuver = Draw { rng: &mut rng, parameters: &parameters, torque_limit }.maneuver(kind);
            let free = Case::new(format!("{name}/{kind}-{index}"), robots[name].body(maneuver))?;
            let comparison = Comparison::of(&free, arguments, effort, &mut rng)?;
            if comparison.is_remarkable() || arguments.all {
                comparison.print();
            }
            comparisons.push(comparison);
        }
    }
    summarise(&comparisons);
    let forward_drive = suite.iter().find(|case| case.name == FORWARD_DRIVE);
    if let Some(forward_drive) = forward_drive {
        let input = asked(forward_drive, effort);
        let (_, forward_drive_ms) = shortest_ms(5, || solved(&input));
        let ratios: Vec<f64> = comparisons.iter().map(|each| each.limited_ms / forward_drive_ms).collect();
        print_quantiles(&format!("CPU against {FORWARD_DRIVE} without limits, {forward_drive_ms:.1} ms"), ratios);
    }
    Ok(())
}

impl Comparison {
    fn of(case: &Case, arguments: &LimitedArguments, effort: &Effort, rng: &mut Xoshiro256PlusPlus) -> Result<Self> {
        let free_input = asked(case, effort);
        let (free, free_ms) = shortest_ms(1, || solved(&free_input));
        let used = Used::of(case, &free);
        let body = if arguments.no_slip { no_slip(case, &used, rng) } else { limited(case, &used, rng) };
        let input = asked(&Case::new(case.name.clone(), body.clone())?, effort);
        let (limited, limited_ms) = shortest_ms(1, || solved(&input));
        let active_share = active_share(&input, &limited);
        let name = format!("{} {}", case.name, body["maneuver"]["limits"]);
        Ok(Self { name, limited, limited_ms, free, free_ms, active_share })
    }

    fn ratio(&self) -> f64 {
        self.limited_ms / self.free_ms
    }

    fn excess(&self) -> (f64, f64) {
        let limits = &self.limited.report.limits;
        let of = |excess: fn(&LimitUse) -> f64| limits.iter().map(excess).fold(f64::MIN, f64::max);
        (of(|used| used.excess), of(|used| used.replay_excess.unwrap_or(f64::MAX)))
    }

    fn is_remarkable(&self) -> bool {
        self.limited.status != Status::Converged || self.ratio() > 15.0 || self.excess().0 > EXCESS.0
    }

    fn print(&self) {
        let (excess, replay_excess) = self.excess();
        println!(
            "{:<13} {:>9.4} s (free {:>9.4}) {:>8.1} ms (free {:>7.1}) {:>5} rollouts active {:>3.0} % excess {excess:+.1e} replay \
             {replay_excess:+.1e}  {}",
            self.limited.status.as_str(),
            self.limited.schedule.final_time,
            self.free.schedule.final_time,
            self.limited_ms,
            self.free_ms,
            self.limited.report.rollouts,
            1e2 * self.active_share,
            self.name,
        );
    }
}

/// The largest values of a plan.
struct Used {
    wheel_rate: f64,
    speed: f64,
    yaw_rate: f64,
    acceleration: f64,
    yaw_acceleration: f64,
    final_time: f64,
}

impl Used {
    fn of(case: &Case, plan: &Solution) -> Self {
        let asked = &case.accepted.input;
        let limits = ManeuverLimits {
            wheel_rate: Some(1e5),
            speed: Some(100.0),
            yaw_rate: Some(1e3),
            acceleration: Some(1e4),
            deceleration: Some(1e4),
            yaw_acceleration: Some(1e6),
            ..ManeuverLimits::default()
        };
        let motion = asked.motion_of(plan.schedule.clone(), plan.report.step_count);
        let input = SimulateInput { limits, aisle: None, ..motion };
        let simulation = simulate(&input, Stop::never()).expect("nothing stops it");
        let largest = |field: &str| {
            let of = simulation.limits.iter().filter(|used| used.limit.ends_with(field));
            of.map(|used| used.largest).fold(0.0, f64::max)
        };
        Self {
            wheel_rate: largest("wheel_rate_rad_s"),
            speed: largest("speed_m_s"),
            yaw_rate: largest(".yaw_rate_rad_s"),
            acceleration: largest("acceleration_m_s2"),
            yaw_acceleration: largest("yaw_acceleration_rad_s2"),
            final_time: plan.schedule.final_time,
        }
    }
}

/// The request with all that binds without slip.
fn no_slip(case: &Case, used: &Used, rng: &mut Xoshiro256PlusPlus) -> Value {
    let mut body = case.body.clone();
    body["maneuver"]["slip"] = json!("forbidden");
    body["maneuver"]["limits"]["speed_m_s"] = json!(rng.random_range(0.5..0.95) * used.speed.max(1e-2));
    add_motor(&mut body, case, used, rng);
    body
}

fn limited(case: &Case, used: &Used, rng: &mut Xoshiro256PlusPlus) -> Value {
    let mut body = case.body.clone();
    let one_in = |rng: &mut Xoshiro256PlusPlus, count: u32| rng.random_ratio(1, count);
    if one_in(rng, 3) {
        body["maneuver"]["slip"] = json!("forbidden");
    }
    if one_in(rng, 5) {
        body["maneuver"]["limits"]["grip_utilization"] = json!(rng.random_range(0.6..0.95));
    }
    if one_in(rng, 3) {
        add_motor(&mut body, case, used, rng);
    }
    for (fields, largest, count, from, to) in [
        (&["wheel_rate_rad_s"][..], used.wheel_rate, 4, 0.5, 0.95),
        (&["speed_m_s"], used.speed, 4, 0.5, 0.95),
        (&["yaw_rate_rad_s"], used.yaw_rate, 4, 0.5, 0.95),
        (&["acceleration_m_s2", "deceleration_m_s2"], used.acceleration, 6, 0.4, 0.9),
        (&["yaw_acceleration_rad_s2"], used.yaw_acceleration, 6, 0.4, 0.9),
    ] {
        if one_in(rng, count) {
            for field in fields {
                body["maneuver"]["limits"][*field] = json!(rng.random_range(from..to) * largest.max(1e-2));
            }
        }
    }
    if one_in(rng, 8) {
        let torque = case.accepted.input.maneuver.torque_limit;
        let time = log_uniform(rng, 0.03..0.2) * used.final_time;
        body["maneuver"]["limits"]["torque_rate_n_m_s"] = json!(2.0 * torque.left.max(torque.right) / time);
    }
    if one_in(rng, 5) {
        add_payload(&mut body, case, rng);
    }
    if one_in(rng, 6) {
        add_aisle(&mut body, case, rng);
    }
    body
}

fn add_motor(body: &mut Value, case: &Case, used: &Used, rng: &mut Xoshiro256PlusPlus) {
    let torque = case.accepted.input.maneuver.torque_limit;
    body["robot"]["motor_stall_torque_n_m"] = json!(rng.random_range(1.0..2.0) * torque.left.max(torque.right));
    body["robot"]["motor_free_speed_rad_s"] = json!(rng.random_range(0.7..1.5) * used.wheel_rate.max(1e-1));
}

fn add_payload(body: &mut Value, case: &Case, rng: &mut Xoshiro256PlusPlus) {
    let robot = case.accepted.input.robot.parameters();
    let mass = rng.random_range(0.0..0.5) * robot.chassis_mass;
    body["payload"] = json!({
        "mass_kg": mass,
        "right_m": robot.center_of_mass_right + within(rng, 0.05 * robot.track_width),
        "forward_m": robot.center_of_mass_forward + within(rng, 0.05 * robot.axle_to_front_support),
        "height_m": robot.center_of_mass_height,
        "yaw_inertia_kg_m2": mass * (0.3 * robot.track_width).powi(2),
    });
}

/// A footprint around the contacts, and a rectangle in which it can turn at start and goal.
fn add_aisle(body: &mut Value, case: &Case, rng: &mut Xoshiro256PlusPlus) {
    let input = &case.accepted.input;
    let robot = input.robot.parameters();
    let (half, back, front) = (0.6 * robot.track_width, -robot.wheel_radius, robot.axle_to_front_support);
    let corner = |right: f64, forward: f64| json!({ "right_m": right, "forward_m": forward });
    body["robot"]["footprint"] =
        json!([corner(-half, back), corner(half, back), corner(half, front), corner(-half, front)]);
    // Everything within this distance of the reference point, whichever that is.
    let reach = half.hypot(front) + robot.center_of_mass_right.hypot(robot.center_of_mass_forward);
    let room = reach * rng.random_range(1.02..1.3);
    let goal = |component| input.maneuver.goal.value(component);
    let [x, y] = [slipdrive::shooting::StateComponent::X, slipdrive::shooting::StateComponent::Y].map(goal);
    let (Some(x), Some(y)) = (x, y) else { return };
    let (left, right, low, high) = (x.min(0.0) - room, x.max(0.0) + room, y.min(0.0) - room, y.max(0.0) + room);
    let place = |x: f64, y: f64| json!({ "x_m": x, "y_m": y });
    body["maneuver"]["keep_in"] = json!([place(left, low), place(right, low), place(right, high), place(left, high)]);
}

/// The share of the control intervals in which some limit is active.
fn active_share(input: &SolveInput, plan: &Solution) -> f64 {
    let limits = input.path_limits();
    if plan.schedule.control_count() == 0 || limits.path.is_empty() {
        return 0.0;
    }
    let start = input.maneuver.start_at_center_of_mass(input.robot.parameters());
    let step_count = plan.report.step_count;
    let rollout = Rollout { start: &start, schedule: &plan.schedule, step_count };
    let law = if limits.forbids_slip { FrictionLaw::Held(0.0) } else { FrictionLaw::Exact };
    let mut motion = EndSensitivity::watching(limits.quantities(), CONTROL_COUNT);
    Simulator::new(&input.robot).record(&rollout, law, &mut motion, Stop::never()).expect("nothing stops it");
    let mut is_active = [false; CONTROL_COUNT];
    for (limit, index) in motion.path.of_others() {
        if limits.path[limit].excess(motion.path.value(index)) > -ACTIVE {
            is_active[slipdrive::simulation::control_interval(motion.path.step(index), step_count, CONTROL_COUNT)] =
                true;
        }
    }
    is_active.iter().filter(|active| **active).count() as f64 / CONTROL_COUNT as f64
}

fn summarise(comparisons: &[Comparison]) {
    let count = comparisons.len();
    let of = |test: &dyn Fn(&Comparison) -> bool| comparisons.iter().filter(|each| test(each)).count();
    println!("\n{count} maneuvers: {} converged", of(&|each| each.limited.status == Status::Converged));
    println!("some limit active for a tenth of the time: {}", of(&|each| each.active_share >= 0.1));
    println!(
        "limits exceeded by more than {:.0e} on the plan's grid: {}, by more than {:.1e} on the replay's: {}",
        EXCESS.0,
        of(&|each| each.excess().0 > EXCESS.0),
        EXCESS.1,
        of(&|each| each.excess().1 > EXCESS.1),
    );
    let ratios = comparisons.iter().map(Comparison::ratio).collect();
    print_quantiles("CPU against the same maneuver without limits", ratios);
    print_quantiles("CPU, ms", comparisons.iter().map(|each| each.limited_ms).collect());
}

fn print_quantiles(name: &str, mut values: Vec<f64>) {
    values.sort_by(f64::total_cmp);
    let [median, most, largest] = [0.5, 0.95, 1.0].map(|share| quantile(&values, share));
    println!("{name}: median {median:.2}, 95 % {most:.2}, largest {largest:.2}");
}

fn asked(case: &Case, effort: &Effort) -> SolveInput {
    let mut input = case.accepted.input.clone();
    effort.apply(&mut input.settings);
    input
}

fn solved(input: &SolveInput) -> Solution {
    solve(input, &RunControl::unattended()).expect("nothing stops it")
}
