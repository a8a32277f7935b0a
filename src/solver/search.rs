//! The search: starts, their local optima, and the best of them.

use std::ops::Range;

use super::candidate::{Candidate, distinct, improves, is_distinct};
use super::certificate::Replayed;
use super::local_search::LocalSearch;
use super::race::Race;
use super::run_control::RunControl;
use super::settings::{Choice, SolveInput, SolverSettings};
use super::solution::{DistinctOptimum, RefinementOutcome, StopReason};
use crate::motion::{EndShift, friction_shift};
use crate::optimizer::Interruption;
use crate::shooting::{ShootingProblem, schedule_from_decision};
use crate::stop::{Stop, Stopped};

/// The result of the search, and its cost.
#[derive(Debug, Default)]
pub(super) struct SearchResult {
    /// The best decision; none when the search was stopped before its first rollout.
    pub(super) best: Option<Candidate>,
    pub(super) stop_reason: StopReason,
    /// Steps of the grid that the best decision was made for.
    pub(super) step_count: usize,
    pub(super) iterations: u64,
    pub(super) rollouts: u64,
    /// Searches of several grids count theirs each time.
    pub(super) starts_tried: usize,
    /// Local optima that meet the goal, fastest first.
    pub(super) distinct_optima: Vec<DistinctOptimum>,
    /// The best decision and the first of each other group of local optima, in the order in which they are wanted.
    pub(super) plans: Vec<Candidate>,
    pub(super) refinement: RefinementOutcome,
    /// The best decision's replay, where the refinement has made it.
    pub(super) replayed: Option<Replayed>,
}

impl SearchResult {
    /// Whether it was ended before it was done.
    pub(super) fn is_interrupted(&self) -> bool {
        self.stop_reason != StopReason::Finished
    }

    /// Adds the search of a finer grid, where this one found no plan; the better of both misses is kept.
    pub(super) fn follow(&mut self, mut finer: Self) {
        if finer.best.as_ref().is_some_and(|next| improves(self.best.as_ref(), next)) {
            std::mem::swap(self, &mut finer);
        } else {
            self.stop_reason = finer.stop_reason;
        }
        self.iterations += finer.iterations;
        self.rollouts += finer.rollouts;
        self.starts_tried += finer.starts_tried;
    }

    /// Searches on from a plan, with all torques and what is left of the rollouts, and counts what that takes; gives the best decision met,
    /// too.
    pub(super) fn searching_on(
        &mut self,
        (mut problem, settings): (ShootingProblem, &SolverSettings),
        from: &Candidate,
        (control, rollout_limit): (&RunControl, u64),
        run: impl FnOnce(&mut LocalSearch) -> Result<Candidate, Interruption>,
    ) -> (Result<Candidate, Interruption>, Option<Candidate>) {
        problem.release_torques();
        problem.set_time_unit(from.final_time());
        problem.aim(from.goal_heading);
        let mut search = LocalSearch::new(problem, settings, control, rollout_limit - self.rollouts);
        let found = run(&mut search);
        self.iterations += search.budget.iterations;
        self.rollouts += search.budget.spent();
        (found, search.best)
    }

    /// How far less friction shifts the ends of the local optima; the steadiest comes first where it is asked for.
    fn weigh(&mut self, input: &SolveInput, optima: &[Candidate], stop: Stop) -> Result<(), Stopped> {
        let step_count = self.step_count;
        let shift = |plan: &Candidate| {
            friction_shift(&input.undisturbed((&schedule_from_decision(&plan.decision), step_count)), stop)
        };
        for (optimum, group) in self.distinct_optima.iter_mut().zip(distinct(optima, Candidate::final_time)) {
            optimum.friction_shift = shift(&optima[group.start])?;
        }
        if input.settings.choice == Choice::Steadiest {
            let fastest = self.plans.first().map_or(0.0, Candidate::final_time);
            let latest = (1.0 + input.settings.choose_within) * fastest;
            let mut ranked = Vec::with_capacity(self.plans.len());
            for plan in &self.plans {
                let shift = if plan.final_time() <= latest { shift(plan)? } else { None };
                ranked.push((shift.map_or(f64::INFINITY, |shift| unsteadiness(shift, &input.settings)), plan));
            }
            // Those that are too slow, or leave the model, stay sorted by their final times.
            ranked.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            let plans: Vec<Candidate> = ranked.into_iter().map(|(_, plan)| plan.clone()).collect();
            self.best = plans.first().cloned().or(self.best.take());
            self.plans = plans;
        }
        Ok(())
    }
}

