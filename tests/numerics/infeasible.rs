//! What cannot be done is said without search: the first requirement that fails, where, by how much, and what would help.

use slipdrive::robot::{PerWheel, RobotParameters};
use slipdrive::shooting::StateComponent::{
    self, Heading, VelocityX, VelocityY, WheelAngleLeft, WheelRateLeft, WheelRateRight, X, Y, YawRate,
};
use slipdrive::shooting::{Goal, LONGEST_FINAL_TIME, Maneuver};
use slipdrive::solver::{
    Method, Reason, Refinement, RunControl, Solution, SolveInput, SolveParameters, SolverSettings, Status, StopReason,
    solve,
};

/// A request and the reason that its answer must name.
#[derive(Clone)]
struct Case {
    kind: &'static str,
    robot: RobotParameters,
    maneuver: Maneuver,
    settings: SolverSettings,
    code: &'static str,
    /// Empty where it is whichever component is missed most.
    field: &'static str,
}

/// The reference robot, asked for nothing: every goal field free, at rest at the origin.
fn case(kind: &'static str, code: &'static str, field: &'static str, change: impl Fn(&mut Case)) -> Case {
    let maneuver = Maneuver { goal: Goal::default(), ..Maneuver::forward_drive() };
    let robot = RobotParameters::default();
    let settings = SolverSettings { start_count: 2, ..SolverSettings::default() };
    let mut case = Case { kind, robot, maneuver, settings, code, field };
    change(&mut case);
    case
}

fn without_torque(case: &mut Case) {
    case.maneuver.torque_limit = PerWheel::new(0.0, 0.0);
}

fn without_friction(case: &mut Case) {
    case.robot.wheel_friction_coefficient = 0.0;
}

fn ask(case: &mut Case, component: StateComponent, value: f64) {
    case.maneuver.goal.set(component, Some(value));
}

fn ask_rest_at(case: &mut Case, x: f64, y: f64, heading: f64) {
    case.maneuver.goal = Goal::at_rest(x, y, heading);
}

/// Kinds that no plan can do.
fn impossible() -> Vec<Case> {
    [without_torque_kinds(), without_friction_kinds(), beyond_the_limits_kinds()].concat()
}

fn without_torque_kinds() -> Vec<Case> {
    vec![
        case("no torque, a drive", "no_torque", "maneuver.goal.y_m", |case| {
            without_torque(case);
            ask_rest_at(case, 0.0, 5.0, 0.0);
        }),
        case("no torque, a turn", "no_torque", "maneuver.goal.heading_rad", |case| {
            without_torque(case);
            ask_rest_at(case, 0.0, 0.0, 1.0);
        }),
        case("no torque, a speed", "no_torque", "maneuver.goal.velocity_y_m_s", |case| {
            without_torque(case);
            ask(case, VelocityY, 1.0);
        }),
        case("no torque, a spinning wheel", "no_torque", "maneuver.goal.wheel_rate_right_rad_s", |case| {
            without_torque(case);
            ask(case, WheelRateRight, 3.0);
        }),
        case("no torque, faster than the start", "no_torque", "maneuver.goal.velocity_y_m_s", |case| {
            without_torque(case);
            case.maneuver.start.velocity.y = 1.0;
            ask(case, VelocityY, 2.0);
            ask(case, YawRate, 0.0);
        }),
        case("less torque than the front support takes", "no_torque", "maneuver.goal.y_m", |case| {
            case.robot.front_friction_coefficient = 0.3;
            case.maneuver.torque_limit = PerWheel::new(0.02, 0.02);
            ask_rest_at(case, 0.0, 5.0, 0.0);
        }),
        case("no torque on one wheel and no friction", "no_torque", "maneuver.goal.wheel_rate_left_rad_s", |case| {
            without_friction(case);
            case.maneuver.torque_limit.left = 0.0;
            ask(case, WheelRateLeft, 1.0);
        }),
        case(
            "no torque on one wheel and no friction, an angle",
            "no_torque",
            "maneuver.goal.wheel_angle_left_rad",
            |case| {
                without_friction(case);
                case.maneuver.torque_limit.left = 0.0;
                ask(case, WheelAngleLeft, 1.0);
            },
        ),
    ]
}

