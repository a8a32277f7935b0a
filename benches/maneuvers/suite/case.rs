//! Cases: requests of the public contract, accepted as the service accepts them.
//!
//! `robots.json` names robots (`robot`) and what their maneuvers have in common (`maneuver`, such as torque limits);
//! `cases.json` lists maneuvers as `robot/maneuver` with the fields that differ. Both use the contract's names.

use std::collections::BTreeMap;
use std::fs;

use anyhow::{Context as _, Result, anyhow, bail, ensure};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use slipdrive::contract::Problem;
use slipdrive::jobs::simulate::Simulate;
use slipdrive::jobs::solve::{AcceptedSolve, Solve};
use slipdrive::jobs::{Kind as _, Limits};
use slipdrive::motion::{Simulation, simulate};
use slipdrive::robot::PerWheel;
use slipdrive::simulation::TorqueSchedule;
use slipdrive::stop::Stop;

use super::{CONTROL_COUNT, NORMAL_LOAD_SHARE, STEP_COUNT, path_of};

/// The robots of the suite by name.
pub(super) type Robots = BTreeMap<String, RobotEntry>;

/// One robot of the suite.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RobotEntry {
    /// What it stands for.
    #[expect(dead_code, reason = "for those who read the file")]
    about: String,
    /// The request's `robot`.
    robot: Value,
    /// What all its maneuvers have in common.
    #[serde(default)]
    maneuver: Map<String, Value>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CaseEntry {
    name: String,
    maneuver: Map<String, Value>,
}

/// One maneuver of one robot.
#[derive(Debug, Clone)]
pub(crate) struct Case {
    /// `robot/maneuver`.
    pub(crate) name: String,
    /// The body of `/solve`.
    pub(crate) body: Value,
    /// The body, validated.
    pub(crate) accepted: AcceptedSolve,
}

impl RobotEntry {
    /// The body of `/solve` for a maneuver of this robot.
    pub(crate) fn body(&self, maneuver: Map<String, Value>) -> Value {
        let mut whole = self.maneuver.clone();
        whole.extend(maneuver);
        // The best-known plans were found with this share.
        whole.entry("limits").or_insert_with(|| json!({ "normal_load_share": NORMAL_LOAD_SHARE }));
        let grid = json!({ "steps": STEP_COUNT, "control_intervals": CONTROL_COUNT });
        json!({ "robot": self.robot, "maneuver": whole, "grid": grid })
    }

    /// The torque limits of this robot's maneuvers, N m.
    pub(crate) fn torque_limit(&self) -> PerWheel<f64> {
        let limit = |field: &str| self.maneuver.get(field).and_then(Value::as_f64).unwrap_or(1.0);
        PerWheel::new(limit("torque_limit_left_n_m"), limit("torque_limit_right_n_m"))
    }
}

impl Case {
    /// Reads a body of `/solve`.
    ///
    /// # Errors
    /// What the service would answer to a bad request.
    pub(crate) fn new(name: String, body: Value) -> Result<Self> {
        let accepted = Solve::read(&serde_json::to_vec(&body)?, &Limits::default()).map_err(|e| refusal(&name, &e))?;
        Ok(Self { name, body, accepted })
    }

    /// What `/simulate` answers to this case's start with a torque schedule of the contract (`torque_schedule`).
    ///
    /// # Errors
    /// What the service would answer to a bad request.
    pub(crate) fn simulated_over_the_wire(&self, torque_schedule: &Value, step_count: usize) -> Result<Simulation> {
        let body = simulate_body(&self.body, torque_schedule, step_count as u64);
        let accepted = Simulate::read(&serde_json::to_vec(&body)?, &Limits::default());
        let accepted = accepted.map_err(|problem| refusal(&self.name, &problem))?;
        Ok(simulate(&accepted.input, Stop::never()).expect("nothing stops it"))
    }

    /// As [`Case::simulated_over_the_wire`] on the case's own grid, without rounding of the interval.
    pub(crate) fn simulated(&self, schedule: &TorqueSchedule) -> Simulation {
        let asked = &self.accepted.input;
        let input = asked.motion_of(schedule.clone(), STEP_COUNT);
        simulate(&input, Stop::never()).expect("nothing stops it")
    }

    /// Largest magnitude of the goal errors at the end of a simulation (m, rad, m/s, rad/s).
    pub(crate) fn largest_goal_error(&self, simulation: &Simulation) -> f64 {
        self.accepted.input.maneuver.goal_error(&simulation.trajectory.end_state).amax()
    }
}

/// The body of `/simulate` for torques that answer a body of `/solve`.
pub(crate) fn simulate_body(solve: &Value, torque_schedule: &Value, steps: u64) -> Value {
    let maneuver = &solve["maneuver"];
    json!({
        "robot": solve["robot"],
        "reference_point": maneuver.get("reference_point").unwrap_or(&json!("chassis_center_of_mass")),
        "start": maneuver.get("start").unwrap_or(&json!({})),
        "torque_schedule": torque_schedule,
        "grid": { "steps": steps },
    })
}

/// Reads all robots and all cases, in the order of the file.
///
/// # Errors
/// Unreadable files, unknown robots, names that are used twice, bodies that the service would refuse.
pub(crate) fn read_cases() -> Result<(Robots, Vec<Case>)> {
    let robots: Robots = reading("robots.json")?;
    let entries: Vec<CaseEntry> = reading("cases.json")?;
    let mut cases: Vec<Case> = Vec::with_capacity(entries.len());
    for CaseEntry { name, maneuver } in entries {
        ensure!(cases.iter().all(|case| case.name != name), "the case `{name}` is listed twice");
        let Some((robot, _)) = name.split_once('/') else { bail!("the case `{name}` names no robot") };
        let robot = robots.get(robot).with_context(|| format!("the robot of case `{name}` is not listed"))?;
        let body = robot.body(maneuver);
        cases.push(Case::new(name, body)?);
    }
    Ok((robots, cases))
}

/// Reads a JSON file of the suite.
///
/// # Errors
/// A file that cannot be read, or that is not what it should be.
pub(super) fn reading<T: for<'a> Deserialize<'a>>(file: &str) -> Result<T> {
    let path = path_of(file);
    let text = fs::read_to_string(&path).with_context(|| format!("{} cannot be read", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is malformed", path.display()))
}

fn refusal(name: &str, problem: &Problem) -> anyhow::Error {
    let faults: Vec<&str> = problem.errors().iter().map(|error| error.message.as_str()).collect();
    anyhow!("the case `{name}` is refused: {problem}: {}", faults.join("; "))
}
