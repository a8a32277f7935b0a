//! The table of a run, its summary, and the same as JSON.

use std::fs;
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use serde::Serialize;
use serde_json::json;

use crate::arguments::{Arguments, Effort};
use crate::measure::Answer;
use crate::values::digest;
use crate::verdict::Verdict;

/// Final times within this share of the best known count as equal to it.
pub(crate) const NEAR: f64 = 0.005;

/// One case and how its answer compares with the best plan known.
#[derive(Debug, Serialize)]
pub(crate) struct Row {
    /// Final time of the best plan known, s.
    #[serde(rename = "best_known_s")]
    pub(crate) best_known: Option<f64>,
    #[serde(flatten)]
    pub(crate) answer: Answer,
}

/// All rows so far; each is printed as it comes.
pub(crate) struct Report {
    pub(crate) rows: Vec<Row>,
    /// Whether final times are those of the grid on which the best known were found.
    pub(crate) is_on_suite_grid: bool,
}

impl Row {
    /// How much slower than the best plan known, as a share of its final time; none for an answer that is no plan.
    pub(crate) fn gap(&self) -> Option<f64> {
        let best = self.best_known.filter(|_| self.answer.is_converged())?;
        Some(self.answer.final_time_s / best - 1.0)
    }

    /// The fastest motion known: no lower bound may exceed it.
    pub(crate) fn fastest_known(&self) -> f64 {
        let own = if self.answer.is_converged() { self.answer.final_time_s } else { f64::INFINITY };
        self.best_known.map_or(own, |best| best.min(own))
    }

    fn line(&self) -> String {
        let answer = &self.answer;
        let gap = self.gap().map_or_else(|| "-".to_owned(), |gap| format!("{:+.2}", 1e2 * gap));
        let mut line = format!(
            "{:<38} {:<13} {:>9.4} {:>7} {:>8} {:>8.1} {:>8.0e} {:>7.2} {:>7.2} {:<3} {:>5} {:>5.2}",
            answer.case,
            answer.status,
            answer.final_time_s,
            gap,
            answer.rollouts,
            answer.solve_time_ms,
            answer.largest_goal_error,
            1e3 * answer.replay_miss_m,
            1e3 * answer.replay_miss_rad,
            if answer.replay_confirmed { "yes" } else { "no" },
            answer.steps,
            answer.lower_bound_s / self.fastest_known(),
        );
        if let Some(shortfall) = answer.shortfall() {
            line = format!("{line}  {shortfall}");
        }
        line
    }
}

const HEAD: &str = "case                                   status              t_f s   gap %  rollouts       ms     miss      \
                    mm    mrad exe steps bound";

impl Report {
    /// An empty report; prints the head of the table.
    pub(crate) fn new(effort: &Effort) -> Self {
        println!("{HEAD}");
        Self { rows: Vec::new(), is_on_suite_grid: !effort.automatic_steps }
    }

    /// Adds and prints a row.
    pub(crate) fn add(&mut self, row: Row) {
        println!("{}", row.line());
        self.rows.push(row);
    }

    /// Share of the rows for which something holds; 1 of none.
    pub(crate) fn share(&self, holds: impl Fn(&Row) -> bool) -> f64 {
        let count = self.rows.iter().filter(|row| holds(row)).count();
        if self.rows.is_empty() { 1.0 } else { count as f64 / self.rows.len() as f64 }
    }

    /// Largest value over all rows; NaN if any is NaN.
    pub(crate) fn largest(&self, value: impl Fn(&Row) -> f64) -> f64 {
        let worse = |worst: f64, next: f64| if next > worst || next.is_nan() { next } else { worst };
        self.rows.iter().map(value).fold(f64::NEG_INFINITY, worse)
    }

    /// Prints summary and verdicts, writes the JSON; with `--check` the exit code is 1 when a rule is broken.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn finish(&self, verdicts: &[Verdict], arguments: &Arguments) -> Result<ExitCode> {
        for line in self.summary() {
            println!("{line}");
        }
        for verdict in verdicts {
            println!("{verdict}");
        }
        if let Some(path) = &arguments.json {
            let document = json!({ "cases": self.rows, "rules": verdicts });
            fs::write(path, serde_json::to_vec_pretty(&document)?)
                .with_context(|| format!("{} cannot be written", path.display()))?;
        }
        let is_broken = verdicts.iter().any(|verdict| !verdict.holds);
        Ok(if arguments.check && is_broken { ExitCode::FAILURE } else { ExitCode::SUCCESS })
    }

    fn summary(&self) -> Vec<String> {
        let times = self.sorted(|row| row.answer.solve_time_ms);
        let rollouts: u64 = self.rows.iter().map(|row| row.answer.rollouts).sum();
        let digests: String = self.rows.iter().map(|row| row.answer.digest.as_str()).collect();
        let mut lines = vec![
            String::new(),
            format!("{} cases: {}", self.rows.len(), self.status_counts()),
            format!("replay confirmed {:.1} %", 1e2 * self.share(|row| row.answer.replay_confirmed)),
            format!(
                "solve time: median {:.0} ms, 95 % {:.0} ms, largest {:.0} ms, total {:.1} s; {rollouts} rollouts",
                quantile(&times, 0.5),
                quantile(&times, 0.95),
                quantile(&times, 1.0),
                1e-3 * times.iter().sum::<f64>(),
            ),
        ];
        let mut gaps: Vec<f64> = self.rows.iter().filter_map(Row::gap).collect();
        gaps.sort_by(f64::total_cmp);
        if !gaps.is_empty() {
            let near = gaps.iter().filter(|gap| **gap <= NEAR).count();
            lines.push(format!(
                "gap to best known: median {:+.2} %, 95 % {:+.2} %, largest {:+.2} %; within 0.5 %: {near} of {}",
                1e2 * quantile(&gaps, 0.5),
                1e2 * quantile(&gaps, 0.95),
                1e2 * quantile(&gaps, 1.0),
                gaps.len(),
            ));
        }
        lines.push(format!("digest of all answers: {}", digest(&digests)));
        lines
    }

    fn status_counts(&self) -> String {
        let mut counts: Vec<(&str, usize)> = Vec::new();
        for status in self.rows.iter().map(|row| row.answer.status) {
            match counts.iter_mut().find(|(known, _)| *known == status) {
                Some((_, count)) => *count += 1,
                None => counts.push((status, 1)),
            }
        }
        counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        counts.iter().map(|(status, count)| format!("{count} {status}")).collect::<Vec<_>>().join(", ")
    }

    fn sorted(&self, value: impl Fn(&Row) -> f64) -> Vec<f64> {
        let mut values: Vec<f64> = self.rows.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values
    }
}

/// The value below which a share of the sorted values lies; NaN of none.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the last index")]
    let index = (share * last as f64).round() as usize;
    sorted[index]
}
