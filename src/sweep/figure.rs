//! A map of two fields of a sweep: what a third value is over them.

use std::collections::BTreeSet;
use std::str::FromStr;

use serde_json::Value;

use super::Sweep;
use super::definition::{Definition, Followed};
use super::path::FieldPath;
use super::results::{Index, ResultsError, StoredRow};
use crate::contract::json;
use crate::plot::{HeatMap, MapAxis, MapCell};

/// Most cells of a map: more make files that no program shows at ease.
const MOST_CELLS: usize = 250_000;
/// Units as names of fields end with them, the longest first, and as they are written.
const UNITS: [(&str, &str); 16] = [
    ("_kg_m2", "kg m\u{b2}"),
    ("_rad_s2", "rad/s\u{b2}"),
    ("_n_m_s", "N m/s"),
    ("_rad_s", "rad/s"),
    ("_m_s2", "m/s\u{b2}"),
    ("_n_m", "N m"),
    ("_m_s", "m/s"),
    ("_n_s", "N s"),
    ("_rad", "rad"),
    ("_kg", "kg"),
    ("_ms", "ms"),
    ("_m", "m"),
    ("_s", "s"),
    ("_n", "N"),
    ("_percent", "%"),
    ("_hz", "Hz"),
];

/// What a map shows: `X,Y,VALUE`, and `FIELD=VALUE` for what else differs. Fields and value may be named by the ends of
/// their paths.
#[derive(Debug, Clone, PartialEq)]
pub struct MapOf {
    across: String,
    up: String,
    value: String,
    /// Rows of other values of these fields are left out.
    only: Vec<(String, Value)>,
}

impl FromStr for MapOf {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<_> = text.split(',').map(str::trim).collect();
        let [across, up, value, only @ ..] = &parts[..] else {
            return Err("it must be X,Y,VALUE, such as y_m,wheel_friction_coefficient,final_time_s".to_owned());
        };
        if FieldPath::parse(value).is_none() {
            return Err(format!("`{value}` must be a path in the answer, such as report.rollouts"));
        }
        let pair = |text: &&str| {
            let (field, value) = text.split_once('=').ok_or_else(|| format!("`{text}` must be FIELD=VALUE"))?;
            let value = serde_json::from_str(value).unwrap_or_else(|_| Value::from(value));
            Ok((field.to_owned(), value))
        };
        let only = only.iter().map(pair).collect::<Result<_, String>>()?;
        let [across, up, value] = [across, up, value].map(|&text| text.to_owned());
        Ok(Self { across, up, value, only })
    }
}

/// A map, or why there is none.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The results cannot be read.
    #[error(transparent)]
    Results(#[from] ResultsError),
    /// The results have no such map.
    #[error("there is no such map: {0}")]
    Unfit(String),
}

/// The axes of a map and what else is chosen, by the full names of their fields.
struct Named<'a> {
    axes: [&'a str; 2],
    only: Vec<(&'a str, Value)>,
}

impl MapOf {
    fn named<'a>(&self, fields: &'a [String]) -> Result<Named<'a>, MapError> {
        let named = |name: &str| full_name(name, fields);
        let axes = [named(&self.across)?, named(&self.up)?];
        if axes[0] == axes[1] {
            return Err(MapError::Unfit(format!("both axes are `{}`, must differ", axes[0])));
        }
        let only = self.only.iter().map(|(name, value)| Ok((named(name)?, value.clone())));
        Ok(Named { axes, only: only.collect::<Result<_, MapError>>()? })
    }
}

impl Sweep {
    /// Whether there are the fields of a map, before any row has run.
    ///
    /// # Errors
    /// Where a field does not differ, or may be each of several.
    pub fn check_map(&self, of: &MapOf) -> Result<(), MapError> {
        let mut fields = self.rows.field_names();
        if fields.is_empty() {
            let rows = (0..self.row_count()).filter_map(|row| self.row(row).ok());
            let names: BTreeSet<_> = rows.flat_map(|row| row.fields).map(|(name, _)| name).collect();
            fields.extend(names);
        }
        of.named(&fields).map(drop)
    }
}

/// A row of the map: places along its axes, and what is there.
struct Entry {
    row: u64,
    at: [f64; 2],
    cell: MapCell,
}

