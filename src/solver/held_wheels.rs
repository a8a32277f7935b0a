//! Plans in which no wheel slips, as a way along the kinks where wheels begin to.
//!
//! Under the exact law a descent stops on such a kink, most of all where slip breaks a limit at once. Rollouts that hold the wheels have
//! none: there the grip is a limit like others, and a descent follows it. What they lead to is a plan of the exact law too.

use super::candidate::{CRITICALITY_TOLERANCE, Candidate, keep_best, keep_better};
use super::local_search::LocalSearch;
use crate::optimizer::{ElasticSolver, Interruption, Problem};

impl LocalSearch<'_> {
    /// The plan of the exact law near one that a search with held wheels finds; none where that finds none faster than `time_to_beat`, s,
    /// or where kinks are not steep.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn holding_wheels(
        &mut self,
        time_to_beat: f64,
        search: impl FnOnce(&mut LocalSearch) -> Result<Candidate, Interruption>,
    ) -> Result<Option<Candidate>, Interruption> {
        if !self.problem.is_steep_where_wheels_slip() {
            return Ok(None);
        }
        let (problem, control) = (self.problem.holding_wheels(), self.control.quietly());
        let mut held = LocalSearch { problem, control, programs: ElasticSolver::default(), best: None, ..*self };
        let found = search(&mut held);
        self.budget = held.budget;
        // Where the budget ends before they are judged by the exact law: any plan of that is better.
        let known = match &found {
            Ok(found) => Some(found.clone()).filter(Candidate::is_feasible),
            Err(_) => held.best.take().filter(Candidate::meets_goal),
        };
        keep_best(&mut self.best, known.map(Candidate::not_judged));
        let found = found?;
        if found.time_to_beat() >= time_to_beat {
            return Ok(None);
        }
        self.problem.aim(found.goal_heading);
        // As it is, under the exact law.
        let stop = self.budget.spend()?;
        let constraints = self.problem.evaluate(&found.decision, stop)?;
        let mut plan = self.candidate(found.decision.clone(), &constraints);
        self.note(&plan);
        keep_better(&mut plan, self.near(&found.decision)?);
        Ok(Some(plan))
    }

    /// From a plan that has settled to a faster one near it, found with held wheels.
    pub(super) fn hold_wheels(&mut self, best: &mut Candidate) -> Result<(), Interruption> {
        let next = self.holding_wheels(best.time_to_beat(), |held| held.near(&best.decision))?;
        if let Some(next) = next.filter(|next| next.gains_on(best, CRITICALITY_TOLERANCE)) {
            *best = next;
            self.settle(best)?;
        }
        Ok(())
    }
}
