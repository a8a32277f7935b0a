//! How much the final time of one program depends on the seed of its search.

use anyhow::{Context as _, Result};
use serde::Serialize;

use crate::arguments::SeedsArguments;
use crate::program::Run;
use crate::report::write_json;
use crate::statistics::{quantile, sorted};

/// Final times within this share of each other count as equal.
pub(crate) const NEAR: f64 = 0.005;

/// One maneuver and its answers, one for each seed.
#[derive(Debug, Serialize)]
struct Row {
    maneuver: String,
    /// The slowest plan over the fastest, minus one; none where a seed has no plan.
    spread: Option<f64>,
    runs: Vec<Run>,
}

/// Solves the maneuvers with several seeds and prints how far they lie apart.
///
/// # Errors
/// A program that gives no answer, and files.
pub(crate) fn run(arguments: &SeedsArguments) -> Result<()> {
    let program = arguments.program()?;
    println!("{:<26} {:>9} {:>9} {:>9} {:>9}", "maneuver", "plans", "t_f s", "spread %", "CPU s");
    let mut rows = Vec::new();
    for maneuver in arguments.selection.maneuvers()? {
        let run = |seed| program.run(&maneuver.request, seed);
        let runs: Result<Vec<Run>> = (0..arguments.seeds).map(run).collect();
        let runs = runs.with_context(|| maneuver.name.clone())?;
        let row = Row { maneuver: maneuver.name, spread: spread(&runs), runs };
        println!("{}", row.line());
        rows.push(row);
    }
    let spreads: Vec<Option<f64>> = rows.iter().map(|row| row.spread).collect();
    println!("\n{}", summary(&spreads));
    write_json(arguments.json.as_deref(), &rows)
}

impl Row {
    fn line(&self) -> String {
        let plans = self.runs.iter().filter(|run| run.is_converged());
        let fastest = plans.clone().map(|run| run.final_time_s).fold(f64::INFINITY, f64::min);
        let spread = self.spread.map_or_else(|| "-".to_owned(), |spread| format!("{:.2}", 1e2 * spread));
        let cpu: f64 = self.runs.iter().map(|run| run.cpu_s).sum();
        format!("{:<26} {:>9} {fastest:>9.4} {spread:>9} {cpu:>9.2}", self.maneuver, plans.count())
    }
}

/// The slowest plan over the fastest, minus one; none where one of the answers is no plan.
pub(crate) fn spread<'a>(runs: impl IntoIterator<Item = &'a Run>) -> Option<f64> {
    let mut range = (f64::INFINITY, f64::NEG_INFINITY);
    for run in runs {
        if !run.is_converged() {
            return None;
        }
        range = (range.0.min(run.final_time_s), range.1.max(run.final_time_s));
    }
    Some(range.1 / range.0 - 1.0)
}

/// How many maneuvers have seeds that agree.
pub(crate) fn summary(spreads: &[Option<f64>]) -> String {
    let known = sorted(spreads.iter().copied().flatten());
    let near = known.iter().filter(|spread| **spread <= NEAR).count();
    format!(
        "seeds differ by at most {:.1} % on {near} of {} maneuvers ({} without a plan from each seed); median {:.2} %, \
         95 % {:.2} %",
        1e2 * NEAR,
        spreads.len(),
        spreads.len() - known.len(),
        1e2 * quantile(&known, 0.5),
        1e2 * quantile(&known, 0.95),
    )
}
