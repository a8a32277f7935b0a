//! Requests: from protobuf messages to the messages of the contract, which hold the defaults and lead to the rules.
//!
//! Every protobuf message is taken apart field by field, so that a field cannot be added and then forgotten.

use super::pb;
use crate::api::error_table::ErrorCode;
use crate::api::message::request::{
    GoalWire, InitialGuessWire, ManeuverWire, RobotWire, SimulateGridWire, SimulateRequest, SolveGridWire,
    SolveRequest, SolverWire, StateWire, TorqueScheduleWire, View,
};
use crate::api::problem::Problem;
use crate::service::domain::{ContactMethod, Method, ReferencePoint};

/// The wire type with the defaults of its own where the protobuf message has no value.
macro_rules! completed {
    ($given:expr, $message:ident => $wire:ident { $($field:ident),* $(,)? }) => {{
        let default = $wire::default();
        match $given {
            None => default,
            Some(pb::$message { $($field),* }) => $wire {
                $($field: $field.map_or(default.$field, Into::into)),*
            },
        }
    }};
}

/// A solve in the form that REST reads.
pub(super) fn solve(given: pb::SolveRequest) -> Result<SolveRequest, Problem> {
    let pb::SolveRequest { robot: given_robot, maneuver: given_maneuver, grid, solver, initial_guess, view } = given;
    Ok(SolveRequest {
        robot: robot(given_robot),
        maneuver: maneuver(given_maneuver.unwrap_or_default())?,
        grid: time_grid(grid.unwrap_or_default()),
        solver: search(solver.unwrap_or_default())?,
        initial_guess: initial_guess.map(guess).transpose()?,
        view: match named(view, "#/view", pb::View::try_from)? {
            pb::View::Unspecified => View::default(),
            pb::View::Full => View::Full,
            pb::View::Plan => View::Plan,
        },
    })
}

/// A simulation in the form that REST reads.
pub(super) fn simulate(given: pb::SimulateRequest) -> Result<SimulateRequest, Problem> {
    let pb::SimulateRequest { robot: given_robot, reference_point, start, torque_schedule, grid, contact_solver } =
        given;
    let pb::SimulateGrid { steps } = grid.unwrap_or_default();
    Ok(SimulateRequest {
        robot: robot(given_robot),
        reference_point: point(reference_point, "#/reference_point")?,
        start: state(start.unwrap_or_default()),
        torque_schedule: schedule(torque_schedule.ok_or_else(|| missing("#/torque_schedule"))?)?,
        grid: SimulateGridWire { steps: steps.map(u64::from) },
        contact_solver: contact_method(contact_solver)?,
    })
}

fn time_grid(given: pb::SolveGrid) -> SolveGridWire {
    let pb::SolveGrid { steps, control_intervals } = given;
    let default = SolveGridWire::default();
    SolveGridWire {
        steps: steps.map(u64::from),
        control_intervals: control_intervals.map_or(default.control_intervals, Into::into),
    }
}

