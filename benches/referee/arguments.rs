//! The command line of the referee.

use std::path::PathBuf;

use anyhow::{Context as _, Result, bail};
use clap::{Args, Parser, Subcommand, value_parser};
use serde_json::Value;

use crate::maneuvers::{self, Drive, Maneuver, drawn_maneuvers};
use crate::program::Program;

/// Seed of the maneuvers on which changes of the search are judged, and which have references. Others are for the last word.
pub(crate) const TUNING_SEED: u64 = 1;

/// Compares two programs on maneuvers of robots that the suite does not have.
#[derive(Debug, Parser)]
#[command(name = "referee")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// `cargo bench` adds it.
    #[arg(long, hide = true, global = true)]
    bench: bool,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Writes maneuvers to a file, one request to a line.
    Draw(DrawArguments),
    /// Solves maneuvers with two programs in turn, and compares final times and CPU times.
    Compare(CompareArguments),
    /// Solves maneuvers with several seeds of one program: how much the final time depends on the seed.
    Seeds(SeedsArguments),
    /// Searches long for the best plans of the tuning maneuvers, and keeps their final times.
    References(ReferencesArguments),
}

/// Which maneuvers are drawn.
#[derive(Debug, Args)]
pub(crate) struct Drawing {
    /// Seed of the maneuvers [default: that of the tuning maneuvers].
    #[arg(long, default_value_t = TUNING_SEED, hide_default_value = true)]
    seed: u64,
    /// Number of maneuvers.
    #[arg(long, value_name = "N", default_value_t = 100)]
    count: usize,
    /// Robots have motors in place of torque limits.
    #[arg(long)]
    motors: bool,
}

/// Which maneuvers are meant.
#[derive(Debug, Args)]
pub(crate) struct Selection {
    /// Only maneuvers whose name contains one of these.
    #[arg(value_name = "FILTER")]
    filters: Vec<String>,
    /// A file of `draw`, in place of a seed.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["seed", "count", "motors"])]
    maneuvers: Option<PathBuf>,
    #[command(flatten)]
    drawing: Drawing,
}

/// The two programs.
#[derive(Debug, Args)]
pub(crate) struct Opponents {
    /// The program that must show something.
    #[arg(long, value_name = "PROGRAM")]
    candidate: PathBuf,
    /// Fields over those of the requests to the candidate, as JSON.
    #[arg(long, value_name = "JSON", value_parser = json)]
    candidate_fields: Option<Value>,
    /// The program that it is compared with.
    #[arg(long, value_name = "PROGRAM")]
    opponent: PathBuf,
    /// Fields over those of the requests to the opponent, as JSON.
    #[arg(long, value_name = "JSON", value_parser = json)]
    opponent_fields: Option<Value>,
    /// Share of its normal force at rest that each contact keeps, for programs that take it from the request
    /// (`maneuver.limits.normal_load_share`).
    #[arg(long, value_name = "SHARE")]
    pub(crate) load_share: Option<f64>,
}

/// Drawing into a file.
#[derive(Debug, Args)]
pub(crate) struct DrawArguments {
    #[command(flatten)]
    pub(crate) drawing: Drawing,
    /// Where the maneuvers are written.
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
}

/// A comparison.
#[derive(Debug, Args)]
pub(crate) struct CompareArguments {
    #[command(flatten)]
    pub(crate) selection: Selection,
    #[command(flatten)]
    pub(crate) opponents: Opponents,
    /// Search seeds for each maneuver.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = value_parser!(u64).range(1..))]
    pub(crate) seeds: u64,
    /// Where all figures are written as JSON.
    #[arg(long, value_name = "OUT")]
    pub(crate) json: Option<PathBuf>,
    /// Ends with exit code 1 unless the median of the CPU ratios is at most `cpu`, the upper end of the interval of the mean gap
    /// at most `gap`, and no plan is lost that the opponent finds.
    #[arg(long, value_name = "cpu=RATIO,gap=SHARE", value_delimiter = ',', value_parser = requirement)]
    pub(crate) require: Vec<Requirement>,
}

