//! The domain types that callers of the service speak, in one place for the transports.

pub use crate::robot::{Configuration, PerWheel, RobotParameters, State, Velocity};
pub use crate::shooting::{Goal, Maneuver, ReferencePoint, StateComponent};
pub use crate::solver::domain::{
    ContactMethod, ContactMode, ContactModeSpan, ContactName, ContactSample, PerContact, Separation, TorqueSchedule,
    Trajectory,
};
pub use crate::solver::{
    DistinctOptimum, LowerBoundAssumption, Method, Reason, Refinement, RefinementOutcome, Replay, Report,
    SimulateInput, Simulation, Solution, SolveInput, SolveProgress, SolverSettings, Status,
};
