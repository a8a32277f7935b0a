//! Maneuvers on robots that the suite does not have, fresh ones for each seed.
//!
//! Kinds take turns, and each maneuver has a robot of its own (`robots.rs`). Torque limits are 0.3 to 5 times what the wheels
//! can pass on at rest, log-uniform. Most kinds are those of `benches/maneuvers/draw.rs`; of its own the referee has:
//!
//! | kind | start | goal |
//! |---|---|---|
//! | nudge | rest | 5 um to 20 cm any way, same heading |
//! | long | rest | 50 to 1,000 m ahead or behind |
//! | strong | rest | pose, torque limits 5 to 20 times what the wheels can pass on |
//! | curve | rest | pose, rolling on a curve at up to 1 m/s and 1 rad/s: all rates of the chassis centre of mass |
//! | axle-curve | rest | the same of the axle midpoint |
//!
//! Goals on a curve ask for what planners do: exact rolling, all rates to six decimals.
//!
//! On request the robots have motors in place of torque limits. They have four times as much torque at standstill, 1.2 to 80 times what
//! the wheels can pass on, and turn the wheels without load at 0.1 to 3 times the speed sqrt(g w) of the robot, log-uniform. These
//! maneuvers begin and end at rest, and none of them is long: a motor may never get to a speed, or take hours.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use slipdrive::contract::message;
use slipdrive::robot::{PerWheel, Robot, RobotParameters};

use crate::draw::{self, Draw, log_uniform, object, sign, within};
use crate::robots::drawn_robot;
use crate::rounding::{to_six_decimals, with_rounded_numbers};
use crate::suite::{CONTROL_COUNT, Case, STEP_COUNT};

/// The kinds that `draw.rs` does not have, or only smaller.
const OWN_KINDS: [&str; 5] = ["nudge", "long", "strong", "curve", "axle-curve"];
/// Kinds from rest to rest over a short way.
const SHORT_KINDS: [&str; 8] = ["straight", "turn", "pose", "free", "unequal", "axle", "nudge", "strong"];
/// How many times its torque limit the motor of a robot has at standstill.
const STALL_MULTIPLE: f64 = 4.0;
/// Share of the friction that rolling on the goal's curve may need.
const CURVE_GRIP: f64 = 0.5;

/// A maneuver by name.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Maneuver {
    pub(crate) name: String,
    /// The body of `POST /solve`.
    pub(crate) request: Value,
}

/// What bounds the torques of drawn robots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Drive {
    /// The torque limits of the maneuvers.
    TorqueLimits,
    /// Motors.
    Motors,
}

/// The maneuvers of a seed; more of them begin with the same ones.
pub(crate) fn drawn_maneuvers(seed: u64, count: usize, drive: Drive) -> Vec<Maneuver> {
    let known = draw::KINDS.into_iter().filter(|kind| !OWN_KINDS.contains(kind));
    let (set, kinds): (String, Vec<&str>) = match drive {
        Drive::TorqueLimits => (seed.to_string(), known.chain(OWN_KINDS).collect()),
        Drive::Motors => (format!("motors-{seed}"), SHORT_KINDS.to_vec()),
    };
    (0..count)
        .map(|index| {
            // A sequence for each maneuver: a rule that refuses one robot more leaves all other maneuvers as they are.
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
            (0..index).for_each(|_| rng.jump());
            let kind = kinds[index % kinds.len()];
            accepted_maneuver(&format!("{set}/{index:03}-{kind}"), (kind, drive), &mut rng)
        })
        .collect()
}

/// Draws until the rules for requests accept the robot and the maneuver.
fn accepted_maneuver(name: &str, (kind, drive): (&str, Drive), rng: &mut Xoshiro256PlusPlus) -> Maneuver {
    loop {
        let Ok(robot) = Robot::new(drawn_robot(rng)) else { continue };
        let mut request = request(kind, &robot, rng);
        if drive == Drive::Motors {
            give_motors(&mut request, robot.parameters(), rng);
        }
        let request = with_rounded_numbers(request);
        if Case::new(name.to_owned(), request.clone()).is_ok() {
            return Maneuver { name: name.to_owned(), request };
        }
    }
}

