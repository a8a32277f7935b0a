//! The seam between the jobs and the numerics.

use crate::assessment::{self, AssessInput, Assessment};
use crate::motion::{self, SimulateInput, Simulation};
use crate::solver::{self, RunControl, Solution, SolveInput};
use crate::stop::{Stop, Stopped};

/// What the workers run; tests and benches put others in its place.
pub trait ManeuverSolver: Send + Sync {
    /// Solves a maneuver.
    ///
    /// # Errors
    /// When `control` cuts it off before there is anything to answer.
    fn solve(&self, input: &SolveInput, control: &RunControl<'_>) -> Result<Solution, Stopped>;

    /// Integrates one torque schedule.
    ///
    /// # Errors
    /// When it was stopped before the end.
    fn simulate(&self, input: &SimulateInput, stop: Stop<'_>) -> Result<Simulation, Stopped>;

    /// Samples a plan.
    ///
    /// # Errors
    /// When `control` stops it before the end.
    fn assess(&self, input: &AssessInput, control: &RunControl<'_>) -> Result<Assessment, Stopped> {
        assessment::assess(input, control)
    }
}

/// The solver of this crate.
#[derive(Debug, Clone, Copy, Default)]
pub struct InProcessSolver;

impl ManeuverSolver for InProcessSolver {
    fn solve(&self, input: &SolveInput, control: &RunControl<'_>) -> Result<Solution, Stopped> {
        solver::solve(input, control)
    }

    fn simulate(&self, input: &SimulateInput, stop: Stop<'_>) -> Result<Simulation, Stopped> {
        motion::simulate(input, stop)
    }
}
