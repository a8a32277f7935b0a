//! Automatic steps: a plan on ever finer grids, warm, until its replay is within tolerance.
//!
//! The scheme is of first order, so the replay miss is about proportional to the step length: the miss determines which
//! grid to try next, and whether any grid within the step limit is fine enough. An optimum moves little with the grid, and
//! a refined search takes few linear programs. Drifting plans are the fastest and the most sensitive ones: where the
//! fastest local optimum needs more steps than the limit, the next fastest that does not is refined. Where the steadiest is asked
//! for, plans come in that order.

use super::candidate::Candidate;
use super::certificate::{Replayed, replay};
use super::control_grid::{further_optima, search};
use super::grid_problem::problem_on;
use super::local_search::LocalSearch;
use super::run_control::{Phase, RunControl};
use super::search::SearchResult;
use super::settings::SolveInput;
use super::solution::RefinementOutcome;
use crate::optimizer::Interruption;
use crate::shooting::schedule_from_decision;
use crate::simulation::Simulator;
use crate::stop::{Stop, Stopped};

/// Grids are refined by at least and at most these factors at a time.
const FACTORS: (usize, usize) = (2, 8);
/// The miss is proportional to the step only up to this factor: the next grid is chosen for a miss as much smaller than the
/// tolerance, and plans are tried that seem to need as many more steps than are allowed.
const UNCERTAINTY: f64 = 2.0;
/// Plans that are refined at most after the first one, of the search and of further starts.
const ATTEMPT_LIMIT: usize = 3;

/// Refines the grid of the best decision, or of a slower one where only that can be executed.
///
/// The best decision stays, on the finest grid on which it meets the goal, where no plan can.
pub(super) fn refine(input: &SolveInput, simulator: &Simulator, control: &RunControl, result: &mut SearchResult) {
    // While the grid is refined, iterates are worse than the plan reported before.
    let outcome = Refiner { input, simulator, control: control.quietly(), result }.run();
    if let Err(interruption) = outcome {
        result.stop_reason = interruption.into();
    }
    result.refinement = outcome.unwrap_or(RefinementOutcome::Interrupted);
}

struct Refiner<'a, 'b> {
    input: &'a SolveInput,
    simulator: &'a Simulator,
    control: RunControl<'a>,
    result: &'b mut SearchResult,
}

/// A decision that meets the goal on its grid.
#[derive(Debug)]
struct Plan {
    candidate: Candidate,
    step_count: usize,
    replayed: Replayed,
}

impl Refiner<'_, '_> {
    fn run(&mut self) -> Result<RefinementOutcome, Interruption> {
        let mut candidates = self.candidates_on_the_coarsest_grid().into_iter();
        if self.result.is_interrupted() {
            return Ok(RefinementOutcome::Interrupted);
        }
        let step_count = self.result.step_count;
        let Some(first) = candidates.next() else { return Ok(RefinementOutcome::NoPlan) };
        // The answer where no plan can be executed; its replay belongs to the certificate.
        let mut first = self.plan(first, step_count, self.control.cut())?;
        let outcome = self.refine(&mut first);
        self.keep(first);
        if outcome? == RefinementOutcome::WithinTolerance || self.refine_first(candidates.collect(), step_count)? {
            return Ok(RefinementOutcome::WithinTolerance);
        }
        let candidates = further_optima(self.input, self.simulator, (&mut *self.result, step_count), &self.control);
        if self.result.is_interrupted() {
            return Ok(RefinementOutcome::Interrupted);
        }
        if self.refine_first(candidates, step_count)? { Ok(RefinementOutcome::WithinTolerance) } else { outcome }
    }

    /// The plans of the search, or of the same search on the coarsest finer grid that has any.
    fn candidates_on_the_coarsest_grid(&mut self) -> Vec<Candidate> {
        let mut step_count = self.result.step_count;
        while self.result.plans.is_empty() && !self.result.is_interrupted() && step_count < self.finest() {
            step_count = (FACTORS.1 * step_count).min(self.finest());
            let (problem, _) = problem_on(self.input, self.simulator, step_count);
            let left = self.input.settings.rollout_limit - self.result.rollouts;
            let finer = search(self.input, (self.simulator, &problem), left, &self.control);
            self.result.follow(finer);
        }
        self.result.plans.clone()
    }

    /// Refines plans, in their order, of those for which the allowed steps may do; keeps the first that can be executed.
    fn refine_first(&mut self, candidates: Vec<Candidate>, step_count: usize) -> Result<bool, Interruption> {
        let mut attempts = 0;
        for candidate in candidates {
            let mut plan = self.plan(candidate, step_count, self.control.stop())?;
            if !self.may_fit_step_limit(&plan) {
                continue;
            }
            attempts += 1;
            if self.refine(&mut plan)? == RefinementOutcome::WithinTolerance {
                self.keep(plan);
                return Ok(true);
            }
            if attempts == ATTEMPT_LIMIT {
                break;
            }
        }
        Ok(false)
    }

