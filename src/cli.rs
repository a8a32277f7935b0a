//! One command per kind of job (`slipdrive solve`): the REST bodies, run in process through the same service.

use std::fs::{self, File};
use std::io::{self, Read, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context as _;
use clap::{ArgMatches, Args as _, Command, FromArgMatches as _};
use slipdrive::contract::{Problem, json};
use slipdrive::jobs::{InProcessSolver, Jobs, Kind, Limits, Visitor};
use slipdrive::metrics::Metrics;
use slipdrive::service::{Service, ServiceSettings};

use crate::EXIT_BAD_INPUT;
use crate::config::{JobArguments, cores};

/// For an answer that is not what was asked for: a plan that misses the goal.
const EXIT_NO_SUCCESS: u8 = 2;

/// Adds the command of every kind of job.
pub(crate) fn with_jobs(command: Command) -> Command {
    let mut commands = Commands(Some(command));
    jobs(&Metrics::new()).each(&mut commands);
    commands.0.unwrap_or_default()
}

/// Runs the command of the kind of job with this name.
///
/// # Errors
/// What cannot be read or written, and a job without an answer.
pub(crate) fn run(name: &str, matches: &ArgMatches) -> anyhow::Result<ExitCode> {
    let mut run = Run { name, matches, outcome: None };
    jobs(&Metrics::new()).each(&mut run);
    run.outcome.unwrap_or_else(|| anyhow::bail!("there is no command `{name}`"))
}

fn jobs(metrics: &Metrics) -> Jobs {
    Jobs::new(Limits::default(), Arc::new(InProcessSolver), metrics)
}

struct Commands(Option<Command>);

impl Visitor for Commands {
    fn visit<K: Kind>(&mut self, _kind: &Arc<K>) {
        let examples: Vec<String> = K::EXAMPLES.iter().map(|(name, _)| format!(", or the example `{name}`")).collect();
        let input =
            format!("File with the JSON body of `POST /{}`; `-` is standard input{}", K::NAME, examples.concat());
        let command = JobArguments::augment_args(Command::new(K::NAME)).about(sentence(K::SUMMARY));
        let command = command.mut_arg("input", |argument| match K::EXAMPLES.first() {
            Some((name, _)) => argument.help(input).required(false).default_value(name),
            None => argument.help(input),
        });
        self.0 = self.0.take().map(|all| all.subcommand(command));
    }
}

fn sentence(words: &str) -> String {
    let mut characters = words.chars();
    let first = characters.next().into_iter().flat_map(char::to_uppercase);
    first.chain(characters).collect()
}

/// Finds the kind and runs its command.
struct Run<'a> {
    name: &'a str,
    matches: &'a ArgMatches,
    outcome: Option<anyhow::Result<ExitCode>>,
}

impl Visitor for Run<'_> {
    fn visit<K: Kind>(&mut self, kind: &Arc<K>) {
        if K::NAME == self.name {
            let arguments = JobArguments::from_arg_matches(self.matches).map_err(anyhow::Error::from);
            self.outcome = Some(arguments.and_then(|arguments| run_job(kind, &arguments)));
        }
    }
}

/// Runs one job; the exit code says whether there is what was asked for.
fn run_job<K: Kind>(kind: &Arc<K>, arguments: &JobArguments) -> anyhow::Result<ExitCode> {
    let limits = Limits::default();
    let input = match K::read(&body::<K>(&arguments.input, limits.max_body_bytes)?, &limits) {
        Ok(input) => input,
        Err(problem) => return Ok(refuse(&problem)),
    };
    // Nobody else is in the queue: all workers help with the one job.
    let workers = arguments.threads.unwrap_or_else(cores);
    let service = Service::start(ServiceSettings { workers, queue_length: 0, ..ServiceSettings::default() })?;
    let made = |input: &K::Input, done: &_| Made::of::<K>(input, done);
    let made = service.reserve()?.submit(Arc::clone(kind), input, None, made)?.blocking_outcome()?;
    write_answer(arguments.json.as_deref(), &made.answer, &made.table)?;
    Ok(if made.is_success { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO_SUCCESS) })
}

/// What a command writes.
struct Made {
    answer: Vec<u8>,
    table: String,
    is_success: bool,
}

impl Made {
    fn of<K: Kind>(input: &K::Input, done: &slipdrive::service::Done<K::Output>) -> Self {
        Self {
            answer: json::write(&K::answer(input, done)),
            table: K::table(input, done),
            is_success: K::is_success(&done.output),
        }
    }
}

/// An example, or a file of which at most one byte above the limit is read: enough for the reader to refuse it.
fn body<K: Kind>(input: &PathBuf, limit: usize) -> anyhow::Result<Vec<u8>> {
    if let Some((_, request)) = K::EXAMPLES.iter().find(|(name, _)| input == Path::new(name)) {
        return Ok(json::write(&request()));
    }
    let mut body = Vec::new();
    let most = limit as u64 + 1;
    let read = if input == Path::new("-") {
        io::stdin().take(most).read_to_end(&mut body)
    } else {
        File::open(input).and_then(|file| file.take(most).read_to_end(&mut body))
    };
    read.with_context(|| format!("{} cannot be read", input.display()))?;
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
fn write_answer(path: Option<&Path>, answer: &[u8], table: &str) -> anyhow::Result<()> {
    let mut output = io::stdout().lock();
    match path {
        Some(path) if path == Path::new("-") => {
            output.write_all(answer)?;
            writeln!(output)?;
        }
        Some(path) => {
            write_file(path, answer)?;
            output.write_all(table.as_bytes())?;
        }
        None => output.write_all(table.as_bytes())?,
    }
    Ok(())
}

fn write_file(path: &Path, content: &[u8]) -> anyhow::Result<()> {
    fs::write(path, content).with_context(|| format!("{} cannot be written", path.display()))
}