/// Something that a comparison must show.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Requirement {
    /// Largest median of the CPU ratios.
    Cpu(f64),
    /// Largest upper end of the interval of the mean gap.
    Gap(f64),
}

/// The spread over seeds.
#[derive(Debug, Args)]
pub(crate) struct SeedsArguments {
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// The program.
    #[arg(long)]
    program: PathBuf,
    /// Fields over those of the requests, as JSON.
    #[arg(long, value_name = "JSON", value_parser = json)]
    fields: Option<Value>,
    /// Share of its normal force at rest that each contact keeps, for programs that take it from the request
    /// (`maneuver.limits.normal_load_share`).
    #[arg(long, value_name = "SHARE")]
    load_share: Option<f64>,
    /// Search seeds for each maneuver.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = value_parser!(u64).range(1..))]
    pub(crate) seeds: u64,
    /// Where all figures are written as JSON.
    #[arg(long, value_name = "OUT")]
    pub(crate) json: Option<PathBuf>,
}

/// Long searches.
#[derive(Debug, Args)]
pub(crate) struct ReferencesArguments {
    /// Only maneuvers whose name contains one of these.
    #[arg(value_name = "FILTER")]
    pub(crate) filters: Vec<String>,
    #[command(flatten)]
    pub(crate) opponents: Opponents,
    /// Starts of each program for each seed.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = value_parser!(u64).range(1..))]
    pub(crate) starts: u64,
    /// Seeds of each program.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = value_parser!(u64).range(1..))]
    pub(crate) seeds: u64,
    /// A Python with what `benches/peer/requirements.txt` names: the peer searches too, where it can express the maneuver.
    #[arg(long, value_name = "PYTHON")]
    pub(crate) peer: Option<PathBuf>,
}

impl Drawing {
    /// Draws the maneuvers.
    pub(crate) fn maneuvers(&self) -> Vec<Maneuver> {
        let drive = if self.motors { Drive::Motors } else { Drive::TorqueLimits };
        drawn_maneuvers(self.seed, self.count, drive)
    }
}

impl Selection {
    /// The maneuvers that are meant.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(crate) fn maneuvers(&self) -> Result<Vec<Maneuver>> {
        let maneuvers = match &self.maneuvers {
            Some(path) => maneuvers::read(path)?,
            None => self.drawing.maneuvers(),
        };
        Ok(selected(maneuvers, &self.filters))
    }
}

impl Opponents {
    /// Candidate and opponent, ready to run.
    ///
    /// # Errors
    /// A program that cannot be run, or refuses its fields.
    pub(crate) fn programs(&self) -> Result<[Program; 2]> {
        Ok([
            Program::new(&self.candidate, self.candidate_fields.as_ref(), self.load_share)?,
            Program::new(&self.opponent, self.opponent_fields.as_ref(), self.load_share)?,
        ])
    }
}

impl SeedsArguments {
    /// The program, ready to run.
    ///
    /// # Errors
    /// A program that cannot be run, or refuses its fields.
    pub(crate) fn program(&self) -> Result<Program> {
        Program::new(&self.program, self.fields.as_ref(), self.load_share)
    }
}

/// The maneuvers whose name contains one of the filters; all without filters.
pub(crate) fn selected(maneuvers: Vec<Maneuver>, filters: &[String]) -> Vec<Maneuver> {
    let is_meant = |name: &str| filters.is_empty() || filters.iter().any(|filter| name.contains(filter.as_str()));
    maneuvers.into_iter().filter(|maneuver| is_meant(&maneuver.name)).collect()
}

fn json(text: &str) -> serde_json::Result<Value> {
    serde_json::from_str(text)
}

fn requirement(text: &str) -> Result<Requirement> {
    let (figure, limit) = text.split_once('=').context("a requirement is `cpu=RATIO` or `gap=SHARE`")?;
    let limit: f64 = limit.parse().with_context(|| format!("`{limit}` is no number"))?;
    match figure {
        "cpu" => Ok(Requirement::Cpu(limit)),
        "gap" => Ok(Requirement::Gap(limit)),
        _ => bail!("there is no requirement on `{figure}`, only on `cpu` and `gap`"),
    }
}