fn request(kind: &str, robot: &Robot, rng: &mut Xoshiro256PlusPlus) -> Value {
    let parameters = robot.parameters();
    let strength = if kind == "strong" { 5.0..20.0 } else { 0.3..5.0 };
    let limit = log_uniform(rng, strength) * grip_torque(robot);
    let mut maneuver = object(&[("torque_limit_left_n_m", limit), ("torque_limit_right_n_m", limit)]);
    let mut draw = Draw { rng, parameters, torque_limit: PerWheel::new(limit, limit) };
    maneuver.extend(match kind {
        "nudge" => to(draw.position(5e-6..0.2)),
        "long" => to(object(&[("y_m", sign(draw.rng) * log_uniform(draw.rng, 50.0..1e3))])),
        "strong" => to(draw.pose()),
        "curve" => to(on_a_curve(&mut draw, -parameters.axle_midpoint())),
        "axle-curve" => {
            let mut maneuver = to(on_a_curve(&mut draw, [0.0, 0.0].into()));
            maneuver.insert("reference_point".to_owned(), json!("axle_midpoint"));
            maneuver
        }
        shared => draw.maneuver(shared),
    });
    json!({
        "robot": message::Robot::from(parameters),
        "maneuver": maneuver,
        "grid": { "steps": STEP_COUNT, "control_intervals": CONTROL_COUNT },
    })
}

/// Puts motors in the place of the torque limits.
fn give_motors(request: &mut Value, robot: &RobotParameters, rng: &mut Xoshiro256PlusPlus) {
    let maneuver = request["maneuver"].as_object_mut().expect("a maneuver is an object");
    let limits = ["torque_limit_left_n_m", "torque_limit_right_n_m"].map(|field| maneuver.remove(field));
    let torque_limit = limits.iter().flatten().filter_map(Value::as_f64).fold(0.0, f64::max);
    let rim_speed = log_uniform(rng, 0.1..3.0) * robot.track_width / robot.natural_time();
    request["robot"]["motor_stall_torque_n_m"] = json!(STALL_MULTIPLE * torque_limit);
    request["robot"]["motor_free_speed_rad_s"] = json!(rim_speed / robot.wheel_radius);
}

/// The torque that a wheel can pass on at rest, N m; the mean of both wheels.
fn grip_torque(robot: &Robot) -> f64 {
    let RobotParameters { wheel_friction_coefficient, wheel_radius, .. } = *robot.parameters();
    let force = robot.normal_force_projection().static_force;
    wheel_friction_coefficient * wheel_radius * 0.5 * (force[0] + force[1])
}

fn to(goal: Map<String, Value>) -> Map<String, Value> {
    Map::from_iter([("goal".to_owned(), Value::Object(goal))])
}

/// A pose in which the robot rolls on a curve; `point` is what the velocity is of, from the axle midpoint (right, forward; m).
fn on_a_curve(draw: &mut Draw<'_>, point: nalgebra::Vector2<f64>) -> Map<String, Value> {
    let RobotParameters { wheel_friction_coefficient, gravity, .. } = *draw.parameters;
    let mut goal = draw.pose();
    let heading = goal["heading_rad"].as_f64().unwrap_or_default();
    let speed = within(draw.rng, 1.0);
    let fastest_turn = (CURVE_GRIP * wheel_friction_coefficient * gravity / speed.abs()).min(1.0);
    let yaw_rate = within(draw.rng, fastest_turn);
    let (sin, cos) = heading.sin_cos();
    let (right, forward) = (-yaw_rate * point.y, speed + yaw_rate * point.x);
    let mut rates = draw.rolling(speed, yaw_rate);
    rates.extend(object(&[
        ("velocity_x_m_s", cos * right - sin * forward),
        ("velocity_y_m_s", sin * right + cos * forward),
    ]));
    goal.extend(rates.into_iter().map(|(field, rate)| (field, json!(rate.as_f64().map(to_six_decimals)))));
    goal
}

/// Writes maneuvers, one to a line.
///
/// # Errors
/// A file that cannot be written.
pub(crate) fn write(maneuvers: &[Maneuver], path: &Path) -> Result<()> {
    let lines: Vec<String> = maneuvers.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
    fs::write(path, lines.join("\n") + "\n").with_context(|| format!("{} cannot be written", path.display()))
}

/// Reads what [`write`] wrote.
///
/// # Errors
/// A file that cannot be read, or that is not what it should be.
pub(crate) fn read(path: &Path) -> Result<Vec<Maneuver>> {
    let text = fs::read_to_string(path).with_context(|| format!("{} cannot be read", path.display()))?;
    let maneuvers: Result<_, _> = text.lines().map(serde_json::from_str).collect();
    maneuvers.with_context(|| format!("{} is malformed", path.display()))
}
