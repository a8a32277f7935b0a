//! The certificate of an answer: its properties, computed from the final torques or taken from the search.

use nalgebra::{DVector, SVector};

use super::bounds::{Grid, LAW_ERROR, LowerBound, largest_lower_bound};
use super::candidate::{CRITICALITY_TOLERANCE, Candidate, Stationarity};
use super::goal_miss::{goal_missed, limit_missed};
use super::local_search::{LocalSearch, STRICT_PENALTY};
use super::run_control::{NoProgress, RunControl};
use super::search::SearchResult;
use super::settings::{Refinement, SolveInput, SolverSettings};
use super::solution::{DistinctOptimum, Reason, RefinementOutcome, Replay, Report, Solution, Status, StopReason};
use crate::contact::ContactName;
use crate::motion::{
    LimitUse, Sensitivity, finite_or_largest, limit_uses, most_exceeded, motion_with_limits, sensitivity,
};
use crate::optimizer::{Interruption, larger, largest_magnitude, sign_violations};
use crate::robot::State;
use crate::shooting::{LIMIT_TOLERANCE, LONGEST_FINAL_TIME, SHORTEST_FINAL_TIME, ShootingProblem, StateComponent};
use crate::simulation::{ContactMethod, NormalLoad, Rollout, Simulator, TorqueSchedule, Trajectory};
use crate::stop::{Stop, Stopped};

/// The replay's grid is this much finer than the plan's.
pub(crate) const REPLAY_REFINEMENT: usize = 16;
/// A replay that misses a speed is judged by how far the robot would drift in this time, s.
const REPLAY_DRIFT_TIME: f64 = 1.0;
/// Share of a limit by which the replay may exceed it: limits of motors and floors are known no better.
pub(crate) const REPLAY_EXCESS: f64 = 5e-3;
/// Rollouts that the criticality measure of a stopped solve may take.
const URGENT_ROLLOUTS: u64 = 12;

/// Certifies a decision, whose motion is known.
///
/// A certificate that is cut off shows the motion of the plan, but neither its replay, nor its sensitivity, nor the lower bound,
/// and claims no local optimum.
pub(super) fn certified(
    input: &SolveInput,
    simulator: &Simulator,
    (problem, bound): (&mut ShootingProblem, LowerBound),
    (best, motion): (Candidate, Motion),
    (result, cut): (SearchResult, Stop),
) -> Solution {
    let step_count = result.step_count;
    problem.aim(best.goal_heading);
    problem.tighten(&best.margins);
    // After a stop the caller waits.
    let rollout_limit = if result.stop_reason == StopReason::Stopped { URGENT_ROLLOUTS } else { u64::MAX };
    let mut certificate = || -> Result<(Optimality, Certificate), Stopped> {
        let optimality = Optimality::of_decision(problem, &best, (&input.settings, rollout_limit), cut)?;
        let replayed = match &result.replayed {
            Some(replayed) => replayed.clone(),
            None => replay(input, simulator, (&motion.schedule, step_count), cut)?,
        };
        let sensitivity = sensitivity(&input.undisturbed((&motion.schedule, step_count)), cut)?;
        let start = input.maneuver.start_at_center_of_mass(input.robot.parameters());
        let rollout = Rollout { start: &start, schedule: &motion.schedule, step_count };
        let indeterminate_steps = simulator.indeterminate_steps(&rollout, cut)?;
        Ok((optimality, Certificate { bound, replayed, sensitivity, indeterminate_steps }))
    };
    let (optimality, shown) = certificate().ok().unzip();
    let optimality = optimality.unwrap_or_else(|| Optimality::unknown(&best.decision));
    motion.solution(input, result, (optimality, shown))
}

/// What is shown of a plan beside its motion.
struct Certificate {
    bound: LowerBound,
    replayed: Replayed,
    sensitivity: Vec<Sensitivity>,
    indeterminate_steps: usize,
}

/// How far a decision is from a local optimum.
struct Optimality {
    /// Criticality measure, s.
    measure: f64,
    is_stationary: bool,
    sign_violations: usize,
}

