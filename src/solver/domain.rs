//! The types below the solver that its input and answer are made of, for callers who must not reach below it.

pub use crate::contact::{ContactMode, ContactName, PerContact};
pub use crate::simulation::{ContactMethod, ContactModeSpan, ContactSample, Separation, TorqueSchedule, Trajectory};
