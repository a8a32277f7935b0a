//! Parts of the tables for people that several kinds of jobs print.

use std::fmt::Write as _;

use crate::contract::json::Named;
use crate::motion::LimitUse;
use crate::simulation::{ContactModeSpan, Separation};

/// Width of the first column.
const LABEL_WIDTH: usize = 16;

/// A value that has a name in the contract, as answers write it.
pub(super) fn word<M: Named + Into<i32>>(value: impl Into<M>) -> &'static str {
    M::name_of(value.into().into()).unwrap_or("unspecified")
}

/// How many, and the first.
pub(super) fn separations(separations: &[Separation]) -> String {
    match separations.first() {
        None => "none".to_owned(),
        Some(first) => format!("{}, first {} at {:.4} s", separations.len(), first.contact.as_str(), first.time),
    }
}

/// The contact modes over time.
pub(super) fn write_timeline(table: &mut String, spans: &[ContactModeSpan]) {
    table.push_str("\ncontact modes\n");
    line(table, &format!("  {:>9} {:>9}  {:<6} {:<6} {:<6} {}", "start s", "end s", "left", "right", "front", "dof"));
    for ContactModeSpan { start, end, mode, degrees_of_freedom } in spans {
        let (left, right, front) = (mode.left.as_str(), mode.right.as_str(), mode.front.as_str());
        line(table, &format!("  {start:>9.4} {end:>9.4}  {left:<6} {right:<6} {front:<6} {degrees_of_freedom}"));
    }
}

/// How far each limit is used, in the unit of its field; nothing where none was given.
pub(super) fn write_limits(table: &mut String, limits: &[LimitUse]) {
    if limits.is_empty() {
        return;
    }
    table.push_str("\nlimits\n");
    let heads = ["limit", "largest", "at s", "excess", "on replay"];
    let [value, largest, time, excess, replay] = heads;
    line(table, &format!("  {:<40} {value:>10} {largest:>10} {time:>9} {excess:>9} {replay:>9}", "field"));
    for LimitUse { limit, value, largest, time, excess, replay_excess } in limits {
        let replay = replay_excess.map_or("-".to_owned(), |excess| format!("{excess:.1e}"));
        line(table, &format!("  {limit:<40} {value:>10.4} {largest:>10.4} {time:>9.4} {excess:>9.1e} {replay:>9}"));
    }
}

/// A label and its value.
pub(super) fn row(table: &mut String, label: &str, value: &str) {
    line(table, &format!("{label:<LABEL_WIDTH$} {value}"));
}

/// A line of its own; what would command a terminal, as texts of saved plans may, is left out.
pub(super) fn line(table: &mut String, text: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(table, "{}", text.trim_end().replace(char::is_control, " "));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{ContactMode, ContactName, PerContact};

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
    fn limits_have_one_line_each() {
        let limit = "maneuver.limits.speed_m_s";
        let used = LimitUse { limit, value: 1.5, largest: 1.5, time: 0.25, excess: 1e-9, replay_excess: None };
        let mut table = String::new();
        write_limits(&mut table, &[]);
        assert_eq!(table, "");
        write_limits(&mut table, &[used, LimitUse { replay_excess: Some(-2e-3), ..used }]);
        let lines: Vec<_> = table.lines().skip(3).map(|line| line.split_whitespace().collect::<Vec<_>>()).collect();
        assert_eq!(lines[0], [limit, "1.5000", "1.5000", "0.2500", "1.0e-9", "-"]);
        assert_eq!(lines[1].last(), Some(&"-2.0e-3"));
    }

    #[test]
    fn lines_command_no_terminal() {
        let mut table = String::new();
        row(&mut table, "reason", "\u{1b}[31mred\u{0}\nforged\u{9b}2J");
        assert_eq!(table, "reason            [31mred  forged 2J\n");
    }

    #[test]
    fn separations_name_the_first() {
        assert_eq!(separations(&[]), "none");
        let first = Separation { time: 0.5, contact: ContactName::Front, normal_force: -1.0 };
        assert_eq!(separations(&[first, first]), "2, first front at 0.5000 s");
    }
}