impl Optimality {
    /// Of a decision that the search has measured, or not yet.
    fn of_decision(
        problem: &mut ShootingProblem,
        best: &Candidate,
        (settings, rollout_limit): (&SolverSettings, u64),
        cut: Stop,
    ) -> Result<Self, Stopped> {
        let control = RunControl::new(cut, &NoProgress);
        // It belongs to the answer, not to the search: neither the search's rollout limit nor its stop ends it.
        let measure_now =
            || LocalSearch::new(problem.clone(), settings, &control, rollout_limit).measured(best, STRICT_PENALTY);
        // A limit that ends it later than at its first rollout makes it an upper bound: only the cut leaves nothing.
        let known = best.stationarity.clone().map_or_else(measure_now, Ok).map_err(|_| Stopped)?;
        let Stationarity { penalty_parameter, time_unit, measure } = &*known;
        if measure.better == Err(Interruption::Stopped) {
            return Err(Stopped);
        }
        problem.set_time_unit(*time_unit);
        let sign_violations = sign_violations(problem, &best.decision, &measure.model, *penalty_parameter, cut)?;
        let final_time = best.final_time();
        let measure = decrease_within(time_unit * measure.prediction, final_time);
        // At the shortest final time no faster plan was looked for.
        let is_stationary = measure <= CRITICALITY_TOLERANCE * final_time && final_time > SHORTEST_FINAL_TIME;
        Ok(Self { measure, is_stationary, sign_violations })
    }

    /// Without a measure the bounds are the whole final time, and a violation at every torque.
    fn unknown(decision: &DVector<f64>) -> Self {
        Self { measure: decision[decision.len() - 1], is_stationary: false, sign_violations: decision.len() - 1 }
    }
}

/// A predicted decrease of the merit as one of the final time, s. Where the goal is missed the merit may fall by more than that time, and
/// what is not a number is all of it. A negative one is as large a rounding.
fn decrease_within(predicted: f64, final_time: f64) -> f64 {
    final_time.min(predicted.abs())
}

/// The answer where no plan exists: the start with its distance from the goal, an empty schedule, and the reason.
pub(super) fn certified_impossible(input: &SolveInput, reason: Reason) -> Solution {
    let mut solution = certified_standstill(input);
    solution.status = Status::Infeasible;
    solution.replay_confirmed = false;
    solution.reason = Some(reason);
    solution.report.distinct_optima = Vec::new();
    if solution.report.refinement != RefinementOutcome::Fixed {
        solution.report.refinement = RefinementOutcome::NoPlan;
    }
    solution
}

/// The answer without motion, where the start already meets the goal.
pub(super) fn certified_standstill(input: &SolveInput) -> Solution {
    let start = input.maneuver.start;
    let trajectory = Trajectory { time: vec![0.0], state: vec![start], end_state: start, ..Trajectory::default() };
    let goal_error = input.maneuver.goal_error(&start);
    let replay = replay_of_miss(input, &goal_error, (0, 0, 0.0));
    let refinement = match input.settings.refinement {
        Refinement::Fixed => RefinementOutcome::Fixed,
        Refinement::UntilConfirmed { .. } if replay.within_tolerance => RefinementOutcome::WithinTolerance,
        // All grids have the same miss, the finest too.
        Refinement::UntilConfirmed { .. } => RefinementOutcome::StepLimit,
    };
    let result = SearchResult {
        distinct_optima: vec![DistinctOptimum { final_time: 0.0, count: 1, friction_shift: None }],
        refinement,
        ..SearchResult::default()
    };
    let optimality = Optimality { measure: 0.0, is_stationary: true, sign_violations: 0 };
    let shown = Certificate {
        bound: largest_lower_bound(input, Grid::Steps(input.settings.step_count)),
        replayed: Replayed { replay, limits: Vec::new() },
        sensitivity: Vec::new(),
        indeterminate_steps: 0,
    };
    let motion = Motion { schedule: TorqueSchedule::empty(), trajectory, goal_error, limits: Vec::new() };
    motion.solution(input, result, (optimality, Some(shown)))
}

/// A plan and its motion on its own grid.
pub(super) struct Motion {
    schedule: TorqueSchedule,
    /// States at the reference point.
    trajectory: Trajectory,
    goal_error: SVector<f64, { State::LEN }>,
    limits: Vec<LimitUse>,
}

