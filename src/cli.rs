//! One command per kind of job (`slipdrive solve`): the REST bodies, run in process through the same service.

mod outputs;
mod progress;
mod progress_of_rows;
mod shown;
mod sweep;
#[cfg(feature = "nats")]
mod sweep_nats;
#[cfg(feature = "nats")]
mod worker;

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context as _;
use clap::{Arg, ArgAction, ArgMatches, Args as _, Command, FromArgMatches as _};
use serde_json::{Map, Value};
use slipdrive::contract::message::PresentedPlan;
use slipdrive::contract::{Problem, indented, json};
use slipdrive::jobs::{Flag, InProcessSolver, Jobs, Kind, Limits, Visitor};
use slipdrive::metrics::Metrics;
use slipdrive::service::{Class, Done, Service, ServiceError, ServiceSettings};

pub(crate) use self::outputs::say;
use self::outputs::{Writer, is_standard_stream};
pub(crate) use self::sweep::sweep;
#[cfg(feature = "nats")]
pub(crate) use self::worker::worker;
use crate::config::{JobArguments, thread_count};
use crate::{EXIT_BAD_INPUT, tell};

/// For an answer that is not what was asked for: a plan that misses the goal.
const EXIT_NO_SUCCESS: u8 = 2;
/// Most bytes of one file that is read, where what is not needed of it is left out: four answers on the largest grid.
const LARGEST_FILE: usize = 32 << 20;

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
    let jobs = jobs(&Metrics::new());
    let mut run = Run { name, matches, jobs: jobs.clone(), outcome: None };
    jobs.each(&mut run);
    run.outcome.unwrap_or_else(|| anyhow::bail!("there is no command `{name}`"))
}

/// Prints an example of a request or of a sweep.
///
/// # Errors
/// When standard output cannot be written.
pub(crate) fn example(name: Option<&str>) -> anyhow::Result<ExitCode> {
    let mut examples = Examples(Vec::new());
    jobs(&Metrics::new()).each(&mut examples);
    examples.0.extend(slipdrive::sweep::EXAMPLES.iter().map(|(name, file)| (*name, file.as_bytes().to_vec())));
    let found = examples.0.iter().find(|(known, _)| name.is_none_or(|name| name == *known));
    let Some((_, body)) = found else {
        let known: Vec<_> = examples.0.iter().map(|(name, _)| *name).collect();
        let fault = format!("there is no example `{}`, but {}", name.unwrap_or_default(), known.join(", "));
        return Ok(refused(&fault));
    };
    say(body)?;
    Ok(ExitCode::SUCCESS)
}

/// Prints what completes the commands in a shell.
///
/// # Errors
/// When standard output cannot be written.
pub(crate) fn completions(shell: clap_complete::Shell, mut command: Command) -> anyhow::Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, "slipdrive", &mut script);
    say(&script)?;
    Ok(ExitCode::SUCCESS)
}

fn jobs(metrics: &Metrics) -> Jobs {
    Jobs::new(Limits::default(), Arc::new(InProcessSolver), metrics)
}

