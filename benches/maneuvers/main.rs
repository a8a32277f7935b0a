//! The benchmark suite: named maneuvers, how well and how fast they are solved, and the best plans known for them.
//!
//! Its use is described in `docs/benchmarks.md`.

mod answers;
mod arguments;
mod draw;
mod improve;
mod limited;
mod measure;
mod random;
mod report;
mod rules;
mod scale;
mod suite;
mod timing;
mod values;
mod verdict;
mod warm;

use std::process::ExitCode;

use anyhow::Result;
use arguments::{Arguments, Mode, Selection};
use clap::Parser as _;
use measure::Runner;
use report::{Report, Row};
use suite::{Case, Witness, read_cases};

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
    match &arguments.mode {
        None => run_suite(arguments),
        Some(Mode::Random(random)) => run_random(arguments, random),
        Some(Mode::Improve(improve)) => {
            let (_, cases) = read_cases()?;
            improve::improve(&selected(cases, &improve.selection), improve, &arguments.effort)?;
            Ok(ExitCode::SUCCESS)
        }
        Some(Mode::Warm(warm)) => {
            let (_, cases) = read_cases()?;
            warm::measure(&selected(cases, &warm.selection), warm)?;
            Ok(ExitCode::SUCCESS)
        }
        Some(Mode::Limited(limited)) => {
            limited::run(limited, &arguments.effort)?;
            Ok(ExitCode::SUCCESS)
        }
        Some(Mode::Answers(arguments)) => answers::run(arguments),
    }
}

/// The suite against the best plans known.
fn run_suite(arguments: &Arguments) -> Result<ExitCode> {
    let (_, cases) = read_cases()?;
    let runner = Runner::start(&arguments.effort)?;
    let mut report = Report::new(&arguments.effort);
    for case in selected(cases, &arguments.selection) {
        let best_known = Witness::read(&case.name)?.map(|witness| witness.final_time_s);
        report.add(Row { best_known, answer: runner.solve(&case)? });
    }
    let verdicts = rules::of_suite(&report);
    report.finish(&verdicts, arguments)
}

/// Fresh maneuvers, of which nothing is known.
fn run_random(arguments: &Arguments, random: &arguments::RandomArguments) -> Result<ExitCode> {
    let runner = Runner::start(&arguments.effort)?;
    let mut report = Report::new(&arguments.effort);
    for case in selected(random::maneuvers(random)?, &random.selection) {
        report.add(Row { best_known: None, answer: runner.solve(&case)? });
    }
    let verdicts = rules::of_random(&report);
    report.finish(&verdicts, arguments)
}

fn selected(cases: Vec<Case>, selection: &Selection) -> Vec<Case> {
    cases.into_iter().filter(|case| selection.holds(&case.name)).collect()
}