fn without_friction_kinds() -> Vec<Case> {
    vec![
        case("no friction, a drive", "no_friction", "maneuver.goal.y_m", |case| {
            without_friction(case);
            ask_rest_at(case, 0.0, 5.0, 0.0);
        }),
        case("no friction, a turn", "no_friction", "maneuver.goal.heading_rad", |case| {
            without_friction(case);
            ask_rest_at(case, 0.0, 0.0, -1.0);
        }),
        case("no friction, braking", "no_friction", "maneuver.goal.velocity_y_m_s", |case| {
            without_friction(case);
            case.maneuver.start.velocity.y = 1.0;
            ask(case, VelocityY, 0.0);
        }),
        case("no friction, off the line of coasting", "no_friction", "maneuver.goal.x_m", |case| {
            without_friction(case);
            case.maneuver.start.velocity.y = 1.0;
            ask(case, X, 1.0);
            ask(case, Y, 1.0);
        }),
        case("no friction, behind the coasting robot", "no_friction", "maneuver.goal.y_m", |case| {
            without_friction(case);
            case.maneuver.start.velocity.y = 1.0;
            ask(case, Y, -1.0);
        }),
        case("no friction, a spin", "no_friction", "maneuver.goal.yaw_rate_rad_s", |case| {
            without_friction(case);
            ask(case, YawRate, 1.0);
        }),
        case("grip at the idle front support alone", "no_friction", "maneuver.goal.y_m", |case| {
            without_friction(case);
            case.robot.front_friction_coefficient = 0.3;
            ask_rest_at(case, 0.0, 1.0, 0.0);
        }),
    ]
}

fn beyond_the_limits_kinds() -> Vec<Case> {
    vec![
        case("too far on ice", "final_time_too_long", "maneuver.goal.y_m", |case| {
            case.robot.wheel_friction_coefficient = 1e-6;
            ask_rest_at(case, 0.0, 1e4, 0.0);
        }),
        case("too fast on ice", "final_time_too_long", "maneuver.goal.velocity_y_m_s", |case| {
            case.robot.wheel_friction_coefficient = 1e-6;
            ask(case, VelocityY, 1.0);
            ask(case, YawRate, 0.0);
        }),
        case("too far for the torque", "final_time_too_long", "maneuver.goal.y_m", |case| {
            case.maneuver.torque_limit = PerWheel::new(1e-9, 1e-9);
            ask_rest_at(case, 0.0, 100.0, 0.0);
        }),
        case("a turn too slow for the torque", "final_time_too_long", "maneuver.goal.heading_rad", |case| {
            case.maneuver.torque_limit = PerWheel::new(1e-12, 1e-12);
            ask(case, Heading, 3.0);
        }),
        case(
            "a wheel too heavy for its torque",
            "final_time_too_long",
            "maneuver.goal.wheel_rate_left_rad_s",
            |case| {
                without_friction(case);
                case.robot.wheel_spin_inertia = 1e4;
                case.maneuver.torque_limit.left = 1e-3;
                ask(case, WheelRateLeft, 1.0);
            },
        ),
        case("a start that lifts a wheel", "start_separates", "maneuver.start.yaw_rate_rad_s", |case| {
            case.maneuver.start.velocity.yaw_rate = 100.0;
            ask_rest_at(case, 0.0, 5.0, 0.0);
        }),
        case("a goal that lifts a wheel", "goal_separates", "maneuver.goal.yaw_rate_rad_s", |case| {
            ask_rest_at(case, 0.0, 5.0, 0.0);
            ask(case, YawRate, 100.0);
        }),
        case(
            "wheels that viscous friction lets lift",
            "start_separates",
            "maneuver.start.wheel_rate_left_rad_s",
            |case| {
                case.robot.wheel_viscous_friction = 0.5;
                let velocity = &mut case.maneuver.start.velocity;
                velocity.y = -1.0;
                velocity.wheel_rate =
                    PerWheel::new(velocity.y / case.robot.wheel_radius, velocity.y / case.robot.wheel_radius);
                ask_rest_at(case, 0.0, -1.0, 0.0);
            },
        ),
        case("a start that unloads a wheel", "start_below_load_share", "maneuver.start.yaw_rate_rad_s", |case| {
            without_friction(case);
            without_torque(case);
            case.maneuver.start.velocity.yaw_rate = 60.0;
            case.maneuver.limits.normal_load_share = 0.3;
            ask(case, Y, 5.0);
        }),
    ]
}

