//! The search of plans with many control intervals: on fewer, then on all of them.
//!
//! A plan of few intervals is one of twice, four times, ... as many too, with the same motion. So the search takes hardly longer for these,
//! and the fastest plan is no slower.

use std::iter::repeat_n;

use super::candidate::{Candidate, keep_better};
use super::grid_problem::problem_on;
use super::hops::PATIENCE;
use super::local_search::LocalSearch;
use super::run_control::RunControl;
use super::search::{self, SearchResult};
use super::settings::{Choice, Method, SolveInput, SolverSettings};
use crate::shooting::{ShootingProblem, decision_from_schedule, schedule_from_decision};
use crate::simulation::{Simulator, TorqueSchedule};

/// Searches on the grid of the problem, where there is no guess on fewer control intervals first.
pub(super) fn search(
    input: &SolveInput,
    (simulator, problem): (&Simulator, &ShootingProblem),
    rollout_limit: u64,
    control: &RunControl,
) -> SearchResult {
    let Some(coarse) = with_fewer_intervals(input) else {
        return search::search(input, problem, rollout_limit, control);
    };
    let (coarse_problem, _) = problem_on(&coarse, simulator, problem.step_count());
    let mut result = search::search(&coarse, &coarse_problem, rollout_limit, control);
    result.best.iter_mut().chain(&mut result.plans).for_each(|plan| resample(plan, input));
    if !result.is_interrupted() {
        use_all_intervals(input, problem, (&mut result, rollout_limit), control);
    }
    result
}

/// Local optima of as many further starts, fastest first.
pub(super) fn further_optima(
    input: &SolveInput,
    simulator: &Simulator,
    (result, step_count): (&mut SearchResult, usize),
    control: &RunControl,
) -> Vec<Candidate> {
    let coarse = with_fewer_intervals(input);
    let searched = coarse.as_ref().unwrap_or(input);
    let (problem, _) = problem_on(searched, simulator, step_count);
    let mut optima = search::further_optima(searched, &problem, result, control);
    for optimum in &mut optima {
        resample(optimum, input);
    }
    optima
}

/// The same maneuver with a half, a quarter, ... of the control intervals, at least the default number of them; none where the plan of
/// such a grid is no plan of the whole one, or where there is a guess for it.
fn with_fewer_intervals(input: &SolveInput) -> Option<SolveInput> {
    let mut control_count = input.settings.control_count;
    while control_count.is_multiple_of(2) && control_count / 2 >= SolverSettings::default().control_count {
        control_count /= 2;
    }
    // A torque may change by less from one interval to the next where these are shorter.
    let has_torque_rate = input.maneuver.limits.torque_rate.is_some();
    let needs_all = input.settings.method == Method::NelderMead || has_torque_rate || input.initial_guess.is_some();
    (control_count < input.settings.control_count && !needs_all).then(|| {
        let settings = SolverSettings { control_count, ..input.settings };
        SolveInput { settings, ..input.clone() }
    })
}

/// The same plan on all intervals, a whole number of which take the place of one: with the same torques to the bit, which keep the
/// same limits.
fn resample(plan: &mut Candidate, input: &SolveInput) {
    let coarse = schedule_from_decision(&plan.decision);
    let count = input.settings.control_count / coarse.control_count();
    if count > 1 {
        let repeated = |torques: &[f64]| torques.iter().flat_map(|torque| repeat_n(*torque, count)).collect();
        let (left, right) = (repeated(&coarse.left), repeated(&coarse.right));
        plan.decision = decision_from_schedule(&TorqueSchedule { left, right, ..coarse });
        plan.stationarity = None;
    }
}

