//! Rules that the input of callers must keep, as values, and the collector of all that break them.
//!
//! A [`Rule`] is data beside the field that it bounds. What a refusal says, what `GET /limits` lists and what OpenAPI
//! gives as minimum and maximum are made from it. Field paths are those of the public contract
//! (`robot.wheel_radius_m`).

use std::fmt;

/// The kind of a violated rule; stable codes of the public contract.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ViolationCode {
    /// The value breaks a rule of sign, range or consistency.
    InvalidValue,
    /// The value is valid, but above what this server accepts.
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

/// The bounds of a number, or of the length of an array.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    /// The smallest value, itself accepted unless `exclusive_minimum` is set.
    pub minimum: f64,
    /// Whether a value must be greater than the minimum.
    pub exclusive_minimum: bool,
    /// The largest value, itself accepted unless `exclusive_maximum` is set; infinite where there is none.
    pub maximum: f64,
    /// Whether a value must be less than the maximum.
    pub exclusive_maximum: bool,
    /// The unit; empty for pure numbers, [`Rule::ITEMS`] for lengths.
    pub unit: &'static str,
}

impl Rule {
    /// The unit of the length of an array.
    pub const ITEMS: &'static str = "items";

    /// Greater than zero.
    pub const fn positive(unit: &'static str) -> Self {
        Self { exclusive_minimum: true, ..Self::at_least(0.0, unit) }
    }

    /// At least this.
    pub const fn at_least(minimum: f64, unit: &'static str) -> Self {
        Self::between(minimum, f64::INFINITY, unit)
    }

    /// From one to the other, both included.
    pub const fn between(minimum: f64, maximum: f64, unit: &'static str) -> Self {
        Self { minimum, exclusive_minimum: false, maximum, exclusive_maximum: false, unit }
    }

    /// From one, included, to the other, not included.
    pub const fn from_to_below(minimum: f64, maximum: f64, unit: &'static str) -> Self {
        Self { exclusive_maximum: true, ..Self::between(minimum, maximum, unit) }
    }

    /// Of at most this magnitude.
    pub const fn within_magnitude(limit: f64, unit: &'static str) -> Self {
        Self::between(-limit, limit, unit)
    }

    /// The same rule where a server accepts no more than this.
    #[must_use]
    pub fn at_most(self, maximum: f64) -> Self {
        let exclusive_maximum = self.exclusive_maximum && self.maximum <= maximum;
        Self { maximum: self.maximum.min(maximum), exclusive_maximum, ..self }
    }

    /// Whether the value keeps the rule; infinities and NaN never do.
    pub fn admits(&self, value: f64) -> bool {
        let is_above = if self.exclusive_minimum { value > self.minimum } else { value >= self.minimum };
        let is_below = if self.exclusive_maximum { value < self.maximum } else { value <= self.maximum };
        value.is_finite() && is_above && is_below
    }

    /// The bound that a refused value passed; none where it is no number, or there is no bound on its side.
    pub(crate) fn passed_by(&self, value: f64) -> Option<f64> {
        let bound = if value > self.minimum { self.maximum } else { self.minimum };
        (bound.is_finite() && !value.is_nan()).then_some(bound)
    }
}

impl fmt::Display for Rule {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { minimum, exclusive_minimum, maximum, exclusive_maximum, unit } = *self;
        let above = if exclusive_minimum { ">" } else { ">=" };
        let below = if exclusive_maximum { "<" } else { "<=" };
        let (minimum, maximum) = (Number(minimum), maximum.is_finite().then_some(Number(maximum)));
        match maximum {
            Some(maximum) if exclusive_minimum || exclusive_maximum => {
                write!(formatter, "{above} {minimum} and {below} {maximum}")?;
            }
            Some(maximum) => write!(formatter, "between {minimum} and {maximum}")?,
            None => write!(formatter, "{above} {minimum}")?,
        }
        if unit.is_empty() { Ok(()) } else { write!(formatter, " {unit}") }
    }
}

/// A number as people read it in a refusal: with a power of ten where it would have many zeros.
pub(crate) struct Number(pub(crate) f64);

impl fmt::Display for Number {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = format!("{:?}", self.0);
        formatter.write_str(digits.strip_suffix(".0").unwrap_or(&digits))
    }
}