impl Motion {
    /// Rolls a plan out, as answers show it.
    ///
    /// # Errors
    /// When it is cut off before the end.
    pub(super) fn of_plan(
        input: &SolveInput,
        simulator: &Simulator,
        (schedule, step_count): (TorqueSchedule, usize),
        cut: Stop,
    ) -> Result<Self, Stopped> {
        let parameters = input.robot.parameters();
        let start = input.maneuver.start_at_center_of_mass(parameters);
        let rollout = Rollout { start: &start, schedule: &schedule, step_count };
        let mut trajectory = simulator.trajectory(&rollout, ContactMethod::Exact, cut)?;
        let limits = limit_uses(simulator, &input.path_limits(), &rollout, cut)?;
        trajectory.move_states_by(input.maneuver.reference_point.offset(parameters));
        let goal_error = input.maneuver.goal_error(&trajectory.end_state);
        Ok(Self { schedule, trajectory, goal_error, limits })
    }

    /// Whether it stays within what numbers can say.
    pub(super) fn is_finite(&self) -> bool {
        self.trajectory.end_state.to_vector().iter().all(|value| value.is_finite())
    }

    /// Whether every contact carries its least load, and sticks where it must.
    fn keeps_contacts(&self, input: &SolveInput) -> bool {
        let least = input.maneuver.limits.least_normal_loads(&input.robot);
        let carries = |load: NormalLoad| load.share >= least[load.contact as usize] - LIMIT_TOLERANCE;
        let slips = |wheel| self.trajectory.slip_time(wheel) > 0.0;
        let sticks = !slips(ContactName::Left) && !slips(ContactName::Right);
        (sticks || !input.maneuver.forbids_slip()) && self.trajectory.normal_loads().all(carries)
    }

    /// The requirement that it misses: of the goal, else of the limits.
    fn missed(&self, input: &SolveInput, stop_reason: StopReason) -> Option<Reason> {
        // What is not a number is missed.
        let misses = |value: f64, tolerance: f64| value > tolerance || value.is_nan();
        let exceeded = most_exceeded(&self.limits).filter(|used| misses(used.excess, LIMIT_TOLERANCE));
        if misses(largest_magnitude(self.goal_error.iter().copied()), input.settings.goal_tolerance) {
            return Some(goal_missed(input, &self.schedule, &self.goal_error, (exceeded, stop_reason)));
        }
        exceeded.map(|used| limit_missed(input, used, stop_reason))
    }

    /// The answer; its certificate may have been cut off.
    fn solution(
        mut self,
        input: &SolveInput,
        result: SearchResult,
        (optimality, shown): (Optimality, Option<Certificate>),
    ) -> Solution {
        let (bound, replayed) = shown.as_ref().map(|shown| (shown.bound, &shown.replayed)).unzip();
        for (used, on_replay) in self.limits.iter_mut().zip(replayed.iter().flat_map(|replayed| &replayed.limits)) {
            used.replay_excess = Some(on_replay.excess);
        }
        let replay = replayed.map(|replayed| replayed.replay);
        let has_separations = !self.trajectory.separations().is_empty();
        let reason = self.missed(input, result.stop_reason);
        let keeps_law = self.trajectory.worst_contact_residual <= LAW_ERROR;
        let status = if reason.is_some() {
            Status::NotConverged
        } else if optimality.is_stationary && keeps_law && !has_separations && self.keeps_contacts(input) {
            Status::Converged
        } else {
            Status::Feasible
        };
        let is_replayed = replay.is_some_and(|replay: Replay| replay.within_tolerance);
        Solution {
            status,
            stop_reason: result.stop_reason,
            replay_confirmed: reason.is_none() && !has_separations && is_replayed,
            reason,
            goal_error: self.goal_error,
            report: Report {
                method: input.settings.method,
                step_count: result.step_count,
                refinement: result.refinement,
                iterations: result.iterations,
                rollouts: result.rollouts,
                starts_tried: result.starts_tried,
                distinct_optima: result.distinct_optima,
                predicted_decrease: optimality.measure,
                lower_bound: bound.map(|bound| bound.time.min(LONGEST_FINAL_TIME)),
                lower_bound_assumption: bound.map(|bound| bound.assumption),
                indeterminate_steps: shown.as_ref().map_or(result.step_count, |shown| shown.indeterminate_steps),
                switching_sign_violations: optimality.sign_violations,
                replay,
                limits: self.limits,
                sensitivity: shown.map_or_else(Vec::new, |shown| shown.sensitivity),
            },
            trajectory: self.trajectory,
            schedule: self.schedule,
        }
    }
}

