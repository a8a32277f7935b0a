//! The comparison of two programs.

use std::process::ExitCode;

use anyhow::Result;

use crate::arguments::{CompareArguments, Requirement};
use crate::pairs::Row;
use crate::program::Program;
use crate::references::References;
use crate::report::Report;
use crate::verdict::Verdict;

/// Solves all maneuvers with both programs in turn, and prints what that says.
///
/// # Errors
/// A program that gives no answer, and files.
pub(crate) fn run(arguments: &CompareArguments) -> Result<ExitCode> {
    let programs = arguments.opponents.programs()?;
    for (role, program) in ["candidate", "opponent"].into_iter().zip(&programs) {
        println!("{}", introduction(role, program));
    }
    let references = References::comparable(arguments.opponents.load_share)?;
    let mut report = Report::new(&programs);
    for (place, maneuver) in arguments.selection.maneuvers()?.iter().enumerate() {
        let reference = references.final_time_of(maneuver);
        report.add(Row::measured(maneuver, place, arguments.seeds, &programs)?, reference);
    }
    let verdicts = verdicts(&report, &arguments.require);
    report.finish(&verdicts, arguments.json.as_deref())?;
    Ok(if verdicts.iter().all(|verdict| verdict.holds) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn introduction(role: &str, program: &Program) -> String {
    let share = if program.takes_load_share { "takes" } else { "is not asked for" };
    let start_up_ms = 1e3 * program.start_up.as_secs_f64();
    format!("{role}: {}, {share} the share of the normal force, starts in {start_up_ms:.1} ms", program.name)
}

/// What is required; with any requirement, no plan may be lost either.
fn verdicts(report: &Report, requirements: &[Requirement]) -> Vec<Verdict> {
    let mut verdicts: Vec<Verdict> = requirements.iter().map(|requirement| verdict(report, *requirement)).collect();
    if !requirements.is_empty() {
        let lost = report.lost();
        verdicts.push(Verdict {
            rule: "no plan is lost that the opponent finds".to_owned(),
            holds: lost == 0,
            measured: format!("{lost} lost"),
        });
    }
    verdicts
}

/// Nothing is shown where no maneuver has plans of both.
fn verdict(report: &Report, requirement: Requirement) -> Verdict {
    match requirement {
        Requirement::Cpu(limit) => {
            let median = report.cpu_ratio().map_or(f64::NAN, |ratio| ratio.median.value);
            Verdict {
                rule: format!("CPU at most {limit} times in the median"),
                holds: median <= limit,
                measured: format!("{median:.3} times"),
            }
        }
        Requirement::Gap(limit) => {
            let high = report.gap().map_or(f64::NAN, |gap| gap.mean.high);
            Verdict {
                rule: format!("upper end of the interval of the mean gap at most {:+.3} %", 1e2 * limit),
                holds: high <= limit,
                measured: format!("{:+.3} %", 1e2 * high),
            }
        }
    }
}