/// Kinds that the search cannot do with what it was given.
fn unmet() -> Vec<Case> {
    vec![
        case("no rollouts to search with", "goal_missed", "", |case| {
            case.settings.rollout_limit = 1;
            ask_rest_at(case, 1.0, 5.0, 0.0);
        }),
        case("one torque for the whole maneuver", "goal_missed", "", |case| {
            (case.settings.control_count, case.settings.refinement) = (1, Refinement::Fixed);
            ask_rest_at(case, 0.0, 5.0, 0.0);
        }),
        case("one step for the whole maneuver", "goal_missed", "", |case| {
            (case.settings.control_count, case.settings.step_count) = (1, 1);
            case.settings.refinement = Refinement::Fixed;
            ask_rest_at(case, 1.0, 0.0, 0.0);
        }),
        case("coasting that never gets there", "goal_missed", "", |case| {
            without_torque(case);
            case.maneuver.start.velocity.y = 1.0;
            ask(case, X, 1.0);
            ask(case, Y, -3.0);
        }),
        case("a speed with locked wheels", "goal_missed", "", |case| {
            ask_rest_at(case, 0.0, 2.0, 0.0);
            ask(case, VelocityY, 0.5);
        }),
        case("a long way on few steps", "goal_missed", "", |case| {
            (case.settings.step_count, case.settings.refinement) = (60, Refinement::Fixed);
            ask_rest_at(case, 60.0, 80.0, 0.0);
        }),
        case("the paper's method against eight requirements", "goal_missed", "", |case| {
            case.settings.method = Method::NelderMead;
            case.settings.rollout_limit = 2000;
            ask_rest_at(case, 0.0, 5.0, 0.0);
        }),
    ]
}

fn solved(case: &Case) -> Solution {
    let input = SolveInput::new(SolveParameters {
        robot: case.robot,
        maneuver: case.maneuver,
        settings: case.settings,
        ..SolveParameters::default()
    });
    solve(&input.unwrap_or_else(|violations| panic!("{}: {violations}", case.kind)), &RunControl::unattended()).unwrap()
}

/// The goal component that a reason names.
fn component(reason: &Reason) -> StateComponent {
    let field = reason.field.strip_prefix("maneuver.goal.").unwrap();
    StateComponent::ALL.into_iter().find(|component| component.field() == field).unwrap()
}

#[test]
fn what_is_impossible_is_found_without_search() {
    let cases = impossible();
    assert!(cases.len() >= 15);
    for case in &cases {
        let (kind, solution) = (case.kind, solved(case));
        let reason = solution.reason.as_ref().unwrap_or_else(|| panic!("{kind}: {:?}", solution.status));
        assert_eq!((solution.status, reason.code), (Status::Infeasible, case.code), "{kind}: {reason:?}");
        assert_eq!(reason.field, case.field, "{kind}: {reason:?}");
        assert_eq!((solution.report.rollouts, solution.stop_reason), (0, StopReason::Finished), "{kind}");
        assert!(
            reason.message.contains(&reason.field) && reason.message.contains("help"),
            "{kind}: {}",
            reason.message
        );
        if kind == "wheels that viscous friction lets lift" {
            let rate = case.maneuver.start.velocity.wheel_rate.left;
            assert!(reason.message.contains(&format!("is {rate},")), "{}", reason.message);
        }
    }
}

#[test]
fn an_infeasible_answer_shows_the_start_and_its_distance_from_the_goal() {
    for case in impossible() {
        let (kind, solution) = (case.kind, solved(&case));
        assert!(!solution.replay_confirmed && solution.report.distinct_optima.is_empty(), "{kind}");
        assert_eq!((solution.schedule.final_time, solution.schedule.control_count()), (0.0, 0), "{kind}");
        assert_eq!(solution.trajectory.state, [case.maneuver.start], "{kind}");
        assert_eq!(solution.goal_error, case.maneuver.goal_error(&case.maneuver.start), "{kind}");
        let reason = solution.reason.unwrap();
        // Nobody knows when a robot would be at a goal that it cannot have.
        assert_eq!(reason.time.is_none(), case.code.starts_with("goal_"), "{kind}: {reason:?}");
        let numbers = [reason.time.unwrap_or(0.0), reason.value, reason.limit, solution.report.lower_bound.unwrap()];
        assert!(numbers.iter().all(|number| number.is_finite()), "{kind}: {numbers:?}");
        assert!(solution.report.lower_bound.unwrap() <= LONGEST_FINAL_TIME, "{kind}");
        if ["no_torque", "no_friction"].contains(&case.code) {
            let missed = component(&reason).index();
            assert_eq!((reason.value, reason.limit), (solution.goal_error[missed].abs(), 1e-6), "{kind}");
        }
    }
}

