//! Parts of the tables for people that several kinds of jobs print.

use std::fmt::Write as _;

use crate::simulation::{ContactModeSpan, Separation};

/// Width of the first column.
const LABEL_WIDTH: usize = 16;

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

/// A label and its value.
pub(super) fn row(table: &mut String, label: &str, value: &str) {
    line(table, &format!("{label:<LABEL_WIDTH$} {value}"));
}

/// A line of its own.
pub(super) fn line(table: &mut String, text: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(table, "{}", text.trim_end());
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
    fn separations_name_the_first() {
        assert_eq!(separations(&[]), "none");
        let first = Separation { time: 0.5, contact: ContactName::Front, normal_force: -1.0 };
        assert_eq!(separations(&[first, first]), "2, first front at 0.5000 s");
    }
}
