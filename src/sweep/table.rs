//! Chosen columns of the results as CSV.

use std::fmt::{self, Write as _};
use std::io::{self, Write};

use serde_json::Value;

use super::path::FieldPath;
use super::results::{Index, ResultsError};

/// A table, or why there is none.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The results cannot be read.
    #[error(transparent)]
    Results(#[from] ResultsError),
    /// The table cannot be written.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// A column that is empty although there are answers, such as a misspelt one: before the sweep has run, nobody knows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EmptyColumn {
    /// The path in the answers.
    pub column: String,
    /// How many answers there are.
    pub answers: u64,
}

impl fmt::Display for EmptyColumn {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "empty column: none of the {} answers has `{}`", self.answers, self.column)
    }
}

/// Writes the table: a row per result in order, with its number, the fields of the axes, the columns of the answer, and
/// why there is no answer. What an answer does not have is empty; arrays and objects are JSON. Gives the columns that no
/// answer has.
///
/// # Errors
/// When the results cannot be read, or the table cannot be written.
pub fn write_csv(index: &Index, output: &mut impl Write) -> Result<Vec<EmptyColumn>, TableError> {
    let (fields, columns) = (index.fields()?, &index.header.columns);
    let names = ["row"].into_iter().chain(fields.iter().chain(columns).map(String::as_str)).chain(["problem"]);
    let head: Vec<_> = names.map(|name| quoted(name.to_owned())).collect();
    writeln!(output, "{}", head.join(","))?;
    let paths: Vec<_> = columns.iter().map(|column| FieldPath::parse(column)).collect();
    let (mut answers, mut has_value) = (0, vec![false; paths.len()]);
    for row in index.rows() {
        let row = row?;
        let mut line = row.row.to_string();
        let of_axes = fields.iter().map(|field| row.axes.get(field));
        let of_answer: Vec<_> = paths.iter().map(|path| path.as_ref()?.of(row.answer.as_ref()?)).collect();
        answers += u64::from(row.answer.is_some());
        for (has_value, value) in has_value.iter_mut().zip(&of_answer) {
            *has_value |= value.is_some();
        }
        let problem = row.problem.as_ref().and_then(|problem| problem.get("code"));
        for value in of_axes.chain(of_answer).chain([problem]) {
            // Writing to a string cannot fail.
            let _ = write!(line, ",{}", value.map(cell).unwrap_or_default());
        }
        writeln!(output, "{line}")?;
    }
    let empty = columns.iter().zip(has_value).filter(|(_, has_value)| answers > 0 && !has_value);
    Ok(empty.map(|(column, _)| EmptyColumn { column: column.clone(), answers }).collect())
}

fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => quoted(text.clone()),
        Value::Bool(_) | Value::Number(_) | Value::Array(_) | Value::Object(_) => quoted(value.to_string()),
    }
}

/// A text as a cell, by RFC 4180.
fn quoted(text: String) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn cells_are_plain_or_quoted() {
        let cells = [json!(0.5), json!("a"), json!("a \"b\", c"), json!([1, 2]), json!(null), json!(true)];
        let expected = ["0.5", "a", "\"a \"\"b\"\", c\"", "\"[1,2]\"", "", "true"];
        assert_eq!(cells.map(|value| cell(&value)), expected);
    }
}
