//! What a server accepts: its own limits, and the rules of single fields.

use serde::Serialize;
use utoipa::ToSchema;

use super::accept::accept_solve;
use super::request::{GoalWire, ManeuverWire, RobotWire, SolveGridWire, SolveRequest, SolverWire, StateWire};
use crate::api::problem::Problem;
use crate::service::{DEFAULT_TIME_LIMIT_S, Limits, ServiceSettings};

/// Answer of `GET /limits`.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = Limits)]
pub(in crate::api) struct LimitsMessage {
    /// Most time steps of a grid.
    pub(in crate::api) max_steps: usize,
    /// Most control intervals per wheel.
    pub(in crate::api) max_control_intervals: usize,
    /// Most starts of one search.
    pub(in crate::api) max_starts: usize,
    /// Longest time limit of a solve, s.
    pub(in crate::api) max_time_limit_s: f64,
    /// Time limit of a solve that names none, s.
    pub(in crate::api) default_time_limit_s: f64,
    /// Most rollouts of one search.
    pub(in crate::api) max_rollout_limit: u64,
    /// Largest request body, bytes.
    pub(in crate::api) max_body_bytes: usize,
    /// Solves that run at once.
    pub(in crate::api) workers: usize,
    /// Solves that may wait for a worker.
    pub(in crate::api) queue_length: usize,
    /// Expected work per worker that may be in flight before more is refused, s.
    pub(in crate::api) queue_work_s: f64,
    /// Items of a gRPC batch that may be unanswered at once.
    pub(in crate::api) batch_window: usize,
    /// The rules that single fields must keep.
    pub(in crate::api) rules: Vec<RuleMessage>,
}

/// The rule that a field must keep.
#[derive(Debug, PartialEq, Eq, Serialize, ToSchema)]
#[schema(as = Rule)]
pub(in crate::api) struct RuleMessage {
    /// Dotted path, such as `robot.wheel_radius_m`.
    pub(in crate::api) field: String,
    /// What it must be, such as `> 0 m`.
    pub(in crate::api) rule: String,
}

impl LimitsMessage {
    /// The limits of a server.
    pub(in crate::api) fn new(settings: &ServiceSettings, batch_window: usize) -> Self {
        // How long a worker may take to stop is no matter of callers.
        let ServiceSettings { workers, queue_length, queue_work, limits, stuck_after: _ } = settings;
        let Limits {
            max_steps,
            max_control_intervals,
            max_starts,
            max_time_limit_s,
            max_rollout_limit,
            max_body_bytes,
        } = *limits;
        Self {
            max_steps,
            max_control_intervals,
            max_starts,
            max_time_limit_s,
            default_time_limit_s: DEFAULT_TIME_LIMIT_S,
            max_rollout_limit,
            max_body_bytes,
            workers: workers.get(),
            queue_length: *queue_length,
            queue_work_s: queue_work.as_secs_f64(),
            batch_window,
            rules: rules(limits),
        }
    }
}

/// The rules in the words of the checks themselves: what they say to a request in which every number breaks its rule.
pub(in crate::api) fn rules(limits: &Limits) -> Vec<RuleMessage> {
    let problem = accept_solve(spoiled(), limits).err();
    let mut rules: Vec<RuleMessage> = Vec::new();
    for error in problem.iter().flat_map(Problem::errors) {
        let field = error.pointer.trim_start_matches("#/").replace('/', ".");
        if let Some((_, rule)) = error.message.split_once(", must be ")
            && !rules.iter().any(|known| known.field == field)
        {
            rules.push(RuleMessage { field, rule: rule.to_owned() });
        }
    }
    rules
}

/// No number at all in every place of a number, zero in every place of a count.
fn spoiled() -> SolveRequest {
    let none = f64::NAN;
    let default = SolveRequest::default();
    SolveRequest {
        robot: RobotWire {
            chassis_mass_kg: none,
            wheel_mass_kg: none,
            chassis_yaw_inertia_kg_m2: none,
            wheel_diametral_inertia_kg_m2: none,
            wheel_spin_inertia_kg_m2: none,
            wheel_radius_m: none,
            track_width_m: none,
            axle_to_front_support_m: none,
            front_support_right_m: none,
            center_of_mass_right_m: none,
            center_of_mass_forward_m: none,
            center_of_mass_height_m: none,
            wheel_friction_coefficient: none,
            front_friction_coefficient: none,
            tangential_restitution: none,
            gravity_m_s2: none,
        },
        maneuver: ManeuverWire {
            start: spoiled_state(),
            goal: spoiled_goal(),
            torque_limit_left_n_m: none,
            torque_limit_right_n_m: none,
            ..default.maneuver
        },
        grid: SolveGridWire { steps: Some(0), control_intervals: 0 },
        solver: SolverWire {
            starts: 0,
            time_limit_s: none,
            rollout_limit: 0,
            goal_tolerance: none,
            replay_tolerance_m: none,
            replay_tolerance_rad: none,
            ..default.solver
        },
        ..default
    }
}

fn spoiled_state() -> StateWire {
    let none = f64::NAN;
    StateWire {
        x_m: none,
        y_m: none,
        heading_rad: none,
        wheel_angle_left_rad: none,
        wheel_angle_right_rad: none,
        velocity_x_m_s: none,
        velocity_y_m_s: none,
        yaw_rate_rad_s: none,
        wheel_rate_left_rad_s: none,
        wheel_rate_right_rad_s: none,
    }
}

fn spoiled_goal() -> GoalWire {
    let none = Some(f64::NAN);
    GoalWire {
        x_m: none,
        y_m: none,
        heading_rad: none,
        wheel_angle_left_rad: none,
        wheel_angle_right_rad: none,
        velocity_x_m_s: none,
        velocity_y_m_s: none,
        yaw_rate_rad_s: none,
        wheel_rate_left_rad_s: none,
        wheel_rate_right_rad_s: none,
        free: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_a_request_has_a_rule() {
        let rules = rules(&Limits::default());
        let completed =
            serde_json::to_value(SolveRequest { maneuver: maneuver_with_goal(), ..SolveRequest::default() });
        let completed = completed.unwrap();
        let mut fields = Vec::new();
        numbers_in(&completed, String::new(), &mut fields);
        for field in fields.iter().filter(|field| *field != "solver.seed") {
            assert!(rules.iter().any(|rule| rule.field == *field), "`{field}` has no rule: {rules:?}");
        }
        let rule = |field: &str| rules.iter().find(|rule| rule.field == field).map(|rule| rule.rule.as_str());
        assert_eq!(rule("robot.wheel_radius_m"), Some("> 0 m"));
        assert_eq!(rule("grid.steps"), Some(">= 1"));
        assert_eq!(rule("maneuver.goal.y_m"), Some("between -10000 and 10000 m"));
    }

    fn maneuver_with_goal() -> ManeuverWire {
        ManeuverWire { goal: GoalWire { y_m: Some(5.0), ..GoalWire::default() }, ..ManeuverWire::default() }
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
}
