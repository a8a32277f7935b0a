//! The answer of an assessment, as a message and as a table for people.

use super::accept::AcceptedAssess;
use crate::assessment::{Assessment, EndError, ParameterShares, QUANTILES, WorstSample};
use crate::contract::convert::{count, footprint};
use crate::contract::message::{
    self, AppliedChange, AssessResponse, EndErrors, ErrorQuantile, LimitExcess, SimulateGrid, SimulateRequest,
    VarianceShares,
};
use crate::jobs::simulate::name_at_root;
use crate::jobs::table::{line, row, word};
use crate::motion::ChangedParameter;

pub(super) fn answer(accepted: &AcceptedAssess, assessment: &Assessment) -> AssessResponse {
    let Assessment {
        sample_count,
        success_count,
        interval: (low, high),
        refused_count,
        separated_count,
        grid,
        nominal,
        mean,
        quantiles,
        shares,
        excesses,
        worst,
    } = assessment;
    let quantile = |(&share, error): (&f64, &EndError)| ErrorQuantile { share, errors: Some(end_errors(error)) };
    AssessResponse {
        samples: count(*sample_count),
        successes: count(*success_count),
        success_rate: *success_count as f64 / *sample_count as f64,
        success_rate_low: *low,
        success_rate_high: *high,
        refused: count(*refused_count),
        separations: count(*separated_count),
        steps: count(grid.step_count),
        grid_factor: count(grid.factor),
        nominal_success: nominal.is_success,
        nominal: Some(end_errors(&nominal.error)),
        mean: Some(end_errors(mean)),
        quantiles: QUANTILES.iter().zip(quantiles).map(quantile).collect(),
        shares: shares.iter().map(variance_shares).collect(),
        limits: excesses
            .iter()
            .map(|excess| LimitExcess {
                limit: limit_name(accepted, excess.limit).to_owned(),
                value: excess.value,
                samples: count(excess.sample_count),
            })
            .collect(),
        worst: worst.as_ref().map(|worst| Box::new(worst_sample(accepted, worst))),
    }
}

fn limit_name(accepted: &AcceptedAssess, limit: &'static str) -> &'static str {
    if accepted.is_simulation() { name_at_root(limit) } else { limit }
}

fn end_errors(error: &EndError) -> EndErrors {
    let [along_m, across_m, distance_m, heading_rad, speed_m_s] = *error;
    EndErrors { along_m, across_m, distance_m, heading_rad, speed_m_s }
}

fn number(parameter: ChangedParameter) -> i32 {
    message::ChangedParameter::from(parameter).into()
}

fn variance_shares(of: &ParameterShares) -> VarianceShares {
    let [along, across, distance, heading, speed] = of.shares;
    VarianceShares { parameter: number(of.parameter), along, across, distance, heading, speed }
}

fn worst_sample(accepted: &AcceptedAssess, worst: &WorstSample) -> message::WorstSample {
    let WorstSample { index, changes, error, relative_error, separates, motion } = worst;
    let change = |&(parameter, change): &(ChangedParameter, f64)| AppliedChange {
        parameter: number(parameter),
        change,
        unit: parameter.unit().to_owned(),
    };
    let simulate = SimulateRequest {
        robot: Some(message::Robot { footprint: footprint(&accepted.footprint), ..(&motion.bare_robot).into() }),
        payload: motion.payload.as_ref().map(Into::into),
        reference_point: message::ReferencePoint::AxleMidpoint.into(),
        start: Some((&motion.start).into()),
        torque_schedule: Some((&motion.schedule).into()),
        grid: Some(SimulateGrid { steps: Some(count(motion.step_count)) }),
        ..SimulateRequest::default()
    };
    message::WorstSample {
        sample: count(*index),
        relative_error: *relative_error,
        errors: Some(end_errors(error)),
        separates: *separates,
        changes: changes.iter().map(change).collect(),
        simulate: Some(simulate),
    }
}

/// The rate, the errors, who is to blame for them, use of limits and the worst sample.
pub(super) fn table(accepted: &AcceptedAssess, assessment: &Assessment) -> String {
    let Assessment { sample_count, success_count, interval: (low, high), grid, nominal, worst, .. } = assessment;
    let mut table = String::new();
    let percent = 100.0 * *success_count as f64 / *sample_count as f64;
    let interval = format!("95 % interval {:.1} to {:.1} %", 100.0 * low, 100.0 * high);
    row(&mut table, "success", &format!("{percent:.1} %, {success_count} of {sample_count} samples, {interval}"));
    let refused = match assessment.refused_count {
        0 => "none".to_owned(),
        count => format!("{count} samples: robots that break the rules, counted as failures"),
    };
    row(&mut table, "refused", &refused);
    row(&mut table, "separations", &format!("{} samples", assessment.separated_count));
    let verdict = if nominal.is_success { "within" } else { "not within" };
    let grid =
        format!("{} steps, {} times the plan's; {verdict} tolerance without changes", grid.step_count, grid.factor);
    row(&mut table, "grid", &grid);
    write_errors(&mut table, assessment);
    write_shares(&mut table, &assessment.shares);
    if !assessment.excesses.is_empty() {
        table.push_str("\nlimits exceeded\n");
    }
    for excess in &assessment.excesses {
        let name = limit_name(accepted, excess.limit);
        line(&mut table, &format!("  {name:<40} {:>10.4} by {:>6} samples", excess.value, excess.sample_count));
    }
    if let Some(worst) = worst {
        table.push_str("\nworst sample\n");
        let lifts = if worst.separates { ", a contact lifts" } else { "" };
        let error = format!("{:.3} of its tolerance{lifts}", worst.relative_error);
        line(&mut table, &format!("  number {}, largest error {error}", worst.index));
        for (parameter, change) in &worst.changes {
            let name = word::<message::ChangedParameter>(*parameter);
            line(&mut table, &format!("  {name:<22} {change:>+12.6} {}", parameter.unit()));
        }
    }
    table
}

fn write_errors(table: &mut String, assessment: &Assessment) {
    table.push_str("\nend errors\n");
    let [along, across, distance, heading, speed] = ["along m", "across m", "distance m", "heading rad", "speed m/s"];
    line(table, &format!("  {:<10} {along:>11} {across:>11} {distance:>11} {heading:>11} {speed:>11}", ""));
    let mut write = |name: &str, error: &EndError| {
        let numbers: Vec<String> = error.iter().map(|error| format!(" {:>11}", rounded(*error, 5))).collect();
        line(table, &format!("  {name:<10}{}", numbers.concat()));
    };
    write("nominal", &assessment.nominal.error);
    write("mean", &assessment.mean);
    for (share, errors) in QUANTILES.iter().zip(&assessment.quantiles) {
        write(&format!("{:.0} %", 100.0 * share), errors);
    }
}

fn write_shares(table: &mut String, shares: &[ParameterShares]) {
    table.push_str("\nshare of variance\n");
    for ParameterShares { parameter, shares } in shares {
        let numbers: Vec<String> = shares.iter().map(|share| format!(" {:>11}", rounded(*share, 2))).collect();
        line(table, &format!("  {:<22}{}", word::<message::ChangedParameter>(*parameter), numbers.concat()));
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
