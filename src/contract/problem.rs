//! Errors on their way to a caller, whichever transport carries them.

use std::fmt;
use std::time::Duration;

use serde::Serialize;
use utoipa::ToSchema;

use super::error_table::ErrorCode;
use crate::rules::{Violation, ViolationCode, Violations};

/// Most violations that one answer lists: a body of nothing but faults must not be answered by megabytes.
const MAX_LISTED_ERRORS: usize = 100;
/// Longest text that may echo a caller's own words, characters.
const MAX_ECHO: usize = 400;
/// Longest text about one field, characters: names all fields that any object has, of which the longest list has 500.
const MAX_OF_FIELD: usize = 2_000;

/// A refusal or failure on its way to the caller.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    code: ErrorCode,
    detail: String,
    retry_after: Option<Duration>,
    /// The first faults of single fields.
    errors: Vec<FieldError>,
    /// How many there are, those that are not listed among them.
    fault_count: usize,
}

/// How long a body may be; shorter ones come first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct BodyLimit {
    /// Largest body, bytes.
    pub bytes: usize,
    /// What the refusal of a larger one advises; empty where there is nothing to leave out.
    pub advice: &'static str,
}

impl BodyLimit {
    /// So many bytes, all of which are needed.
    pub const fn of(bytes: usize) -> Self {
        Self { bytes, advice: "" }
    }
}

/// One fault of one field.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct FieldError {
    /// JSON pointer as a URI fragment, such as `#/robot/wheel_radius_m`.
    pub pointer: String,
    /// The code of the broken rule.
    pub code: &'static str,
    /// Field, value and rule.
    pub message: String,
    /// The bound that was passed, where the rule is a bound.
    #[schema(required = true)]
    pub limit: Option<f64>,
}

impl Problem {
    /// A problem without field errors.
    pub fn new(code: ErrorCode, detail: impl Into<String>) -> Self {
        Self { code, detail: shortened(detail.into(), MAX_ECHO), retry_after: None, errors: Vec::new(), fault_count: 0 }
    }

    /// The refusal of a body above the limit.
    pub(crate) fn body_too_large(BodyLimit { bytes, advice }: BodyLimit) -> Self {
        let separator = if advice.is_empty() { "" } else { "; " };
        Self::new(ErrorCode::BodyTooLarge, format!("the body is larger than {bytes} bytes{separator}{advice}"))
    }

    /// Both problems at once, faults of single fields.
    #[must_use]
    pub(crate) fn and(mut self, further: Self) -> Self {
        // What is no request at all speaks first, what another server would take last.
        let order = [ErrorCode::InvalidField, ErrorCode::InvalidValue, ErrorCode::ProblemTooLarge];
        let codes = [self.code, further.code];
        self.code = order.into_iter().find(|code| codes.contains(code)).unwrap_or(self.code);
        self.errors.extend(further.errors);
        self.errors.truncate(MAX_LISTED_ERRORS);
        self.fault_count += further.fault_count;
        self.detail = number_of_faults(self.fault_count, self.errors.len());
        self
    }

    /// Both results, or all that is wrong with either.
    ///
    /// # Errors
    /// One problem, or both as one: faults of single fields.
    pub(crate) fn both<A, B>(one: Result<A, Self>, other: Result<B, Self>) -> Result<(A, B), Self> {
        match (one, other) {
            (Ok(one), Ok(other)) => Ok((one, other)),
            (Err(problem), Ok(_)) | (Ok(_), Err(problem)) => Err(problem),
            (Err(problem), Err(further)) => Err(problem.and(further)),
        }
    }

    /// The same problem, worth another try after this time.
    #[must_use]
    pub fn worth_retrying_after(self, wait: Option<Duration>) -> Self {
        Self { retry_after: wait, ..self }
    }

    /// A problem of the one field at `pointer`.
    pub(crate) fn at_field(code: ErrorCode, pointer: String, message: String) -> Self {
        let message = shortened(message, MAX_OF_FIELD);
        let error = FieldError { pointer, code: code.entry().code, message: message.clone(), limit: None };
        Self { code, detail: message, retry_after: None, errors: vec![error], fault_count: 1 }
    }

