//! Requests: from wire types to validated domain input, and to the completed body with its hash.
//!
//! Every wire struct is taken apart field by field, so that a field cannot be added and then forgotten.

use std::fmt::Write as _;
use std::time::Duration;

use sha2::{Digest, Sha256};

use super::goal::{goal_from_wire, goal_to_wire};
use super::request::{
    GoalWire, InitialGuessWire, ManeuverWire, RobotWire, SimulateGridWire, SimulateRequest, SolveGridWire,
    SolveRequest, SolverWire, StateWire, TorqueScheduleWire, View,
};
use super::strict::read_object;
use crate::api::problem::Problem;
use crate::service::domain::{
    Configuration, Maneuver, PerWheel, Refinement, RobotParameters, SimulateInput, SolveInput, SolverSettings, State,
    TorqueSchedule, Velocity,
};
use crate::service::{DEFAULT_TIME_LIMIT_S, Limits};
use crate::violation::Checks;

/// A solve request that passed all checks.
#[derive(Debug, Clone)]
pub struct AcceptedSolve {
    /// What to solve.
    pub input: SolveInput,
    /// How long the solve may run.
    pub time_limit: Duration,
    /// How much of the answer is asked for.
    pub view: View,
    /// SHA-256 of the completed request, in hexadecimal.
    pub input_hash: String,
    pub(in crate::api) completed: SolveRequest,
}

/// Reads, validates and completes the body of a solve.
///
/// # Errors
/// `body_too_large`, `malformed_body`, `invalid_field`, or all violated rules and limits at once.
pub fn read_solve(body: &[u8], limits: &Limits) -> Result<AcceptedSolve, Problem> {
    accept_solve(read_object(within_limit(body, limits)?)?, limits)
}

/// Reads and validates the body of a simulation.
///
/// # Errors
/// `body_too_large`, `malformed_body`, `invalid_field`, or all violated rules and limits at once.
pub fn read_simulate(body: &[u8], limits: &Limits) -> Result<SimulateInput, Problem> {
    accept_simulate(read_object(within_limit(body, limits)?)?, limits)
}

/// Transports refuse large bodies while they read them; files come whole.
fn within_limit<'a>(body: &'a [u8], limits: &Limits) -> Result<&'a [u8], Problem> {
    let limit = limits.max_body_bytes;
    if body.len() <= limit { Ok(body) } else { Err(Problem::body_too_large(limit)) }
}

/// The complete body of the paper's case: 5 m forward from rest to rest on 200 steps.
pub fn forward_drive_body() -> Vec<u8> {
    let mut request = SolveRequest::default();
    request.maneuver.goal = goal_to_wire(&Maneuver::forward_drive().goal);
    // The straight start alone leads to the paper's plan; the default search finds faster ones that drift.
    request.solver.starts = 1;
    request.grid.steps = Some(SolverSettings::PAPER_STEP_COUNT as u64);
    canonical_bytes(&request)
}

pub(in crate::api) fn accept_solve(request: SolveRequest, limits: &Limits) -> Result<AcceptedSolve, Problem> {
    let mut checks = Checks::new();
    let SolveRequest { robot, maneuver, grid, solver, initial_guess, view } = request.clone();
    let maneuver = maneuver_from_wire(&maneuver, &mut checks);
    let (settings, time_limit_s) = settings_from_wire(&grid, &solver, limits);
    let guess = initial_guess.map(guess_from_wire);
    limits.check_solve(&settings, guess.as_ref(), time_limit_s, &mut checks);
    // A guess above the limit is refused already: judging each of its numbers would only grow the answer.
    let guess = guess.filter(|guess| limits.admits_torque_arrays(guess));
    let input = SolveInput::new(checks, robot_from_wire(&robot), maneuver, settings, guess)?;

    let completed = SolveRequest {
        maneuver: ManeuverWire { goal: goal_to_wire(&input.maneuver.goal), ..request.maneuver },
        ..request
    };
    let input_hash = hash(&canonical_bytes(&completed));
    // Positive and below the server's limit, as checked.
    let time_limit = Duration::from_secs_f64(time_limit_s);
    Ok(AcceptedSolve { input, time_limit, view, input_hash, completed })
}

