//! What a kind of job is to callers.

use serde::Serialize;
use serde::de::DeserializeOwned;
use utoipa::ToSchema;

use super::Limits;
use crate::contract::message::PresentRequest;
use crate::contract::{BodyLimit, ErrorCode, Numbers, Problem, json, pointer_of_path};
use crate::metrics::catalogue::Family;
use crate::rules::RuleSet;
use crate::service::{Done, Job, ServiceError};

/// A request to begin with.
pub struct Example<T> {
    /// Its name in paths and on the command line.
    pub name: &'static str,
    /// What it is, for people.
    pub title: &'static str,
    /// The request, complete.
    pub request: fn() -> T,
}

/// A field of a request that is a flag of the command too.
#[derive(Debug, Clone, Copy)]
pub struct Flag {
    /// The name of the field.
    pub field: &'static str,
    /// What the help says.
    pub help: &'static str,
}

/// A file to be written.
#[derive(Debug)]
pub struct File {
    /// Its name.
    pub name: &'static str,
    /// Its media type.
    pub media_type: &'static str,
    /// Its bytes.
    pub content: Vec<u8>,
}

/// How far a job is, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgressLine {
    /// Parts that have begun.
    pub begun: usize,
    /// All parts.
    pub of: usize,
    /// What it does and what it has found.
    pub words: String,
}

/// A job that callers ask for by a message.
///
/// Its [`Job::NAME`] is its route (`POST /solve`), its command (`slipdrive solve`), its operation in OpenAPI and its label
/// in metrics.
pub trait Kind: Job {
    /// What it does, in a few words.
    const SUMMARY: &'static str;
    /// Its methods of gRPC with one message in: the first answers once, a second one as a stream of events.
    const METHODS: &'static [&'static str];
    /// Whether it reports progress, so that callers may ask for events.
    const REPORTS_PROGRESS: bool = false;
    /// Requests to begin with: `GET /examples/NAME`, and in place of a file on the command line.
    const EXAMPLES: &'static [Example<Self::Request>] = &[];
    /// How many files that `--save` wrote its command takes at most; 0: it takes one body, which has nothing beside.
    const SAVED_FILES: usize = 0;
    /// Fields of the request that its command takes as flags too, in JSON.
    const FLAGS: &'static [Flag] = &[];
    /// The same of fields that are texts or names, as they are.
    const TEXT_FLAGS: &'static [Flag] = &[];
    /// Whether its answer has files ([`Kind::files`]).
    const HAS_FILES: bool = false;
    /// Whether a request with its answer can be presented ([`Kind::presentation`]).
    const HAS_FIGURES: bool = false;
    /// Its own families of metrics.
    const FAMILIES: &'static [Family] = &[];
    /// What is asked.
    type Request: DeserializeOwned + Serialize + Numbers + ToSchema + Send + 'static;
    /// What is answered.
    type Answer: Serialize + ToSchema + prost::Message + 'static;
    /// What is reported of its progress; `()` if nothing.
    type Report: From<Self::Progress> + Serialize + ToSchema + Send;

    /// The rules of a request, by the paths of its fields.
    fn rules(limits: &Limits) -> RuleSet;

    /// Validates and completes a request whose zeros have no sign.
    ///
    /// # Errors
    /// `invalid_field`, or all violated rules and limits at once.
    fn validate(request: Self::Request, limits: &Limits) -> Result<Self::Input, Problem>;

    /// Judges a request before it is read: what would then hold far more than its own length is refused.
    ///
    /// # Errors
    /// The rule that it breaks, or why so little of it cannot be read.
    fn survey(_request: AsWritten<'_>) -> Result<(), Problem> {
        Ok(())
    }

    /// Takes a request as any transport has read it.
    ///
    /// # Errors
    /// Those of [`Kind::validate`].
    fn accept(mut request: Self::Request, limits: &Limits) -> Result<Self::Input, Problem> {
        request.unify_zeros();
        Self::validate(request, limits)
    }

    /// Its largest request.
    fn body_limit(limits: &Limits) -> BodyLimit {
        limits.body()
    }

    /// How long the answer will probably be, bytes, where that grows with the input and a number takes so many: memory is reserved
    /// for it before the job is queued.
    fn answer_bytes(_input: &Self::Input, _number_bytes: usize) -> usize {
        0
    }

    /// The answer; made on the worker.
    fn answer(input: &Self::Input, done: &Done<Self::Output>) -> Self::Answer;

    /// The answer as a short table for people.
    fn table(input: &Self::Input, done: &Done<Self::Output>) -> String;

    /// What presents a request, as it was read, with its answer; none where there is nothing to show.
    fn presentation(_body: &[u8], _answer: Self::Answer) -> Option<PresentRequest> {
        None
    }

    /// The files that its answer has, which its command writes into a folder.
    fn files(_output: &Self::Output) -> &[File] {
        &[]
    }

    /// One request of several files.
    ///
    /// # Errors
    /// `malformed_body` or `invalid_field` where one of them is no JSON object.
    fn joined(mut files: Vec<Vec<u8>>) -> Result<Vec<u8>, Problem> {
        Ok(files.pop().unwrap_or_default())
    }

    /// Its progress for people; none where there is none to show.
    fn progress_line(_progress: &Self::Progress) -> Option<ProgressLine> {
        None
    }

    /// Whether there is what was asked for: the exit code of the command.
    fn is_success(_output: &Self::Output) -> bool {
        true
    }

    /// Reads and accepts a request in JSON.
    ///
    /// # Errors
    /// `body_too_large`, `malformed_body` and those of [`Kind::accept`].
    fn read(body: &[u8], limits: &Limits) -> Result<Self::Input, Problem> {
        // Transports refuse large bodies while they read them; files come whole.
        let largest = Self::body_limit(limits);
        if body.len() > largest.bytes {
            return Err(Problem::body_too_large(largest));
        }
        Self::survey(AsWritten::Json(body))?;
        Self::accept(json::read_object(body)?, limits)
    }
}

/// A request as it came.
#[derive(Debug, Clone, Copy)]
pub enum AsWritten<'a> {
    /// A body of REST, a line of a batch, a file.
    Json(&'a [u8]),
    /// A message of gRPC.
    Protobuf(&'a [u8]),
}

impl From<ServiceError> for Problem {
    fn from(error: ServiceError) -> Self {
        let code = match error {
            ServiceError::QueueFull { .. } | ServiceError::ShareUsedUp { .. } => ErrorCode::QueueFull,
            ServiceError::DeadlineUnreachable { .. } => ErrorCode::DeadlineUnreachable,
            ServiceError::DeadlineExceeded => ErrorCode::DeadlineExceeded,
            ServiceError::TimeLimitExceeded => ErrorCode::TimeLimitExceeded,
            ServiceError::Unavailable { .. } => ErrorCode::Unavailable,
            ServiceError::Cancelled => ErrorCode::Cancelled,
            ServiceError::SolverPanic => ErrorCode::SolverPanic,
            ServiceError::Contradicted { field, .. } => {
                return Self::at_field(ErrorCode::InvalidValue, pointer_of_path(field), error.to_string());
            }
        };
        Self::new(code, error.to_string()).worth_retrying_after(error.retry_after())
    }
}
