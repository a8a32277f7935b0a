//! Answers: from the messages of the contract to protobuf messages.
//!
//! Every message is taken apart field by field, so that a field cannot be added and then forgotten.

#![expect(clippy::needless_pass_by_value, reason = "messages are turned into messages, whether they own arrays or not")]

use super::pb;
use crate::api::message::accept::AcceptedSolve;
use crate::api::message::limits::{LimitsMessage, RuleMessage};
use crate::api::message::request::{
    GoalWire, InitialGuessWire, ManeuverWire, RobotWire, SolveGridWire, SolveRequest, SolverWire, StateWire,
    TorqueScheduleWire, View,
};
use crate::api::message::response::{
    AppliedLimitsWire, ContactModeWire, ContactWire, ContactsWire, DistinctOptimumWire, GoalErrorWire, ProgressEvent,
    ReasonWire, ReplayWire, ReportWire, SeparationWire, SimulateAnswer, SolveAnswer, TrajectoryWire,
};
use crate::service::StopReason;
use crate::service::domain::{
    ContactMode, ContactName, LowerBoundAssumption, Method, ReferencePoint, RefinementOutcome, Status,
};

/// The protobuf message with the same fields.
macro_rules! same_fields {
    ($given:expr, $wire:ident => $message:ident { $($field:ident),* $(,)? }) => {{
        let $wire { $($field),* } = $given;
        pb::$message { $($field: $field.into()),* }
    }};
}

