//! Requests of assessments: from messages to a plan and what is not known of it.

use std::time::Duration;

use nalgebra::Vector2;

use crate::assessment::{AssessInput, Distribution, Limited, MOST_STEPS};
use crate::contract::Problem;
use crate::contract::convert::{aisle_corners, named, payload, required, robot};
use crate::contract::json::Named;
use crate::contract::message::{self, AssessRequest, Tolerances, Uncertainty};
use crate::jobs::Limits;
use crate::jobs::plan::{AcceptedPlan, Said};
use crate::jobs::table::word;
use crate::motion::{ChangedParameter, Undisturbed};
use crate::robot::{Payload, RobotParameters, check_robot};
use crate::rules::{Checks, Number, Rule, RuleSet};
use crate::shooting::{Aisle, AisleCorners, Goal};
use crate::solver::SolveInput;

const SAMPLES_RULE: Rule = Rule::between(1.0, 10_000.0, "");
const UNCERTAIN_RULE: Rule = Rule::between(1.0, message::ChangedParameter::NAMES.len() as f64, Rule::ITEMS);
const DEFAULT_SAMPLES: u32 = 1_000;
/// From what rollouts round to, to any miss.
const DISTANCE_RULE: Rule = Rule::between(1e-9, 1e4, "m");
const HEADING_RULE: Rule = Rule::between(1e-9, 4.0, "rad");
const SPEED_RULE: Rule = Rule::between(1e-9, 1e4, "m/s");
const TOLERANCES: [(&str, Rule); 5] = [
    ("along_m", DISTANCE_RULE),
    ("across_m", DISTANCE_RULE),
    ("distance_m", DISTANCE_RULE),
    ("heading_rad", HEADING_RULE),
    ("speed_m_s", SPEED_RULE),
];
const FORM_RULE: &str = "either `low` and `high` or `mean` and `standard_deviation`";

/// Beyond four standard deviations above the mean are 3 of 100,000 samples.
const LONGEST_DELAY_FITS: &str =
    "such that the longest delay (`high`, or `mean` and four standard deviations) leaves at most 1000 intervals";

/// A plan and what is not known of it.
#[derive(Debug)]
pub struct AcceptedAssess {
    /// The plan as it was answered.
    pub(super) plan: Box<AcceptedPlan>,
    pub(super) input: AssessInput,
    /// The outline of the robot that drives it (right, forward) from the axle midpoint, m; empty where there is none.
    pub(super) footprint: Vec<Vector2<f64>>,
    /// How long it may run; none where no clock ends it.
    pub(super) time_limit: Option<Duration>,
}

impl AcceptedAssess {
    /// Whether limits are at the root of the request, as a simulation has them.
    pub(super) fn is_simulation(&self) -> bool {
        matches!(self.plan.said, Said::Simulate(_))
    }
}

pub(super) fn rules() -> RuleSet {
    RuleSet::of([("samples", SAMPLES_RULE), ("uncertain", UNCERTAIN_RULE)])
        .with("tolerances", RuleSet::of(TOLERANCES))
        .with("robot", RobotParameters::rules())
        .with("payload", Payload::rules())
        .and(AisleCorners::footprint_rules())
        .across(&["solve", "simulate"], "either `solve` or `simulate`, whose request keeps the rules of its kind")
        .across(&["solve.answer", "simulate.answer"], "an answer with a plan that moves")
        .across(&["tolerances"], "at least one tolerance")
        .across(&["uncertain[].low", "uncertain[].high"], FORM_RULE)
        .across(&["uncertain[].mean", "uncertain[].standard_deviation"], FORM_RULE)
        .across(
            &["uncertain[].low", "uncertain[].high", "uncertain[].mean", "uncertain[].standard_deviation"],
            "of at most 10 as a share, 100 m, 4 rad and 10000 kg; a delay of 0 to 10 s; a standard deviation is not negative",
        )
        .across(&["uncertain[].low", "uncertain[].high"], "`low` is at most `high`")
        .across(&["uncertain[].parameter"], "each parameter once; those of a payload where there is one")
        .across(&["uncertain[].high", "uncertain[].standard_deviation"], LONGEST_DELAY_FITS)
        .across(&["samples"], "at most 20,000,000 steps of all samples together, on the plan's grid")
}

/// What a change of the parameter may be.
const fn rule_of(parameter: ChangedParameter) -> Rule {
    match parameter {
        ChangedParameter::DelayLeft | ChangedParameter::DelayRight => Rule::between(0.0, 10.0, "s"),
        ChangedParameter::StartHeading => Rule::within_magnitude(4.0, "rad"),
        ChangedParameter::PayloadMass => Rule::within_magnitude(1e4, "kg"),
        ChangedParameter::Friction
        | ChangedParameter::Mass
        | ChangedParameter::Torque
        | ChangedParameter::TorqueLeft
        | ChangedParameter::TorqueRight => Rule::within_magnitude(10.0, ""),
        ChangedParameter::CenterOfMassRight
        | ChangedParameter::CenterOfMassForward
        | ChangedParameter::PayloadRight
        | ChangedParameter::PayloadForward
        | ChangedParameter::StartX
        | ChangedParameter::StartY => Rule::within_magnitude(100.0, "m"),
    }
}

