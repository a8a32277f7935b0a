//! The certificate of an answer: its properties, computed from the final torques or taken from the search.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use nalgebra::SVector;

use super::candidate::{Candidate, Stationarity};
use super::goal_miss::goal_missed;
use super::local_search::penalty_parameters;
use super::lower_bound::{Grid, LowerBound, largest, lower_bounds};
use super::search::SearchResult;
use super::settings::{Refinement, SolveInput};
use super::solution::{DistinctOptimum, Reason, RefinementOutcome, Replay, Report, Solution, Status, StopReason};
use crate::optimizer::{Budget, criticality_measure, sign_violations};
use crate::robot::State;
use crate::shooting::{LONGEST_FINAL_TIME, ShootingProblem, StateComponent, schedule_from_decision};
use crate::simulation::{ContactMethod, Rollout, Simulator, TorqueSchedule, Trajectory};

/// The replay's grid is this much finer than the plan's.
const REPLAY_REFINEMENT: usize = 16;
/// Largest accepted residual of the contact law, relative to m g dt.
const CONTACT_RESIDUAL_TOLERANCE: f64 = 1e-10;
/// Largest accepted criticality measure, as a share of the final time.
const CRITICALITY_TOLERANCE: f64 = 1e-4;
/// Rollouts that the criticality measure of a stopped solve may take.
const URGENT_ROLLOUTS: u64 = 12;
/// A stop flag that is never set.
static NEVER: AtomicBool = AtomicBool::new(false);

/// Certifies the search's best decision.
pub(super) fn certified(
    input: &SolveInput,
    simulator: &Simulator,
    (problem, bound): (&mut ShootingProblem, LowerBound),
    best: &Candidate,
    result: SearchResult,
) -> Solution {
    let schedule = schedule_from_decision(&best.decision);
    if let Some(heading) = best.goal_heading {
        problem.aim_at_heading(heading);
    }
    let is_urgent = result.stop_reason == StopReason::Stopped;
    let tolerance = input.settings.goal_tolerance;
    let measured = || measured(problem, best, tolerance, is_urgent).map(Arc::new);
    let stationarity = best.stationarity.clone().or_else(measured);
    let measure = stationarity.as_ref().map_or(f64::NAN, |known| known.measure.prediction);
    // Without a measure the bounds are the whole final time, and a violation at every control.
    let measure = if measure.is_finite() { measure } else { schedule.final_time };
    let is_stationary = measure <= CRITICALITY_TOLERANCE * schedule.final_time;
    let violations = stationarity.map_or(best.decision.len(), |known| {
        sign_violations(problem, &best.decision, &known.measure.model, known.penalty_parameter)
    });
    let evidence = Evidence::collect(input, simulator, schedule, &result);
    let mut solution = evidence.solution(input, result, bound, (measure, is_stationary));
    solution.report.switching_sign_violations = violations;
    solution
}

/// The criticality measure of a decision for which the search has not computed it.
///
/// It belongs to the answer, not to the search: neither the search's rollout limit nor its stop flag ends it. After a stop
/// it has a small limit of its own, because the caller waits.
fn measured(
    problem: &mut ShootingProblem,
    best: &Candidate,
    goal_tolerance: f64,
    is_urgent: bool,
) -> Option<Stationarity> {
    let mut budget = Budget::new(&NEVER, if is_urgent { URGENT_ROLLOUTS } else { u64::MAX });
    let [_, penalty_parameter] = penalty_parameters(problem, best.final_time());
    let settings = Stationarity::settings(problem, (penalty_parameter, best.final_time()), goal_tolerance);
    let measure = criticality_measure(problem, &best.decision, &settings, &mut budget).ok()?;
    Some(Stationarity { penalty_parameter, measure })
}

/// The answer where no plan exists: the start with its distance from the goal, an empty schedule, and the reason.
pub(super) fn certified_impossible(input: &SolveInput, reason: Reason) -> Solution {
    let mut solution = certified_standstill(input, StopReason::Finished);
    solution.status = Status::Infeasible;
    solution.reason = Some(reason);
    solution.report.distinct_optima = Vec::new();
    if solution.report.refinement != RefinementOutcome::Fixed {
        solution.report.refinement = RefinementOutcome::NoPlan;
    }
    solution
}

/// The answer without motion: where the start already meets the goal, or where the caller no longer waits.
pub(super) fn certified_standstill(input: &SolveInput, stop_reason: StopReason) -> Solution {
    let trajectory = Trajectory { time: vec![0.0], state: vec![input.maneuver.start], ..Trajectory::default() };
    let goal_error = input.maneuver.goal_error(&input.maneuver.start);
    let replay = replay_of_miss(input, &goal_error, 0);
    let evidence = Evidence { goal_error, replay, trajectory, schedule: TorqueSchedule::empty() };
    let refinement = match input.settings.refinement {
        Refinement::Fixed => RefinementOutcome::Fixed,
        Refinement::UntilConfirmed { .. } => RefinementOutcome::WithinTolerance,
    };
    let result = SearchResult {
        best: None,
        stop_reason,
        step_count: 0,
        iterations: 0,
        rollouts: 0,
        starts_tried: 0,
        distinct_optima: vec![DistinctOptimum { final_time: 0.0, count: 1 }],
        optima: Vec::new(),
        refinement,
        replay: None,
    };
    let bound = largest(&lower_bounds(input, Grid::Steps(input.settings.step_count)));
    let mut solution = evidence.solution(input, result, bound, (0.0, true));
    solution.report.control_count = 0;
    solution
}