/// A plan on a finer grid.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Replayed {
    pub(super) replay: Replay,
    /// What it uses of the limits, in the order of those of the plan.
    limits: Vec<LimitUse>,
}

/// The same torques on a finer grid: the miss is the distance of its end from the goal.
///
/// # Errors
/// When it was stopped before the end.
pub(super) fn replay(
    input: &SolveInput,
    simulator: &Simulator,
    (schedule, step_count): (&TorqueSchedule, usize),
    stop: Stop,
) -> Result<Replayed, Stopped> {
    let parameters = input.robot.parameters();
    let start = input.maneuver.start_at_center_of_mass(parameters);
    let fine = Rollout { start: &start, schedule, step_count: REPLAY_REFINEMENT * step_count };
    let (motion, limits) = motion_with_limits(simulator, &input.path_limits(), (&fine, schedule), stop)?;
    let end = simulator.end_frame(&fine, input.maneuver.reference_point.offset(parameters)).state(&motion.end);
    let miss = input.maneuver.goal_error(&end).map(finite_or_largest);
    let excess = most_exceeded(&limits).map_or(0.0, |used| finite_or_largest(larger(0.0, used.excess)));
    let replay = replay_of_miss(input, &miss, (fine.step_count, motion.separations, excess));
    Ok(Replayed { replay, limits })
}

/// The replay whose end misses the goal by `miss`.
fn replay_of_miss(
    input: &SolveInput,
    miss: &SVector<f64, { State::LEN }>,
    (step_count, separations, limit_excess): (usize, usize, f64),
) -> Replay {
    let of = |component: StateComponent| miss[component.index()].abs();
    let distance = |x, y| finite_or_largest(of(x).hypot(of(y)));
    let wheel_radius = input.robot.parameters().wheel_radius;
    // Of the wheel that misses more, by its rim, so that angles count as places do and rates as speeds.
    let rim = |left, right| finite_or_largest(wheel_radius * of(left).max(of(right)));
    let mut replay = Replay {
        step_count,
        miss_position: distance(StateComponent::X, StateComponent::Y)
            .max(rim(StateComponent::WheelAngleLeft, StateComponent::WheelAngleRight)),
        miss_heading: of(StateComponent::Heading),
        miss_speed: distance(StateComponent::VelocityX, StateComponent::VelocityY),
        miss_yaw_rate: of(StateComponent::YawRate),
        miss_wheel_speed: rim(StateComponent::WheelRateLeft, StateComponent::WheelRateRight),
        separations,
        limit_excess,
        within_tolerance: false,
    };
    replay.within_tolerance = replay.relative_miss(&input.settings) <= 1.0 && separations == 0;
    replay
}

impl Replayed {
    /// The fields of the limits that are exceeded by more than the replay may exceed them, and by how much.
    pub(super) fn excesses(&self) -> Vec<(&'static str, f64)> {
        let exceeded = self.limits.iter().filter(|used| used.excess.is_finite() && used.excess > REPLAY_EXCESS);
        exceeded.map(|used| (used.limit, used.excess)).collect()
    }

    /// Whether no limit is exceeded by more than the replay may exceed it; a motion that diverges keeps none.
    pub(super) fn keeps_limits(&self) -> bool {
        self.replay.limit_excess <= REPLAY_EXCESS
    }
}

impl Replay {
    /// The largest miss in units of its tolerance.
    pub(super) fn relative_miss(&self, settings: &SolverSettings) -> f64 {
        let drift = |speed: f64| REPLAY_DRIFT_TIME * speed;
        let position = self.miss_position.max(drift(self.miss_speed)).max(drift(self.miss_wheel_speed));
        let heading = self.miss_heading.max(drift(self.miss_yaw_rate));
        let miss = (position / settings.replay_tolerance_position).max(heading / settings.replay_tolerance_heading);
        miss.max(self.limit_excess / REPLAY_EXCESS)
    }
}

#[cfg(test)]
mod tests;
