//! The shooting problem of a maneuver on a grid, without final times that no plan reaches.

use super::bounds::{Grid, LowerBound, largest_lower_bound};
use super::settings::SolveInput;
use super::starts::starts;
use crate::motion::ROUNDING;
use crate::shooting::ShootingProblem;
use crate::simulation::Simulator;

/// The problem on a grid and the lower bound of its final time.
///
/// Final times below the bound are excluded, so that the search cannot collapse to a final time of zero.
pub(super) fn problem_on<'a>(
    input: &SolveInput,
    simulator: &'a Simulator,
    step_count: usize,
) -> (ShootingProblem<'a>, LowerBound) {
    let bound = largest_lower_bound(input, Grid::Steps(step_count));
    let time_unit = starts(input, 1)[0].schedule.final_time.max(bound.time);
    let grid = (step_count, input.settings.control_count);
    let mut problem = ShootingProblem::new(simulator, (&input.maneuver, &input.path_limits()), grid, time_unit);
    // But for rounding, which shall exclude no plan.
    problem.rule_out_before((1.0 - ROUNDING) * bound.time);
    (problem, bound)
}