    /// The same problem of an object that is at this path of the input, such as `plans[0]`.
    #[must_use]
    pub(crate) fn below(mut self, path: &str) -> Self {
        let below = pointer_of_path(path);
        for error in &mut self.errors {
            let inner = quoted_path(&error.pointer);
            error.pointer.replace_range(..1, &below);
            // Messages begin with the path of their field, and the detail of one fault is its message.
            let Some(rest) = error.message.strip_prefix(&inner) else { continue };
            let message = quoted_path(&error.pointer) + rest;
            if self.detail == error.message {
                self.detail.clone_from(&message);
            }
            error.message = message;
        }
        self
    }

    /// The code from the error table.
    pub fn code(&self) -> ErrorCode {
        self.code
    }

    /// The faults of single fields; the first hundred where there are more.
    pub fn errors(&self) -> &[FieldError] {
        &self.errors
    }

    /// The sentence that says it where only the first so many faults are listed.
    pub(crate) fn detail_listing(&self, listed: usize) -> String {
        let [all, some] = [self.errors.len(), listed].map(|listed| number_of_faults(self.fault_count, listed));
        self.detail.replace(&all, &some)
    }

    /// How many faults of single fields there are, listed or not.
    pub(crate) fn fault_count(&self) -> usize {
        self.fault_count
    }

    /// What this occurrence is about.
    pub(crate) fn detail(&self) -> &str {
        &self.detail
    }

    /// When it is worth trying again, where that is known.
    pub(crate) fn retry_after(&self) -> Option<Duration> {
        self.retry_after
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let entry = self.code.entry();
        write!(formatter, "{} ({}): {}", entry.title, entry.code, self.detail)
    }
}

impl std::error::Error for Problem {}

impl From<Violations> for Problem {
    fn from(violations: Violations) -> Self {
        let list = violations.list();
        // A request with a wrong value stays wrong on a larger server: that code speaks first.
        let only_too_large = list.iter().all(|violation| violation.code == ViolationCode::ProblemTooLarge);
        let code = if only_too_large { ErrorCode::ProblemTooLarge } else { ErrorCode::InvalidValue };
        let errors: Vec<_> = list.iter().take(MAX_LISTED_ERRORS).map(FieldError::from).collect();
        let detail = match list {
            [_] => errors[0].message.clone(),
            _ => number_of_faults(list.len(), errors.len()),
        };
        Self { code, detail, retry_after: None, errors, fault_count: list.len() }
    }
}

fn number_of_faults(count: usize, listed: usize) -> String {
    let listed = if count > listed { format!("; the first {listed} are listed") } else { String::new() };
    format!("{count} values break their rules{listed}")
}

impl From<&Violation> for FieldError {
    fn from(violation: &Violation) -> Self {
        let Violation { field, code, message, limit } = violation;
        Self { pointer: pointer_of_path(field), code: code.as_str(), message: with_short_value(message), limit: *limit }
    }
}

/// A message of the rule that a value breaks, which is not cut where the value is.
fn with_short_value(message: &str) -> String {
    const RULE: &str = ", must be ";
    match message.rsplit_once(RULE) {
        Some((value, rule)) => shortened(value.to_owned(), MAX_ECHO) + RULE + rule,
        None => shortened(message.to_owned(), MAX_ECHO),
    }
}

/// `robot.wheel_radius_m` as `#/robot/wheel_radius_m`, `a.b[3]` as `#/a/b/3`.
pub(crate) fn pointer_of_path(path: &str) -> String {
    format!("#/{}", path.replace(['.', '['], "/").replace(']', ""))
}

/// `#/robot/wheel_radius_m` as `robot.wheel_radius_m`, `#/a/b/3` as `a.b[3]`; empty for `#`.
pub(crate) fn path_of_pointer(pointer: &str) -> String {
    let mut path = String::new();
    for segment in pointer.split('/').skip(1) {
        if segment.parse::<usize>().is_ok() {
            path.extend(["[", segment, "]"]);
        } else {
            path.extend([if path.is_empty() { "" } else { "." }, &segment.replace("~1", "/").replace("~0", "~")]);
        }
    }
    path
}

