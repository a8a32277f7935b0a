//! From a maneuver to a decision vector, goal errors and their Jacobian.

mod aisle;
mod decision;
mod goal_rows;
mod maneuver;
mod path_constraints;
mod path_limits;
mod penalty;
mod problem;
mod torque_rate;

pub use aisle::{Aisle, AisleCorners, ConvexPolygon, Edge};
pub use decision::{decision_from_schedule, decision_len, schedule_from_decision};
pub use goal_rows::GoalScales;
pub use maneuver::{Goal, Maneuver, ManeuverLimits, ReferencePoint, SlipPolicy, StateComponent, wrapped_angle};
pub(crate) use maneuver::{check_state, rules_of_state};
pub use path_constraints::LIMIT_TOLERANCE;
pub(crate) use path_limits::{LEAST_LOAD_FOR_GRIP, limited_point};
pub use path_limits::{PathLimit, PathLimits};
pub use problem::{LONGEST_FINAL_TIME, SHORTEST_FINAL_TIME, ShootingProblem};
