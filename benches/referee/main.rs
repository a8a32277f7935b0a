//! The referee: two programs on maneuvers of robots that the suite does not have.
//!
//! Its use is described in `docs/benchmarks.md`.

mod arguments;
mod compare;
mod cpu;
#[path = "../maneuvers/draw.rs"]
mod draw;
mod maneuvers;
mod pairs;
mod peer;
mod program;
mod references;
mod report;
mod robots;
mod rounding;
mod spread;
mod statistics;
#[allow(dead_code, unused_imports, reason = "the runner uses more of the suite")]
#[path = "../maneuvers/suite/mod.rs"]
mod suite;
#[allow(dead_code, reason = "the runner has digests of answers too")]
#[path = "../maneuvers/values.rs"]
mod values;
#[path = "../maneuvers/verdict.rs"]
mod verdict;

use std::process::ExitCode;

use anyhow::Result;
use arguments::{Arguments, Command};
use clap::Parser as _;

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.command {
        Command::Draw(draw) => maneuvers::write(&draw.drawing.maneuvers(), &draw.out)?,
        Command::Compare(compare) => return compare::run(compare),
        Command::Seeds(seeds) => spread::run(seeds)?,
        Command::References(references) => references::run(references)?,
    }
    Ok(ExitCode::SUCCESS)
}
