//! Rule violations of caller input, collected all at once.
//!
//! Every validated domain type reports through [`Violations`], so that REST and gRPC name the same field, value
//! and rule. Field paths are those of the public contract (`robot.wheel_radius_m`).

use std::fmt;

/// The kind of a violated rule; stable codes of the public contract.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ViolationCode {
    /// The value breaks a rule of sign, range or consistency.
    InvalidValue,
    /// The value is sound, but above what this server accepts.
    ProblemTooLarge,
}

impl ViolationCode {
    /// The `snake_case` code that callers see.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::InvalidValue => "invalid_value",
            Self::ProblemTooLarge => "problem_too_large",
        }
    }
}

/// One violated rule.
#[derive(Debug, Clone, PartialEq)]
pub struct Violation {
    /// Dotted path of the field in the public contract, such as `robot.wheel_radius_m`.
    pub field: String,
    /// What kind of rule was violated.
    pub code: ViolationCode,
    /// Field, value, rule and unit in one sentence.
    pub message: String,
    /// The bound that was passed, where the rule is a bound.
    pub limit: Option<f64>,
}

/// A non-empty list of violations, as an error.
#[derive(Debug, Clone, PartialEq)]
pub struct Violations(Vec<Violation>);

impl Violations {
    /// The violations, in the order of the checks.
    pub fn list(&self) -> &[Violation] {
        &self.0
    }
}

impl fmt::Display for Violations {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, violation) in self.0.iter().enumerate() {
            let separator = if index == 0 { "" } else { "; " };
            write!(formatter, "{separator}{}", violation.message)?;
        }
        Ok(())
    }
}

impl std::error::Error for Violations {}

/// Collects violations below a field path.
#[derive(Debug, Default)]
pub struct Checks {
    path: Vec<String>,
    found: Vec<Violation>,
}

impl Checks {
    /// A collector at the root of the input.
    pub fn new() -> Self {
        Self::default()
    }

    /// Runs `check` with all its field names below `name`.
    pub fn within<T>(&mut self, name: &str, check: impl FnOnce(&mut Self) -> T) -> T {
        self.path.push(name.to_owned());
        let result = check(self);
        self.path.pop();
        result
    }

    /// Requires a finite value above zero.
    pub fn positive(&mut self, field: &str, value: f64, unit: &str) {
        self.require(field, value, value.is_finite() && value > 0.0, &format!("> 0{}", spaced(unit)), Some(0.0));
    }

    /// Requires a finite value of at least zero.
    pub fn non_negative(&mut self, field: &str, value: f64, unit: &str) {
        self.require(field, value, value.is_finite() && value >= 0.0, &format!(">= 0{}", spaced(unit)), Some(0.0));
    }

    /// Requires a finite value of magnitude at most `limit`.
    pub fn within_magnitude(&mut self, field: &str, value: f64, limit: f64, unit: &str) {
        let rule = format!("between -{limit} and {limit}{}", spaced(unit));
        self.require(field, value, value.is_finite() && value.abs() <= limit, &rule, Some(limit));
    }

    /// Requires a finite value from `lower` to `upper`, both included.
    pub fn between(&mut self, field: &str, value: f64, (lower, upper): (f64, f64), unit: &str) {
        let limit = if value < lower { lower } else { upper };
        let rule = format!("between {lower} and {upper}{}", spaced(unit));
        self.require(field, value, (lower..=upper).contains(&value), &rule, Some(limit));
    }

    /// Requires `holds`; otherwise notes that `field` is `value` and must be `rule`.
    pub fn require(&mut self, field: &str, value: impl fmt::Display, holds: bool, rule: &str, limit: Option<f64>) {
        if !holds {
            let path = self.path_of(field);
            let message = format!("`{path}` is {value}, must be {rule}");
            self.push(path, ViolationCode::InvalidValue, message, limit);
        }
    }

    /// Requires a count to be at most what the server accepts.
    pub fn at_most(&mut self, field: &str, value: f64, limit: f64) {
        if value > limit {
            let path = self.path_of(field);
            let message = format!("`{path}` is {value}, must be at most {limit} on this server");
            self.push(path, ViolationCode::ProblemTooLarge, message, Some(limit));
        }
    }

    /// How many violations were found so far.
    pub fn count(&self) -> usize {
        self.found.len()
    }

    /// `value` when no rule was violated.
    ///
    /// # Errors
    /// All violations found.
    pub fn into_result<T>(self, value: T) -> Result<T, Violations> {
        if self.found.is_empty() { Ok(value) } else { Err(Violations(self.found)) }
    }

    fn push(&mut self, field: String, code: ViolationCode, message: String, limit: Option<f64>) {
        self.found.push(Violation { field, code, message, limit });
    }

    fn path_of(&self, field: &str) -> String {
        let mut path = self.path.join(".");
        if !path.is_empty() && !field.starts_with('[') {
            path.push('.');
        }
        path + field
    }
}

fn spaced(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" {unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_names_path_value_and_rule() {
        let mut checks = Checks::new();
        checks.within("maneuver", |checks| checks.positive("torque_limit_left_n_m", -1.0, "N m"));
        let error = checks.into_result(()).unwrap_err();
        assert_eq!(error.to_string(), "`maneuver.torque_limit_left_n_m` is -1, must be > 0 N m");
    }

    #[test]
    fn all_violations_are_kept() {
        let mut checks = Checks::new();
        checks.positive("a", f64::NAN, "");
        checks.non_negative("b", 0.0, "");
        checks.at_most("c", 3.0, 2.0);
        assert_eq!(checks.count(), 2);
    }
}
