//! What it takes to state a maneuver, solve or simulate it, and read the answer.

pub use crate::motion::{SimulateInput, SimulateParameters, Simulation, simulate};
pub use crate::robot::{PerWheel, RobotParameters, State};
pub use crate::rules::Violations;
pub use crate::shooting::{Goal, Maneuver, ReferencePoint, StateComponent};
pub use crate::simulation::TorqueSchedule;
pub use crate::solver::{
    Method, Refinement, RunControl, Solution, SolveInput, SolveParameters, SolverSettings, Status, solve,
};