/// The map as SVG.
///
/// # Errors
/// Where a field does not differ or has no numbers, two rows have one place, or the results cannot be read.
pub fn map(index: &Index, of: &MapOf) -> Result<String, MapError> {
    let fields = index.fields()?;
    let Named { axes: [across, up], only } = of.named(&fields)?;
    let value = FieldPath::parse(&of.value).ok_or_else(|| MapError::Unfit(format!("`{}` is no path", of.value)))?;
    let mut entries = Vec::new();
    for row in index.rows() {
        let row = row?;
        if only.iter().all(|(name, value)| row.axes.get(*name).is_some_and(|of_row| is_same(of_row, value))) {
            entries.push(entry(&row, [across, up], &value)?);
        }
    }
    let axes = [0, 1].map(|axis| {
        let found = entries.iter().map(|entry| entry.at[axis]);
        distinct(found.chain(planned(index, [across, up][axis])).collect())
    });
    let cells = cells(&entries, &axes)?;
    let [across_values, up_values] = axes;
    let (across_label, up_label, value_label) = (label(across), label(up), label(&of.value));
    Ok(HeatMap {
        title: format!("{} over {} and {}", capital(bare(&value_label)), bare(&across_label), bare(&up_label)),
        caption: caption(index, &only),
        across: MapAxis { label: across_label, values: across_values },
        up: MapAxis { label: up_label, values: up_values },
        value: value_label,
        cells,
        missing: if index.progress.done == index.header.rows { "no row" } else { "not run yet" },
    }
    .svg())
}

fn caption(index: &Index, only: &[(&str, Value)]) -> String {
    let slice: Vec<_> = only.iter().map(|(name, value)| format!(", {name} = {value}")).collect();
    let sweep = &index.header.sweep[..index.header.sweep.len().min(8)];
    format!("{}{}; sweep {sweep}, slipdrive {}", index.progress, slice.concat(), index.header.solver_version)
}

/// The one field that is called so, or whose path ends so.
fn full_name<'a>(name: &str, fields: &'a [String]) -> Result<&'a str, MapError> {
    let ends = |field: &&String| field.strip_suffix(name).is_some_and(|rest| rest.is_empty() || rest.ends_with('.'));
    let found: Vec<_> = match fields.iter().find(|field| *field == name) {
        Some(field) => vec![field],
        None => fields.iter().filter(ends).collect(),
    };
    match found[..] {
        [only] => Ok(only),
        [] => Err(MapError::Unfit(format!("`{name}` does not differ from row to row; {} do", fields.join(", ")))),
        _ => Err(MapError::Unfit(format!("`{name}` may be each of {}", joined(&found)))),
    }
}

fn joined(names: &[&String]) -> String {
    names.iter().map(|name| name.as_str()).collect::<Vec<_>>().join(", ")
}

fn is_same(one: &Value, other: &Value) -> bool {
    match (one.as_f64(), other.as_f64()) {
        (Some(one), Some(other)) => one == other,
        _ => one == other,
    }
}

fn entry(row: &StoredRow, axes: [&str; 2], value: &FieldPath) -> Result<Entry, MapError> {
    let number = |name: &str| {
        let number = row.axes.get(name).and_then(Value::as_f64);
        number.ok_or_else(|| MapError::Unfit(format!("`{name}` is no number in row {}", row.row)))
    };
    let cell = match &row.answer {
        None => MapCell::Failed,
        Some(answer) if is_without_plan(answer) => MapCell::None,
        Some(answer) => value.of(answer).and_then(Value::as_f64).map_or(MapCell::None, MapCell::Value),
    };
    Ok(Entry { row: row.row, at: [number(axes[0])?, number(axes[1])?], cell })
}

/// Whether the numbers of an answer speak of a plan that misses its goal.
fn is_without_plan(answer: &Value) -> bool {
    let status = answer.get("status").and_then(Value::as_str);
    matches!(status, Some("not_converged" | "infeasible"))
}

/// The values that a field takes in the end, where axes say it.
fn planned(index: &Index, name: &str) -> Vec<f64> {
    let text = json::write(&index.header.definition);
    let axes = Definition::read(&text, Followed::ByNothing).map(|definition| definition.axes).unwrap_or_default();
    let Some(axis) = axes.iter().find(|axis| axis.fields().any(|(field, _)| field == name)) else { return Vec::new() };
    let at = |place| axis.at(place).find(|(field, ..)| *field == name).and_then(|(.., value)| value.as_f64());
    // Beyond this there is no map anyway.
    (0..axis.len().min(MOST_CELLS as u64)).filter_map(at).collect()
}

