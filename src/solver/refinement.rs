//! Automatic steps: a plan on ever finer grids, warm, until its replay is within tolerance.
//!
//! The scheme is of first order, so the replay miss shrinks in proportion to the step: the miss itself tells which grid to
//! try next. An optimum moves little with the grid, and a refined search takes few linear programs.

use super::certificate::replay;
use super::local_search::{Candidate, LocalSearch};
use super::run_control::RunControl;
use super::search::SearchResult;
use super::settings::SolveInput;
use super::solution::{Replay, StopReason};
use crate::shooting::{ShootingProblem, schedule_from_decision};
use crate::simulation::{Rollout, Simulator};

/// Grids are refined by at least and at most these factors at a time.
const FACTORS: (f64, f64) = (2.0, 8.0);
/// The next grid aims this far below the tolerance: the miss is only roughly proportional to the step.
const MARGIN: f64 = 1.5;

/// Refines the grid of the best decision; leaves it where the step limit, the budget or a lost goal ends that.
pub(super) fn refine(
    input: &SolveInput,
    simulator: &Simulator,
    step_limit: usize,
    control: &RunControl,
    result: &mut SearchResult,
) {
    while result.stop_reason == StopReason::Finished {
        let Some(best) = result.best.as_ref().filter(|best| best.is_feasible(input.settings.goal_tolerance)) else {
            return;
        };
        let replay = replay_of(input, simulator, best, result.step_count);
        if replay.within_tolerance || result.step_count >= step_limit {
            return;
        }
        let step_count = next_step_count(input, &replay, result.step_count).min(step_limit);
        let mut problem = ShootingProblem::new(simulator, &input.maneuver, step_count, input.settings.control_count);
        let rollout_limit = input.settings.rollout_limit - result.rollouts;
        let mut search = LocalSearch::new(&mut problem, &input.settings, control, rollout_limit);
        let refined = search.adapt(best);
        let (_, iterations, rollouts) = search.into_parts();
        result.iterations += iterations;
        result.rollouts += rollouts;
        match refined {
            Ok(refined) if refined.is_feasible(input.settings.goal_tolerance) => {
                result.best = Some(refined);
                result.step_count = step_count;
            }
            Ok(_) => return,
            Err(interruption) => result.stop_reason = interruption.into(),
        }
    }
}

fn replay_of(input: &SolveInput, simulator: &Simulator, best: &Candidate, step_count: usize) -> Replay {
    let schedule = schedule_from_decision(&best.decision);
    let start = input.maneuver.start_at_center_of_mass(input.robot.parameters());
    replay(input, simulator, &Rollout { start: &start, schedule: &schedule, step_count })
}

fn next_step_count(input: &SolveInput, replay: &Replay, step_count: usize) -> usize {
    let position = replay.miss_position / input.settings.replay_tolerance_position;
    let heading = replay.miss_heading / input.settings.replay_tolerance_heading;
    let factor = (MARGIN * position.max(heading)).clamp(FACTORS.0, FACTORS.1).ceil();
    // A factor of at most 8, and whole.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 2 and 8")]
    let factor = factor as usize;
    step_count * factor
}