pub(in crate::api) fn accept_simulate(request: SimulateRequest, limits: &Limits) -> Result<SimulateInput, Problem> {
    let mut checks = Checks::new();
    let SimulateRequest { robot, reference_point, start, torque_schedule, grid, contact_solver } = request;
    let SimulateGridWire { steps } = grid;
    let mut schedule = schedule_from_wire(torque_schedule);
    // Absent: the paper's number of steps, or one step per interval where there are more intervals.
    let interval_count = schedule.control_count().min(limits.max_control_intervals);
    let step_count = steps.map_or(SolverSettings::PAPER_STEP_COUNT.max(interval_count), count);
    limits.check_simulate(step_count, &schedule, &mut checks);
    if !limits.admits_torque_arrays(&schedule) {
        // Refused already: judging each number would only grow the answer.
        schedule.left.truncate(1);
        schedule.right.truncate(1);
    }
    let start = (reference_point, state_from_wire(&start));
    let input = SimulateInput::new(checks, robot_from_wire(&robot), start, schedule, (step_count, contact_solver))?;
    Ok(input)
}

/// The bytes whose hash names a request.
pub(in crate::api) fn canonical_bytes(completed: &SolveRequest) -> Vec<u8> {
    serde_json::to_vec(completed).expect("a request of names and numbers is valid JSON")
}