/// Searches on the grid of the problem from every start, then polishes the best local optima; the result does not depend on the
/// helpers.
pub(super) fn search(
    input: &SolveInput,
    problem: &ShootingProblem<'_>,
    rollout_limit: u64,
    control: &RunControl,
) -> SearchResult {
    let nothing = SearchResult { step_count: problem.step_count(), ..SearchResult::default() };
    let mut race = Race::new(input, problem, (nothing, rollout_limit), control);
    race.run();
    let Race { found: mut result, optima, .. } = race;
    let optima = feasible(optima);
    result.plans = result.best.iter().chain(&optima).filter(|plan| plan.is_feasible()).cloned().collect();
    result.plans.dedup_by(|next, kept| !is_distinct(kept.final_time(), next.final_time()));
    result.distinct_optima = grouped(&optima);
    if result.stop_reason != StopReason::Stopped && result.weigh(input, &optima, control.stop()).is_err() {
        result.stop_reason = StopReason::Stopped;
    }
    result
}

/// Local optima of as many further starts, fastest first.
pub(super) fn further_optima(
    input: &SolveInput,
    problem: &ShootingProblem,
    result: &mut SearchResult,
    control: &RunControl,
) -> Vec<Candidate> {
    // What this grid leads to does not compare with a plan that was refined.
    let best = result.best.take();
    let mut race = Race::new(input, problem, (std::mem::take(result), input.settings.rollout_limit), control);
    race.block();
    race.release_torques();
    *result = SearchResult { best, ..race.found };
    feasible(race.optima)
}

/// A shift of the end in units of the replay's tolerances; none is larger than that of a motion that leaves the model.
pub(super) fn unsteadiness(shift: EndShift, settings: &SolverSettings) -> f64 {
    if shift.separates {
        return f64::INFINITY;
    }
    (shift.distance / settings.replay_tolerance_position).max(shift.angle / settings.replay_tolerance_heading)
}

/// Those that meet the goal, fastest first.
fn feasible(mut optima: Vec<Candidate>) -> Vec<Candidate> {
    optima.retain(Candidate::is_feasible);
    optima.sort_by(|a, b| a.final_time().total_cmp(&b.final_time()));
    optima
}

impl From<Interruption> for StopReason {
    fn from(interruption: Interruption) -> Self {
        match interruption {
            Interruption::Stopped => Self::Stopped,
            Interruption::RolloutLimit => Self::RolloutLimit,
        }
    }
}

/// The groups of sorted optima.
fn grouped(optima: &[Candidate]) -> Vec<DistinctOptimum> {
    let of = |group: Range<usize>| DistinctOptimum {
        final_time: optima[group.start].final_time(),
        count: optima[group].iter().map(|optimum| optimum.times_found).sum(),
        friction_shift: None,
    };
    distinct(optima, Candidate::final_time).into_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::shooting::StateComponent;
    use crate::simulation::Simulator;
    use crate::solver::grid_problem::problem_on;
    use crate::solver::settings::{Method, Refinement, SolveParameters};

    #[test]
    fn without_further_starts_there_are_no_further_optima() {
        let parameters = SolveParameters {
            settings: SolverSettings { method: Method::NelderMead, rollout_limit: 10, ..SolverSettings::default() },
            ..SolveParameters::default()
        };
        let input = SolveInput::new(parameters).unwrap();
        let (simulator, control) = (Simulator::new(&input.robot), RunControl::unattended());
        let (problem, _) = problem_on(&input, &simulator, input.settings.step_count);
        let mut result = search(&input, &problem, 10, &control);
        // As after the searches of several grids; the method has one start.
        result.starts_tried = 3;
        assert!(further_optima(&input, &problem, &mut result, &control).is_empty());
    }

    #[test]
    fn more_starts_are_for_where_none_leads_to_a_plan() {
        let tried = |speed: f64| {
            let refinement = Refinement::Fixed;
            let settings = SolverSettings { start_count: 2, step_count: 40, refinement, ..SolverSettings::default() };
            let mut parameters = SolveParameters { settings, ..SolveParameters::default() };
            parameters.maneuver.goal.set(StateComponent::Y, Some(1.0));
            parameters.maneuver.goal.set(StateComponent::VelocityY, Some(speed));
            let input = SolveInput::new(parameters).unwrap();
            let (simulator, control) = (Simulator::new(&input.robot), RunControl::unattended());
            let (problem, _) = problem_on(&input, &simulator, input.settings.step_count);
            search(&input, &problem, u64::MAX, &control).starts_tried
        };
        assert_eq!(tried(0.0), 2);
        // Faster than a metre's way allows.
        assert_eq!(tried(50.0), 4);
    }

    #[test]
    fn near_final_times_count_as_one_optimum() {
        let optimum =
            |final_time: f64| Candidate::new(DVector::from_element(1, final_time), None).judged((0.0, 0.0), false);
        let optima = grouped(&feasible([2.931, 2.836, 2.930].map(optimum).to_vec()));
        let groups: Vec<_> = optima.iter().map(|group| (group.final_time, group.count)).collect();
        assert_eq!(groups, [(2.836, 1), (2.930, 2)]);
    }
}
