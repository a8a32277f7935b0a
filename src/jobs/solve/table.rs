//! The answer of a solve as a short table for people.

use super::Solved;
use crate::jobs::table::{line, row, separations, write_limits, write_timeline};
use crate::service::Done;
use crate::shooting::Goal;
use crate::simulation::TorqueSchedule;
use crate::solver::{Reason, Replay, Report, Solution};

/// What a certificate says that was cut off.
const NOT_REACHED: &str = "not computed in time";

/// Status, final time, goal errors, replay, use of limits and the timeline of contact modes.
pub(super) fn of_solution(solved: &Done<Solved>, goal: &Goal) -> String {
    let Solution { status, replay_confirmed, reason, schedule, report, contact_modes, .. } = &solved.output.solution;
    let mut table = String::new();
    row(&mut table, "status", &format!("{} ({})", status.as_str(), solved.output.stop_reason.as_str()));
    if let Some(Reason { message, .. }) = reason {
        row(&mut table, "reason", message);
    }
    row(&mut table, "final time", &final_time(schedule, report));
    row(&mut table, "replay confirmed", if *replay_confirmed { "yes" } else { "no" });
    row(&mut table, "grid", &format!("{} steps ({})", report.step_count, report.refinement.as_str()));
    row(&mut table, "replay miss", &report.replay.as_ref().map_or(NOT_REACHED.to_owned(), replay_miss));
    row(&mut table, "separations", &separations(&report.separations));
    let effort = format!(
        "{} rollouts, {} iterations, {} starts in {:.3} s",
        report.rollouts,
        report.iterations,
        report.starts_tried,
        solved.duration.as_secs_f64()
    );
    row(&mut table, "effort", &effort);
    table.push_str("\ngoal error\n");
    for (component, _) in goal.constrained() {
        let error = solved.output.solution.goal_error[component.index()];
        line(&mut table, &format!("  {:<22} {error:>12.3e}", component.field()));
    }
    write_limits(&mut table, &report.limits);
    write_timeline(&mut table, contact_modes);
    table
}

fn final_time(schedule: &TorqueSchedule, report: &Report) -> String {
    let bound = report.lower_bound.zip(report.lower_bound_assumption);
    let bound =
        bound.map_or(NOT_REACHED.to_owned(), |(bound, assumption)| format!("{bound:.6} s by {}", assumption.as_str()));
    format!("{:.6} s (lower bound {bound})", schedule.final_time)
}

fn replay_miss(replay: &Replay) -> String {
    let Replay { step_count, miss_position, miss_heading, miss_speed, separations, within_tolerance, .. } = replay;
    let verdict = match (within_tolerance, separations) {
        (true, _) => "within tolerance",
        (false, 0) => "above tolerance",
        (false, _) => "a contact separates",
    };
    format!("{miss_position:.2e} m, {miss_heading:.2e} rad, {miss_speed:.2e} m/s on {step_count} steps: {verdict}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replay_names_misses_with_units_and_the_verdict() {
        let replay = Replay {
            step_count: 3200,
            miss_position: 2e-4,
            miss_heading: 0.0,
            miss_speed: 1e-3,
            miss_yaw_rate: 0.0,
            miss_wheel_speed: 0.0,
            separations: 0,
            limit_excess: 0.0,
            within_tolerance: true,
        };
        assert_eq!(replay_miss(&replay), "2.00e-4 m, 0.00e0 rad, 1.00e-3 m/s on 3200 steps: within tolerance");
    }
}