/// A plan's motion, on its own grid and on the fine one.
struct Evidence {
    schedule: TorqueSchedule,
    /// States at the reference point.
    trajectory: Trajectory,
    goal_error: SVector<f64, { State::LEN }>,
    replay: Replay,
}

impl Evidence {
    fn collect(input: &SolveInput, simulator: &Simulator, schedule: TorqueSchedule, result: &SearchResult) -> Self {
        let parameters = input.robot.parameters();
        let start = input.maneuver.start_at_center_of_mass(parameters);
        let rollout = Rollout { start: &start, schedule: &schedule, step_count: result.step_count };
        let mut trajectory = simulator.trajectory(&rollout, ContactMethod::Exact);
        trajectory.move_states_by(input.maneuver.reference_point.offset(parameters));
        let end = trajectory.state[trajectory.state.len() - 1];
        let goal_error = input.maneuver.goal_error(&end);
        let replay = result.replay.unwrap_or_else(|| replay(input, simulator, &rollout));
        Self { schedule, trajectory, goal_error, replay }
    }

    fn solution(
        self,
        input: &SolveInput,
        result: SearchResult,
        bound: LowerBound,
        (measure, is_stationary): (f64, bool),
    ) -> Solution {
        let separations = self.trajectory.separations();
        let meets_goal = self.goal_error.amax() <= input.settings.goal_tolerance;
        let keeps_law = self.trajectory.worst_contact_residual <= CONTACT_RESIDUAL_TOLERANCE;
        let status = if !meets_goal {
            Status::NotConverged
        } else if is_stationary && keeps_law && separations.is_empty() {
            Status::Converged
        } else {
            Status::Feasible
        };
        Solution {
            status,
            stop_reason: result.stop_reason,
            replay_confirmed: meets_goal && separations.is_empty() && self.replay.within_tolerance,
            reason: (!meets_goal).then(|| goal_missed(input, &self.schedule, &self.goal_error, result.stop_reason)),
            goal_error: self.goal_error,
            contact_modes: self.trajectory.contact_modes(),
            report: Report {
                method: input.settings.method,
                step_count: result.step_count,
                refinement: result.refinement,
                control_count: input.settings.control_count,
                iterations: result.iterations,
                rollouts: result.rollouts,
                starts_tried: result.starts_tried,
                distinct_optima: result.distinct_optima,
                worst_contact_residual: self.trajectory.worst_contact_residual,
                predicted_decrease: measure,
                lower_bound: bound.time.min(LONGEST_FINAL_TIME),
                lower_bound_assumption: bound.assumption,
                separations,
                indeterminate_steps: self.trajectory.indeterminate_steps,
                slip_reversals: self.trajectory.slip_reversals(),
                switching_sign_violations: 0,
                replay: self.replay,
            },
            trajectory: self.trajectory,
            schedule: self.schedule,
        }
    }
}

/// The same torques on a finer grid: the miss is the distance of its end from the goal.
pub(super) fn replay(input: &SolveInput, simulator: &Simulator, plan: &Rollout) -> Replay {
    let fine = Rollout { step_count: REPLAY_REFINEMENT * plan.step_count, ..*plan };
    let offset = input.maneuver.reference_point.offset(input.robot.parameters());
    let miss = input.maneuver.goal_error(&simulator.end_state(&fine).moved_by(offset)).map(finite_or_largest);
    replay_of_miss(input, &miss, fine.step_count)
}

/// The replay whose end misses the goal by `miss`.
fn replay_of_miss(input: &SolveInput, miss: &SVector<f64, { State::LEN }>, step_count: usize) -> Replay {
    let of = |component: StateComponent| miss[component.index()];
    let miss_position = finite_or_largest(of(StateComponent::X).hypot(of(StateComponent::Y)));
    let miss_heading = of(StateComponent::Heading).abs();
    Replay {
        step_count,
        miss_position,
        miss_heading,
        miss_speed: finite_or_largest(of(StateComponent::VelocityX).hypot(of(StateComponent::VelocityY))),
        within_tolerance: miss_position <= input.settings.replay_tolerance_position
            && miss_heading <= input.settings.replay_tolerance_heading,
    }
}

/// The miss of a motion that diverges on the fine grid becomes the largest number.
fn finite_or_largest(value: f64) -> f64 {
    if value.is_finite() { value } else { f64::MAX }
}
