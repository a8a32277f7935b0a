//! Shooting.
mod maneuver;
pub use maneuver::{Goal, Maneuver, ReferencePoint, StateComponent, check_state, wrapped_angle};
