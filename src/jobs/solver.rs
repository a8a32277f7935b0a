//! The seam between the jobs and the numerics.

use crate::solver::{self, RunControl, SimulateInput, Simulation, Solution, SolveInput};

/// What the workers run; tests and benches put others in its place.
pub trait ManeuverSolver: Send + Sync {
    /// Solves a maneuver; polls the stop flag of `control` at least once per rollout.
    fn solve(&self, input: &SolveInput, control: &RunControl<'_>) -> Solution;

    /// Integrates one torque schedule.
    fn simulate(&self, input: &SimulateInput) -> Simulation;
}

/// The solver of this crate.
#[derive(Debug, Clone, Copy, Default)]
pub struct InProcessSolver;

impl ManeuverSolver for InProcessSolver {
    fn solve(&self, input: &SolveInput, control: &RunControl<'_>) -> Solution {
        solver::solve(input, control)
    }

    fn simulate(&self, input: &SimulateInput) -> Simulation {
        solver::simulate(input)
    }
}
