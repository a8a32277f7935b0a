//! Answers as short tables for people.

use std::fmt::Write as _;

use slipdrive::service::domain::{
    ContactModeSpan, Goal, Reason, Replay, Report, Separation, Solution, StateComponent, TorqueSchedule,
};
use slipdrive::service::{Simulated, Solved};

/// Width of the first column.
const LABEL_WIDTH: usize = 16;

/// Status, final time, goal errors, replay and the timeline of contact modes.
pub(crate) fn of_solution(solved: &Solved, goal: &Goal) -> String {
    let Solution { status, executable, reason, schedule, report, contact_modes, .. } = &solved.solution;
    let mut table = String::new();
    row(&mut table, "status", &format!("{} ({})", status.as_str(), solved.stop_reason.as_str()));
    if let Some(Reason { message, .. }) = reason {
        row(&mut table, "reason", message);
    }
    row(&mut table, "final time", &final_time(schedule, report));
    row(&mut table, "executable", if *executable { "yes" } else { "no" });
    row(&mut table, "grid", &format!("{} steps ({})", report.step_count, report.refinement.as_str()));
    row(&mut table, "replay miss", &replay_miss(&report.replay));
    row(&mut table, "separations", &separations(&report.separations));
    let effort = format!(
        "{} rollouts, {} iterations, {} starts in {:.3} s",
        report.rollouts,
        report.iterations,
        report.starts_tried,
        solved.solve_time.as_secs_f64()
    );
    row(&mut table, "effort", &effort);
    table.push_str("\ngoal error\n");
    for (component, _) in goal.constrained() {
        let error = solved.solution.goal_error[component.index()];
        line(&mut table, &format!("  {:<22} {error:>12.3e}", component.field()));
    }
    write_timeline(&mut table, contact_modes);
    table
}

/// Duration, end state and the timeline of contact modes.
pub(crate) fn of_simulation(simulated: &Simulated) -> String {
    let simulation = &simulated.simulation;
    let trajectory = &simulation.trajectory;
    let mut table = String::new();
    let end_time = trajectory.time.last().copied().unwrap_or_default();
    row(&mut table, "duration", &format!("{end_time:.6} s in {} steps", trajectory.step_count()));
    row(&mut table, "separations", &separations(&simulation.separations));
    row(&mut table, "slip reversals", &simulation.slip_reversals.to_string());
    row(&mut table, "indeterminate", &format!("{} steps", trajectory.indeterminate_steps));
    row(&mut table, "contact residual", &format!("{:.1e}", trajectory.worst_contact_residual));
    table.push_str("\nend state\n");
    if let Some(state) = trajectory.state.last() {
        let values = state.to_vector();
        for component in StateComponent::ALL {
            line(&mut table, &format!("  {:<22} {:>12.6}", component.field(), values[component.index()]));
        }
    }
    write_timeline(&mut table, &simulation.contact_modes);
    table
}

fn final_time(schedule: &TorqueSchedule, report: &Report) -> String {
    let bound = format!("{:.6} s by {}", report.lower_bound, report.lower_bound_assumption.as_str());
    format!("{:.6} s (lower bound {bound})", schedule.final_time)
}

fn replay_miss(replay: &Replay) -> String {
    let Replay { step_count, miss_position, miss_heading, miss_speed, within_tolerance } = replay;
    let verdict = if *within_tolerance { "within tolerance" } else { "above tolerance" };
    format!("{miss_position:.2e} m, {miss_heading:.2e} rad, {miss_speed:.2e} m/s on {step_count} steps: {verdict}")
}

fn separations(separations: &[Separation]) -> String {
    match separations.first() {
        None => "none".to_owned(),
        Some(first) => format!("{}, first {} at {:.4} s", separations.len(), first.contact.as_str(), first.time),
    }
}

fn write_timeline(table: &mut String, spans: &[ContactModeSpan]) {
    table.push_str("\ncontact modes\n");
    line(table, &format!("  {:>9} {:>9}  {:<6} {:<6} {:<6} {}", "start s", "end s", "left", "right", "front", "dof"));
    for ContactModeSpan { start, end, mode, degrees_of_freedom } in spans {
        let (left, right, front) = (mode.left.as_str(), mode.right.as_str(), mode.front.as_str());
        line(table, &format!("  {start:>9.4} {end:>9.4}  {left:<6} {right:<6} {front:<6} {degrees_of_freedom}"));
    }
}

fn row(table: &mut String, label: &str, value: &str) {
    line(table, &format!("{label:<LABEL_WIDTH$} {value}"));
}

fn line(table: &mut String, text: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(table, "{}", text.trim_end());
}

#[cfg(test)]
mod tests {
    use slipdrive::service::domain::{ContactMode, ContactName, PerContact};

    use super::*;

    #[test]
    fn timeline_has_one_line_per_span() {
        let mode = PerContact { left: ContactMode::Stick, right: ContactMode::Slip, front: ContactMode::Slip };
        let span = ContactModeSpan { start: 0.0, end: 1.25, mode, degrees_of_freedom: 3 };
        let mut table = String::new();
        write_timeline(&mut table, &[span, span]);
        let line = "     0.0000    1.2500  stick  slip   slip   3";
        assert_eq!(table.lines().skip(3).collect::<Vec<_>>(), [line, line]);
    }

    #[test]
    fn replay_names_misses_with_units_and_the_verdict() {
        let replay = Replay {
            step_count: 3200,
            miss_position: 2e-4,
            miss_heading: 0.0,
            miss_speed: 1e-3,
            within_tolerance: true,
        };
        assert_eq!(replay_miss(&replay), "2.00e-4 m, 0.00e0 rad, 1.00e-3 m/s on 3200 steps: within tolerance");
    }

    #[test]
    fn separations_name_the_first() {
        assert_eq!(separations(&[]), "none");
        let first = Separation { time: 0.5, contact: ContactName::Front, normal_force: -1.0 };
        assert_eq!(separations(&[first, first]), "2, first front at 0.5000 s");
    }
}
