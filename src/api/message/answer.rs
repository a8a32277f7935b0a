//! Answers: from domain types to wire types.
//!
//! Every domain struct is taken apart field by field, so that a field cannot be added and then forgotten.

use nalgebra::SVector;

use super::accept::AcceptedSolve;
use super::limits::LimitsMessage;
use super::request::{TorqueScheduleWire, View};
use super::response::{
    AppliedLimitsWire, ContactModeWire, ContactWire, ContactsWire, DistinctOptimumWire, GoalErrorWire, ReasonWire,
    ReplayWire, ReportWire, SeparationWire, SimulateAnswer, SolveAnswer, TrajectoryWire, ValidateAnswer,
};
use crate::service::domain::{
    Configuration, ContactModeSpan, ContactSample, DistinctOptimum, Goal, PerContact, PerWheel, Reason, Replay, Report,
    Separation, Simulation, Solution, State, StateComponent, TorqueSchedule, Trajectory, Velocity,
};
use crate::service::{Simulated, Solved};

/// The JSON answer of a solve.
pub fn solve_answer(accepted: &AcceptedSolve, solved: &Solved) -> Vec<u8> {
    json(&solve_message(accepted, solved))
}

/// The answer of a solve.
pub(in crate::api) fn solve_message<'a>(accepted: &'a AcceptedSolve, solved: &Solved) -> SolveAnswer<'a> {
    let Solved { solution, solve_time, stop_reason, queue_wait: _ } = solved;
    let Solution {
        status,
        // The service tells why the solver was stopped.
        stop_reason: _,
        executable,
        reason,
        schedule,
        goal_error,
        trajectory,
        contact_modes,
        report,
    } = solution;
    let is_full = accepted.view == View::Full;
    SolveAnswer {
        status: *status,
        stop_reason: *stop_reason,
        executable: *executable,
        reason: reason.as_ref().map(reason_to_wire),
        final_time_s: schedule.final_time,
        torque_schedule: schedule_to_wire(schedule),
        contact_modes: contact_modes.iter().map(contact_mode_to_wire).collect(),
        goal_error: goal_error_to_wire(goal_error, &accepted.input.maneuver.goal),
        trajectory: is_full.then(|| trajectory_to_wire(trajectory)),
        contacts: is_full.then(|| contacts_to_wire(&trajectory.contact)),
        report: report_to_wire(report, solve_time.as_secs_f64()),
        applied_limits: AppliedLimitsWire { time_limit_s: accepted.time_limit.as_secs_f64() },
        solver_version: env!("CARGO_PKG_VERSION"),
        input_hash: &accepted.input_hash,
    }
}

/// The JSON answer of a simulation.
pub fn simulate_answer(simulated: &Simulated) -> Vec<u8> {
    json(&simulate_message(simulated))
}

/// The answer of a simulation.
pub(in crate::api) fn simulate_message(simulated: &Simulated) -> SimulateAnswer {
    // The same request gives the same bytes: the duration goes to the log only.
    let Simulated { simulation, duration: _, queue_wait: _ } = simulated;
    let Simulation { trajectory, contact_modes, separations, slip_reversals } = simulation;
    SimulateAnswer {
        trajectory: trajectory_to_wire(trajectory),
        contacts: contacts_to_wire(&trajectory.contact),
        contact_modes: contact_modes.iter().map(contact_mode_to_wire).collect(),
        separations: separations.iter().map(separation_to_wire).collect(),
        worst_contact_residual: trajectory.worst_contact_residual,
        indeterminate_steps: trajectory.indeterminate_steps,
        slip_reversals: *slip_reversals,
    }
}

/// The JSON answer of a validation.
pub(in crate::api) fn validate_answer(accepted: &AcceptedSolve) -> Vec<u8> {
    json(&ValidateAnswer { completed: &accepted.completed, input_hash: &accepted.input_hash })
}

/// The JSON answer of `GET /limits`.
pub(in crate::api) fn limits_answer(message: &LimitsMessage) -> Vec<u8> {
    json(message)
}

fn json<T: serde::Serialize>(answer: &T) -> Vec<u8> {
    serde_json::to_vec(answer).expect("an answer of names and numbers is valid JSON")
}

fn reason_to_wire(reason: &Reason) -> ReasonWire {
    let Reason { code, field, time, value, limit, message } = reason;
    ReasonWire { code, field: field.clone(), time_s: *time, value: *value, limit: *limit, message: message.clone() }
}

fn schedule_to_wire(schedule: &TorqueSchedule) -> TorqueScheduleWire {
    let TorqueSchedule { final_time: _, left, right } = schedule;
    TorqueScheduleWire { interval_s: schedule.interval(), left_n_m: left.clone(), right_n_m: right.clone() }
}