    fn keep(&mut self, plan: Plan) {
        self.result.best = Some(plan.candidate);
        self.result.step_count = plan.step_count;
        self.result.replayed = Some(plan.replayed);
    }

    /// Whether the allowed steps may do for the plan: those that bring its replay within tolerance if the miss is proportional to the step.
    fn may_fit_step_limit(&self, plan: &Plan) -> bool {
        let needed = plan.replayed.replay.relative_miss(&self.input.settings) * plan.step_count as f64;
        needed <= UNCERTAINTY * self.finest() as f64
    }

    /// Moves a plan to the finest grid that it needs and reaches, as far as it comes before an interruption.
    fn refine(&mut self, plan: &mut Plan) -> Result<RefinementOutcome, Interruption> {
        while !plan.replayed.replay.within_tolerance {
            if plan.step_count >= self.finest() {
                return self.back_off(plan);
            }
            let Some(finer) = self.on_a_finer_grid(plan)? else { return Ok(RefinementOutcome::GoalLost) };
            *plan = finer;
        }
        Ok(RefinementOutcome::WithinTolerance)
    }

    /// Moves a plan to limits that are tighter by what its replay exceeds them (back-off), where that replay keeps them: there is no
    /// finer grid.
    fn back_off(&mut self, plan: &mut Plan) -> Result<RefinementOutcome, Interruption> {
        let margins = plan.replayed.excesses();
        if margins.is_empty() {
            return Ok(RefinementOutcome::StepLimit);
        }
        let back_off = |search: &mut LocalSearch| search.back_off(&plan.candidate);
        let slower = self.searching_from(plan, (plan.step_count, &margins), back_off)?;
        let slower = self.plan(slower, plan.step_count, self.control.stop())?;
        if slower.candidate.is_feasible() && slower.replayed.keeps_limits() {
            *plan = Plan { candidate: Candidate { margins, ..slower.candidate }, ..slower };
        }
        let is_confirmed = plan.replayed.replay.within_tolerance;
        Ok(if is_confirmed { RefinementOutcome::WithinTolerance } else { RefinementOutcome::StepLimit })
    }

    /// The plan on the grid that its miss asks for, or on the nearest coarser one that still leads to the goal.
    fn on_a_finer_grid(&mut self, plan: &Plan) -> Result<Option<Plan>, Interruption> {
        let mut factor = self.next_factor(plan);
        loop {
            let step_count = (factor * plan.step_count).min(self.finest());
            let candidate = self.searching_from(plan, (step_count, &[]), |search| search.adapt(&plan.candidate))?;
            if candidate.is_feasible() {
                return Ok(Some(self.plan(candidate, step_count, self.control.stop())?));
            }
            if factor <= FACTORS.0 {
                return Ok(None);
            }
            factor = (factor / 2).max(FACTORS.0);
        }
    }

    /// Searches from a plan, on a grid and with tighter limits.
    fn searching_from(
        &mut self,
        Plan { candidate, .. }: &Plan,
        (step_count, margins): (usize, &[(&str, f64)]),
        run: impl FnOnce(&mut LocalSearch) -> Result<Candidate, Interruption>,
    ) -> Result<Candidate, Interruption> {
        let _phase = self.control.enter(Phase::Refinement);
        let settings = &self.input.settings;
        let (mut problem, _) = problem_on(self.input, self.simulator, step_count);
        problem.tighten(margins);
        self.result.searching_on((problem, settings), candidate, (&self.control, settings.rollout_limit), run).0
    }

    fn plan(&self, candidate: Candidate, step_count: usize, stop: Stop) -> Result<Plan, Stopped> {
        let schedule = schedule_from_decision(&candidate.decision);
        let replayed = replay(self.input, self.simulator, (&schedule, step_count), stop)?;
        Ok(Plan { candidate, step_count, replayed })
    }

    fn finest(&self) -> usize {
        self.input.settings.finest_step_count()
    }

    /// By what the miss asks for, and not beyond the finest grid: smaller factors follow where this one loses the goal, each with
    /// another grid.
    fn next_factor(&self, plan: &Plan) -> usize {
        let largest = FACTORS.1.min(self.finest().div_ceil(plan.step_count));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 2 and 8, and whole")]
        let factor = (UNCERTAINTY * plan.replayed.replay.relative_miss(&self.input.settings))
            .clamp(FACTORS.0 as f64, largest as f64)
            .ceil() as usize;
        factor
    }
}
