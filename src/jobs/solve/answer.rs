//! The answer of a solve.

use nalgebra::SVector;

use super::accept::AcceptedSolve;
use super::{Progressed, Solved, StopReason};
use crate::contract::convert::{contacts, count, same_values};
use crate::contract::message;
use crate::motion::Sensitivity;
use crate::robot::{Payload, State};
use crate::service::Done;
use crate::shooting::{Goal, StateComponent};
use crate::simulation::{TorqueSchedule, Trajectory};
use crate::solver::{
    DistinctOptimum, LowerBoundAssumption, Reason, RefinementOutcome, Replay, Report, Solution, SolveProgress, Status,
};

same_values!(Status = Status { Converged, Feasible, NotConverged, Infeasible });
same_values!(StopReason = StopReason { Finished, TimeLimit, Deadline, RolloutLimit });
same_values!(Refinement = RefinementOutcome { Fixed, WithinTolerance, StepLimit, GoalLost, Interrupted, NoPlan });
same_values!(LowerBoundAssumption = LowerBoundAssumption { Friction, YawFriction, DriveTorque, WheelDrive, Limits });

/// The answer of a solve.
pub(super) fn solution(accepted: &AcceptedSolve, done: &Done<Solved>) -> message::Solution {
    let Solved { solution, stop_reason, .. } = &done.output;
    let Solution {
        status,
        // The service knows why the solver was stopped.
        stop_reason: _,
        replay_confirmed,
        reason,
        schedule,
        goal_error: error,
        trajectory,
        report: given_report,
    } = solution;
    let is_full = accepted.view == message::View::Full;
    message::Solution {
        status: message::Status::from(*status).into(),
        stop_reason: message::StopReason::from(*stop_reason).into(),
        replay_confirmed: *replay_confirmed,
        reason: reason.as_ref().map(Into::into),
        final_time_s: schedule.final_time,
        torque_schedule: Some(schedule.into()),
        contact_modes: trajectory.contact_modes().iter().map(Into::into).collect(),
        end_state: Some((&trajectory.end_state).into()),
        goal_error: Some(goal_error(error, &accepted.input.maneuver.goal)),
        trajectory: is_full.then(|| trajectory.into()),
        contacts: is_full.then(|| contacts(&trajectory.contact)),
        robot: accepted.input.payload.filter(Payload::is_load).map(|_| joined_robot(accepted)),
        report: Some(report(given_report, (schedule, trajectory), done.duration.as_secs_f64())),
        applied_limits: accepted.time_limit.map(|limit| message::AppliedLimits { time_limit_s: limit.as_secs_f64() }),
        solver_version: env!("CARGO_PKG_VERSION").to_owned(),
        input_hash: accepted.input_hash.clone(),
    }
}

/// The robot that moves, in the outline of the one that was given.
fn joined_robot(accepted: &AcceptedSolve) -> message::Robot {
    let footprint = accepted.completed.robot.iter().flat_map(|bare| bare.footprint.clone()).collect();
    message::Robot { footprint, ..accepted.input.robot.parameters().into() }
}

impl From<Progressed> for message::Progress {
    fn from(progress: Progressed) -> Self {
        let SolveProgress { best_final_time, best_goal_error, start, start_count } = progress.best;
        let (start, start_count, phase) = (count(start), count(start_count), progress.phase.into());
        Self { best_final_time_s: best_final_time, best_goal_error, start, start_count, phase }
    }
}

impl From<&Reason> for message::Reason {
    fn from(reason: &Reason) -> Self {
        let Reason { code, field, time, value, limit, message } = reason.clone();
        Self { code: code.to_owned(), field, time_s: time, value, limit, message }
    }
}

