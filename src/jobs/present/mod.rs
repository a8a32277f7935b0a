//! Figures of plans, and the plans in words: what report, page and command line show.

pub(crate) mod count;
mod csv;
mod draw;
mod replay_words;
mod report;
mod words;

use std::sync::Arc;
use std::time::Duration;

use serde_json::{Map, Value};

use super::limits::BODY_WITH_ANSWERS;
use super::plan::{AcceptedPlan, forget_motion};
use super::table::line;
use super::{AsWritten, Kind, Limits, ManeuverSolver};
use crate::contract::message::{Figure, PlanInWords, PresentRequest, PresentResponse, PresentedPlan};
use crate::contract::{BodyLimit, Problem, json};
use crate::metrics::Metrics;
use crate::plot;
pub use crate::plot::STYLE;
use crate::rules::{Checks, Rule, RuleSet};
use crate::service::{Class, Cost, Done, Job, JobControl, Stopped};
pub(super) use words::short;

/// How many plans one figure tells apart.
const PLANS_RULE: Rule = Rule::between(1.0, 4.0, Rule::ITEMS);
/// What a plan takes a small cloud machine beside its rollout, s.
const DRAWING_S: f64 = 5e-3;
/// What a step of a rollout takes there, s, its share of the curves included.
const STEP_S: f64 = 5e-6;
/// Most bytes of all figures in JSON, whose quotes are escaped, with where their data lie: measured 1.1 of their SVG.
const FIGURES_BYTES: usize = plot::MOST_FIGURES * plot::LARGEST_FIGURE / 10 * 12;
/// What is said of a plan, bytes.
const WORDS_BYTES: usize = 10_000;

/// Presents plans.
pub struct Present(Arc<dyn ManeuverSolver>);

impl Present {
    /// Rolls motions out with this solver.
    pub fn new(solver: Arc<dyn ManeuverSolver>, _metrics: &Metrics) -> Self {
        Self(solver)
    }
}

/// Plans to show.
#[derive(Debug)]
pub struct AcceptedPlans {
    /// The plans, in the order of the request.
    pub plans: Vec<AcceptedPlan>,
    /// What was asked and answered, where the report is to quote it.
    quoted: Option<Vec<PresentedPlan>>,
    /// How long they may take; none where no clock ends it.
    time_limit: Option<Duration>,
}

/// The plans as they are shown.
#[derive(Debug)]
pub struct Presented {
    /// The figures.
    pub figures: Vec<plot::Figure>,
    /// What is said of each plan.
    pub words: Vec<PlanInWords>,
}

impl Job for Present {
    const NAME: &'static str = "present";
    const CLASS: Class = Class::Light;
    type Input = AcceptedPlans;
    type Output = Presented;
    type Progress = ();

    fn cost(&self, input: &AcceptedPlans) -> Cost {
        Cost::seconds(input.plans.iter().map(|plan| DRAWING_S + plan.step_count() as f64 * STEP_S).sum())
    }

    fn time_limit(&self, input: &AcceptedPlans) -> Option<Duration> {
        input.time_limit
    }

    fn run(&self, input: &AcceptedPlans, control: &JobControl<'_, ()>) -> Result<Presented, Stopped> {
        let plans = &input.plans;
        let rolled_out = |plan: &AcceptedPlan| plan.trajectory(&*self.0, control.stop().cut_flag().into());
        let trajectories: Result<Vec<_>, _> = plans.iter().map(rolled_out).collect();
        let trajectories = trajectories.map_err(|_| control.cut_off())?;
        let shown: Vec<_> = plans.iter().zip(&trajectories).collect();
        let words = shown.iter().zip(LABELS).map(|((plan, motion), label)| words::of_plan(label, plan, motion));
        let words: Vec<_> = words.collect();
        let figures = draw::figures(&shown, &words);
        Ok(Presented { figures, words })
    }
}

/// What plans are called.
const LABELS: [&str; 4] = ["A", "B", "C", "D"];

