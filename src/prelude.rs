//! What it takes to state a maneuver, solve or simulate it, and read the answer.

pub use crate::robot::{PerWheel, RobotParameters, State};
pub use crate::rules::Violations;
pub use crate::shooting::{Goal, Maneuver, ReferencePoint, StateComponent};
pub use crate::simulation::TorqueSchedule;
pub use crate::solver::{
    Method, Refinement, RunControl, SimulateInput, SimulateParameters, Simulation, Solution, SolveInput,
    SolveParameters, SolverSettings, Status, simulate, solve,
};