pub(super) fn accept(request: AssessRequest, limits: &Limits) -> Result<AcceptedAssess, Problem> {
    let AssessRequest { solve, simulate, robot, payload, uncertain, tolerances, samples, seed } = request;
    let tolerances = required(tolerances, "tolerances")?;
    let samples = samples.unwrap_or(DEFAULT_SAMPLES);
    let mut checks = Checks::new();
    checks.bounds("samples", samples.into(), &SAMPLES_RULE);
    let tolerances = checked_tolerances(tolerances, &mut checks);
    checks.length("uncertain", uncertain.len(), &UNCERTAIN_RULE);
    let uncertain = if UNCERTAIN_RULE.admits(uncertain.len() as f64) {
        checked_uncertain(&uncertain, &mut checks)?
    } else {
        Vec::new()
    };
    let plan = AcceptedPlan::of(solve, simulate, limits);
    let input = match plan {
        Ok(plan) => {
            let (planned, goal, limited, aisle) = made_for(&plan, &mut checks);
            let (driven, sample_count) = (planned.clone(), samples as usize);
            let mut input =
                AssessInput { planned, driven, goal, limited, aisle, uncertain, tolerances, sample_count, seed };
            let footprint = drive_with((robot, payload), &plan.corners, &mut input, &mut checks)?;
            check_together(&input, &mut checks);
            Ok((input, footprint, Box::new(plan.without_report())))
        }
        Err(problem) => {
            check_by_themselves((robot, payload), &mut checks)?;
            Err(problem)
        }
    };
    let ((), (input, footprint, plan)) = Problem::both(checks.finish().map_err(Problem::from), input)?;
    Ok(AcceptedAssess { plan, input, footprint, time_limit: limits.time_limit() })
}

fn checked_tolerances(given: Tolerances, checks: &mut Checks) -> [Option<f64>; 5] {
    let Tolerances { along_m, across_m, distance_m, heading_rad, speed_m_s } = given;
    let tolerances = [along_m, across_m, distance_m, heading_rad, speed_m_s];
    checks.within("tolerances", |checks| {
        for ((field, rule), value) in TOLERANCES.iter().zip(tolerances) {
            if let Some(value) = value {
                checks.bounds(field, value, rule);
            }
        }
    });
    checks.require("tolerances", "empty", tolerances.iter().any(Option::is_some), "at least one tolerance", None);
    tolerances
}

/// The distributions, in the order of the request.
fn checked_uncertain(
    given: &[Uncertainty],
    checks: &mut Checks,
) -> Result<Vec<(ChangedParameter, Distribution)>, Problem> {
    let mut uncertain: Vec<(ChangedParameter, Distribution)> = Vec::new();
    for (index, given) in given.iter().enumerate() {
        let field = format!("uncertain[{index}].parameter");
        let named: message::ChangedParameter = named(given.parameter, &field)?;
        let parameter: ChangedParameter = required(named.into(), &field)?;
        let is_first = !uncertain.iter().any(|(known, _)| *known == parameter);
        checks.require(
            &field,
            word::<message::ChangedParameter>(parameter),
            is_first,
            "a parameter that is not given before",
            None,
        );
        let distribution = checks
            .within(&format!("uncertain[{index}]"), |checks| checked_distribution(given, &rule_of(parameter), checks));
        uncertain.push((parameter, distribution));
    }
    Ok(uncertain)
}

fn checked_distribution(given: &Uncertainty, rule: &Rule, checks: &mut Checks) -> Distribution {
    let Uncertainty { parameter: _, low, high, mean, standard_deviation } = *given;
    match (low, high, mean, standard_deviation) {
        (Some(low), Some(high), None, None) => {
            checks.bounds("low", low, rule);
            checks.bounds("high", high, rule);
            let at_most = format!("at most `high` ({})", Number(high));
            checks.require("low", Number(low), low <= high, at_most, Some(high));
            Distribution::Uniform { low, high }
        }
        (None, None, Some(mean), Some(standard_deviation)) => {
            checks.bounds("mean", mean, rule);
            let spread = Rule::between(0.0, rule.maximum, rule.unit);
            checks.bounds("standard_deviation", standard_deviation, &spread);
            Distribution::Normal { mean, standard_deviation }
        }
        _ => {
            let given = [("low", low), ("high", high), ("mean", mean), ("standard_deviation", standard_deviation)];
            let names: Vec<&str> = given.iter().filter_map(|(name, value)| value.map(|_| *name)).collect();
            let names = if names.is_empty() { "no number".to_owned() } else { names.join(", ") };
            checks.require("parameter", format!("given with {names}"), false, FORM_RULE, None);
            Distribution::Uniform { low: 0.0, high: 0.0 }
        }
    }
}