/// The same in the quotes that messages have; `#` as `body`.
pub(super) fn quoted_path(pointer: &str) -> String {
    let path = path_of_pointer(pointer);
    if path.is_empty() { "`body`".to_owned() } else { format!("`{path}`") }
}

/// Cuts a text that may hold the caller's own words.
pub(super) fn shortened(mut text: String, most: usize) -> String {
    if let Some((cut, _)) = text.char_indices().nth(most) {
        text.truncate(cut);
        text.push_str("...");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::{Checks, Rule};

    #[test]
    fn pointer_follows_fields_and_indices() {
        assert_eq!(pointer_of_path("initial_guess.torque_left_n_m[3]"), "#/initial_guess/torque_left_n_m/3");
    }

    #[test]
    fn problem_of_an_inner_object_names_the_whole_path() {
        let problem = Problem::at_field(ErrorCode::InvalidField, "#/steps".to_owned(), "`steps`: missing".to_owned());
        let problem = problem.below("report").below("plans[2]");
        assert_eq!(problem.errors()[0].pointer, "#/plans/2/report/steps");
        assert_eq!(problem.errors()[0].message, "`plans[2].report.steps`: missing");
        assert_eq!(problem.detail(), problem.errors()[0].message);
        let problem = Problem::at_field(ErrorCode::InvalidField, "#".to_owned(), "`body`: empty".to_owned());
        assert_eq!(problem.below("plans[0]").detail(), "`plans[0]`: empty");
    }

    #[test]
    fn each_of_several_faults_names_the_whole_path() {
        let mut checks = Checks::new();
        checks.bounds("robot.wheel_radius_m", 0.0, &Rule::positive("m"));
        checks.length("keep_in", 0, &Rule::between(3.0, 4.0, Rule::ITEMS));
        let problem = Problem::from(checks.finish().unwrap_err()).below("solve.request");
        let messages: Vec<_> = problem.errors().iter().map(|error| error.message.as_str()).collect();
        let [radius, aisle] = [
            "`solve.request.robot.wheel_radius_m` is 0, must be > 0 m",
            "`solve.request.keep_in` is 0 items long, must be between 3 and 4 items",
        ];
        assert_eq!((messages, problem.detail()), (vec![radius, aisle], "2 values break their rules"));
    }

    #[test]
    fn value_faults_outrank_size_faults() {
        let mut checks = Checks::new();
        checks.server_limit("grid.steps", 2.0, 1.0);
        checks.bounds("robot.wheel_radius_m", 0.0, &Rule::positive("m"));
        let problem = Problem::from(checks.finish().unwrap_err());
        assert_eq!((problem.code(), problem.errors().len()), (ErrorCode::InvalidValue, 2));
    }

    #[test]
    fn long_list_of_faults_is_cut_and_counted() {
        let faults = |count: usize| {
            let mut checks = Checks::new();
            for index in 0..count {
                checks.bounds(&format!("field[{index}]"), 0.0, &Rule::positive(""));
            }
            Problem::from(checks.finish().unwrap_err())
        };
        for problem in [faults(1000), faults(1).and(faults(999)), faults(600).and(faults(400))] {
            assert_eq!((problem.errors().len(), problem.fault_count()), (MAX_LISTED_ERRORS, 1000));
            assert_eq!(problem.detail(), "1000 values break their rules; the first 100 are listed");
        }
    }

    #[test]
    fn long_value_leaves_its_rule_whole() {
        let mut checks = Checks::new();
        checks.require("frame_id", "x".repeat(600), false, "1 to 128 bytes", None);
        let problem = Problem::from(checks.finish().unwrap_err());
        assert!(problem.detail().ends_with("xxx..., must be 1 to 128 bytes"), "{problem}");
        assert!(problem.detail() == problem.errors()[0].message && problem.detail().len() < 450);
    }
}
