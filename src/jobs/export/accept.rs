//! Requests of exports: from messages to a plan and how it is handed over.

use std::time::Duration;

use super::ros::Labels;
use crate::contract::Problem;
use crate::contract::convert::{named, required};
use crate::contract::message::{ExportFormat, ExportRequest, Status};
use crate::jobs::Limits;
use crate::jobs::plan::{AcceptedPlan, Said};
use crate::jobs::table::word;
use crate::rules::{Checks, Number, Rule, RuleSet};

const RATE_RULE: Rule = Rule::between(1.0, 10_000.0, "Hz");
/// Most points at the rate asked for, the first and the last included.
pub(super) const MAX_POINTS: f64 = 10_000.0;
/// Seconds are `int32` in messages, and no plan with so few points a second takes as long as what is left.
const SECONDS_RULE: Rule = Rule::between(0.0, 2_147_000_000.0, "s");
const NANOSECONDS_RULE: Rule = Rule::between(0.0, 999_999_999.0, "ns");
const JOINTS_RULE: Rule = Rule::between(2.0, 2.0, Rule::ITEMS);
/// Longest name of a frame or a joint, bytes.
const MAX_NAME: usize = 128;
const NAME_RULE: &str = "1 to 128 bytes without control characters";
const DEFAULT_FRAME: &str = "odom";
const DEFAULT_JOINTS: [&str; 2] = ["left_wheel_joint", "right_wheel_joint"];

/// A plan and how it is handed over.
#[derive(Debug)]
pub struct AcceptedExport {
    pub(super) plan: Box<AcceptedPlan>,
    pub(super) format: ExportFormat,
    /// Hz.
    pub(super) rate: f64,
    pub(super) labels: Labels,
    /// How long it may run; none where no clock ends it.
    pub(super) time_limit: Option<Duration>,
}

impl AcceptedExport {
    /// Points at the rate asked for, about.
    pub(super) fn point_count(&self) -> f64 {
        self.plan.motion.schedule.final_time * self.rate + 1.0
    }
}

pub(super) fn rules() -> RuleSet {
    let of_start = RuleSet::of([("sec", SECONDS_RULE), ("nanosec", NANOSECONDS_RULE)]);
    RuleSet::of([("rate_hz", RATE_RULE), ("joint_names", JOINTS_RULE)])
        .with("start_time", of_start)
        .across(&["solve", "simulate"], "either `solve` or `simulate`, whose request keeps the rules of its kind")
        .across(&["solve.answer", "simulate.answer"], "an answer with a plan")
        .across(&["rate_hz"], "at most 10000 points: the final time of the plan times the rate, and one")
        .across(&["frame_id"], NAME_RULE)
        .across(&["joint_names"], "two different names, each 1 to 128 bytes without control characters")
}

pub(super) fn accept(request: ExportRequest, limits: &Limits) -> Result<AcceptedExport, Problem> {
    let ExportRequest { solve, simulate, format, rate_hz, frame_id, start_time, joint_names } = request;
    let format: ExportFormat = named(format, "format")?;
    let format = required(Some(format).filter(|format| *format != ExportFormat::Unspecified), "format")?;
    let rate = required(rate_hz, "rate_hz")?;
    let start_time = start_time.unwrap_or_default();
    let frame_id = frame_id.unwrap_or_else(|| DEFAULT_FRAME.to_owned());
    let joint_names = if joint_names.is_empty() { DEFAULT_JOINTS.map(str::to_owned).to_vec() } else { joint_names };

    let mut checks = Checks::new();
    checks.bounds("rate_hz", rate, &RATE_RULE);
    check_name("frame_id", &frame_id, &mut checks);
    checks.within("start_time", |checks| {
        checks.bounds("sec", start_time.sec as f64, &SECONDS_RULE);
        checks.bounds("nanosec", start_time.nanosec as f64, &NANOSECONDS_RULE);
    });
    checks.length("joint_names", joint_names.len(), &JOINTS_RULE);
    // Of many names only the number counts.
    for (index, name) in joint_names.iter().enumerate().take(DEFAULT_JOINTS.len()) {
        check_name(&format!("joint_names[{index}]"), name, &mut checks);
    }
    if let [left, right] = joint_names.as_slice() {
        checks.require("joint_names[1]", format!("{right:?}"), left != right, "another name than the first", None);
    }
    let plan = AcceptedPlan::of(solve, simulate, limits);
    let plan = plan.map(|plan| Box::new(plan.without_report()));
    if let Ok(plan) = &plan {
        check_plan(plan, rate, &mut checks);
    }
    let ((), plan) = Problem::both(checks.finish().map_err(Problem::from), plan)?;
    let start_ns = start_time.sec.unsigned_abs() * 1_000_000_000 + start_time.nanosec.unsigned_abs();
    let Ok(joint_names) = <[String; 2]>::try_from(joint_names) else { return required(None, "joint_names") };
    let labels = Labels { start_ns, frame_id, joint_names };
    Ok(AcceptedExport { plan, format, rate, labels, time_limit: limits.light_time_limit() })
}

/// Times in files are whole nanoseconds, s.
const LEAST_INTERVAL_S: f64 = 1e-9;
const INTERVAL_RULE: &str = ">= 1e-9: times in files are whole nanoseconds";

/// That there is a plan, of not too many points.
fn check_plan(plan: &AcceptedPlan, rate: f64, checks: &mut Checks) {
    let final_time = plan.motion.schedule.final_time;
    if let Said::Solve(_, answer) = &plan.said {
        let has_torques = !plan.motion.schedule.left.is_empty();
        let is_plan = match answer.status() {
            // Where the start is the goal the plan is to stay.
            Status::Converged => true,
            Status::Feasible | Status::NotConverged | Status::Unspecified => has_torques,
            Status::Infeasible => false,
        };
        let torques = if has_torques { "" } else { " and there are no torques" };
        let found = format!("{}{torques}", word::<Status>(answer.status()));
        checks.require("solve.answer.status", found, is_plan, "that of a plan", None);
    }
    check_interval(plan, checks);
    let largest = (MAX_POINTS - 1.0) / final_time;
    if RATE_RULE.admits(rate) && final_time * rate > MAX_POINTS - 1.0 {
        let rule =
            format!("at most {} Hz for a plan of {} s: {MAX_POINTS} points", Number(largest), Number(final_time));
        checks.require("rate_hz", Number(rate), false, &rule, Some(largest));
    }
}

/// That no two torques begin at one time.
fn check_interval(plan: &AcceptedPlan, checks: &mut Checks) {
    let schedule = &plan.motion.schedule;
    let field = match plan.said {
        Said::Solve(..) => "solve.answer.torque_schedule.interval_s",
        Said::Simulate(_) => "simulate.request.torque_schedule.interval_s",
    };
    if !schedule.left.is_empty() {
        let interval = schedule.final_time / schedule.left.len() as f64;
        let holds = interval >= LEAST_INTERVAL_S;
        checks.require(field, Number(interval), holds, INTERVAL_RULE, Some(LEAST_INTERVAL_S));
    }
}

fn check_name(field: &str, name: &str, checks: &mut Checks) {
    let holds = (1..=MAX_NAME).contains(&name.len()) && !name.chars().any(char::is_control);
    checks.require(field, format!("{name:?}"), holds, NAME_RULE, None);
}
