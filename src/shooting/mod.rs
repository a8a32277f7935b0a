//! From a maneuver to a decision vector, goal errors and their Jacobian.

mod aisle;
mod decision;
mod maneuver;
mod normal_force_constraints;
mod penalty;
mod problem;

pub use aisle::{Aisle, AisleCorners, ConvexPolygon, Edge};
pub use decision::{decision_from_schedule, decision_len, schedule_from_decision};
pub use maneuver::{Goal, Maneuver, ManeuverLimits, ReferencePoint, SlipPolicy, StateComponent, wrapped_angle};
pub(crate) use maneuver::{check_state, rules_of_state};
pub use normal_force_constraints::NORMAL_LOAD_TOLERANCE;
pub use penalty::Penalty;
pub use problem::{GoalScales, LONGEST_FINAL_TIME, SHORTEST_FINAL_TIME, ShootingProblem};