/// Names and bodies of all examples.
struct Examples(Vec<(&'static str, Vec<u8>)>);

impl Visitor for Examples {
    fn visit<K: Kind>(&mut self, _kind: &Arc<K>) {
        self.0.extend(K::EXAMPLES.iter().map(|example| (example.name, indented(&(example.request)()).into_bytes())));
    }
}

struct Commands(Option<Command>);

impl Visitor for Commands {
    fn visit<K: Kind>(&mut self, _kind: &Arc<K>) {
        let examples: Vec<String> =
            K::EXAMPLES.iter().map(|example| format!(", or the example `{}`", example.name)).collect();
        let input = if K::SAVED_FILES > 0 {
            format!("What `--save` has written, or the JSON body of `POST /{}`; `-` is standard input", K::NAME)
        } else {
            format!("File with the JSON body of `POST /{}`; `-` is standard input{}", K::NAME, examples.concat())
        };
        let command = JobArguments::augment_args(Command::new(K::NAME)).about(sentence(K::SUMMARY));
        // Of kinds that take several files more are refused by the command, which says how many.
        let most = if K::SAVED_FILES > 1 { usize::MAX } else { 1 };
        let command = command.mut_arg("input", |argument| {
            let argument = argument.help(input).action(ArgAction::Set).num_args(1..=most);
            match K::EXAMPLES.first() {
                Some(example) => argument.required(false).default_value(example.name),
                None => argument,
            }
        });
        let of_figures = ["save", "report", "svg", "csv"].into_iter();
        let command =
            of_figures.fold(command, |command, flag| command.mut_arg(flag, |argument| argument.hide(!K::HAS_FIGURES)));
        let command = command.mut_arg("out", |argument| argument.hide(!K::HAS_FILES));
        let command = command.mut_arg("save", |argument| match K::SAVED_FILES {
            // What holds several plans is no answer that one of them belongs to.
            2.. => argument.help("Keeps the plans here, for `slipdrive present`; `-` is standard output"),
            _ => argument,
        });
        let flag = |flag: &Flag| {
            let argument = Arg::new(flag.field).long(flag.field.replace('_', "-")).value_name("VALUE").help(flag.help);
            argument.allow_negative_numbers(true)
        };
        let command = command.args(K::TEXT_FLAGS.iter().chain(K::FLAGS).map(flag));
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
    jobs: Jobs,
    outcome: Option<anyhow::Result<ExitCode>>,
}

impl Visitor for Run<'_> {
    fn visit<K: Kind>(&mut self, kind: &Arc<K>) {
        if K::NAME == self.name {
            let arguments = JobArguments::from_arg_matches(self.matches).map_err(anyhow::Error::from);
            let flags = flags::<K>(self.matches);
            self.outcome = Some(arguments.and_then(|arguments| run_job(kind, &self.jobs, &arguments, flags)));
        }
    }
}

/// The fields of the request that are given as flags: texts, and JSON, of which what cannot be read is refused as a text.
fn flags<K: Kind>(matches: &ArgMatches) -> Map<String, Value> {
    let given = |flag: &Flag| matches.get_one::<String>(flag.field).map(String::as_str);
    let json = |text: &str| serde_json::from_str(text).unwrap_or_else(|_| Value::from(text));
    let texts = K::TEXT_FLAGS.iter().filter_map(|flag| Some((flag.field.to_owned(), Value::from(given(flag)?))));
    let others = K::FLAGS.iter().filter_map(|flag| Some((flag.field.to_owned(), json(given(flag)?))));
    texts.chain(others).collect()
}

/// Runs one job; the exit code says whether there is what was asked for.
fn run_job<K: Kind>(
    kind: &Arc<K>,
    jobs: &Jobs,
    arguments: &JobArguments,
    flags: Map<String, Value>,
) -> anyhow::Result<ExitCode> {
    let faults = faulty_outputs::<K>(arguments);
    if !faults.is_empty() {
        return Ok(refused(&faults.join("\nerror: ")));
    }
    let (given, most) = (arguments.input.len(), K::SAVED_FILES.max(1));
    if given > most {
        return Ok(refused(&format!("there are {given} files, must be at most {most}")));
    }
    // The two seconds of light jobs are for servers.
    let limits = if K::CLASS == Class::Light { jobs.limits().without_clock() } else { *jobs.limits() };
    let body = match read_body::<K>(arguments, &limits)?.and_then(|body| with_flags(body, flags)) {
        Ok(body) => body,
        Err(problem) => return Ok(refuse(&problem)),
    };
    let input = match K::read(&body, &limits) {
        Ok(input) => input,
        Err(problem) => return Ok(refuse_request::<K>(&problem, &body)),
    };
    // Nobody else is in the queue: all workers help with the one job.
    let workers = thread_count(arguments.threads);
    let service = Service::start(ServiceSettings { workers, queue_length: 0, ..ServiceSettings::default() })?;
    let made = |input: &K::Input, done: &Done<K::Output>| Made::<K>::of(input, done);
    let running = service.reserve(K::CLASS)?.submit(Arc::clone(kind), input, None, made)?;
    let made = match progress::watched::<K, _>(running) {
        Ok(made) => made,
        Err(error) => match error.downcast() {
            Ok(contradicted @ ServiceError::Contradicted { .. }) => return Ok(refuse(&contradicted.into())),
            Ok(other) => return Err(other.into()),
            Err(error) => return Err(error),
        },
    };
    let is_success = made.is_success;
    let mut writer = Writer::default();
    write_answer(arguments, &made, &mut writer);
    if shows(arguments) {
        let request = K::presentation(&body, made.answer).context("the answer cannot be shown");
        let shown = request.and_then(|request| shown::write(&request, jobs, &service, arguments, &mut writer));
        writer.tell(shown);
    }
    Ok(match (writer.has_failed, is_success) {
        (true, _) => ExitCode::FAILURE,
        (false, true) => ExitCode::SUCCESS,
        (false, false) => ExitCode::from(EXIT_NO_SUCCESS),
    })
}

/// Whether anything but the answer is asked for of a plan.
fn shows(arguments: &JobArguments) -> bool {
    arguments.save.is_some() || shown::is_asked_for(arguments)
}

/// What cannot be written.
fn faulty_outputs<K: Kind>(arguments: &JobArguments) -> Vec<String> {
    let mut faults = outputs::collisions(arguments);
    if shows(arguments) && !K::HAS_FIGURES {
        faults.push(format!("there is nothing to show of `{}`", K::NAME));
    }
    if arguments.out.is_some() && !K::HAS_FILES {
        faults.push(format!("there are no files of `{}`", K::NAME));
    }
    faults
}

/// What a command writes.
struct Made<K: Kind> {
    answer: K::Answer,
    table: String,
    files: Vec<(&'static str, Vec<u8>)>,
    is_success: bool,
}

impl<K: Kind> Made<K> {
    fn of(input: &K::Input, done: &Done<K::Output>) -> Self {
        Self {
            answer: K::answer(input, done),
            table: K::table(input, done),
            files: K::files(&done.output).iter().map(|file| (file.name, file.content.clone())).collect(),
            is_success: K::is_success(&done.output),
        }
    }
}

/// The request: an example, a file, or several files as one.
fn read_body<K: Kind>(arguments: &JobArguments, limits: &Limits) -> anyhow::Result<Result<Vec<u8>, Problem>> {
    let example = |input: &Path| K::EXAMPLES.iter().find(|example| input == Path::new(example.name));
    if let Some(example) = arguments.input.first().and_then(|input| example(input)) {
        return Ok(Ok(json::write(&(example.request)())));
    }
    let most = if K::SAVED_FILES > 0 { LARGEST_FILE } else { K::body_limit(limits).bytes };
    let examples: Vec<_> = K::EXAMPLES.iter().map(|example| example.name).collect();
    // Whoever mistypes the name of an example asks for a file.
    let is_no_example =
        if examples.is_empty() { String::new() } else { format!("is no example ({}), and ", examples.join(", ")) };
    let files: anyhow::Result<Vec<_>> = arguments
        .input
        .iter()
        .map(|input| {
            read_file(input, most).with_context(|| format!("{} {is_no_example}cannot be read", input.display()))
        })
        .collect();
    Ok(K::joined(files?))
}

/// The body with further fields in place of its own.
fn with_flags(body: Vec<u8>, flags: Map<String, Value>) -> Result<Vec<u8>, Problem> {
    if flags.is_empty() {
        return Ok(body);
    }
    let mut object = json::read_any_object(&body)?;
    object.extend(flags);
    Ok(json::write(&object))
}

/// As [`refuse`], with what the file is for where it is of another kind.
fn refuse_request<K: Kind>(problem: &Problem, body: &[u8]) -> ExitCode {
    let code = refuse(problem);
    if K::SAVED_FILES == 0 && is_saved(body) {
        tell(&"  `--save` has written this, for `present`, `export` and `assess`; the request is in its `request`");
    } else if K::SAVED_FILES > 0 && is_request(body) {
        tell(&"  this is a request: `--save` of `solve` and `simulate` keeps the plan of one for this command");
    } else if K::SAVED_FILES == 1 && json::read_any_object(body).is_ok_and(|fields| fields.contains_key("plans")) {
        tell(&"  `--save` of `present` has written this: several plans, for `present` alone");
    }
    code
}

/// Whether this, or the first of several files, asks for a plan or a motion.
fn is_request(body: &[u8]) -> bool {
    let fields = json::read_any_object(body).unwrap_or_default();
    let first = fields.get("plans").and_then(|plans| plans.get(0)).and_then(Value::as_object).unwrap_or(&fields);
    ["maneuver", "torque_schedule"].iter().any(|field| first.contains_key(*field))
}

/// Whether this is a plan as [`shown::write`] saves it.
fn is_saved(body: &[u8]) -> bool {
    json::read_object(body).is_ok_and(|PresentedPlan { solve, simulate }| solve.is_some() || simulate.is_some())
}

/// A file of which at most one byte above the limit is read: enough for the reader to refuse it.
fn read_file(input: &Path, limit: usize) -> io::Result<Vec<u8>> {
    let mut body = Vec::new();
    let most = limit as u64 + 1;
    if is_standard_stream(input) {
        io::stdin().take(most).read_to_end(&mut body)?;
    } else {
        File::open(input)?.take(most).read_to_end(&mut body)?;
    }
    Ok(body)
}

/// Says what cannot be used.
pub(crate) fn refused(fault: &str) -> ExitCode {
    tell(&format_args!("error: {fault}"));
    ExitCode::from(EXIT_BAD_INPUT)
}

fn refuse(problem: &Problem) -> ExitCode {
    tell(&format_args!("error: {problem}"));
    tell_faults(problem);
    ExitCode::from(EXIT_BAD_INPUT)
}

/// Says what is wrong, fault by fault; a single one is the problem's own detail.
fn tell_faults(problem: &Problem) {
    for error in problem.errors().iter().filter(|_| problem.errors().len() > 1) {
        tell(&format_args!("  {}: {}", error.pointer, error.message));
    }
}

/// Writes the JSON answer and the files, where they are asked for, and prints the table, where standard output is for nothing else.
fn write_answer<K: Kind>(arguments: &JobArguments, made: &Made<K>, writer: &mut Writer) {
    if let Some(path) = &arguments.json {
        let end: &[u8] = if is_standard_stream(path) { b"\n" } else { b"" };
        writer.file(path, &[&json::write(&made.answer), end].concat());
    }
    if outputs::leave_standard_output(arguments) {
        writer.tell(say(made.table.as_bytes()));
    }
    if let Some(folder) = &arguments.out {
        writer.folder(folder, made.files.iter().map(|(name, content)| ((*name).to_owned(), content.as_slice())));
    } else if K::HAS_FILES && arguments.json.is_none() {
        // The table lists them. The JSON answer has their content.
        tell(&"nothing was written: `--out DIR` writes these files");
    }
}
