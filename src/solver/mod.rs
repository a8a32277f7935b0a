//! Solver.
pub mod domain;
mod run_control;
mod schedule_check;
mod settings;
mod simulate;
mod solution;
pub use run_control::{NoProgress, ProgressObserver, RunControl, SolveProgress};
pub(crate) use schedule_check::violations_of_schedule;
pub use settings::{Method, SolveInput, SolverSettings};
pub use simulate::{ContactSolver, SimulateInput, Simulation, simulate};
pub use solution::{DistinctOptimum, LowerBoundAssumption, Reason, Replay, Report, Solution, Status, StopReason};
/// Solves a maneuver.
pub fn solve(_input: &SolveInput, _control: &RunControl) -> Solution {
    panic!("the solver is not here yet")
}