fn contact_mode_to_wire(span: &ContactModeSpan) -> ContactModeWire {
    let ContactModeSpan { start, end, mode, degrees_of_freedom } = *span;
    let PerContact { left, right, front } = mode;
    ContactModeWire { start_s: start, end_s: end, left, right, front, degrees_of_freedom }
}

fn goal_error_to_wire(error: &SVector<f64, { State::LEN }>, goal: &Goal) -> GoalErrorWire {
    let of = |component: StateComponent| error[component.index()];
    let where_constrained = |component| goal.value(component).map(|_| of(component));
    GoalErrorWire {
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

fn trajectory_to_wire(trajectory: &Trajectory) -> TrajectoryWire {
    let mut wire = TrajectoryWire { time_s: trajectory.time.clone(), ..TrajectoryWire::default() };
    for state in &trajectory.state {
        let State { configuration, velocity } = *state;
        let Configuration { x, y, heading, wheel_angle: PerWheel { left: angle_left, right: angle_right } } =
            configuration;
        let Velocity { x: velocity_x, y: velocity_y, yaw_rate, wheel_rate: PerWheel { left, right } } = velocity;
        wire.x_m.push(x);
        wire.y_m.push(y);
        wire.heading_rad.push(heading);
        wire.wheel_angle_left_rad.push(angle_left);
        wire.wheel_angle_right_rad.push(angle_right);
        wire.velocity_x_m_s.push(velocity_x);
        wire.velocity_y_m_s.push(velocity_y);
        wire.yaw_rate_rad_s.push(yaw_rate);
        wire.wheel_rate_left_rad_s.push(left);
        wire.wheel_rate_right_rad_s.push(right);
    }
    wire
}

fn contacts_to_wire(contacts: &[PerContact<ContactSample>]) -> ContactsWire {
    ContactsWire {
        left: contact_to_wire(contacts.iter().map(|step| &step.left)),
        right: contact_to_wire(contacts.iter().map(|step| &step.right)),
        front: contact_to_wire(contacts.iter().map(|step| &step.front)),
    }
}

fn contact_to_wire<'a>(samples: impl Iterator<Item = &'a ContactSample>) -> ContactWire {
    let mut wire = ContactWire::default();
    for sample in samples {
        let ContactSample {
            normal_force,
            lateral_force,
            longitudinal_force,
            lateral_slip,
            longitudinal_slip,
            // Told as spans in `contact_modes`.
            mode: _,
        } = *sample;
        wire.normal_force_n.push(normal_force);
        wire.lateral_force_n.push(lateral_force);
        wire.longitudinal_force_n.push(longitudinal_force);
        wire.lateral_slip_m_s.push(lateral_slip);
        wire.longitudinal_slip_m_s.push(longitudinal_slip);
    }
    wire
}

fn report_to_wire(report: &Report, solve_time_s: f64) -> ReportWire {
    let Report {
        method,
        step_count,
        refinement,
        control_count,
        iterations,
        rollouts,
        starts_tried,
        distinct_optima,
        worst_contact_residual,
        predicted_decrease,
        lower_bound,
        lower_bound_assumption,
        separations,
        indeterminate_steps,
        slip_reversals,
        switching_sign_violations,
        replay,
    } = report;
    ReportWire {
        method: *method,
        steps: *step_count,
        control_intervals: *control_count,
        iterations: *iterations,
        rollouts: *rollouts,
        solve_time_s,
        starts_tried: *starts_tried,
        distinct_optima: distinct_optima.iter().map(distinct_optimum_to_wire).collect(),
        worst_contact_residual: *worst_contact_residual,
        predicted_decrease_s: *predicted_decrease,
        lower_bound_s: *lower_bound,
        lower_bound_assumption: *lower_bound_assumption,
        separations: separations.iter().map(separation_to_wire).collect(),
        indeterminate_steps: *indeterminate_steps,
        slip_reversals: *slip_reversals,
        switching_sign_violations: *switching_sign_violations,
        replay: replay_to_wire(replay),
        refinement: *refinement,
    }
}

fn distinct_optimum_to_wire(optimum: &DistinctOptimum) -> DistinctOptimumWire {
    let DistinctOptimum { final_time, count } = *optimum;
    DistinctOptimumWire { final_time_s: final_time, count }
}

fn separation_to_wire(separation: &Separation) -> SeparationWire {
    let Separation { time, contact, normal_force } = *separation;
    SeparationWire { time_s: time, contact, normal_force_n: normal_force }
}

fn replay_to_wire(replay: &Replay) -> ReplayWire {
    let Replay { step_count, miss_position, miss_heading, miss_speed, within_tolerance } = *replay;
    ReplayWire {
        steps: step_count,
        miss_m: miss_position,
        miss_heading_rad: miss_heading,
        miss_speed_m_s: miss_speed,
        within_tolerance,
    }
}
