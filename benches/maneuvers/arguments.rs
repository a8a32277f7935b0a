//! The command line of the runner.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use slipdrive::solver::{Refinement, SolverSettings};

/// Most steps of automatic grids: the service's limit.
const AUTOMATIC_STEP_LIMIT: usize = 10_000;

/// Solves the maneuvers of the suite and compares them with the best plans known.
#[derive(Debug, Parser)]
#[command(name = "maneuvers")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) mode: Option<Mode>,
    #[command(flatten)]
    pub(crate) selection: Selection,
    #[command(flatten)]
    pub(crate) effort: Effort,
    /// Where all figures are written as JSON.
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Ends with exit code 1 when a rule is broken.
    #[arg(long, global = true)]
    pub(crate) check: bool,
    /// `cargo bench` adds it.
    #[arg(long, hide = true, global = true)]
    bench: bool,
}

/// Which cases are meant.
#[derive(Debug, Default, Args)]
pub(crate) struct Selection {
    /// Only cases whose name contains one of these.
    #[arg(value_name = "FILTER")]
    filters: Vec<String>,
}

/// How the solver is asked to work.
#[derive(Debug, Clone, Args)]
pub(crate) struct Effort {
    /// Starts of each search; default: the service's.
    #[arg(long, global = true, value_name = "N")]
    pub(crate) starts: Option<usize>,
    /// Seed of each search; default: the service's.
    #[arg(long, global = true, value_name = "N")]
    pub(crate) solver_seed: Option<u64>,
    /// Lets the solver choose the number of steps, instead of 200.
    #[arg(long, global = true)]
    pub(crate) automatic_steps: bool,
    /// Workers of the service, which may share the starts of one search.
    #[arg(long, global = true, value_name = "N", default_value = "1")]
    pub(crate) threads: NonZeroUsize,
}

/// What to do instead of running the suite.
#[derive(Debug, Subcommand)]
pub(crate) enum Mode {
    /// Searches for faster plans than the best known and keeps them.
    Improve(ImproveArguments),
    /// Solves fresh random maneuvers of the robots.
    Random(RandomArguments),
    /// Compares warm re-solves of changed robots with cold ones.
    Warm(WarmArguments),
    /// Compares random maneuvers with limits with the same ones without.
    Limited(LimitedArguments),
    /// Compares the answers of both transports to many requests with the digests on file.
    Answers(AnswersArguments),
}

/// The search for better plans.
#[derive(Debug, Args)]
pub(crate) struct ImproveArguments {
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Seed of this run; runs with different seeds add up.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Leaves cases alone on which at least as many starts were spent before.
    #[arg(long, value_name = "N")]
    pub(crate) up_to: Option<u64>,
}

/// Random maneuvers.
#[derive(Debug, Args)]
pub(crate) struct RandomArguments {
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Maneuvers of each robot.
    #[arg(long, value_name = "N", default_value_t = 200)]
    pub(crate) per_robot: usize,
    /// Seed of the maneuvers.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

/// Maneuvers with limits.
#[derive(Debug, Args)]
pub(crate) struct LimitedArguments {
    /// Maneuvers of each of five robots.
    #[arg(long, value_name = "N", default_value_t = 40)]
    pub(crate) per_robot: usize,
    /// Seed of the maneuvers and limits.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// All of them without slip, with limits of speed and motor.
    #[arg(long)]
    pub(crate) no_slip: bool,
    /// Prints a line for each.
    #[arg(long)]
    pub(crate) all: bool,
}

/// Warm re-solves.
#[derive(Debug, Args)]
pub(crate) struct WarmArguments {
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Cases in the sample beside the forward drive.
    #[arg(long, value_name = "N", default_value_t = 24)]
    pub(crate) sample: usize,
    /// Each solve is timed this many times, and the shortest counts.
    #[arg(long, value_name = "N", default_value = "5")]
    pub(crate) repetitions: NonZeroUsize,
}

/// Reference answers.
#[derive(Debug, Args)]
pub(crate) struct AnswersArguments {
    /// Writes the file in place of comparing with it.
    #[arg(long)]
    pub(crate) write: bool,
}

impl Effort {
    /// Sets what was asked for; anything else stays as it is.
    pub(crate) fn apply(&self, settings: &mut SolverSettings) {
        settings.start_count = self.starts.unwrap_or(settings.start_count);
        settings.seed = self.solver_seed.unwrap_or(settings.seed);
        if self.automatic_steps {
            settings.refinement = Refinement::UntilConfirmed { step_limit: AUTOMATIC_STEP_LIMIT };
        }
    }
}

impl Selection {
    /// Whether a case is meant.
    pub(crate) fn holds(&self, name: &str) -> bool {
        self.filters.is_empty() || self.filters.iter().any(|filter| name.contains(filter.as_str()))
    }
}
