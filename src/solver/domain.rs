//! Types of the modules below the solver that occur in its input and answer, for callers that may use the solver only.

pub use crate::contact::{ContactMode, ContactName, PerContact};
pub use crate::simulation::{ContactMethod, ContactModeSpan, ContactSample, Separation, TorqueSchedule, Trajectory};