/// A field of `T` by its name in the contract, its value, and its bounds.
pub(crate) type BoundedField<T> = (&'static str, fn(&T) -> f64, Rule);

/// A field of `T` that may be absent, by its name in the contract, its value, and its bounds.
pub(crate) type OptionalField<T> = (&'static str, fn(&T) -> Option<f64>, Rule);

/// A rule that several fields keep together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CrossFieldRule {
    /// Paths of the fields.
    pub fields: Vec<String>,
    /// What must hold, as a sentence without its end.
    pub rule: &'static str,
}

/// All rules of an object: of its fields one by one, and of several together.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RuleSet {
    /// Path and bounds of each field.
    pub fields: Vec<(String, Rule)>,
    /// What bounds cannot say.
    pub cross_field: Vec<CrossFieldRule>,
}

impl RuleSet {
    /// Rules of single fields.
    pub fn of<'a>(fields: impl IntoIterator<Item = (&'a str, Rule)>) -> Self {
        let fields = fields.into_iter().map(|(field, rule)| (field.to_owned(), rule)).collect();
        Self { fields, cross_field: Vec::new() }
    }

    /// Adds a rule of several fields.
    #[must_use]
    pub fn across(mut self, fields: &[&str], rule: &'static str) -> Self {
        let fields = fields.iter().map(|&field| field.to_owned()).collect();
        self.cross_field.push(CrossFieldRule { fields, rule });
        self
    }

    /// Adds the rules of the object in the field `name`.
    #[must_use]
    pub fn with(mut self, name: &str, object: Self) -> Self {
        let below = |field: String| format!("{name}.{field}");
        self.fields.extend(object.fields.into_iter().map(|(field, rule)| (below(field), rule)));
        self.cross_field.extend(object.cross_field.into_iter().map(|CrossFieldRule { fields, rule }| CrossFieldRule {
            fields: fields.into_iter().map(below).collect(),
            rule,
        }));
        self
    }

    /// Adds the rules of fields of the same object.
    #[must_use]
    pub fn and(mut self, further: Self) -> Self {
        self.fields.extend(further.fields);
        self.cross_field.extend(further.cross_field);
        self
    }

    /// Lowers the maximum of a field to what a server accepts.
    ///
    /// # Panics
    /// When the field has no rule.
    #[must_use]
    pub fn at_most(mut self, field: &str, maximum: f64) -> Self {
        let found = self.fields.iter_mut().find(|(name, _)| name == field);
        let (_, rule) = found.unwrap_or_else(|| panic!("`{field}` has no rule"));
        *rule = rule.at_most(maximum);
        self
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

    /// The same, where the value of this field was not given.
    #[cfg(any(feature = "server", test))]
    #[must_use]
    pub(crate) fn of_default(mut self, field: &str) -> Self {
        for violation in self.0.iter_mut().filter(|violation| violation.field == field) {
            violation.message.push_str("; it was not given, this is its default");
        }
        self
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
pub(crate) struct Checks {
    path: Vec<String>,
    found: Vec<Violation>,
}

impl Checks {
    /// A collector at the root of the input.
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// Runs `check` with all its field names below `name`.
    pub(crate) fn within<T>(&mut self, name: &str, check: impl FnOnce(&mut Self) -> T) -> T {
        self.path.push(name.to_owned());
        let result = check(self);
        self.path.pop();
        result
    }

    /// Requires a value within its bounds.
    pub(crate) fn bounds(&mut self, field: &str, value: f64, rule: &Rule) {
        self.require(field, Number(value), rule.admits(value), rule, rule.passed_by(value));
    }

    /// Requires an array of a length within its bounds.
    pub(crate) fn length(&mut self, field: &str, length: usize, rule: &Rule) {
        let count = length as f64;
        self.require(field, format_args!("{length} items long"), rule.admits(count), rule, rule.passed_by(count));
    }

    /// Requires `holds`; otherwise notes that `field` is `value` and must be `rule`: nothing is written before.
    pub(crate) fn require(
        &mut self,
        field: &str,
        value: impl fmt::Display,
        holds: bool,
        rule: impl fmt::Display,
        limit: Option<f64>,
    ) {
        if !holds {
            let path = self.path_of(field);
            let message = format!("`{path}` is {value}, must be {rule}");
            self.push(path, ViolationCode::InvalidValue, message, limit);
        }
    }

    /// Requires a value to be at most what this server accepts.
    #[cfg(any(feature = "server", test))]
    pub(crate) fn server_limit(&mut self, field: &str, value: f64, limit: f64) {
        if value > limit {
            let path = self.path_of(field);
            let message = format!("`{path}` is {}, must be at most {} here", Number(value), Number(limit));
            self.push(path, ViolationCode::ProblemTooLarge, message, Some(limit));
        }
    }

    /// How many violations were found so far.
    pub(crate) fn count(&self) -> usize {
        self.found.len()
    }

    /// Whether no rule was violated.
    ///
    /// # Errors
    /// All violations found.
    pub(crate) fn finish(self) -> Result<(), Violations> {
        if self.found.is_empty() { Ok(()) } else { Err(Violations(self.found)) }
    }

    /// The outcome of further checks, with the violations found before.
    ///
    /// # Errors
    /// All violations found.
    #[cfg(any(feature = "server", test))]
    pub(crate) fn and<T>(mut self, further: Result<T, Violations>) -> Result<T, Violations> {
        match further {
            Ok(value) => self.finish().map(|()| value),
            Err(Violations(found)) => {
                self.found.extend(found);
                Err(Violations(self.found))
            }
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_names_path_value_and_rule() {
        let mut checks = Checks::new();
        checks.within("maneuver", |checks| checks.bounds("torque_limit_left_n_m", -1.0, &Rule::positive("N m")));
        let error = checks.finish().unwrap_err();
        assert_eq!(error.to_string(), "`maneuver.torque_limit_left_n_m` is -1, must be > 0 N m");
    }

    #[test]
    fn numbers_are_short() {
        let mut checks = Checks::new();
        checks.bounds("small", 1e-300, &Rule::between(1e-9, 0.001, ""));
        checks.bounds("large", -1e300, &Rule::at_least(1e4, "m"));
        checks.server_limit("huge", 1e300, 1e3);
        let error = checks.finish().unwrap_err().to_string();
        let [small, large, huge] = [
            "`small` is 1e-300, must be between 1e-9 and 0.001",
            "`large` is -1e300, must be >= 10000 m",
            "`huge` is 1e300, must be at most 1000 here",
        ];
        assert_eq!(error, [small, large, huge].join("; "));
    }

    #[test]
    fn all_violations_are_kept() {
        let mut checks = Checks::new();
        checks.bounds("a", f64::NAN, &Rule::positive(""));
        checks.bounds("b", 0.0, &Rule::at_least(0.0, ""));
        checks.server_limit("c", 3.0, 2.0);
        assert_eq!(checks.count(), 2);
    }

    #[test]
    fn further_violations_come_after_those_found_before() {
        let violation = |field: &str| {
            let mut checks = Checks::new();
            checks.length(field, 3, &Rule::between(1.0, 2.0, Rule::ITEMS));
            checks
        };
        let both = violation("a").and(violation("b").finish()).unwrap_err();
        assert_eq!(
            both.to_string(),
            "`a` is 3 items long, must be between 1 and 2 items; `b` is 3 items long, must be between 1 and 2 items"
        );
        assert!(violation("a").and(Ok(())).is_err() && Checks::new().and(Ok(())).is_ok());
    }

    #[test]
    fn refused_values_name_the_bound_that_they_passed() {
        let limit = |value: f64, rule: Rule| {
            let mut checks = Checks::new();
            checks.bounds("a", value, &rule);
            checks.finish().map_or_else(|violations| violations.list()[0].limit, |()| Some(f64::NAN))
        };
        let rule = Rule::between(1.0, 2.0, "m");
        assert_eq!([0.9, 2.1, f64::NAN].map(|value| limit(value, rule)), [Some(1.0), Some(2.0), None]);
        assert_eq!([0.0, f64::INFINITY].map(|value| limit(value, Rule::positive("m"))), [Some(0.0), None]);
        assert!([1.0, 2.0].iter().all(|&value| rule.admits(value)));
        let share = Rule::from_to_below(0.5, 1.0, "");
        assert_eq!((share.admits(0.5), limit(1.0, share)), (true, Some(1.0)));
        assert_eq!(share.to_string(), ">= 0.5 and < 1");
    }
}