/// Polishes the best plan on all intervals; the steadiest one only descends there.
fn use_all_intervals(
    input: &SolveInput,
    problem: &ShootingProblem,
    (result, rollout_limit): (&mut SearchResult, u64),
    control: &RunControl,
) {
    let Some(mut best) = result.best.clone() else { return };
    // Crossed kinks and hops lead to faster plans, whether these are steady or not.
    let (patience, round) = match input.settings.choice {
        Choice::Fastest => (PATIENCE, 0),
        Choice::Steadiest => (0, 1),
    };
    let polish = |search: &mut LocalSearch| search.polish(&best, patience, round);
    // Iterates are worse than the plan reported before.
    let control = control.quietly();
    let (outcome, found) =
        result.searching_on((problem.clone(), &input.settings), &best, (&control, rollout_limit), polish);
    match outcome {
        // With its criticality measure, also where it is no better.
        Ok(polished) => best = polished,
        Err(interruption) => result.stop_reason = interruption.into(),
    }
    if let Some(found) = found {
        keep_better(&mut best, found);
    }
    if let Some(first) = result.plans.first_mut() {
        first.clone_from(&best);
    }
    result.best = Some(best);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::friction_shift;
    use crate::shooting::{Goal, Maneuver, ManeuverLimits};
    use crate::solver::search::unsteadiness;
    use crate::solver::settings::{Refinement, SolveParameters};
    use crate::solver::{Solution, Status, solve};
    use crate::stop::Stop;

    fn parameters(control_count: usize) -> SolveParameters {
        let settings = SolverSettings { control_count, start_count: 4, ..SolverSettings::default() };
        SolveParameters { settings, ..SolveParameters::default() }
    }

    fn searched_intervals(parameters: SolveParameters) -> Option<usize> {
        with_fewer_intervals(&SolveInput::new(parameters).unwrap()).map(|coarse| coarse.settings.control_count)
    }

    #[test]
    fn grids_are_halved_down_to_the_default_number_of_intervals() {
        let searched = [40, 79, 80, 81, 100, 160].map(|control_count| searched_intervals(parameters(control_count)));
        assert_eq!(searched, [None, None, Some(40), None, Some(50), Some(40)]);
    }

    #[test]
    fn what_a_coarse_grid_cannot_hold_is_searched_on_the_whole_one() {
        let guess = TorqueSchedule { final_time: 3.0, left: vec![0.1; 80], right: vec![0.1; 80] };
        assert_eq!(searched_intervals(SolveParameters { initial_guess: Some(guess), ..parameters(80) }), None);
        let limits = ManeuverLimits { torque_rate: Some(10.0), ..ManeuverLimits::default() };
        let maneuver = Maneuver { limits, ..Maneuver::forward_drive() };
        assert_eq!(searched_intervals(SolveParameters { maneuver, ..parameters(80) }), None);
    }

    #[test]
    fn a_plan_on_all_intervals_has_the_same_torques() {
        let input = SolveInput::new(parameters(160)).unwrap();
        let third = TorqueSchedule { final_time: 2.836_110, left: vec![1.0 / 3.0; 40], right: vec![-0.7; 40] };
        let mut plan = Candidate::new(decision_from_schedule(&third), None);
        resample(&mut plan, &input);
        let whole = schedule_from_decision(&plan.decision);
        assert_eq!((whole.control_count(), whole.final_time), (160, third.final_time));
        assert!(whole.left.iter().all(|torque| *torque == third.left[0]));
        assert!(whole.right.iter().all(|torque| *torque == third.right[0]));
        assert!(plan.stationarity.is_none());
    }

    /// A quarter turn on 160 steps whose steadiest plan is wanted.
    fn steadiest(control_count: usize) -> SolveInput {
        let mut parameters = parameters(control_count);
        let settings = &mut parameters.settings;
        (settings.choice, settings.choose_within) = (Choice::Steadiest, 0.1);
        (settings.step_count, settings.refinement) = (160, Refinement::Fixed);
        parameters.maneuver.goal = Goal::at_rest(0.0, 0.0, 1.5);
        SolveInput::new(parameters).unwrap()
    }

    #[test]
    fn more_intervals_make_the_steadiest_plan_no_less_steady() {
        let [coarse, fine] = [40, 80].map(|control_count| {
            let input = steadiest(control_count);
            let Solution { status, schedule, .. } = solve(&input, &RunControl::unattended()).unwrap();
            assert_eq!((status, schedule.control_count()), (Status::Converged, control_count));
            let shift = friction_shift(&input.undisturbed((&schedule, 160)), Stop::never()).unwrap().unwrap();
            unsteadiness(shift, &input.settings)
        });
        assert!(fine <= 1.001 * coarse, "{fine} in place of {coarse} tolerances");
    }

    #[test]
    fn what_is_measured_of_a_plan_that_is_no_better_stays_known() {
        let (input, control) = (steadiest(80), RunControl::unattended());
        let simulator = Simulator::new(&input.robot);
        let (problem, _) = problem_on(&input, &simulator, 160);
        let mut result = search(&input, (&simulator, &problem), u64::MAX, &control);
        let mut settled = result.best.clone().unwrap();
        settled.stationarity = None;
        result.best = Some(settled.clone());
        use_all_intervals(&input, &problem, (&mut result, u64::MAX), &control);
        let [best, first] = [result.best.as_ref(), result.plans.first()].map(Option::unwrap);
        assert_eq!(best.decision, settled.decision);
        assert!(best.stationarity.is_some() && first.stationarity.is_some());
    }

    #[test]
    fn more_intervals_make_no_plan_slower() {
        let solved = |control_count| -> Solution {
            let mut parameters = parameters(control_count);
            (parameters.settings.step_count, parameters.settings.refinement) = (160, Refinement::Fixed);
            let input = SolveInput::new(parameters).unwrap();
            solve(&input, &RunControl::unattended()).unwrap()
        };
        let [coarse, fine] = [40, 80].map(solved);
        assert_eq!((coarse.status, fine.status), (Status::Converged, Status::Converged));
        assert_eq!(fine.schedule.control_count(), 80);
        assert!(fine.schedule.final_time <= coarse.schedule.final_time);
    }
}
