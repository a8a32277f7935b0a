//! The answer of a solve as a short table for people.

use super::Solved;
use crate::contract::message;
use crate::jobs::table::{line, row, separations, word, write_limits, write_timeline};
use crate::motion::Sensitivity;
use crate::service::Done;
use crate::shooting::Goal;
use crate::simulation::TorqueSchedule;
use crate::solver::{REPLAY_EXCESS, Reason, Replay, Report, Solution, Status};

/// What a certificate says that was cut off.
const NOT_REACHED: &str = "not computed in time";

/// Status, final time, goal errors, replay, use of limits, sensitivity and the timeline of contact modes.
pub(super) fn of_solution(solved: &Done<Solved>, goal: &Goal) -> String {
    let Solution { status, replay_confirmed, reason, schedule, report, trajectory, .. } = &solved.output.solution;
    let mut table = String::new();
    let is_there = *status == Status::Converged && schedule.final_time == 0.0;
    let nothing_to_do = if is_there { ": the start is the goal" } else { "" };
    let ending = solved.output.stop_reason.as_str();
    row(&mut table, "status", &format!("{} ({ending}){nothing_to_do}", status.as_str()));
    if let Some(Reason { message, .. }) = reason {
        row(&mut table, "reason", message);
    }
    // What is impossible has no motion to speak of.
    if *status != Status::Infeasible {
        row(&mut table, "final time", &final_time(schedule, report));
        row(&mut table, "replay confirmed", if *replay_confirmed { "yes" } else { "no" });
        row(
            &mut table,
            "grid",
            &format!("{} steps ({})", report.step_count, word::<message::Refinement>(report.refinement)),
        );
        row(&mut table, "replay miss", &report.replay.as_ref().map_or(NOT_REACHED.to_owned(), replay_miss));
        row(&mut table, "separations", &separations(&trajectory.separations()));
    }
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
    write_sensitivity(&mut table, &report.sensitivity);
    write_timeline(&mut table, &trajectory.contact_modes());
    table
}

/// How far each small error shifts the end, in the worse of its directions.
fn write_sensitivity(table: &mut String, sensitivity: &[Sensitivity]) {
    if sensitivity.is_empty() {
        return;
    }
    table.push_str("\nend shift by\n");
    let distance = |one: &Sensitivity| one.outcome.as_ref().map_or(-1.0, |shift| shift.distance);
    for both in sensitivity.chunk_by(|a, b| a.parameter == b.parameter) {
        let Some(worse) = both.iter().max_by(|a, b| distance(a).total_cmp(&distance(b))) else { continue };
        let shift = match &worse.outcome {
            Ok(shift) => {
                let lifts = if shift.separates { ", a contact lifts" } else { "" };
                let refused =
                    |one: &Sensitivity| Some(format!("; {} refused by {}", change(one), one.outcome.as_ref().err()?));
                let other = both.iter().find_map(refused).unwrap_or_default();
                format!("{:.4} m, {:.4} rad{lifts}{other}", shift.distance, shift.angle)
            }
            Err(field) => format!("refused by {field}"),
        };
        let name = word::<message::ChangedParameter>(worse.parameter);
        line(table, &format!("  {name:<22} {:>12}  {shift}", change(worse)));
    }
}

/// With its sign and unit, such as -10 %.
fn change(sensitivity: &Sensitivity) -> String {
    let (change, unit) = (sensitivity.change, sensitivity.parameter.unit());
    if unit == "share" { format!("{:+.0} %", 100.0 * change) } else { format!("{change:+.4} {unit}") }
}

fn final_time(schedule: &TorqueSchedule, report: &Report) -> String {
    let bound = report.lower_bound.zip(report.lower_bound_assumption);
    let bound =
        bound.map_or(NOT_REACHED.to_owned(), |(bound, assumption)| format!("{bound:.6} s by {}", assumption.as_str()));
    format!("{:.6} s (lower bound {bound})", schedule.final_time)
}

fn replay_miss(replay: &Replay) -> String {
    let Replay { step_count, miss_position, miss_heading, separations, .. } = replay;
    let Replay { miss_speed, miss_yaw_rate, miss_wheel_speed, .. } = replay;
    let verdict = if replay.within_tolerance { "within tolerance" } else { "above tolerance" };
    let separates = if *separations > 0 { ", a contact separates" } else { "" };
    let exceeds = if replay.limit_excess > REPLAY_EXCESS { ", a limit is exceeded" } else { "" };
    format!(
        "{miss_position:.2e} m, {miss_heading:.2e} rad, {:.2e} m/s, {miss_yaw_rate:.2e} rad/s on {step_count} steps: \
         {verdict}{separates}{exceeds}",
        miss_speed.max(*miss_wheel_speed)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::ChangedParameter;
    use crate::motion::EndShift;

    #[test]
    fn worse_direction_of_each_parameter_has_a_line() {
        let one = |parameter, change, distance| {
            let outcome = Ok(EndShift { distance, angle: 0.5, separates: distance > 1.0 });
            Sensitivity { parameter, change, outcome }
        };
        let refused = |change| {
            let outcome = Err("robot.center_of_mass_right_m".to_owned());
            Sensitivity { parameter: ChangedParameter::CenterOfMassRight, change, outcome }
        };
        let (friction, heading) = (ChangedParameter::Friction, ChangedParameter::StartHeading);
        let changes = [one(friction, -0.1, 0.25), one(friction, 0.1, 0.125), refused(-0.01), refused(0.01)];
        let mut table = String::new();
        write_sensitivity(&mut table, &[]);
        assert_eq!(table, "");
        write_sensitivity(&mut table, &changes);
        write_sensitivity(&mut table, &[one(heading, -0.01, 0.0), one(heading, 0.01, 2.0)]);
        let lines: Vec<_> = table.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect();
        assert_eq!(lines[2], "friction -10 % 0.2500 m, 0.5000 rad");
        assert_eq!(lines[3], "center_of_mass_right +0.0100 m refused by robot.center_of_mass_right_m");
        assert_eq!(lines[6], "start_heading +0.0100 rad 2.0000 m, 0.5000 rad, a contact lifts");
        let mut half = String::new();
        write_sensitivity(&mut half, &[refused(-0.01), one(ChangedParameter::CenterOfMassRight, 0.01, 0.25)]);
        let end = "0.2500 m, 0.5000 rad; -0.0100 m refused by robot.center_of_mass_right_m\n";
        assert!(half.ends_with(end), "{half}");
    }

    #[test]
    fn replay_names_misses_with_units_and_the_verdict() {
        let replay = Replay {
            step_count: 3200,
            miss_position: 2e-4,
            miss_heading: 0.0,
            miss_speed: 1e-3,
            miss_yaw_rate: 3e-4,
            miss_wheel_speed: 0.0,
            separations: 0,
            limit_excess: 0.0,
            within_tolerance: true,
        };
        assert_eq!(
            replay_miss(&replay),
            "2.00e-4 m, 0.00e0 rad, 1.00e-3 m/s, 3.00e-4 rad/s on 3200 steps: within tolerance"
        );
        let exceeding =
            Replay { miss_position: 0.1, separations: 1, limit_excess: 0.02, within_tolerance: false, ..replay };
        let said = replay_miss(&exceeding);
        assert!(said.ends_with(": above tolerance, a contact separates, a limit is exceeded"), "{said}");
    }
}
