//! Requests of a solve: from the message to validated domain input, and to the completed message with its hash.

use std::mem::take;
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use crate::contract::convert::{aisle_corners, count, maneuver, named, payload, required, robot};
use crate::contract::message::{InitialGuess, SolveGrid, SolveRequest, Solver, ValidateResponse, View};
use crate::contract::{Problem, hexadecimal, json, message};
use crate::jobs::limits::{Clock, DEFAULT_TIME_LIMIT_S, Limits};
use crate::motion;
use crate::rules::{Checks, Number, Rule, RuleSet, Violations};
use crate::simulation::TorqueSchedule;
use crate::solver::{Choice, Refinement, SolveInput, SolveParameters, SolverSettings};

/// The bounds of the time limit, which belongs to the service.
const TIME_LIMIT_RULE: Rule = Rule::positive("s");
/// What it must be where no clock ends a solve.
const WITHOUT_CLOCK: &str = "absent: solves are ended by their rollout limit alone here";

/// A solve request that passed all checks.
#[derive(Debug, Clone)]
pub struct AcceptedSolve {
    /// What to solve.
    pub input: SolveInput,
    /// How long the solve may run; none where no clock ends it.
    pub time_limit: Option<Duration>,
    /// How much of the answer is asked for.
    pub view: View,
    /// SHA-256 of the completed request, in hexadecimal.
    pub input_hash: String,
    /// The request with what absent fields mean; `ValidateResponse` says which ones stay absent.
    pub completed: SolveRequest,
}

/// The rules of a request.
pub(super) fn rules(limits: &Limits) -> RuleSet {
    let rules = SolveParameters::rules()
        .with("solver", RuleSet::of([("time_limit_s", TIME_LIMIT_RULE)]))
        .at_most("grid.steps", limits.max_steps as f64)
        .at_most("grid.control_intervals", limits.max_control_intervals as f64)
        .at_most("solver.starts", limits.max_starts as f64)
        .at_most("solver.rollout_limit", limits.max_rollout_limit as f64)
        .at_most("solver.time_limit_s", limits.max_time_limit_s);
    limits.on_arrays(rules, ["initial_guess.torque_left_n_m", "initial_guess.torque_right_n_m"])
}

/// Validates and completes a request.
///
/// # Errors
/// `invalid_field`, or all violated rules and limits at once.
pub(super) fn accept(request: SolveRequest, limits: &Limits) -> Result<AcceptedSolve, Problem> {
    let mut checks = Checks::new();
    let SolveRequest {
        robot: given_robot,
        payload: given_payload,
        maneuver: given_maneuver,
        grid,
        solver,
        initial_guess,
        view,
    } = request;
    let view = match named(view, "view")? {
        View::Unspecified => View::Full,
        view @ (View::Full | View::Plan) => view,
    };
    let grid = grid.unwrap_or_default();
    let (settings, time_limit_s) = settings(&grid, solver.unwrap_or_default(), limits)?;
    let (mut given_robot, mut given_maneuver) = (given_robot.unwrap_or_default(), given_maneuver.unwrap_or_default());
    let (footprint, keep_in) = (take(&mut given_robot.footprint), take(&mut given_maneuver.keep_in));
    let robot = robot(&given_robot, &mut checks);
    let parameters = SolveParameters {
        robot,
        payload: given_payload.map(payload).transpose()?,
        maneuver: maneuver(given_maneuver, &robot, &mut checks)?,
        aisle: aisle_corners(&keep_in, &footprint),
        settings,
        initial_guess: initial_guess.clone().map(guess).transpose()?,
    };
    let parameters = within_limits(parameters, time_limit_s, limits, &mut checks);
    let of_default = |violations: Violations| match grid.control_intervals {
        Some(_) => violations,
        None => violations.of_default("grid.control_intervals"),
    };
    let input = checks.and(SolveInput::new(parameters)).map_err(of_default)?;
    let completed = SolveRequest {
        robot: Some(message::Robot { footprint, ..(&robot).into() }),
        payload: input.payload.as_ref().filter(|payload| payload.is_load()).map(Into::into),
        maneuver: Some(message::Maneuver { keep_in, ..(&input.maneuver).into() }),
        grid: Some(SolveGrid { control_intervals: Some(count(settings.control_count)), ..grid }),
        solver: Some(solver_message(&settings, time_limit_s)),
        initial_guess,
        view: view.into(),
    };
    let input_hash = hexadecimal(&Sha256::digest(json::write(&completed)));
    // Positive and below the server's limit, as checked.
    let time_limit = time_limit_s.map(Duration::from_secs_f64);
    Ok(AcceptedSolve { input, time_limit, view, input_hash, completed })
}