fn robot(given: Option<pb::Robot>) -> RobotWire {
    completed!(given, Robot => RobotWire {
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

fn maneuver(given: pb::Maneuver) -> Result<ManeuverWire, Problem> {
    let pb::Maneuver {
        reference_point,
        start,
        goal: given_goal,
        torque_limit_left_n_m: left,
        torque_limit_right_n_m: right,
    } = given;
    let default = ManeuverWire::default();
    Ok(ManeuverWire {
        reference_point: point(reference_point, "#/maneuver/reference_point")?,
        start: state(start.unwrap_or_default()),
        goal: goal(given_goal.unwrap_or_default()),
        torque_limit_left_n_m: left.unwrap_or(default.torque_limit_left_n_m),
        torque_limit_right_n_m: right.unwrap_or(default.torque_limit_right_n_m),
    })
}

fn state(given: pb::State) -> StateWire {
    let pb::State {
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
    } = given;
    StateWire {
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
    }
}

fn goal(given: pb::Goal) -> GoalWire {
    let pb::Goal {
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
    } = given;
    GoalWire {
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
    }
}

fn search(given: pb::Solver) -> Result<SolverWire, Problem> {
    let pb::Solver {
        method,
        starts,
        seed,
        time_limit_s,
        rollout_limit,
        goal_tolerance,
        replay_tolerance_m,
        replay_tolerance_rad,
    } = given;
    let default = SolverWire::default();
    Ok(SolverWire {
        method: match named(method, "#/solver/method", pb::Method::try_from)? {
            pb::Method::Unspecified => default.method,
            pb::Method::SequentialLinear => Method::SequentialLinear,
            pb::Method::NelderMead => Method::NelderMead,
        },
        starts: starts.map_or(default.starts, u64::from),
        seed,
        time_limit_s: time_limit_s.unwrap_or(default.time_limit_s),
        rollout_limit: rollout_limit.unwrap_or(default.rollout_limit),
        goal_tolerance: goal_tolerance.unwrap_or(default.goal_tolerance),
        replay_tolerance_m: replay_tolerance_m.unwrap_or(default.replay_tolerance_m),
        replay_tolerance_rad: replay_tolerance_rad.unwrap_or(default.replay_tolerance_rad),
    })
}

fn guess(given: pb::InitialGuess) -> Result<InitialGuessWire, Problem> {
    let pb::InitialGuess { final_time_s, torque_left_n_m, torque_right_n_m } = given;
    let final_time_s = final_time_s.ok_or_else(|| missing("#/initial_guess/final_time_s"))?;
    Ok(InitialGuessWire { final_time_s, torque_left_n_m, torque_right_n_m })
}

fn schedule(given: pb::TorqueSchedule) -> Result<TorqueScheduleWire, Problem> {
    let pb::TorqueSchedule { interval_s, left_n_m, right_n_m } = given;
    let interval_s = interval_s.ok_or_else(|| missing("#/torque_schedule/interval_s"))?;
    Ok(TorqueScheduleWire { interval_s, left_n_m, right_n_m })
}

fn point(number: i32, pointer: &str) -> Result<ReferencePoint, Problem> {
    Ok(match named(number, pointer, pb::ReferencePoint::try_from)? {
        pb::ReferencePoint::Unspecified => ReferencePoint::default(),
        pb::ReferencePoint::ChassisCenterOfMass => ReferencePoint::ChassisCenterOfMass,
        pb::ReferencePoint::AxleMidpoint => ReferencePoint::AxleMidpoint,
    })
}

fn contact_method(number: i32) -> Result<ContactMethod, Problem> {
    Ok(match named(number, "#/contact_solver", pb::ContactSolver::try_from)? {
        pb::ContactSolver::Unspecified => ContactMethod::default(),
        pb::ContactSolver::Exact => ContactMethod::Exact,
        pb::ContactSolver::FixedPoint => ContactMethod::FixedPoint,
    })
}

/// Enums of proto3 are open: a number without a name is refused as REST refuses an unknown name.
fn named<T, E>(number: i32, pointer: &str, try_from: impl FnOnce(i32) -> Result<T, E>) -> Result<T, Problem> {
    try_from(number).map_err(|_| {
        let field = dotted(pointer);
        Problem::at_field(ErrorCode::InvalidField, pointer.to_owned(), format!("`{field}`: unknown value {number}"))
    })
}

fn missing(pointer: &str) -> Problem {
    let field = dotted(pointer);
    Problem::at_field(ErrorCode::InvalidField, pointer.to_owned(), format!("`{field}`: missing field"))
}

fn dotted(pointer: &str) -> String {
    super::status::field_of_pointer(pointer)
}

/// The calls that carry a solve have one message each, with the same fields.
macro_rules! same_fields {
    ($($message:ident),*) => {
        $(impl From<pb::$message> for pb::SolveRequest {
            fn from(given: pb::$message) -> Self {
                let pb::$message { robot, maneuver, grid, solver, initial_guess, view } = given;
                Self { robot, maneuver, grid, solver, initial_guess, view }
            }
        })*
    };
}

same_fields!(SolveStreamRequest, ValidateRequest);

/// The id of an item and what it asks.
pub(super) fn batch_item(given: pb::SolveBatchRequest) -> (String, pb::SolveRequest) {
    let pb::SolveBatchRequest { robot, maneuver, grid, solver, initial_guess, view, request_id } = given;
    (request_id, pb::SolveRequest { robot, maneuver, grid, solver, initial_guess, view })
}
