//! The search for the fastest maneuver.

mod accept;
mod answer;
mod cost;
mod examples;
mod finishing;
mod metrics;
mod observer;
mod table;

use std::sync::Arc;
use std::time::{Duration, Instant};

pub use accept::{AcceptedSolve, validated};
use finishing::FinishingPace;
use metrics::SolveMetrics;
pub use observer::Progressed;
use observer::SolveObserver;

use super::idle_workers::IdleWorkers;
use super::{ARRAYS_OF_STEPS, Example, Kind, Limits, ManeuverSolver, ProgressLine};
use crate::contract::message::{self, PresentRequest, PresentedPlan, SearchPhase, SolveRequest, SolvedPlan, View};
use crate::contract::{Problem, json};
use crate::metrics::Metrics;
use crate::metrics::catalogue::Family;
use crate::rules::RuleSet;
use crate::service::{Cost, Done, Finishing, Job, JobControl, StopCause, Stopped, WorkDone};
use crate::solver::{RunControl, Solution, SolveProgress, SolverSettings, Status, StopReason as SolverStop};

/// Solves maneuvers.
pub struct Solve {
    solver: Arc<dyn ManeuverSolver>,
    finishing: FinishingPace,
    metrics: SolveMetrics,
}

impl Solve {
    /// Solves with this solver, and counts among these metrics.
    pub fn new(solver: Arc<dyn ManeuverSolver>, metrics: &Metrics) -> Self {
        let metrics = SolveMetrics::new(metrics.registration());
        Self { solver, finishing: FinishingPace::default(), metrics }
    }
}

/// What came out of a solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Solved {
    /// The plan with its report.
    pub solution: Solution,
    /// Why it ended.
    pub stop_reason: StopReason,
    search_end: Option<Instant>,
}

/// Why a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The whole search asked for was done, and its plan certified.
    Finished,
    /// The caller's time limit passed.
    TimeLimit,
    /// The caller's deadline came near.
    Deadline,
    /// The rollout limit was used up.
    RolloutLimit,
}

impl StopReason {
    /// The name in the public contract.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::TimeLimit => "time_limit",
            Self::Deadline => "deadline",
            Self::RolloutLimit => "rollout_limit",
        }
    }
}

impl Job for Solve {
    const NAME: &'static str = "solve";
    type Input = AcceptedSolve;
    type Output = Solved;
    type Progress = Progressed;

    fn cost(&self, accepted: &AcceptedSolve) -> Cost {
        cost::expected(&accepted.input.settings)
    }

    fn work_done(&self, accepted: &AcceptedSolve, solved: &Solved) -> Option<WorkDone> {
        cost::done(&accepted.input.settings, solved)
    }

    fn time_limit(&self, accepted: &AcceptedSolve) -> Option<Duration> {
        accepted.time_limit
    }

    fn finishing(&self, accepted: &AcceptedSolve) -> Finishing {
        self.finishing.finishing(&accepted.input.settings)
    }

    fn run(&self, accepted: &AcceptedSolve, control: &JobControl<'_, Progressed>) -> Result<Solved, Stopped> {
        let (observer, workers) = (SolveObserver::new(control), IdleWorkers(control));
        let stop = control.stop();
        let run = RunControl::new(stop.flag(), &observer).cut_off_by(stop.cut_flag()).helped_by(&workers);
        let solution = self.solver.solve(&accepted.input, &run).map_err(|_| control.cut_off())?;
        let stop_reason = stop_reason(&solution, control)?;
        Ok(Solved { solution, stop_reason, search_end: observer.search_end.get().copied() })
    }

    fn answered(&self, done: &Done<Solved>) {
        let Solved { solution, search_end, .. } = &done.output;
        self.metrics.count(done);
        if let Some(end) = search_end {
            // A certificate that was cut off takes longer: the next ones get twice the time that it had.
            let factor = if solution.report.replay.is_some() { 1 } else { 2 };
            self.finishing.record(solution.report.step_count, factor * end.elapsed());
        }
    }
}

impl Kind for Solve {
    const SUMMARY: &'static str = "solves one maneuver";
    const METHODS: &'static [&'static str] = &["Solve", "SolveStream"];
    const REPORTS_PROGRESS: bool = true;
    const HAS_FIGURES: bool = true;
    const EXAMPLES: &'static [Example<SolveRequest>] = examples::ALL;
    const FAMILIES: &'static [Family] = metrics::FAMILIES;
    type Request = SolveRequest;
    type Answer = message::Solution;
    type Report = message::Progress;

    fn rules(limits: &Limits) -> RuleSet {
        accept::rules(limits)
    }

    fn validate(request: SolveRequest, limits: &Limits) -> Result<AcceptedSolve, Problem> {
        accept::accept(request, limits)
    }

    fn answer_bytes(accepted: &AcceptedSolve, number_bytes: usize) -> usize {
        let SolverSettings { step_count, control_count, .. } = accepted.input.settings;
        let of_steps = if accepted.view == View::Full { ARRAYS_OF_STEPS * step_count } else { 0 };
        number_bytes * (of_steps + 2 * control_count)
    }

    fn answer(accepted: &AcceptedSolve, done: &Done<Solved>) -> message::Solution {
        answer::solution(accepted, done)
    }

    fn table(accepted: &AcceptedSolve, done: &Done<Solved>) -> String {
        table::of_solution(done, &accepted.input.maneuver.goal)
    }

    fn presentation(body: &[u8], answer: message::Solution) -> Option<PresentRequest> {
        let solve = SolvedPlan { request: Some(json::read_object(body).ok()?), answer: Some(answer) };
        Some(PresentRequest { plans: vec![PresentedPlan { solve: Some(solve.into()), simulate: None }], report: false })
    }

    fn progress_line(progress: &Progressed) -> Option<ProgressLine> {
        let SolveProgress { best_final_time, best_goal_error, start, start_count } = progress.best;
        let phase = match progress.phase {
            SearchPhase::Unspecified | SearchPhase::Start => "searching",
            SearchPhase::Polish => "polishing",
            SearchPhase::Refinement => "refining",
            SearchPhase::Certificate => "certifying",
        };
        let words =
            format!("{phase} {start} of {start_count}, best {best_final_time:.3} s, goal error {best_goal_error:.1e}");
        Some(ProgressLine { begun: start, of: start_count, words })
    }

    fn is_success(solved: &Solved) -> bool {
        match solved.solution.status {
            Status::Converged | Status::Feasible => true,
            Status::NotConverged | Status::Infeasible => false,
        }
    }
}

fn stop_reason(solution: &Solution, control: &JobControl<'_, Progressed>) -> Result<StopReason, Stopped> {
    let stop = control.stop();
    let is_certified = solution.report.replay.is_some();
    let cause = match solution.stop_reason {
        SolverStop::Finished if is_certified => return Ok(StopReason::Finished),
        SolverStop::RolloutLimit if is_certified => return Ok(StopReason::RolloutLimit),
        // The search was done, but what is said of its plan depends on the time there was.
        SolverStop::Finished | SolverStop::RolloutLimit => stop.cut_cause(),
        SolverStop::Stopped => stop.cause(),
    };
    match cause {
        Some(StopCause::TimeLimit) => Ok(StopReason::TimeLimit),
        Some(StopCause::Deadline) => Ok(StopReason::Deadline),
        Some(cause @ (StopCause::CallerGone | StopCause::Shutdown)) => Err(Stopped::By(cause)),
        None => {
            tracing::error!("the solver says that it was stopped, but nobody stopped it");
            Err(Stopped::Unasked)
        }
    }
}