fn hash(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::with_capacity(64), |mut text, byte| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Counts beyond the address space are far above every limit: the largest count is refused just the same.
fn count(wire: u64) -> usize {
    usize::try_from(wire).unwrap_or(usize::MAX)
}

fn robot_from_wire(wire: &RobotWire) -> RobotParameters {
    let RobotWire {
        chassis_mass_kg: chassis_mass,
        wheel_mass_kg: wheel_mass,
        chassis_yaw_inertia_kg_m2: chassis_yaw_inertia,
        wheel_diametral_inertia_kg_m2: wheel_diametral_inertia,
        wheel_spin_inertia_kg_m2: wheel_spin_inertia,
        wheel_radius_m: wheel_radius,
        track_width_m: track_width,
        axle_to_front_support_m: axle_to_front_support,
        front_support_right_m: front_support_right,
        center_of_mass_right_m: center_of_mass_right,
        center_of_mass_forward_m: center_of_mass_forward,
        center_of_mass_height_m: center_of_mass_height,
        wheel_friction_coefficient,
        front_friction_coefficient,
        tangential_restitution,
        gravity_m_s2: gravity,
    } = *wire;
    RobotParameters {
        chassis_mass,
        wheel_mass,
        chassis_yaw_inertia,
        wheel_diametral_inertia,
        wheel_spin_inertia,
        wheel_radius,
        track_width,
        axle_to_front_support,
        front_support_right,
        center_of_mass_right,
        center_of_mass_forward,
        center_of_mass_height,
        wheel_friction_coefficient,
        front_friction_coefficient,
        tangential_restitution,
        gravity,
    }
}

impl Default for RobotWire {
    fn default() -> Self {
        let RobotParameters {
            chassis_mass,
            wheel_mass,
            chassis_yaw_inertia,
            wheel_diametral_inertia,
            wheel_spin_inertia,
            wheel_radius,
            track_width,
            axle_to_front_support,
            front_support_right,
            center_of_mass_right,
            center_of_mass_forward,
            center_of_mass_height,
            wheel_friction_coefficient,
            front_friction_coefficient,
            tangential_restitution,
            gravity,
        } = RobotParameters::default();
        Self {
            chassis_mass_kg: chassis_mass,
            wheel_mass_kg: wheel_mass,
            chassis_yaw_inertia_kg_m2: chassis_yaw_inertia,
            wheel_diametral_inertia_kg_m2: wheel_diametral_inertia,
            wheel_spin_inertia_kg_m2: wheel_spin_inertia,
            wheel_radius_m: wheel_radius,
            track_width_m: track_width,
            axle_to_front_support_m: axle_to_front_support,
            front_support_right_m: front_support_right,
            center_of_mass_right_m: center_of_mass_right,
            center_of_mass_forward_m: center_of_mass_forward,
            center_of_mass_height_m: center_of_mass_height,
            wheel_friction_coefficient,
            front_friction_coefficient,
            tangential_restitution,
            gravity_m_s2: gravity,
        }
    }
}

fn maneuver_from_wire(wire: &ManeuverWire, checks: &mut Checks) -> Maneuver {
    let ManeuverWire { reference_point, start, goal, torque_limit_left_n_m, torque_limit_right_n_m } = wire;
    let start = state_from_wire(start);
    let goal = checks.within("maneuver", |checks| checks.within("goal", |checks| goal_from_wire(goal, &start, checks)));
    let torque_limit = PerWheel::new(*torque_limit_left_n_m, *torque_limit_right_n_m);
    Maneuver { reference_point: *reference_point, start, goal, torque_limit }
}

impl Default for ManeuverWire {
    fn default() -> Self {
        let Maneuver { reference_point, start: _, goal: _, torque_limit } = Maneuver::forward_drive();
        Self {
            reference_point,
            // Absent start and goal are not those of the paper's case: rest at the origin, and the start.
            start: StateWire::default(),
            goal: GoalWire::default(),
            torque_limit_left_n_m: torque_limit.left,
            torque_limit_right_n_m: torque_limit.right,
        }
    }
}

fn state_from_wire(wire: &StateWire) -> State {
    let StateWire {
        x_m: x,
        y_m: y,
        heading_rad: heading,
        wheel_angle_left_rad,
        wheel_angle_right_rad,
        velocity_x_m_s,
        velocity_y_m_s,
        yaw_rate_rad_s: yaw_rate,
        wheel_rate_left_rad_s,
        wheel_rate_right_rad_s,
    } = *wire;
    let wheel_angle = PerWheel::new(wheel_angle_left_rad, wheel_angle_right_rad);
    let wheel_rate = PerWheel::new(wheel_rate_left_rad_s, wheel_rate_right_rad_s);
    State {
        configuration: Configuration { x, y, heading, wheel_angle },
        velocity: Velocity { x: velocity_x_m_s, y: velocity_y_m_s, yaw_rate, wheel_rate },
    }
}

/// The settings, and the time limit in s, which belongs to the service.
fn settings_from_wire(grid: &SolveGridWire, solver: &SolverWire, limits: &Limits) -> (SolverSettings, f64) {
    let SolveGridWire { steps, control_intervals } = *grid;
    let control_count = count(control_intervals);
    let (step_count, refinement) = if let Some(steps) = steps {
        (count(steps), Refinement::Fixed)
    } else {
        // More intervals than the server takes are refused whatever the grid.
        let first = SolverSettings::first_step_count(control_count.min(limits.max_control_intervals));
        (first.min(limits.max_steps), Refinement::UntilExecutable { step_limit: limits.max_steps })
    };
    let SolverWire {
        method,
        starts,
        seed,
        time_limit_s,
        rollout_limit,
        goal_tolerance,
        replay_tolerance_m,
        replay_tolerance_rad,
    } = *solver;
    let settings = SolverSettings {
        method,
        step_count,
        refinement,
        control_count,
        start_count: count(starts),
        seed,
        rollout_limit,
        goal_tolerance,
        replay_tolerance_position: replay_tolerance_m,
        replay_tolerance_heading: replay_tolerance_rad,
    };
    (settings, time_limit_s)
}

impl Default for SolveGridWire {
    fn default() -> Self {
        let SolverSettings { control_count, .. } = SolverSettings::default();
        Self { steps: None, control_intervals: control_count as u64 }
    }
}

impl Default for SolverWire {
    fn default() -> Self {
        let SolverSettings {
            method,
            step_count: _,
            refinement: _,
            control_count: _,
            start_count,
            seed,
            rollout_limit,
            goal_tolerance,
            replay_tolerance_position,
            replay_tolerance_heading,
        } = SolverSettings::default();
        Self {
            method,
            starts: start_count as u64,
            seed,
            time_limit_s: DEFAULT_TIME_LIMIT_S,
            rollout_limit,
            goal_tolerance,
            replay_tolerance_m: replay_tolerance_position,
            replay_tolerance_rad: replay_tolerance_heading,
        }
    }
}

fn guess_from_wire(wire: InitialGuessWire) -> TorqueSchedule {
    let InitialGuessWire { final_time_s: final_time, torque_left_n_m: left, torque_right_n_m: right } = wire;
    TorqueSchedule { final_time, left, right }
}

fn schedule_from_wire(wire: TorqueScheduleWire) -> TorqueSchedule {
    let TorqueScheduleWire { interval_s, left_n_m: left, right_n_m: right } = wire;
    TorqueSchedule { final_time: interval_s * left.len() as f64, left, right }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wire_defaults_are_the_domain_defaults() {
        let accepted = read_solve(b"{}", &Limits::default()).unwrap();
        assert_eq!(accepted.input.robot.parameters(), &RobotParameters::default());
        assert_eq!(accepted.input.settings, SolverSettings::default());
        assert_eq!(accepted.time_limit, Duration::from_secs(10));
    }

    #[test]
    fn forward_drive_is_the_case_of_the_domain() {
        let accepted = read_solve(&forward_drive_body(), &Limits::default()).unwrap();
        assert_eq!(accepted.input.maneuver, Maneuver::forward_drive());
        assert_eq!(accepted.input.settings, SolveInput::forward_drive().settings);
    }

    #[test]
    fn automatic_steps_start_on_a_grid_that_fits_the_intervals() {
        let grid_for = |control_intervals: usize| {
            let body = format!(r#"{{"grid": {{"control_intervals": {control_intervals}}}}}"#);
            let settings = read_solve(body.as_bytes(), &Limits::default()).unwrap().input.settings;
            assert_eq!(settings.refinement, Refinement::UntilExecutable { step_limit: 10_000 });
            settings.step_count
        };
        assert_eq!([1, 37, 40, 200, 201, 1000].map(grid_for), [200, 222, 200, 200, 201, 1000]);
    }

    #[test]
    fn completed_body_of_automatic_steps_means_the_same() {
        let accepted = read_solve(b"{}", &Limits::default()).unwrap();
        let again = read_solve(&canonical_bytes(&accepted.completed), &Limits::default()).unwrap();
        assert_eq!(again.input_hash, accepted.input_hash);
        assert_eq!(again.input.settings, accepted.input.settings);
        let fixed = read_solve(br#"{"grid": {"steps": 200}}"#, &Limits::default()).unwrap();
        assert_ne!(fixed.input_hash, accepted.input_hash);
    }

    #[test]
    fn forward_drive_keeps_its_hash() {
        // Callers store hashes: a change of names, order or defaults of the completed body must be meant.
        let accepted = read_solve(&forward_drive_body(), &Limits::default()).unwrap();
        assert_eq!(accepted.input_hash, "85bea469ecece9bade97a2ef09e2c0819a49869d6702683754de0a4085aa65c4");
    }

    #[test]
    fn long_schedule_is_refused_before_its_numbers_are_judged() {
        let zeros = vec!["9e99"; 2000].join(",");
        let body =
            format!(r#"{{"torque_schedule": {{"interval_s": 1, "left_n_m": [{zeros}], "right_n_m": [{zeros}]}}}}"#);
        let problem = read_simulate(body.as_bytes(), &Limits::default()).unwrap_err();
        let pointers: Vec<_> = problem.errors().iter().map(|error| error.pointer.as_str()).collect();
        assert_eq!(pointers, ["#/torque_schedule/left_n_m", "#/torque_schedule/right_n_m"]);
    }
}
