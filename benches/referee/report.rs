//! The table of a comparison, what it says in sum, and the same as JSON.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use serde::Serialize;
use serde_json::json;

use crate::pairs::{Pair, Row};
use crate::program::{Program, Run};
use crate::spread::{self, NEAR, spread};
use crate::statistics::{Estimate, Summary, quantile, sorted};
use crate::verdict::Verdict;

/// One maneuver with the best final time that long searches found.
#[derive(Debug, Serialize)]
struct Entry {
    #[serde(flatten)]
    row: Row,
    reference_s: Option<f64>,
}

/// A is the candidate, B the opponent; the figures are means over the seeds, the final time is the fastest.
const HEAD: &str = "
maneuver                   plans        t_f s     gap %     CPU s       CPU
                            A  B            A       A/B         A       A/B";

/// All maneuvers so far; each is printed as it comes.
pub(crate) struct Report {
    /// Names of candidate and opponent.
    programs: [String; 2],
    entries: Vec<Entry>,
}

impl Report {
    /// An empty report; prints the head of the table.
    pub(crate) fn new(programs: &[Program; 2]) -> Self {
        println!("{HEAD}");
        Self { programs: programs.each_ref().map(|program| program.name.clone()), entries: Vec::new() }
    }

    /// Adds and prints a maneuver.
    pub(crate) fn add(&mut self, row: Row, reference_s: Option<f64>) {
        println!("{}", line(&row));
        self.entries.push(Entry { row, reference_s });
    }

    /// How much slower the candidate's plans are, as a share of the final time.
    pub(crate) fn gap(&self) -> Option<Summary> {
        Some(self.log_ratios(final_time)?.map(f64::exp_m1))
    }

    /// CPU times of the candidate over those of the opponent.
    pub(crate) fn cpu_ratio(&self) -> Option<Summary> {
        Some(self.log_ratios(cpu_time)?.map(f64::exp))
    }

    /// Pairs in which only the opponent found a plan.
    pub(crate) fn lost(&self) -> usize {
        self.count(|pair| pair.opponent.is_converged() && !pair.candidate.is_converged())
    }

    /// Prints the sum and the verdicts, and writes the JSON.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn finish(&self, verdicts: &[Verdict], path: Option<&Path>) -> Result<()> {
        println!();
        for line in self.summary() {
            println!("{line}");
        }
        for verdict in verdicts {
            println!("{verdict}");
        }
        let figures = json!({
            "programs": self.programs,
            "gap": self.gap(),
            "cpu_ratio": self.cpu_ratio(),
            "rules": verdicts,
            "maneuvers": self.entries,
        });
        write_json(path, &figures)
    }

    fn log_ratios(&self, figure: impl Fn(&Run) -> f64) -> Option<Summary> {
        let ratios: Vec<f64> = self.entries.iter().filter_map(|entry| entry.row.log_ratio(&figure)).collect();
        Summary::of(&ratios)
    }

    fn count(&self, holds: impl Fn(&Pair) -> bool) -> usize {
        self.pairs().filter(|pair| holds(pair)).count()
    }

    fn pairs(&self) -> impl Iterator<Item = &Pair> {
        self.entries.iter().flat_map(|entry| &entry.row.pairs)
    }

    fn summary(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "{} maneuvers, {} pairs: {} with plans of both, {} lost, {} won, {} with plans of neither",
            self.entries.len(),
            self.pairs().count(),
            self.count(Pair::is_converged),
            self.lost(),
            self.count(|pair| pair.candidate.is_converged() && !pair.opponent.is_converged()),
            self.count(|pair| !pair.candidate.is_converged() && !pair.opponent.is_converged()),
        )];
        if let Some(Summary { median, mean }) = self.gap() {
            lines.push(format!("gap:       median {}, mean {}", percents(median), percents(mean)));
        }
        if let Some(Summary { median, mean }) = self.cpu_ratio() {
            lines.push(format!("CPU ratio: median {}, geometric mean {}", times(median), times(mean)));
        }
        for (role, run) in ROLES {
            let cpu: f64 = self.pairs().map(|pair| run(pair).cpu_s).sum();
            let ended = self.count(|pair| !run(pair).is_finished());
            let spreads: Vec<Option<f64>> =
                self.entries.iter().map(|entry| spread(entry.row.pairs.iter().map(run))).collect();
            lines.push(format!("{role}: {cpu:.1} s of CPU, {ended} searches cut short; {}", spread::summary(&spreads)));
            lines.extend(self.against_references(run).map(|line| format!("{role}: {line}")));
        }
        lines
    }

    fn against_references(&self, run: Side) -> Option<String> {
        let gaps = sorted(self.entries.iter().flat_map(|entry| {
            let plans = entry.row.pairs.iter().map(run).filter(|run| run.is_converged());
            plans.filter_map(|run| Some(run.final_time_s / entry.reference_s? - 1.0))
        }));
        let near = gaps.iter().filter(|gap| **gap <= NEAR).count();
        (!gaps.is_empty()).then(|| {
            let [median, high, largest] = [0.5, 0.95, 1.0].map(|share| 1e2 * quantile(&gaps, share));
            format!(
                "gap to the references: median {median:+.2} %, 95 % {high:+.2} %, largest {largest:+.2} %; within {} %: {near} of \
                 {}",
                1e2 * NEAR,
                gaps.len()
            )
        })
    }
}

/// One program's run of a pair.
type Side = fn(&Pair) -> &Run;

/// Names of the programs in a pair, and their runs.
const ROLES: [(&str, Side); 2] = [("candidate", |pair| &pair.candidate), ("opponent", |pair| &pair.opponent)];

fn final_time(run: &Run) -> f64 {
    run.final_time_s
}

fn cpu_time(run: &Run) -> f64 {
    run.cpu_s
}

/// Ratios are of the seeds where both programs have plans.
fn line(row: &Row) -> String {
    let plans = |run: Side| row.pairs.iter().filter(|pair| run(pair).is_converged()).count();
    let [(_, candidate), (_, opponent)] = ROLES;
    let shown =
        |value: Option<f64>, digits: usize| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"));
    let fastest = row.pairs.iter().map(candidate).filter(|run| run.is_converged()).map(|run| run.final_time_s);
    let cpu: f64 = row.pairs.iter().map(|pair| pair.candidate.cpu_s).sum::<f64>() / row.pairs.len() as f64;
    format!(
        "{:<26} {:>2} {:>2} {:>12} {:>9} {cpu:>9.3} {:>9}",
        row.maneuver,
        plans(candidate),
        plans(opponent),
        shown(fastest.reduce(f64::min), 4),
        shown(row.log_ratio(final_time).map(|ratio| 1e2 * ratio.exp_m1()), 3),
        shown(row.log_ratio(cpu_time).map(f64::exp), 3),
    )
}

fn percents(Estimate { value, low, high }: Estimate) -> String {
    format!("{:+.3} % ({:+.3} to {:+.3} %)", 1e2 * value, 1e2 * low, 1e2 * high)
}

fn times(Estimate { value, low, high }: Estimate) -> String {
    format!("{value:.3} ({low:.3} to {high:.3})")
}

/// Writes figures as JSON, where a file is named.
///
/// # Errors
/// A file that cannot be written.
pub(crate) fn write_json(path: Option<&Path>, figures: &impl Serialize) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    fs::write(path, serde_json::to_vec_pretty(figures)?)
        .with_context(|| format!("{} cannot be written", path.display()))
}