#[test]
fn what_the_search_missed_is_named_with_what_would_help() {
    for case in unmet() {
        let (kind, solution) = (case.kind, solved(&case));
        let reason = solution.reason.as_ref().unwrap_or_else(|| panic!("{kind}: {:?}", solution.status));
        assert_eq!((solution.status, reason.code), (Status::NotConverged, case.code), "{kind}: {reason:?}");
        assert_eq!(reason.value, solution.goal_error[component(reason).index()].abs(), "{kind}: {reason:?}");
        // The component that is missed most.
        assert_eq!((reason.value, reason.limit), (solution.goal_error.amax(), 1e-6), "{kind}");
        assert!(reason.message.contains("would help"), "{kind}: {}", reason.message);
        let cause = match kind {
            "no rollouts to search with" => "`solver.rollout_limit`",
            "one torque for the whole maneuver" => "`grid.control_intervals`",
            "a long way on few steps" => {
                "or 452 or more `grid.steps`, on which the robot keeps its course so far, would help"
            }
            "the paper's method against eight requirements" => "the method `sequential_linear` would help",
            "a speed with locked wheels" => {
                "wheel rates fit its velocity or are free (as asked, a wheel slips by 0.5 m/s)"
            }
            _ => "",
        };
        assert!(reason.message.contains(cause), "{kind}: {}", reason.message);
    }
}

#[test]
fn a_coasting_robot_meets_headings_on_its_way_round() {
    for heading in [0.5, 3.5, -0.5, -3.5] {
        let turning = case("coasting round", "", "", |case| {
            without_torque(case);
            case.robot.center_of_mass_forward = 0.0;
            case.maneuver.start.velocity.yaw_rate = 1.0;
            let rim = 0.5 * case.robot.track_width / case.robot.wheel_radius;
            case.maneuver.start.velocity.wheel_rate = PerWheel::new(-rim, rim);
            ask(case, Heading, heading);
        });
        assert_eq!(solved(&turning).status, Status::Converged, "{heading}");
    }
}

#[test]
fn goals_of_a_speed_alone_are_met() {
    let goals: [&[(StateComponent, f64)]; 4] = [
        &[(VelocityX, 1.0), (VelocityY, 0.0)],
        &[(VelocityX, -1.0)],
        &[(WheelRateLeft, 10.0)],
        &[(WheelRateLeft, 5.0), (WheelRateRight, -5.0)],
    ];
    for goal in goals {
        let speeding = case("a speed alone", "", "", |case| {
            case.settings.refinement = Refinement::Fixed;
            for (component, value) in goal {
                ask(case, *component, *value);
            }
        });
        let solution = solved(&speeding);
        assert_eq!(solution.status, Status::Converged, "{goal:?}: {:?}", solution.reason);
    }
}

#[test]
fn nelder_mead_turns_in_place() {
    let turn = case("a turn", "", "", |case| {
        (case.settings.method, case.settings.refinement) = (Method::NelderMead, Refinement::Fixed);
        (case.settings.step_count, case.settings.control_count) = (40, 10);
        ask_rest_at(case, 0.0, 0.0, 1.5);
    });
    assert!(solved(&turn).goal_error.amax() < 0.2);
}

#[test]
fn a_goal_on_the_way_of_a_coasting_robot_is_reached_without_torque() {
    let coasting = case("coasting", "", "", |case| {
        without_torque(case);
        case.maneuver.start.velocity.y = 1.0;
        case.maneuver.start.velocity.wheel_rate = PerWheel::new(1.0 / 0.06, 1.0 / 0.06);
        ask(case, Y, 2.0);
        ask(case, VelocityY, 1.0);
    });
    let solution = solved(&coasting);
    assert_eq!(solution.status, Status::Converged, "{:?}", solution.reason);
    // Rolling straight on loses nothing: 2 m at 1 m/s.
    assert!((solution.schedule.final_time - 2.0).abs() < 1e-5);
}

#[test]
fn one_driven_wheel_is_not_impossible() {
    let one_wheel = case("one wheel", "", "", |case| {
        case.maneuver.torque_limit.left = 0.0;
        ask(case, YawRate, 1.0);
    });
    assert_eq!(solved(&one_wheel).status, Status::Converged);
}
