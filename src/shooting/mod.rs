//! From a maneuver to a decision vector, goal errors and their Jacobian.

mod decision;
mod load_limits;
mod maneuver;
mod penalty;
mod problem;

pub use decision::{decision_from_schedule, decision_len, schedule_from_decision};
pub use load_limits::LOAD_TOLERANCE;
pub use maneuver::{Goal, Maneuver, ReferencePoint, StateComponent, check_state, wrapped_angle};
pub use penalty::Penalty;
pub use problem::{GoalScales, LONGEST_FINAL_TIME, SHORTEST_FINAL_TIME, ShootingProblem};
