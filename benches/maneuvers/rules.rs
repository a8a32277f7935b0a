//! What a run must show.

use crate::report::{NEAR, Report, Row};
use crate::suite::GOAL_TOLERANCE;
use crate::verdict::Verdict;

/// Share of the suite that must be near.
const NEAR_SHARE: f64 = 0.95;
/// Share of the suite that must be confirmed by its replay when the solver chooses the grid.
const CONFIRMED_SHARE: f64 = 0.95;
/// Share of random maneuvers that must converge.
const RANDOM_SHARE: f64 = 0.99;
/// A bound that is met exactly may be computed as a few units in the last place above it.
const BOUND_ROUNDING: f64 = 1e-9;

/// The rules of the suite.
pub(crate) fn of_suite(report: &Report) -> Vec<Verdict> {
    let mut verdicts = vec![converged(report, 1.0)];
    verdicts.extend(of_every_answer(report));
    if report.is_on_suite_grid {
        let near = |row: &Row| row.gap().is_some_and(|gap| gap <= NEAR);
        verdicts.push(share_of(report, "final time within 0.5 % of the best known", NEAR_SHARE, near));
    } else {
        verdicts.push(share_of(report, "replay confirmed", CONFIRMED_SHARE, |row| row.answer.replay_confirmed));
    }
    verdicts
}

/// The rules of random maneuvers.
pub(crate) fn of_random(report: &Report) -> Vec<Verdict> {
    let mut verdicts = vec![converged(report, RANDOM_SHARE)];
    verdicts.extend(of_every_answer(report));
    verdicts
}

fn converged(report: &Report, required: f64) -> Verdict {
    let holds = |row: &Row| {
        let answer = &row.answer;
        answer.is_converged() && !answer.ran_out_of_time() && answer.largest_goal_error <= GOAL_TOLERANCE
    };
    share_of(report, "converged within the time limit, goal errors at most 1e-6", required, holds)
}

fn of_every_answer(report: &Report) -> [Verdict; 3] {
    let converged_error = |row: &Row| if row.answer.is_converged() { row.answer.largest_goal_error } else { 0.0 };
    let worst = report.largest(converged_error);
    let difference = report.largest(|row| row.answer.simulation_difference);
    let bound = report.largest(|row| row.answer.lower_bound_s / row.fastest_known());
    [
        Verdict {
            rule: "converged answers meet the goal within 1e-6".to_owned(),
            holds: worst <= GOAL_TOLERANCE,
            measured: format!("largest goal error {worst:.1e}"),
        },
        Verdict {
            rule: "/simulate reproduces every goal error to the last bit".to_owned(),
            holds: difference == 0.0,
            measured: format!("largest difference {difference:.1e}"),
        },
        Verdict {
            rule: "no lower bound exceeds a known final time".to_owned(),
            holds: bound <= 1.0 + BOUND_ROUNDING,
            measured: format!("largest ratio {bound:.4}"),
        },
    ]
}

fn share_of(report: &Report, what: &str, required: f64, holds: impl Fn(&Row) -> bool) -> Verdict {
    let share = report.share(holds);
    Verdict {
        rule: format!("{what} on at least {:.0} %", 1e2 * required),
        holds: share >= required,
        measured: format!("{:.1} %", 1e2 * share),
    }
}
