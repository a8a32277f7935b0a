//! The requests: every case of the suite and some random maneuvers, each varied by its place in the list.
//!
//! Few starts and a limit on rollouts keep them short; the time limit is so long that it decides nothing.

use anyhow::Result;
use serde_json::{Value, json};

use crate::arguments::{RandomArguments, Selection};
use crate::random;
use crate::suite::{Case, read_cases};

/// How long, s, and on how many steps a robot without a plan is simulated: without torque.
pub(super) const COASTING_S: f64 = 0.5;
pub(super) const COASTING_STEPS: u32 = 100;

/// Random maneuvers: their number, their seed, and what they are chosen from.
const RANDOM_COUNT: usize = 24;
const RANDOM_SEED: u64 = 271_828;
const RANDOM_KINDS: usize = 10;
const RANDOM_OF_EACH_ROBOT: usize = 4;
/// One motion in so many is simulated with the paper's contact solver, which is slow, on few steps.
const FIXED_POINT_EVERY: usize = 7;
const FIXED_POINT_STEPS: u32 = 50;

/// A request of a plan, and how the motion under it is asked for.
pub(super) struct Request {
    /// The maneuver and how it is varied.
    pub(super) name: String,
    /// The body of `/solve`.
    pub(super) body: Value,
    /// Steps of the paper's contact solver; else the default one simulates on the grid of the plan.
    pub(super) fixed_point_steps: Option<u32>,
}

/// A name and what it changes in the body.
type Variation = (&'static str, fn(&mut Value));

const SUITE: Variation = ("suite", |_| {});
const PLAN: Variation = ("plan", |body| body["view"] = json!("plan"));
const AXLE: Variation = ("axle", |body| body["maneuver"]["reference_point"] = json!("axle_midpoint"));
const AUTOMATIC: Variation = ("automatic", |body| body["grid"] = json!({}));
const COARSE: Variation = ("coarse", |body| body["grid"] = json!({ "steps": 120, "control_intervals": 30 }));
const GUESS: Variation = ("guess", |body| body["initial_guess"] = guess(body));
const SETTINGS: Variation = ("settings", set_everything);
const NELDER_MEAD: Variation = ("nelder-mead", |body| {
    body["solver"]["method"] = json!("nelder_mead");
    body["solver"]["rollout_limit"] = json!(2_000);
});
const NO_TORQUE: Variation = ("no-torque", |body| {
    body["maneuver"]["torque_limit_left_n_m"] = json!(0.0);
    body["maneuver"]["torque_limit_right_n_m"] = json!(0);
});
const NO_FRICTION: Variation = ("no-friction", |body| body["robot"]["wheel_friction_coefficient"] = json!(0.0));

/// They take turns: 25 and the 18 maneuvers that robots share have no common factor, so that each meets many of them.
const TURN: [Variation; 25] = [
    SUITE,
    AUTOMATIC,
    PLAN,
    GUESS,
    AXLE,
    SUITE,
    SETTINGS,
    COARSE,
    GUESS,
    PLAN,
    NELDER_MEAD,
    SUITE,
    AXLE,
    NO_TORQUE,
    GUESS,
    SETTINGS,
    PLAN,
    SUITE,
    COARSE,
    AXLE,
    NO_FRICTION,
    GUESS,
    SUITE,
    SETTINGS,
    PLAN,
];

/// All requests in their order.
///
/// # Errors
/// Files that cannot be read.
pub(super) fn all() -> Result<Vec<Request>> {
    let (_, suite) = read_cases()?;
    let cases = suite.into_iter().chain(random_cases()?);
    Ok(cases.enumerate().map(|(index, case)| Request::new(index, case)).collect())
}

/// Another four kinds of each robot.
fn random_cases() -> Result<Vec<Case>> {
    let arguments = RandomArguments { selection: Selection::default(), per_robot: RANDOM_KINDS, seed: RANDOM_SEED };
    let cases = random::maneuvers(&arguments)?;
    let chosen = (0..RANDOM_COUNT).map(|index| index / RANDOM_OF_EACH_ROBOT * RANDOM_KINDS + index % RANDOM_KINDS);
    Ok(chosen.map(|index| cases[index].clone()).collect())
}

impl Request {
    fn new(index: usize, case: Case) -> Self {
        let (variation, vary) = TURN[index % TURN.len()];
        let mut body = case.body;
        body["solver"] = json!({ "starts": 2, "time_limit_s": 60, "rollout_limit": 20_000 });
        vary(&mut body);
        let is_fixed_point = index.is_multiple_of(FIXED_POINT_EVERY);
        let fixed_point_steps = is_fixed_point.then_some(FIXED_POINT_STEPS);
        Self { name: format!("{}:{variation}", case.name), body, fixed_point_steps }
    }
}

/// Full speed ahead, then full brake.
fn guess(body: &Value) -> Value {
    let torques = |field: &str| {
        let limit = body["maneuver"][field].as_f64().unwrap_or(1.0);
        [vec![limit; 10], vec![-limit; 10]].concat()
    };
    json!({
        "final_time_s": 3.5,
        "torque_left_n_m": torques("torque_limit_left_n_m"),
        "torque_right_n_m": torques("torque_limit_right_n_m"),
    })
}

/// Every setting of the search, and the defaults that may be named.
fn set_everything(body: &mut Value) {
    body["view"] = json!("full");
    body["maneuver"]["reference_point"] = json!("chassis_center_of_mass");
    body["solver"] = json!({
        "method": "sequential_linear",
        "starts": 3,
        "seed": 7,
        "time_limit_s": 60.0,
        "rollout_limit": 5_000,
        "goal_tolerance": 1e-8,
        "replay_tolerance_m": 5e-4,
        "replay_tolerance_rad": 2e-3,
    });
}