/// The plan as its own robot drives it, its goal, its limits and its aisle.
fn made_for(plan: &AcceptedPlan, checks: &mut Checks) -> (Undisturbed, Option<Goal>, Limited, Option<Aisle>) {
    let moves = plan.step_count() > 0;
    let AcceptedPlan { said, motion, corners: _ } = plan;
    let planned = Undisturbed::new(
        (motion.bare_robot, motion.payload),
        (motion.reference_point, &motion.start),
        (&motion.schedule, motion.step_count),
    );
    let (field, goal, limited, aisle) = match said {
        Said::Solve(asked, _) => {
            let SolveInput { maneuver, aisle, .. } = &**asked;
            let limited = Limited::Maneuver(Box::new(*maneuver));
            ("solve.answer.torque_schedule", Some(maneuver.goal), limited, aisle)
        }
        Said::Simulate(_) => {
            let limited = Limited::Motion(motion.reference_point, motion.limits);
            ("simulate.request.torque_schedule", None, limited, &motion.aisle)
        }
    };
    checks.require(field, format!("{} s long", motion.schedule.final_time), moves, "of a plan that moves", None);
    (planned, goal, limited, aisle.clone())
}

/// Lets the robot and the payload that are given drive the plan; gives the outline of what drives it.
fn drive_with(
    (given_robot, given_payload): (Option<message::Robot>, Option<message::Payload>),
    corners: &AisleCorners,
    AssessInput { driven, aisle, .. }: &mut AssessInput,
    checks: &mut Checks,
) -> Result<Vec<Vector2<f64>>, Problem> {
    let mut footprint = corners.footprint.clone();
    if let Some(given) = &given_robot {
        driven.bare_robot = robot(given, checks);
        if !given.footprint.is_empty() {
            footprint = aisle_corners(&[], &given.footprint).footprint;
            *aisle = AisleCorners { footprint: footprint.clone(), ..corners.clone() }.check("keep_in", checks);
        }
    }
    if let Some(given) = given_payload {
        driven.payload = Some(payload(given)?);
    }
    driven.check(checks);
    Ok(footprint)
}

/// What robot and payload break where there is no plan whose own they are in place of.
fn check_by_themselves(
    (given_robot, given_payload): (Option<message::Robot>, Option<message::Payload>),
    checks: &mut Checks,
) -> Result<(), Problem> {
    let payload = given_payload.map(payload).transpose()?;
    match (given_robot, payload) {
        (Some(given), payload) => check_robot(&robot(&given, checks), payload.as_ref(), checks),
        (None, Some(payload)) => checks.within("payload", |checks| payload.check(checks)),
        (None, None) => {}
    }
    Ok(())
}

/// That what is uncertain is there, that delays fit, and that it is not too much.
fn check_together(input: &AssessInput, checks: &mut Checks) {
    for (index, (parameter, _)) in input.uncertain.iter().enumerate() {
        let is_of_payload = matches!(
            parameter,
            ChangedParameter::PayloadMass | ChangedParameter::PayloadRight | ChangedParameter::PayloadForward
        );
        let has_place = !is_of_payload || input.driven.payload.is_some();
        let field = format!("uncertain[{index}].parameter");
        checks.require(
            &field,
            word::<message::ChangedParameter>(*parameter),
            has_place,
            "of a payload that is given",
            None,
        );
    }
    // What follows makes no sense of a plan without motion.
    if checks.count() > 0 {
        return;
    }
    for (index, &(parameter, distribution)) in input.uncertain.iter().enumerate() {
        if matches!(parameter, ChangedParameter::DelayLeft | ChangedParameter::DelayRight) {
            let (name, value) = match distribution {
                Distribution::Uniform { high, .. } => ("high", high),
                Distribution::Normal { standard_deviation, .. } => ("standard_deviation", standard_deviation),
            };
            // Not below zero, whatever the mean: such samples fail, and the others count.
            let fits = input.driven.under(&[(parameter, distribution.largest().max(0.0))]).is_ok();
            let field = format!("uncertain[{index}].{name}");
            checks.require(&field, Number(value), fits, LONGEST_DELAY_FITS, None);
        }
    }
    if checks.count() > 0 {
        return;
    }
    let steps = input.expected_steps();
    let most = (MOST_STEPS / steps).floor();
    checks.server_limit("samples", input.sample_count as f64, most);
}
