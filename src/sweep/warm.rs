//! Rows that begin with the plan of the row before.

use serde_json::{Value, json};

use super::definition::Definition;
use super::path::FieldPath;
use crate::contract::{ErrorCode, Problem};
use crate::jobs::solve::Solve;
use crate::rules::Checks;
use crate::service::Job as _;

/// The field of a request that a plan goes to.
const GUESS: &str = "initial_guess";
const ABSENT_RULE: &str = "absent where `warm_start` is true";

/// The plan of a row, for the next one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Guess {
    /// The key of its row.
    pub(super) key: String,
    /// As `initial_guess`.
    value: Value,
}

/// Whether the rows can begin with plans, where the file asks for it.
///
/// # Errors
/// `invalid_value` where they cannot.
pub(super) fn check(definition: &Definition) -> Result<(), Problem> {
    if !definition.warm_start {
        return Ok(());
    }
    if definition.job != Solve::NAME {
        let text = format!("`warm_start` is true, must be false for `{}`: only a solve has a plan", definition.job);
        return Err(Problem::at_field(ErrorCode::InvalidValue, "#/warm_start".to_owned(), text));
    }
    let mut checks = Checks::new();
    let is_absent = definition.base.get(GUESS).is_none();
    checks.require("request.initial_guess", "given", is_absent, ABSENT_RULE, None);
    for (index, axis) in definition.axes.iter().enumerate() {
        for (name, path) in axis.fields() {
            let is_other = FieldPath::parse(GUESS).is_some_and(|guess| !guess.overlaps(path));
            checks.require(&format!("axes[{index}].field"), format!("`{name}`"), is_other, ABSENT_RULE, None);
        }
    }
    Ok(checks.finish()?)
}

/// Whether the row of a line can begin with a plan, where the file asks for it.
///
/// # Errors
/// `invalid_value` where it has one of its own.
pub(super) fn check_line(definition: &Definition, line: &Value) -> Result<(), Problem> {
    let mut checks = Checks::new();
    let is_absent = line.get(GUESS).is_none_or(Value::is_null);
    checks.require(GUESS, "given", is_absent || !definition.warm_start, ABSENT_RULE, None);
    Ok(checks.finish()?)
}

impl Guess {
    /// The plan of an answer, where it is one that a search may begin with.
    pub(super) fn of(key: String, answer: &[u8]) -> Option<Self> {
        let answer: Value = serde_json::from_slice(answer).ok()?;
        Self::of_value(key, &answer)
    }

    /// The same of an answer that was read.
    pub(super) fn of_value(key: String, answer: &Value) -> Option<Self> {
        let schedule = answer.get("torque_schedule")?;
        let (left, right) = (schedule.get("left_n_m")?, schedule.get("right_n_m")?);
        if answer.get("status")? != "converged" || left.as_array()?.is_empty() {
            return None;
        }
        let final_time = answer.get("final_time_s")?;
        Some(Self {
            key,
            value: json!({"final_time_s": final_time, "torque_left_n_m": left, "torque_right_n_m": right}),
        })
    }

    /// The request that descends from this plan and searches nowhere else.
    pub(super) fn descent(&self, request: &Value) -> Option<Value> {
        let mut request = request.clone();
        let put = |request: &mut Value, path: &str, value: Value| FieldPath::parse(path)?.put(request, value).ok();
        put(&mut request, GUESS, self.value.clone())?;
        put(&mut request, "solver.starts", json!(1))?;
        Some(request)
    }
}
