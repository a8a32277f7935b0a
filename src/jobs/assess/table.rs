//! The table of an assessment, for people.

use super::accept::AcceptedAssess;
use super::answer::limit_name;
use crate::assessment::{Assessment, EndError, FEWEST_FOR_SHARES, ParameterShares, QUANTILES, WorstSample};
use crate::contract::message::ChangedParameter;
use crate::jobs::table::{line, row, word};

/// Width of the names before the errors.
const NAME_WIDTH: usize = 22;

/// The rate, the errors, who is to blame for them, use of limits and the worst sample.
pub(super) fn table(accepted: &AcceptedAssess, assessment: &Assessment) -> String {
    let Assessment { sample_count, success_count, interval: (low, high), grid, nominal, worst, .. } = assessment;
    let mut table = String::new();
    let percent = 100.0 * *success_count as f64 / *sample_count as f64;
    let interval = format!("95 % interval {:.1} to {:.1} %", 100.0 * low, 100.0 * high);
    row(&mut table, "success", &format!("{percent:.1} %, {success_count} of {sample_count} samples, {interval}"));
    let refused = match assessment.refused_count {
        0 => "none".to_owned(),
        count => {
            format!(
                "{count} samples, counted as failures: changes that break the rules of the robot, or a negative delay"
            )
        }
    };
    row(&mut table, "refused", &refused);
    row(&mut table, "separations", &format!("{} samples", assessment.separated_count));
    let verdict = if nominal.is_success { "within" } else { "not within" };
    let grid =
        format!("{} steps, {} times the plan's; {verdict} tolerance without changes", grid.step_count, grid.factor);
    row(&mut table, "grid", &grid);
    write_errors(&mut table, assessment);
    write_shares(&mut table, assessment);
    write_limits(&mut table, accepted, assessment);
    if let Some(worst) = worst {
        write_worst(&mut table, worst);
    }
    table
}

fn write_errors(table: &mut String, assessment: &Assessment) {
    let [along, across, distance, heading, speed] = ["along m", "across m", "distance m", "heading rad", "speed m/s"];
    let headings = format!(" {along:>11} {across:>11} {distance:>11} {heading:>11} {speed:>11}");
    table.push('\n');
    line(table, &format!("{:<width$}{headings}", "end errors", width = NAME_WIDTH + 2));
    write_row(table, "without changes", &assessment.nominal.error, 5);
    if assessment.refused_count == assessment.sample_count {
        line(table, "  no sample has a motion");
        return;
    }
    write_row(table, "mean, with signs", &assessment.mean, 5);
    for (share, errors) in QUANTILES.iter().zip(&assessment.quantiles) {
        write_row(table, &format!("{:.0} % are within", 100.0 * share), errors, 5);
    }
}

fn write_row(table: &mut String, name: &str, values: &EndError, digits: usize) {
    let numbers: Vec<String> = values.iter().map(|value| format!(" {:>11}", rounded(*value, digits))).collect();
    line(table, &format!("  {name:<NAME_WIDTH$}{}", numbers.concat()));
}

/// A dash stands for an error that does not vary.
fn write_shares(table: &mut String, assessment: &Assessment) {
    table.push_str("\nshare of variance\n");
    let is_unknown = |of: &ParameterShares| of.shares.iter().all(|share| share.is_nan());
    if assessment.shares.iter().all(is_unknown) {
        line(table, &format!("  none: the errors do not vary, or fewer than {FEWEST_FOR_SHARES} samples end"));
        return;
    }
    for ParameterShares { parameter, shares } in &assessment.shares {
        write_row(table, word::<ChangedParameter>(*parameter), shares, 2);
    }
}

fn write_limits(table: &mut String, accepted: &AcceptedAssess, assessment: &Assessment) {
    if !assessment.excesses.is_empty() {
        table.push_str("\nlimits, exceeded by over 0.5 %\n");
    }
    for excess in &assessment.excesses {
        let name = limit_name(accepted, excess.limit);
        line(table, &format!("  {name:<40} {:>10.4} in {:>6} samples", excess.value, excess.sample_count));
    }
}

fn write_worst(table: &mut String, worst: &WorstSample) {
    table.push_str("\nworst sample\n");
    let error = if worst.relative_error.is_finite() {
        format!("largest error {:.3} of its tolerance", worst.relative_error)
    } else {
        "its motion diverges".to_owned()
    };
    let lifts = if worst.separates { ", a contact lifts" } else { "" };
    line(table, &format!("  number {}, {error}{lifts}", worst.index));
    for (parameter, change) in &worst.changes {
        let name = word::<ChangedParameter>(*parameter);
        line(table, &format!("  {name:<NAME_WIDTH$} {change:>+12.6} {}", parameter.unit()));
    }
}

/// With so many digits, zero without a sign; a dash for what the samples do not tell.
fn rounded(value: f64, digits: usize) -> String {
    let unit = 10.0_f64.powf(digits as f64);
    // A negative zero and 0 add up to 0.
    let value = (value * unit).round() / unit + 0.0;
    if value.is_nan() { "-".to_owned() } else { format!("{value:.digits$}") }
}

#[cfg(test)]
mod tests {
    use super::rounded;

    #[test]
    fn zeros_have_no_sign_and_what_is_unknown_is_a_dash() {
        assert_eq!(
            [-4e-6, 0.0, -1.25, f64::NAN].map(|value| rounded(value, 5)),
            ["0.00000", "0.00000", "-1.25000", "-"]
        );
    }
}
