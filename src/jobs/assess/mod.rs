//! How often a plan succeeds where robot, torques and start are known up to a distribution only: many rollouts of its torques.
//!
//! Errors, parameters and statistics: `docs/floor.md`.

mod accept;
mod answer;
mod metrics;
mod table;

use std::sync::Arc;
use std::time::Duration;

pub use accept::AcceptedAssess;

use self::metrics::AssessMetrics;
use super::idle_workers::IdleWorkers;
use super::limits::BODY_WITH_ANSWERS;
use super::plan::without_motion;
use super::{Flag, Kind, Limits, ManeuverSolver, STEP_S};
use crate::assessment::Assessment;
use crate::contract::message::{AssessRequest, AssessResponse};
use crate::contract::{BodyLimit, Problem};
use crate::metrics::Metrics;
use crate::metrics::catalogue::Family;
use crate::rules::RuleSet;
use crate::service::{Cost, Done, Job, JobControl, Stopped, WorkDone};
use crate::solver::{NoProgress, RunControl};

/// What a sample takes a small cloud machine beside its steps, s.
const SAMPLE_S: f64 = 100e-6;
/// The rollout of a sample that is compared with limits, in rollouts of one that is not.
const WITH_LIMITS: f64 = 1.8;

/// Assesses plans.
pub struct Assess {
    solver: Arc<dyn ManeuverSolver>,
    metrics: AssessMetrics,
}

impl Assess {
    /// Samples with this solver, and counts among these metrics.
    pub fn new(solver: Arc<dyn ManeuverSolver>, metrics: &Metrics) -> Self {
        Self { solver, metrics: AssessMetrics::new(metrics.registration()) }
    }
}

fn cost_on(accepted: &AcceptedAssess, grid_factor: usize) -> Cost {
    let rollouts = if accepted.input.has_limits() { WITH_LIMITS } else { 1.0 };
    let steps = accepted.input.expected_steps() * grid_factor as f64;
    Cost::seconds(accepted.input.sample_count as f64 * (SAMPLE_S + rollouts * steps * STEP_S))
}

impl Job for Assess {
    const NAME: &'static str = "assess";
    type Input = AcceptedAssess;
    type Output = Assessment;
    type Progress = ();

    /// On the plan's grid, which is good enough for plans that meet their goal.
    fn cost(&self, accepted: &AcceptedAssess) -> Cost {
        cost_on(accepted, 1)
    }

    fn work_done(&self, accepted: &AcceptedAssess, assessment: &Assessment) -> Option<WorkDone> {
        Some(WorkDone { cost: cost_on(accepted, assessment.grid.factor), is_complete: true })
    }

    fn time_limit(&self, accepted: &AcceptedAssess) -> Option<Duration> {
        accepted.time_limit
    }

    fn run(&self, accepted: &AcceptedAssess, control: &JobControl<'_, ()>) -> Result<Assessment, Stopped> {
        let motion = accepted.plan.trajectory(&*self.solver, control.stop().cut_flag().into());
        accepted.plan.check_belongs(&motion.map_err(|_| control.cut_off())?)?;
        let workers = IdleWorkers(control);
        let run = RunControl::new(control.stop().cut_flag(), &NoProgress).helped_by(&workers);
        self.solver.assess(&accepted.input, &run).map_err(|_| control.cut_off())
    }

    fn answered(&self, done: &Done<Assessment>) {
        self.metrics.count(&done.output);
    }
}

impl Kind for Assess {
    const SUMMARY: &'static str = "says how often a plan succeeds";
    const METHODS: &'static [&'static str] = &["Assess"];
    const SAVED_FILES: usize = 1;
    const FLAGS: &'static [Flag] = &[
        Flag {
            field: "uncertain",
            help: "What is not known, such as [{\"parameter\": \"friction\", \"low\": -0.1, \"high\": 0.1}]",
        },
        Flag {
            field: "tolerances",
            help: "When a sample is a success, such as {\"distance_m\": 0.05, \"heading_rad\": 0.05}",
        },
        Flag { field: "samples", help: "How many samples [default: 1000]" },
        Flag { field: "seed", help: "Seed of all random numbers [default: 0]" },
        Flag { field: "robot", help: "The robot that drives the plan [default: the plan's]" },
        Flag { field: "payload", help: "What it carries [default: the plan's]" },
    ];
    const FAMILIES: &'static [Family] = metrics::FAMILIES;
    type Request = AssessRequest;
    type Answer = AssessResponse;
    type Report = ();

    fn rules(_limits: &Limits) -> RuleSet {
        accept::rules()
    }

    fn validate(request: AssessRequest, limits: &Limits) -> Result<AcceptedAssess, Problem> {
        accept::accept(request, limits)
    }

    fn body_limit(_limits: &Limits) -> BodyLimit {
        BODY_WITH_ANSWERS
    }

    fn answer_bytes(accepted: &AcceptedAssess, number_bytes: usize) -> usize {
        // The schedule of the worst sample.
        number_bytes * 2 * accepted.input.driven.schedule.control_count()
    }

    fn answer(accepted: &AcceptedAssess, done: &Done<Assessment>) -> AssessResponse {
        answer::answer(accepted, &done.output)
    }

    /// The file has a plan, or a whole request.
    fn joined(files: Vec<Vec<u8>>) -> Result<Vec<u8>, Problem> {
        without_motion(&files.concat())
    }

    fn table(accepted: &AcceptedAssess, done: &Done<Assessment>) -> String {
        table::table(accepted, &done.output)
    }
}