/// Adds what is above the server's limits to `checks`; a guess that is too long goes no further.
fn within_limits(
    mut parameters: SolveParameters,
    time_limit_s: Option<f64>,
    limits: &Limits,
    checks: &mut Checks,
) -> SolveParameters {
    let SolverSettings { step_count, control_count, start_count, rollout_limit, .. } = parameters.settings;
    checks.server_limit("grid.steps", step_count as f64, limits.max_steps as f64);
    checks.server_limit("grid.control_intervals", control_count as f64, limits.max_control_intervals as f64);
    checks.server_limit("solver.starts", start_count as f64, limits.max_starts as f64);
    checks.server_limit("solver.rollout_limit", rollout_limit as f64, limits.max_rollout_limit as f64);
    if let Some(time_limit_s) = time_limit_s {
        check_time_limit(time_limit_s, limits, checks);
    }
    parameters.initial_guess = parameters.initial_guess.filter(|TorqueSchedule { left, right, .. }| {
        let arrays = [("initial_guess.torque_left_n_m", &left[..]), ("initial_guess.torque_right_n_m", &right[..])];
        limits.check_arrays(checks, arrays)
    });
    parameters
}

fn check_time_limit(time_limit_s: f64, limits: &Limits, checks: &mut Checks) {
    const FIELD: &str = "solver.time_limit_s";
    match limits.clock {
        Clock::Limits => {
            checks.bounds(FIELD, time_limit_s, &TIME_LIMIT_RULE);
            checks.server_limit(FIELD, time_limit_s, limits.max_time_limit_s);
        }
        Clock::Rests => checks.require(FIELD, Number(time_limit_s), false, WITHOUT_CLOCK, None),
    }
}

/// The completed request, for those who only ask whether it is valid.
pub fn validated(accepted: AcceptedSolve) -> ValidateResponse {
    let AcceptedSolve { completed, input_hash, .. } = accepted;
    let SolveRequest { robot, payload, maneuver, grid, solver, initial_guess, view } = completed;
    ValidateResponse { robot, payload, maneuver, grid, solver, initial_guess, view, input_hash }
}

/// The settings, and the time limit in s, which belongs to the service.
fn settings(grid: &SolveGrid, solver: Solver, limits: &Limits) -> Result<(SolverSettings, Option<f64>), Problem> {
    let default = SolverSettings::default();
    let count_or = |given: Option<u32>, default: usize| given.map_or(default, |count| count as usize);
    let SolveGrid { steps, control_intervals } = *grid;
    let control_count = count_or(control_intervals, default.control_count);
    let (step_count, refinement) = if let Some(steps) = steps {
        (steps as usize, Refinement::Fixed)
    } else {
        // More intervals than the server takes are refused whatever the grid.
        let first = motion::first_step_count(control_count.min(limits.max_control_intervals));
        (first.min(limits.max_steps), Refinement::UntilConfirmed { step_limit: limits.max_steps })
    };
    let Solver {
        method,
        starts,
        seed,
        time_limit_s,
        rollout_limit,
        goal_tolerance,
        replay_tolerance_m,
        replay_tolerance_rad,
        choose,
        choose_within,
    } = solver;
    let settings = SolverSettings {
        method: named::<message::Method>(method, "solver.method")?.into(),
        step_count,
        refinement,
        control_count,
        start_count: count_or(starts, default.start_count),
        seed,
        rollout_limit: rollout_limit.unwrap_or(default.rollout_limit),
        goal_tolerance: goal_tolerance.unwrap_or(default.goal_tolerance),
        replay_tolerance_position: replay_tolerance_m.unwrap_or(default.replay_tolerance_position),
        replay_tolerance_heading: replay_tolerance_rad.unwrap_or(default.replay_tolerance_heading),
        choice: named::<message::Choice>(choose, "solver.choose")?.into(),
        choose_within: choose_within.unwrap_or(default.choose_within),
    };
    let default_time_limit_s = (limits.clock == Clock::Limits).then_some(DEFAULT_TIME_LIMIT_S);
    Ok((settings, time_limit_s.or(default_time_limit_s)))
}