fn goal_error(error: &SVector<f64, { State::LEN }>, goal: &Goal) -> message::GoalError {
    let of = |component: StateComponent| error[component.index()];
    let where_constrained = |component| goal.value(component).map(|_| of(component));
    message::GoalError {
        x_m: of(StateComponent::X),
        y_m: of(StateComponent::Y),
        heading_rad: of(StateComponent::Heading),
        wheel_angle_left_rad: where_constrained(StateComponent::WheelAngleLeft),
        wheel_angle_right_rad: where_constrained(StateComponent::WheelAngleRight),
        velocity_x_m_s: of(StateComponent::VelocityX),
        velocity_y_m_s: of(StateComponent::VelocityY),
        yaw_rate_rad_s: of(StateComponent::YawRate),
        wheel_rate_left_rad_s: of(StateComponent::WheelRateLeft),
        wheel_rate_right_rad_s: of(StateComponent::WheelRateRight),
    }
}

fn report(
    report: &Report,
    (schedule, trajectory): (&TorqueSchedule, &Trajectory),
    solve_time_s: f64,
) -> message::Report {
    let Report {
        method,
        step_count,
        refinement,
        iterations,
        rollouts,
        starts_tried,
        distinct_optima,
        predicted_decrease,
        lower_bound,
        lower_bound_assumption,
        indeterminate_steps,
        switching_sign_violations,
        replay: given_replay,
        limits,
        sensitivity: shifts,
    } = report;
    message::Report {
        method: message::Method::from(*method).into(),
        steps: count(*step_count),
        control_intervals: count(schedule.control_count()),
        iterations: *iterations,
        rollouts: *rollouts,
        solve_time_s,
        starts_tried: count(*starts_tried),
        distinct_optima: distinct_optima.iter().map(optimum).collect(),
        worst_contact_residual: trajectory.worst_contact_residual,
        predicted_decrease_s: *predicted_decrease,
        lower_bound_s: lower_bound.unwrap_or(f64::NAN),
        lower_bound_assumption: lower_bound_assumption
            .map_or(message::LowerBoundAssumption::Unspecified, Into::into)
            .into(),
        separations: trajectory.separations().iter().map(Into::into).collect(),
        least_normal_load: trajectory.least_normal_load().as_ref().map(Into::into),
        indeterminate_steps: count(*indeterminate_steps),
        slip_reversals: count(trajectory.slip_reversals()),
        switching_sign_violations: count(*switching_sign_violations),
        replay: given_replay.as_ref().map(replay),
        refinement: message::Refinement::from(*refinement).into(),
        limits: limits.iter().map(Into::into).collect(),
        sensitivity: shifts.iter().map(sensitivity).collect(),
    }
}

fn optimum(optimum: &DistinctOptimum) -> message::DistinctOptimum {
    let DistinctOptimum { final_time, count: of, friction_shift: shift } = *optimum;
    message::DistinctOptimum {
        final_time_s: final_time,
        count: count(of),
        friction_shift_m: shift.map(|shift| shift.distance),
        friction_shift_rad: shift.map(|shift| shift.angle),
    }
}

fn sensitivity(sensitivity: &Sensitivity) -> message::Sensitivity {
    let Sensitivity { parameter, change, outcome } = sensitivity;
    let shift = outcome.as_ref().ok();
    message::Sensitivity {
        parameter: message::ChangedParameter::from(*parameter).into(),
        change: *change,
        unit: parameter.unit().to_owned(),
        end_shift_m: shift.map(|shift| shift.distance),
        end_shift_rad: shift.map(|shift| shift.angle),
        separates: shift.is_some_and(|shift| shift.separates),
        refused: outcome.as_ref().err().cloned(),
    }
}

fn replay(replay: &Replay) -> message::Replay {
    let Replay {
        step_count,
        miss_position,
        miss_heading,
        miss_speed,
        miss_yaw_rate,
        miss_wheel_speed,
        separations,
        // By field in `limits`.
        limit_excess: _,
        within_tolerance,
    } = *replay;
    message::Replay {
        steps: count(step_count),
        miss_m: miss_position,
        miss_heading_rad: miss_heading,
        miss_speed_m_s: miss_speed,
        miss_yaw_rate_rad_s: miss_yaw_rate,
        miss_wheel_speed_m_s: miss_wheel_speed,
        separations: count(separations),
        within_tolerance,
    }
}
