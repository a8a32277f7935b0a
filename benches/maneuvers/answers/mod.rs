//! Reference answers: digests of what both transports of a server answer to 200 requests, one line per request on file.
//!
//! They tell whether a change of the code changes any answer. Names are not hashed, so that a rename in the contract does not
//! disturb them: of JSON the values are, of protobuf messages the encoding, which holds tags. Tags must not change.

mod grpc;
mod requests;
mod rest;
mod server;

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use requests::Request;
use tokio::runtime::Runtime;

use self::server::Server;
use crate::arguments::AnswersArguments;
use crate::suite::path_of;

/// The file, and what its first line says.
const FILE: (&str, &str) = ("answers.txt", "# written by: cargo bench --bench maneuvers -- answers --write");
/// What a line holds after the name of its request.
const COLUMNS: [&str; 5] = ["input_hash", "REST solve", "gRPC solve", "REST simulate", "gRPC simulate"];
/// Hexadecimal digits that a line keeps of a digest.
const DIGITS: usize = 16;

/// One request and what came of it.
struct Line {
    name: String,
    columns: [String; COLUMNS.len()],
}

/// Asks everything, and compares the answers with the file or writes it.
///
/// # Errors
/// Refused requests, answers that depend on wall time, a file that cannot be read or written.
pub(crate) fn run(arguments: &AnswersArguments) -> Result<ExitCode> {
    let lines = Runtime::new()?.block_on(ask_all())?;
    if arguments.write { write(&lines) } else { compare(&lines) }
}

async fn ask_all() -> Result<Vec<Line>> {
    let server = Server::start().await?;
    let mut lines = Vec::new();
    for request in requests::all()? {
        let line = ask(&server, &request).await;
        lines.push(line.with_context(|| format!("the request `{}` has no reference answer", request.name))?);
    }
    Ok(lines)
}

/// Asks both transports at once: each keeps one worker busy.
async fn ask(server: &Server, request: &Request) -> Result<Line> {
    let (rest, grpc) = tokio::try_join!(server.rest.ask(request), server.grpc.ask(request))?;
    let ([rest_solve, rest_simulate], [grpc_solve, grpc_simulate]) = (rest.digests, grpc);
    let digests = [rest_solve, grpc_solve, rest_simulate, grpc_simulate];
    let [solve, solve_too, simulate, simulate_too] = digests.map(|digest| digest[..DIGITS].to_owned());
    let columns = [rest.input_hash, solve, solve_too, simulate, simulate_too];
    Ok(Line { name: request.name.clone(), columns })
}

fn write(lines: &[Line]) -> Result<ExitCode> {
    let (file, head) = FILE;
    let text = lines.iter().fold(format!("{head}\n"), |text, line| format!("{text}{line}\n"));
    fs::write(path_of(file), text).with_context(|| format!("{file} cannot be written"))?;
    println!("{} requests: {file} is written", lines.len());
    Ok(ExitCode::SUCCESS)
}

fn compare(lines: &[Line]) -> Result<ExitCode> {
    let (file, head) = FILE;
    let text = fs::read_to_string(path_of(file)).with_context(|| format!("{file} cannot be read"))?;
    let known = text.lines().filter(|line| *line != head).filter_map(|line| line.split_once(' '));
    let mut known: BTreeMap<&str, &str> = known.collect();
    let mut faults: Vec<String> =
        lines.iter().filter_map(|line| line.fault(known.remove(line.name.as_str()))).collect();
    faults.extend(known.keys().map(|name| format!("{name}: no longer asked")));
    for fault in &faults {
        println!("{fault}");
    }
    println!("{} requests: {} differ from {file}", lines.len(), faults.len());
    Ok(if faults.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

impl Line {
    /// What differs from the columns on file.
    fn fault(&self, known: Option<&str>) -> Option<String> {
        let Some(known) = known else { return Some(format!("{}: not on file", self.name)) };
        let mut known = known.split(' ');
        let differs = |(_, column): &(&str, &String)| known.next() != Some(column.as_str());
        let different: Vec<&str> =
            COLUMNS.into_iter().zip(&self.columns).filter(differs).map(|(name, _)| name).collect();
        (!different.is_empty()).then(|| format!("{}: {}", self.name, different.join(", ")))
    }
}

impl fmt::Display for Line {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} {}", self.name, self.columns.join(" "))
    }
}