impl Kind for Present {
    const SUMMARY: &'static str = "draws plans and says in words why to trust them";
    const METHODS: &'static [&'static str] = &["Present"];
    const SAVED_FILES: usize = 4;
    const HAS_FIGURES: bool = true;
    type Request = PresentRequest;
    type Answer = PresentResponse;
    type Report = ();

    fn rules(_limits: &Limits) -> RuleSet {
        RuleSet::of([("plans", PLANS_RULE)])
            .across(&["plans"], "each plan has either `solve` or `simulate`, whose request keeps the rules of its kind")
    }

    fn survey(request: AsWritten<'_>) -> Result<(), Problem> {
        count::check(request)
    }

    fn validate(request: PresentRequest, limits: &Limits) -> Result<AcceptedPlans, Problem> {
        let quoted = request.report.then(|| request.plans.iter().cloned().map(report::quoted).collect());
        let mut checks = Checks::new();
        checks.length("plans", request.plans.len(), &PLANS_RULE);
        checks.finish()?;
        let mut plans = Ok(Vec::new());
        for (index, PresentedPlan { solve, simulate }) in request.plans.into_iter().enumerate() {
            let plan = AcceptedPlan::of(solve, simulate, limits);
            let plan = plan.map_err(|fault| fault.below(&format!("plans[{index}]")));
            // A faulty one hides no other.
            plans = Problem::both(plans, plan).map(|(mut plans, plan)| {
                plans.push(plan);
                plans
            });
        }
        Ok(AcceptedPlans { plans: plans?, quoted, time_limit: limits.light_time_limit() })
    }

    fn body_limit(_limits: &Limits) -> BodyLimit {
        BODY_WITH_ANSWERS
    }

    fn answer_bytes(input: &AcceptedPlans, _number_bytes: usize) -> usize {
        let shown = FIGURES_BYTES + input.plans.len() * WORDS_BYTES;
        // A report has figures and words again.
        shown + input.quoted.as_deref().map_or(0, |quoted| shown + report::further_bytes(quoted))
    }

    fn answer(input: &AcceptedPlans, done: &Done<Presented>) -> PresentResponse {
        let Presented { figures, words } = &done.output;
        let figures = figures.iter().map(Figure::from).collect();
        let shown = PresentResponse { figures, plans: words.clone(), report_html: String::new() };
        let report_html = input.quoted.as_deref().map(|quoted| report::page(quoted, &shown)).unwrap_or_default();
        PresentResponse { report_html, ..shown }
    }

    fn presentation(body: &[u8], _answer: PresentResponse) -> Option<PresentRequest> {
        json::read_object(body).ok()
    }

    /// Each file has one plan, or a whole request.
    fn joined(files: Vec<Vec<u8>>) -> Result<Vec<u8>, Problem> {
        let (mut request, mut plans) = (Map::new(), Vec::new());
        for file in files {
            let mut object = json::read_any_object(&file)?;
            match object.remove("plans") {
                Some(Value::Array(of_file)) => plans.extend(of_file),
                Some(_) => return Err(json::faulty_field("plans", "must be a list")),
                None => {
                    plans.push(Value::Object(object));
                    continue;
                }
            }
            // What a request says beside is read with it.
            request.append(&mut object);
        }
        plans.iter_mut().for_each(forget_motion);
        request.insert("plans".to_owned(), Value::Array(plans));
        Ok(json::write(&request))
    }

    /// What is said of each plan.
    fn table(_input: &AcceptedPlans, done: &Done<Presented>) -> String {
        let mut table = String::new();
        for (index, words) in done.output.words.iter().enumerate() {
            if index > 0 {
                table.push('\n');
            }
            line(&mut table, &format!("{}  {}", words.label, words.headline));
            words.details.iter().for_each(|sentence| line(&mut table, &format!("   {sentence}")));
            if !words.certificate.is_empty() {
                line(&mut table, "   why to trust it");
            }
            words.certificate.iter().for_each(|sentence| line(&mut table, &format!("   - {sentence}")));
        }
        table
    }
}
