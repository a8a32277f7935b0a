//! What a solve will probably cost, and what it has cost.

use super::{Solved, StopReason};
use crate::service::{Cost, WorkDone};
use crate::solver::{Method, SolverSettings};

/// What a step of a rollout takes a small cloud machine, s, its share of derivatives and linear programs included.
const SEQUENTIAL_LINEAR_STEP_S: f64 = 1.6e-7;
/// Without derivatives and linear programs.
const NELDER_MEAD_STEP_S: f64 = 6e-8;
/// Certificate and answer, per step: a search of few rollouts is little beside them.
const FINISHING_STEP_S: f64 = 7e-6;
/// A linear program takes as long as so many steps per torque of a wheel: a rollout of 200 steps takes three times as long
/// with 200 torques as with 40.
const STEPS_PER_CONTROL: f64 = 2.5;

/// What the settings ask for. Goals of 1 to 5 m take 130 to 280 rollouts from one start, and on average 2,000 from two, 4,000
/// from six; those of the suite take 17,000 from 36: the best optima are searched on.
pub(super) fn expected(settings: &SolverSettings) -> Cost {
    let starts = settings.start_count as f64;
    let rollouts = match settings.method {
        Method::SequentialLinear if settings.start_count == 1 => 200.0,
        Method::SequentialLinear => 1000.0 + 500.0 * starts,
        Method::NelderMead => 400_000.0 * starts,
    };
    of_rollouts(settings, rollouts.min(settings.rollout_limit as f64))
}

/// What a solve has done; none if it needed no search.
pub(super) fn done(settings: &SolverSettings, solved: &Solved) -> Option<WorkDone> {
    let rollouts = solved.solution.report.rollouts;
    let is_complete = match solved.stop_reason {
        StopReason::Finished | StopReason::RolloutLimit => true,
        StopReason::TimeLimit | StopReason::Deadline => false,
    };
    (rollouts > 0).then(|| WorkDone { cost: of_rollouts(settings, rollouts as f64), is_complete })
}

/// Few rollouts of a search are on a finer grid than its first.
fn of_rollouts(settings: &SolverSettings, rollouts: f64) -> Cost {
    let steps = settings.step_count as f64;
    let search = match settings.method {
        Method::SequentialLinear => {
            rollouts * (steps + STEPS_PER_CONTROL * settings.control_count as f64) * SEQUENTIAL_LINEAR_STEP_S
        }
        Method::NelderMead => rollouts * steps * NELDER_MEAD_STEP_S,
    };
    Cost::seconds(search + steps * FINISHING_STEP_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cost_follows_the_starts_up_to_the_rollout_limit() {
        let cost = |start_count: usize, rollout_limit: u64| {
            expected(&SolverSettings { start_count, rollout_limit, ..SolverSettings::default() })
        };
        let of_rollouts =
            |rollouts: f64| Cost::seconds(rollouts * 300.0 * SEQUENTIAL_LINEAR_STEP_S + 200.0 * FINISHING_STEP_S);
        assert_eq!(cost(1, 1_000_000), of_rollouts(200.0));
        assert_eq!(cost(24, 1_000_000), of_rollouts(13_000.0));
        assert_eq!(cost(24, 1), of_rollouts(1.0));
    }
}
