//! `slipdrive solve` and `slipdrive simulate`: the REST bodies, run in process through the same service.

mod table;

use std::fs::{self, File};
use std::io::{self, Read, Write as _};
use std::num::NonZeroUsize;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context as _;
use slipdrive::api::rest::{Problem, forward_drive_body, read_simulate, read_solve, simulate_answer, solve_answer};
use slipdrive::plot;
use slipdrive::service::domain::Status;
use slipdrive::service::{InProcessSolver, Limits, Service, ServiceSettings, SolveClocks};

use crate::EXIT_BAD_INPUT;
use crate::config::{SimulateArguments, SolveArguments, cores};

/// For a plan that misses the goal.
const EXIT_NO_PLAN: u8 = 2;

/// Solves one maneuver; the exit code tells whether the plan meets the goal.
pub(crate) fn solve(arguments: &SolveArguments) -> anyhow::Result<ExitCode> {
    let limits = Limits::default();
    let body = if arguments.input == Path::new("forward-drive") {
        forward_drive_body()
    } else {
        read_body(&arguments.input, limits.max_body_bytes)?
    };
    let accepted = match read_solve(&body, &limits) {
        Ok(accepted) => accepted,
        Err(problem) => return Ok(refuse(&problem)),
    };
    // Named, because dropping the service stops its jobs.
    let service = service(limits, arguments.threads.unwrap_or_else(cores))?;
    let clocks = SolveClocks { time_limit: accepted.time_limit, deadline: None };
    let solved = service.reserve()?.solve_blocking(accepted.input.clone(), clocks)?;
    let table = table::of_solution(&solved, &accepted.input.maneuver.goal);
    if let Some(path) = &arguments.plot {
        fs::write(path, plot::html(&solved.solution))
            .with_context(|| format!("{} cannot be written", path.display()))?;
    }
    write_answer(arguments.json.as_deref(), || solve_answer(&accepted, &solved), &table)?;
    Ok(match solved.solution.status {
        Status::Converged | Status::Feasible => ExitCode::SUCCESS,
        Status::NotConverged | Status::Infeasible => ExitCode::from(EXIT_NO_PLAN),
    })
}

/// Integrates one torque schedule.
pub(crate) fn simulate(arguments: &SimulateArguments) -> anyhow::Result<ExitCode> {
    let limits = Limits::default();
    let body = read_body(&arguments.input, limits.max_body_bytes)?;
    let input = match read_simulate(&body, &limits) {
        Ok(input) => input,
        Err(problem) => return Ok(refuse(&problem)),
    };
    let service = service(limits, NonZeroUsize::MIN)?;
    let simulated = service.reserve()?.simulate_blocking(input)?;
    let table = table::of_simulation(&simulated);
    write_answer(arguments.json.as_deref(), || simulate_answer(&simulated), &table)?;
    Ok(ExitCode::SUCCESS)
}

/// Nobody else is in the queue: all workers help with the one job.
fn service(limits: Limits, workers: NonZeroUsize) -> io::Result<Service> {
    let settings = ServiceSettings { workers, queue_length: 0, limits, ..ServiceSettings::default() };
    Service::start(settings, Arc::new(InProcessSolver))
}

/// Reads at most one byte above the limit: enough for the reader to refuse it.
fn read_body(path: &Path, limit: usize) -> anyhow::Result<Vec<u8>> {
    let mut body = Vec::new();
    let most = limit as u64 + 1;
    let read = if path == Path::new("-") {
        io::stdin().take(most).read_to_end(&mut body)
    } else {
        File::open(path).and_then(|file| file.take(most).read_to_end(&mut body))
    };
    read.with_context(|| format!("{} cannot be read", path.display()))?;
    Ok(body)
}

fn refuse(problem: &Problem) -> ExitCode {
    eprintln!("error: {problem}");
    for error in problem.errors() {
        eprintln!("  {}: {}", error.pointer, error.message);
    }
    ExitCode::from(EXIT_BAD_INPUT)
}

/// Prints the table, and the JSON answer where it is asked for.
fn write_answer(path: Option<&Path>, answer: impl Fn() -> Vec<u8>, table: &str) -> anyhow::Result<()> {
    let mut output = io::stdout().lock();
    match path {
        Some(path) if path == Path::new("-") => {
            output.write_all(&answer())?;
            writeln!(output)?;
        }
        Some(path) => {
            fs::write(path, answer()).with_context(|| format!("{} cannot be written", path.display()))?;
            output.write_all(table.as_bytes())?;
        }
        None => output.write_all(table.as_bytes())?,
    }
    Ok(())
}