fn solver_message(settings: &SolverSettings, time_limit_s: Option<f64>) -> Solver {
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
        choice,
        choose_within,
    } = *settings;
    // Defaults are what absent fields mean: requests without them keep their hashes.
    let choose = match choice {
        Choice::Fastest => message::Choice::Unspecified,
        Choice::Steadiest => message::Choice::Steadiest,
    };
    Solver {
        method: message::Method::from(method).into(),
        starts: Some(count(start_count)),
        seed,
        time_limit_s,
        rollout_limit: Some(rollout_limit),
        goal_tolerance: Some(goal_tolerance),
        replay_tolerance_m: Some(replay_tolerance_position),
        replay_tolerance_rad: Some(replay_tolerance_heading),
        choose: choose.into(),
        choose_within: Some(choose_within).filter(|&share| share != SolverSettings::default().choose_within),
    }
}

fn guess(given: InitialGuess) -> Result<TorqueSchedule, Problem> {
    let InitialGuess { final_time_s, torque_left_n_m: left, torque_right_n_m: right } = given;
    let final_time = required(final_time_s, "initial_guess.final_time_s")?;
    Ok(TorqueSchedule { final_time, left, right })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::Kind as _;
    use crate::jobs::limits::{MAX_CONTROL_INTERVALS, MAX_ROLLOUT_LIMIT, MAX_STARTS, MAX_STEPS};
    use crate::jobs::solve::Solve;
    use crate::jobs::solve::examples::forward_drive;
    use crate::robot::RobotParameters;
    use crate::rules::ViolationCode;
    use crate::shooting::Maneuver;

    fn forward_drive_body() -> Vec<u8> {
        json::write(&forward_drive())
    }

    fn faults_of(settings: SolverSettings, time_limit_s: f64) -> Vec<(String, ViolationCode)> {
        let mut checks = Checks::new();
        let parameters = SolveParameters { settings, ..SolveParameters::default() };
        within_limits(parameters, Some(time_limit_s), &Limits::default(), &mut checks);
        match checks.finish() {
            Ok(()) => Vec::new(),
            Err(violations) => violations.list().iter().map(|fault| (fault.field.clone(), fault.code)).collect(),
        }
    }

    #[test]
    fn defaults_are_within_the_limits() {
        assert_eq!(faults_of(SolverSettings::default(), DEFAULT_TIME_LIMIT_S), []);
    }

    #[test]
    fn every_limit_is_named_with_its_field() {
        let settings = SolverSettings {
            step_count: MAX_STEPS + 1,
            control_count: MAX_CONTROL_INTERVALS + 1,
            start_count: MAX_STARTS + 1,
            rollout_limit: MAX_ROLLOUT_LIMIT + 1,
            ..SolverSettings::default()
        };
        let expected =
            ["grid.steps", "grid.control_intervals", "solver.starts", "solver.rollout_limit", "solver.time_limit_s"];
        let expected = expected.map(|field| (field.to_owned(), ViolationCode::ProblemTooLarge));
        assert_eq!(faults_of(settings, 61.0), expected);
    }

    #[test]
    fn time_limit_must_be_positive() {
        let found = faults_of(SolverSettings::default(), 0.0);
        assert_eq!(found, [("solver.time_limit_s".to_owned(), ViolationCode::InvalidValue)]);
    }

    #[test]
    fn every_number_of_a_request_has_a_rule() {
        let rules = rules(&Limits::default());
        let completed = serde_json::to_value(forward_drive()).unwrap();
        let mut fields = Vec::new();
        numbers_in(&completed, String::new(), &mut fields);
        assert!(fields.len() > 40, "{fields:?}");
        for field in fields.iter().filter(|field| *field != "solver.seed") {
            assert!(rules.fields.iter().any(|(name, _)| name == field), "`{field}` has no rule: {rules:?}");
        }
        let rule = |field: &str| rules.fields.iter().find(|(name, _)| name == field).map(|(_, rule)| rule.to_string());
        assert_eq!(rule("robot.wheel_radius_m").as_deref(), Some("between 0.001 and 10 m"));
        assert_eq!(rule("grid.steps").as_deref(), Some("between 1 and 10000"));
        assert_eq!(rule("maneuver.goal.y_m").as_deref(), Some("between -10000 and 10000 m"));
        assert_eq!(rule("solver.time_limit_s").as_deref(), Some("> 0 and <= 60 s"));
        assert_eq!(rule("initial_guess.torque_left_n_m").as_deref(), Some("between 1 and 1000 items"));
    }

    fn numbers_in(value: &serde_json::Value, path: String, fields: &mut Vec<String>) {
        if let Some(object) = value.as_object() {
            for (name, value) in object {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                numbers_in(value, path, fields);
            }
        } else if value.is_number() {
            fields.push(path);
        }
    }

    #[test]
    fn wire_defaults_are_the_domain_defaults() {
        let accepted = Solve::read(b"{}", &Limits::default()).unwrap();
        assert_eq!(accepted.input.robot.parameters(), &RobotParameters::default());
        assert_eq!(accepted.input.settings, SolverSettings::default());
        assert_eq!(accepted.time_limit, Some(Duration::from_secs(10)));
    }

    #[test]
    fn forward_drive_is_the_case_of_the_domain() {
        let accepted = Solve::read(&forward_drive_body(), &Limits::default()).unwrap();
        assert_eq!(accepted.input.maneuver, Maneuver::forward_drive());
        assert_eq!(accepted.input.settings, SolveInput::forward_drive().settings);
    }

    #[test]
    fn automatic_steps_start_on_a_grid_that_fits_the_intervals() {
        let grid_for = |control_intervals: usize| {
            let body = format!(r#"{{"grid": {{"control_intervals": {control_intervals}}}}}"#);
            let settings = Solve::read(body.as_bytes(), &Limits::default()).unwrap().input.settings;
            assert_eq!(settings.refinement, Refinement::UntilConfirmed { step_limit: 10_000 });
            settings.step_count
        };
        assert_eq!([1, 37, 40, 200, 201, 1000].map(grid_for), [200, 222, 200, 200, 201, 1000]);
    }

    #[test]
    fn completed_body_of_automatic_steps_means_the_same() {
        let accepted = Solve::read(b"{}", &Limits::default()).unwrap();
        let again = Solve::read(&json::write(&accepted.completed), &Limits::default()).unwrap();
        assert_eq!(again.input_hash, accepted.input_hash);
        assert_eq!(again.input.settings, accepted.input.settings);
        let fixed = Solve::read(br#"{"grid": {"steps": 200}}"#, &Limits::default()).unwrap();
        assert_ne!(fixed.input_hash, accepted.input_hash);
    }

    #[test]
    fn what_is_as_its_absence_is_left_out_of_the_completed_body() {
        let body = br#"{"robot": {"wheel_viscous_friction_n_m_s": 0, "footprint": []}, "maneuver": {"slip": "allowed", "keep_in": []},
                        "solver": {"choose": "fastest", "choose_within": 0.01}}"#;
        let given = Solve::read(body, &Limits::default()).unwrap();
        assert_eq!(given.completed, Solve::read(b"{}", &Limits::default()).unwrap().completed);
        let completed = serde_json::to_value(given.completed).unwrap();
        let names = |object: &serde_json::Value| object.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&completed), ["grid", "maneuver", "robot", "solver", "view"]);
        assert_eq!(names(&completed["grid"]), ["control_intervals"]);
        assert_eq!(names(&completed["maneuver"]["limits"]), ["normal_load_share"]);
        // The other 16 of the robot, and all ten of the start.
        assert_eq!((names(&completed["robot"]).len(), names(&completed["maneuver"]["start"]).len()), (16, 10));
    }

    #[test]
    fn without_a_clock_a_time_limit_is_refused_and_none_is_added() {
        let limits = Limits::default().without_clock();
        let problem = Solve::read(br#"{"solver": {"time_limit_s": 5}}"#, &limits).unwrap_err();
        let error = &problem.errors()[0];
        assert_eq!(error.pointer, "#/solver/time_limit_s");
        assert!(error.message.starts_with("`solver.time_limit_s` is 5, must be absent"), "{}", error.message);
        let accepted = Solve::read(b"{}", &limits).unwrap();
        assert_eq!((accepted.time_limit, accepted.completed.solver.unwrap().time_limit_s), (None, None));
    }

    #[test]
    fn forward_drive_keeps_its_hash() {
        // Callers store hashes: a change of names, order or defaults of the completed body must be meant.
        let accepted = Solve::read(&forward_drive_body(), &Limits::default()).unwrap();
        assert_eq!(accepted.input_hash, "9dceaf852f12e3a4605fe219ea333cdfde0cf92421a422af9f5a2a63e8fed5e5");
    }

    #[test]
    fn start_that_is_refused_is_not_refused_as_the_goal_too() {
        let problem = Solve::read(br#"{"maneuver": {"start": {"x_m": 2e4}}}"#, &Limits::default()).unwrap_err();
        let pointers: Vec<_> = problem.errors().iter().map(|error| error.pointer.as_str()).collect();
        assert_eq!(pointers, ["#/maneuver/start/x_m"]);
    }

    #[test]
    fn whole_numbers_may_have_a_point() {
        let with = |number: &str| {
            let solver = format!(r#"{{"seed": {number}, "rollout_limit": {number}, "starts": {number}}}"#);
            Solve::read(
                format!(r#"{{"solver": {solver}, "grid": {{"steps": {number}}}}}"#).as_bytes(),
                &Limits::default(),
            )
        };
        assert_eq!(with("60.0").unwrap().input_hash, with("60").unwrap().input_hash);
        assert_eq!(with("6e1").unwrap().input_hash, with("60").unwrap().input_hash);
        assert_eq!(with("60.5").unwrap_err().errors()[0].pointer, "#/solver/seed");
        let seed =
            |number: &str| Solve::read(format!(r#"{{"solver": {{"seed": {number}}}}}"#).as_bytes(), &Limits::default());
        assert!(seed("18446744073709551615").is_ok(), "the largest keeps its digits");
        for beyond in ["18446744073709551616", "1e30", "-1", "-1.0"] {
            assert_eq!(seed(beyond).unwrap_err().errors()[0].code, "invalid_field", "{beyond}");
        }
        let many = Solve::read(br#"{"solver": {"rollout_limit": 1e30}}"#, &Limits::default()).unwrap_err();
        assert_eq!(many.errors()[0].code, "problem_too_large");
    }

    #[test]
    fn zeros_of_both_signs_have_one_hash() {
        let of = |zero: &str| {
            let body = format!(
                r#"{{"robot": {{"center_of_mass_right_m": {zero}, "footprint": [{{"right_m": {zero}, "forward_m": -1}},
                     {{"right_m": 1, "forward_m": 1}}, {{"right_m": -1, "forward_m": 1}}]}},
                    "maneuver": {{"start": {{"heading_rad": {zero}}}, "goal": {{"x_m": {zero}, "y_m": 1}}}},
                    "initial_guess": {{"final_time_s": 1, "torque_left_n_m": [{zero}], "torque_right_n_m": [1]}}}}"#
            );
            Solve::read(body.as_bytes(), &Limits::default()).unwrap()
        };
        let (plus, minus) = (of("0"), of("-0.0"));
        assert_eq!(plus.input_hash, minus.input_hash);
        let start = minus.input.maneuver.start.configuration;
        assert!([start.heading, start.x].into_iter().all(f64::is_sign_positive), "the solver sees no other number");
    }

    #[test]
    fn long_guess_is_refused_before_its_numbers_are_judged() {
        let torques = vec!["9e99"; 2000].join(",");
        let guess =
            format!(r#"{{"final_time_s": 1, "torque_left_n_m": [{torques}], "torque_right_n_m": [{torques}]}}"#);
        let body = format!(r#"{{"initial_guess": {guess}}}"#);
        let problem = Solve::read(body.as_bytes(), &Limits::default()).unwrap_err();
        let pointers: Vec<_> = problem.errors().iter().map(|error| error.pointer.as_str()).collect();
        assert_eq!(pointers, ["#/initial_guess/torque_left_n_m", "#/initial_guess/torque_right_n_m"]);
    }
}
