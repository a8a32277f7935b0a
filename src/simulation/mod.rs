//! Simulation.
mod contact_timeline;
mod torque_schedule;
mod trajectory;
pub use contact_timeline::{ContactModeSpan, Separation};
pub use torque_schedule::{TorqueSchedule, control_interval};
pub use trajectory::{ContactSample, Trajectory};