/// Counts are bounded by the limits on grids and starts, far below this.
fn count(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

/// The same for counts that were written by a caller and accepted.
fn accepted_count(number: u64) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

pub(super) fn solution(answer: SolveAnswer<'_>) -> pb::Solution {
    let SolveAnswer {
        status,
        stop_reason,
        executable,
        reason: given_reason,
        final_time_s,
        torque_schedule,
        contact_modes,
        goal_error: given_error,
        trajectory: given_trajectory,
        contacts: given_contacts,
        report: given_report,
        applied_limits: AppliedLimitsWire { time_limit_s },
        solver_version,
        input_hash,
    } = answer;
    pb::Solution {
        status: status_number(status).into(),
        stop_reason: stop_reason_number(stop_reason).into(),
        executable,
        reason: given_reason.map(reason),
        final_time_s,
        torque_schedule: Some(schedule(torque_schedule)),
        contact_modes: contact_modes.into_iter().map(contact_mode_span).collect(),
        goal_error: Some(goal_error(given_error)),
        trajectory: given_trajectory.map(trajectory),
        contacts: given_contacts.map(contacts),
        report: Some(report(given_report)),
        applied_limits: Some(pb::AppliedLimits { time_limit_s }),
        solver_version: solver_version.to_owned(),
        input_hash: input_hash.to_owned(),
    }
}

pub(super) fn simulation(answer: SimulateAnswer) -> pb::SimulateResponse {
    let SimulateAnswer {
        trajectory: given_trajectory,
        contacts: given_contacts,
        contact_modes,
        separations,
        worst_contact_residual,
        indeterminate_steps,
        slip_reversals,
    } = answer;
    pb::SimulateResponse {
        trajectory: Some(trajectory(given_trajectory)),
        contacts: Some(contacts(given_contacts)),
        contact_modes: contact_modes.into_iter().map(contact_mode_span).collect(),
        separations: separations.into_iter().map(separation).collect(),
        worst_contact_residual,
        indeterminate_steps: count(indeterminate_steps),
        slip_reversals: count(slip_reversals),
    }
}

pub(super) fn validated(accepted: AcceptedSolve) -> pb::ValidateResponse {
    let SolveRequest { robot: given_robot, maneuver: given_maneuver, grid, solver, initial_guess, view } =
        accepted.completed;
    let SolveGridWire { steps, control_intervals } = grid;
    pb::ValidateResponse {
        robot: Some(robot(given_robot)),
        maneuver: Some(maneuver(given_maneuver)),
        grid: Some(pb::SolveGrid {
            steps: steps.map(accepted_count),
            control_intervals: Some(accepted_count(control_intervals)),
        }),
        solver: Some(search(solver)),
        initial_guess: initial_guess.map(
            |given| same_fields!(given, InitialGuessWire => InitialGuess { final_time_s, torque_left_n_m, torque_right_n_m }),
        ),
        view: match view {
            View::Full => pb::View::Full,
            View::Plan => pb::View::Plan,
        }
        .into(),
        input_hash: accepted.input_hash,
    }
}

pub(super) fn limits(message: LimitsMessage) -> pb::GetLimitsResponse {
    let LimitsMessage {
        max_steps,
        max_control_intervals,
        max_starts,
        max_time_limit_s,
        default_time_limit_s,
        max_rollout_limit,
        max_body_bytes,
        workers,
        queue_length,
        queue_work_s,
        batch_window,
        rules,
    } = message;
    pb::GetLimitsResponse {
        max_steps: count(max_steps),
        max_control_intervals: count(max_control_intervals),
        max_starts: count(max_starts),
        max_time_limit_s,
        default_time_limit_s,
        max_rollout_limit,
        max_body_bytes: max_body_bytes as u64,
        workers: count(workers),
        queue_length: count(queue_length),
        queue_work_s,
        batch_window: count(batch_window),
        rules: rules.into_iter().map(|rule| same_fields!(rule, RuleMessage => FieldRule { field, rule })).collect(),
    }
}

pub(super) fn progress(event: &ProgressEvent) -> pb::Progress {
    let ProgressEvent { best_final_time_s, best_goal_error, start, start_count } = *event;
    pb::Progress { best_final_time_s, best_goal_error, start: count(start), start_count: count(start_count) }
}

pub(super) fn queued(position: usize) -> pb::Queued {
    pb::Queued { position: count(position) }
}

fn robot(given: RobotWire) -> pb::Robot {
    same_fields!(given, RobotWire => Robot {
        chassis_mass_kg,
        wheel_mass_kg,
        chassis_yaw_inertia_kg_m2,
        wheel_diametral_inertia_kg_m2,
        wheel_spin_inertia_kg_m2,
        wheel_radius_m,
        track_width_m,
        axle_to_front_support_m,
        front_support_right_m,
        center_of_mass_right_m,
        center_of_mass_forward_m,
        center_of_mass_height_m,
        wheel_friction_coefficient,
        front_friction_coefficient,
        tangential_restitution,
        gravity_m_s2,
    })
}

fn maneuver(given: ManeuverWire) -> pb::Maneuver {
    let ManeuverWire { reference_point, start, goal: given_goal, torque_limit_left_n_m, torque_limit_right_n_m } =
        given;
    pb::Maneuver {
        reference_point: match reference_point {
            ReferencePoint::ChassisCenterOfMass => pb::ReferencePoint::ChassisCenterOfMass,
            ReferencePoint::AxleMidpoint => pb::ReferencePoint::AxleMidpoint,
        }
        .into(),
        start: Some(state(start)),
        goal: Some(goal(given_goal)),
        torque_limit_left_n_m: Some(torque_limit_left_n_m),
        torque_limit_right_n_m: Some(torque_limit_right_n_m),
    }
}

fn state(given: StateWire) -> pb::State {
    same_fields!(given, StateWire => State {
        x_m,
        y_m,
        heading_rad,
        wheel_angle_left_rad,
        wheel_angle_right_rad,
        velocity_x_m_s,
        velocity_y_m_s,
        yaw_rate_rad_s,
        wheel_rate_left_rad_s,
        wheel_rate_right_rad_s,
    })
}

fn goal(given: GoalWire) -> pb::Goal {
    same_fields!(given, GoalWire => Goal {
        x_m,
        y_m,
        heading_rad,
        wheel_angle_left_rad,
        wheel_angle_right_rad,
        velocity_x_m_s,
        velocity_y_m_s,
        yaw_rate_rad_s,
        wheel_rate_left_rad_s,
        wheel_rate_right_rad_s,
        free,
    })
}

fn search(given: SolverWire) -> pb::Solver {
    let SolverWire {
        method,
        starts,
        seed,
        time_limit_s,
        rollout_limit,
        goal_tolerance,
        replay_tolerance_m,
        replay_tolerance_rad,
    } = given;
    pb::Solver {
        method: method_number(method).into(),
        starts: Some(accepted_count(starts)),
        seed,
        time_limit_s: Some(time_limit_s),
        rollout_limit: Some(rollout_limit),
        goal_tolerance: Some(goal_tolerance),
        replay_tolerance_m: Some(replay_tolerance_m),
        replay_tolerance_rad: Some(replay_tolerance_rad),
    }
}

fn schedule(given: TorqueScheduleWire) -> pb::TorqueSchedule {
    same_fields!(given, TorqueScheduleWire => TorqueSchedule { interval_s, left_n_m, right_n_m })
}

fn reason(given: ReasonWire) -> pb::Reason {
    same_fields!(given, ReasonWire => Reason { code, field, time_s, value, limit, message })
}

fn contact_mode_span(given: ContactModeWire) -> pb::ContactModeSpan {
    let ContactModeWire { start_s, end_s, left, right, front, degrees_of_freedom } = given;
    pb::ContactModeSpan {
        start_s,
        end_s,
        left: contact_mode_number(left).into(),
        right: contact_mode_number(right).into(),
        front: contact_mode_number(front).into(),
        degrees_of_freedom: degrees_of_freedom.into(),
    }
}

fn goal_error(given: GoalErrorWire) -> pb::GoalError {
    same_fields!(given, GoalErrorWire => GoalError {
        x_m,
        y_m,
        heading_rad,
        wheel_angle_left_rad,
        wheel_angle_right_rad,
        velocity_x_m_s,
        velocity_y_m_s,
        yaw_rate_rad_s,
        wheel_rate_left_rad_s,
        wheel_rate_right_rad_s,
    })
}

fn trajectory(given: TrajectoryWire) -> pb::Trajectory {
    same_fields!(given, TrajectoryWire => Trajectory {
        time_s,
        x_m,
        y_m,
        heading_rad,
        wheel_angle_left_rad,
        wheel_angle_right_rad,
        velocity_x_m_s,
        velocity_y_m_s,
        yaw_rate_rad_s,
        wheel_rate_left_rad_s,
        wheel_rate_right_rad_s,
    })
}

fn contacts(given: ContactsWire) -> pb::Contacts {
    let ContactsWire { left, right, front } = given;
    pb::Contacts { left: Some(contact(left)), right: Some(contact(right)), front: Some(contact(front)) }
}

fn contact(given: ContactWire) -> pb::Contact {
    same_fields!(given, ContactWire => Contact {
        normal_force_n,
        lateral_force_n,
        longitudinal_force_n,
        lateral_slip_m_s,
        longitudinal_slip_m_s,
    })
}

fn report(given: ReportWire) -> pb::Report {
    let ReportWire {
        method,
        steps,
        control_intervals,
        iterations,
        rollouts,
        solve_time_s,
        starts_tried,
        distinct_optima,
        worst_contact_residual,
        predicted_decrease_s,
        lower_bound_s,
        lower_bound_assumption,
        separations,
        indeterminate_steps,
        slip_reversals,
        switching_sign_violations,
        replay: given_replay,
        refinement,
    } = given;
    pb::Report {
        method: method_number(method).into(),
        steps: count(steps),
        control_intervals: count(control_intervals),
        iterations,
        rollouts,
        solve_time_s,
        starts_tried: count(starts_tried),
        distinct_optima: distinct_optima.into_iter().map(distinct_optimum).collect(),
        worst_contact_residual,
        predicted_decrease_s,
        lower_bound_s,
        lower_bound_assumption: match lower_bound_assumption {
            LowerBoundAssumption::Friction => pb::LowerBoundAssumption::Friction,
            LowerBoundAssumption::YawFriction => pb::LowerBoundAssumption::YawFriction,
            LowerBoundAssumption::DriveTorque => pb::LowerBoundAssumption::DriveTorque,
            LowerBoundAssumption::WheelDrive => pb::LowerBoundAssumption::WheelDrive,
        }
        .into(),
        separations: separations.into_iter().map(separation).collect(),
        indeterminate_steps: count(indeterminate_steps),
        slip_reversals: count(slip_reversals),
        switching_sign_violations: count(switching_sign_violations),
        replay: Some(replay(given_replay)),
        refinement: match refinement {
            RefinementOutcome::Fixed => pb::Refinement::Fixed,
            RefinementOutcome::WithinTolerance => pb::Refinement::WithinTolerance,
            RefinementOutcome::StepLimit => pb::Refinement::StepLimit,
            RefinementOutcome::GoalLost => pb::Refinement::GoalLost,
            RefinementOutcome::Interrupted => pb::Refinement::Interrupted,
            RefinementOutcome::NoPlan => pb::Refinement::NoPlan,
        }
        .into(),
    }
}

fn distinct_optimum(given: DistinctOptimumWire) -> pb::DistinctOptimum {
    let DistinctOptimumWire { final_time_s, count: starts } = given;
    pb::DistinctOptimum { final_time_s, count: count(starts) }
}

fn separation(given: SeparationWire) -> pb::Separation {
    let SeparationWire { time_s, contact, normal_force_n } = given;
    let contact = match contact {
        ContactName::Left => pb::ContactName::Left,
        ContactName::Right => pb::ContactName::Right,
        ContactName::Front => pb::ContactName::Front,
    };
    pb::Separation { time_s, contact: contact.into(), normal_force_n }
}

fn replay(given: ReplayWire) -> pb::Replay {
    let ReplayWire { steps, miss_m, miss_heading_rad, miss_speed_m_s, within_tolerance } = given;
    pb::Replay { steps: count(steps), miss_m, miss_heading_rad, miss_speed_m_s, within_tolerance }
}

fn status_number(status: Status) -> pb::Status {
    match status {
        Status::Converged => pb::Status::Converged,
        Status::Feasible => pb::Status::Feasible,
        Status::NotConverged => pb::Status::NotConverged,
        Status::Infeasible => pb::Status::Infeasible,
    }
}

fn stop_reason_number(reason: StopReason) -> pb::StopReason {
    match reason {
        StopReason::Finished => pb::StopReason::Finished,
        StopReason::TimeLimit => pb::StopReason::TimeLimit,
        StopReason::Deadline => pb::StopReason::Deadline,
        StopReason::RolloutLimit => pb::StopReason::RolloutLimit,
    }
}

fn method_number(method: Method) -> pb::Method {
    match method {
        Method::SequentialLinear => pb::Method::SequentialLinear,
        Method::NelderMead => pb::Method::NelderMead,
    }
}

fn contact_mode_number(mode: ContactMode) -> pb::ContactMode {
    match mode {
        ContactMode::Stick => pb::ContactMode::Stick,
        ContactMode::Slip => pb::ContactMode::Slip,
    }
}