fn distinct(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

fn cells(entries: &[Entry], [across, up]: &[Vec<f64>; 2]) -> Result<Vec<MapCell>, MapError> {
    let count = across.len() * up.len();
    if count == 0 || count > MOST_CELLS {
        let text = format!("it has {count} cells, must be between 1 and {MOST_CELLS}");
        return Err(MapError::Unfit(text));
    }
    let (mut cells, mut taken) = (vec![MapCell::Missing; count], vec![None; count]);
    for Entry { row, at, cell } in entries {
        let place = |values: &[f64], value: f64| values.partition_point(|other| *other < value);
        let place = place(up, at[1]) * across.len() + place(across, at[0]);
        if let Some(other) = taken[place].replace(*row) {
            let text = format!("rows {other} and {row} have one place; add FIELD=VALUE for what else differs");
            return Err(MapError::Unfit(text));
        }
        cells[place] = *cell;
    }
    Ok(cells)
}

/// A path as words with its unit: `maneuver.goal.y_m` as `goal y (m)`.
fn label(path: &str) -> String {
    let words = path.split_once('.').map_or(path, |(_, rest)| rest);
    let unit = UNITS.iter().find_map(|(end, unit)| Some((words.strip_suffix(end)?, unit)));
    let spaced = |words: &str| words.replace(['.', '_'], " ");
    match unit {
        Some((words, unit)) => format!("{} ({unit})", spaced(words)),
        None => spaced(words),
    }
}

/// A label without its unit.
fn bare(label: &str) -> &str {
    label.split(" (").next().unwrap_or(label)
}

fn capital(words: &str) -> String {
    let mut characters = words.chars();
    characters.next().into_iter().flat_map(char::to_uppercase).chain(characters).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_have_words_and_units() {
        let labels = ["maneuver.goal.y_m", "robot.wheel_friction_coefficient", "final_time_s", "report.rollouts"];
        let expected = ["goal y (m)", "wheel friction coefficient", "final time (s)", "rollouts"];
        assert_eq!(labels.map(label), expected);
        assert_eq!(label("maneuver.limits.torque_rate_n_m_s"), "limits torque rate (N m/s)");
        assert_eq!(label("robot.gravity_m_s2"), "gravity (m/s\u{b2})");
    }

    #[test]
    fn fields_are_found_by_the_ends_of_their_paths() {
        let fields = ["maneuver.goal.y_m", "maneuver.start.y_m", "robot.gravity_m_s2"].map(str::to_owned);
        assert_eq!(full_name("gravity_m_s2", &fields).unwrap(), "robot.gravity_m_s2");
        assert_eq!(full_name("goal.y_m", &fields).unwrap(), "maneuver.goal.y_m");
        let fault = |name: &str| full_name(name, &fields).unwrap_err().to_string();
        assert!(fault("y_m").contains("may be each of maneuver.goal.y_m, maneuver.start.y_m"), "{}", fault("y_m"));
        assert!(fault("avity_m_s2").contains("does not differ"));
    }

    #[test]
    fn two_rows_of_one_place_are_refused() {
        let entry = |row| Entry { row, at: [1.0, 2.0], cell: MapCell::Value(1.0) };
        let axes = [vec![1.0], vec![2.0]];
        assert_eq!(cells(&[entry(0)], &axes).unwrap(), [MapCell::Value(1.0)]);
        assert!(cells(&[entry(0), entry(3)], &axes).unwrap_err().to_string().contains("rows 0 and 3"));
    }

    #[test]
    fn maps_are_asked_for_by_three_names_and_more() {
        let of: MapOf = "x_m,y_m,final_time_s,mass_kg=3".parse().unwrap();
        assert_eq!(of.only, [("mass_kg".to_owned(), Value::from(3))]);
        assert!("x_m,y_m".parse::<MapOf>().is_err() && "x,y,,z".parse::<MapOf>().is_err());
        assert!("x,y,z,mass".parse::<MapOf>().unwrap_err().contains("FIELD=VALUE"));
    }
}
