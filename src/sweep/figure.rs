//! A map of two fields of a sweep: what a third value is over them.

mod choice;

use std::collections::BTreeSet;

pub use choice::MapOf;
use choice::Named;
use serde_json::Value;

use super::Sweep;
use super::axis::Axis;
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

/// A map, or why there is none.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The results cannot be read.
    #[error(transparent)]
    Results(#[from] ResultsError),
    /// The sweep has no such map.
    #[error("there is no such map: {0}")]
    Unfit(String),
    /// There are answers, and none of them has the value: before the sweep has run, nobody knows.
    #[error("no map: none of the {answers} answers has a number at `{value}`")]
    NoValue {
        /// The path in the answers.
        value: String,
        /// How many answers there are.
        answers: u64,
    },
}

impl Sweep {
    /// Whether there is such a map, before any row has run; whether answers have its value, they alone know.
    ///
    /// # Errors
    /// Where a field does not differ, may be each of several or has no numbers, no row has what is chosen, or two rows
    /// have one place as something else differs too.
    pub fn check_map(&self, of: &MapOf) -> Result<(), MapError> {
        if let Some(axes) = self.rows.axes().filter(|axes| !axes.is_empty()) {
            return of.named(&self.rows.field_names())?.check_crossed(axes);
        }
        let rows = || (0..self.row_count()).filter_map(|row| self.row(row).ok());
        let names: BTreeSet<_> = rows().flat_map(|row| row.fields).map(|(name, _)| name).collect();
        let fields: Vec<_> = names.into_iter().collect();
        let named = of.named(&fields)?;
        let mut entries = Vec::new();
        for row in rows() {
            let of = |name: &str| row.fields.iter().find(|(field, _)| field == name).map(|(_, value)| value);
            if named.admits(of, true) {
                entries.push(Entry { row: row.number, at: named.place(row.number, of)?, cell: MapCell::Missing });
            }
            // Either two of them have one place or there are too many cells: more need not be known.
            if entries.len() > MOST_CELLS {
                break;
            }
        }
        if entries.is_empty() {
            return Err(MapError::Unfit(named.nothing_chosen(|_| true)));
        }
        cells(&entries, &axes_of(&entries, |_| Vec::new())).map(drop)
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
/// Where there is no such map, no answer has its value, or the results cannot be read.
pub fn map(index: &Index, of: &MapOf) -> Result<String, MapError> {
    let fields = index.fields()?;
    let named = of.named(&fields)?;
    let planned_axes = planned_axes(index);
    named.check_crossed(&planned_axes)?;
    let value = FieldPath::parse(&of.value).ok_or_else(|| MapError::Unfit(format!("`{}` is no path", of.value)))?;
    let (mut entries, mut answers, mut has_value) = (Vec::new(), 0, false);
    for row in index.rows() {
        let row = row?;
        if named.admits(|name| row.axes.get(name), true) {
            let at = named.place(row.row, |name| row.axes.get(name))?;
            entries.push(Entry { row: row.row, at, cell: cell(&row, &value) });
        }
        answers += u64::from(row.answer.is_some());
        has_value |= row.answer.as_ref().is_some_and(|answer| number_at(&value, answer).is_some());
    }
    if answers > 0 && !has_value {
        return Err(MapError::NoValue { value: of.value.clone(), answers });
    }
    if entries.is_empty() && planned_axes.is_empty() {
        return Err(MapError::Unfit(named.nothing_chosen(|_| true)));
    }
    let Named { axes: [across, up], only } = named;
    let axes = axes_of(&entries, |axis| planned(&planned_axes, [across, up][axis]));
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

/// What is shown of a row.
fn cell(row: &StoredRow, value: &FieldPath) -> MapCell {
    match &row.answer {
        None => MapCell::Failed,
        Some(answer) if is_without_plan(answer) => MapCell::None,
        Some(answer) => number_at(value, answer).map_or(MapCell::None, MapCell::Value),
    }
}

fn number_at(path: &FieldPath, answer: &Value) -> Option<f64> {
    path.of(answer).and_then(Value::as_f64)
}

/// Whether the numbers of an answer speak of a plan that misses its goal.
fn is_without_plan(answer: &Value) -> bool {
    let status = answer.get("status").and_then(Value::as_str);
    matches!(status, Some("not_converged" | "infeasible"))
}

/// The axes of the sweep; none where lines make its rows.
fn planned_axes(index: &Index) -> Vec<Axis> {
    let text = json::write(&index.header.definition);
    Definition::read(&text, Followed::ByNothing).map(|definition| definition.axes).unwrap_or_default()
}

/// The values that a field takes in the end, where axes say it.
fn planned(axes: &[Axis], name: &str) -> Vec<f64> {
    let Some(axis) = axes.iter().find(|axis| axis.fields().any(|(field, _)| field == name)) else { return Vec::new() };
    let at = |place| axis.at(place).find(|(field, ..)| *field == name).and_then(|(.., value)| value.as_f64());
    // Beyond this there is no map anyway.
    (0..axis.len().min(MOST_CELLS as u64)).filter_map(at).collect()
}

/// The values along both axes of a map: those of its rows, and those that are planned.
fn axes_of(entries: &[Entry], planned: impl Fn(usize) -> Vec<f64>) -> [Vec<f64>; 2] {
    [0, 1].map(|axis| distinct(entries.iter().map(|entry| entry.at[axis]).chain(planned(axis)).collect()))
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

/// Objects that no reader misses before their fields.
const NOT_NAMED: [&str; 4] = ["maneuver.", "report.", "robot.", "solver."];

/// A path as words with its unit: `maneuver.goal.y_m` as `goal y (m)`, `left_n_m[3]` as `left [3] (N m)`.
fn label(path: &str) -> String {
    let words = NOT_NAMED.iter().find_map(|of| path.strip_prefix(of)).unwrap_or(path);
    let (words, index) = words.find('[').filter(|_| words.ends_with(']')).map_or((words, ""), |at| words.split_at(at));
    let index = if index.is_empty() { String::new() } else { format!(" {index}") };
    let unit = UNITS.iter().find_map(|(end, unit)| Some((words.strip_suffix(end)?, *unit)));
    // Its name ends as that of a torque rate.
    let unit = unit.map(|(name, unit)| (name, if name.ends_with("viscous_friction") { "N m s/rad" } else { unit }));
    let spaced = |words: &str| words.replace(['.', '_'], " ");
    match unit {
        Some((words, unit)) => format!("{}{index} ({unit})", spaced(words)),
        None => format!("{}{index}", spaced(words)),
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
        assert_eq!(label("robot.wheel_viscous_friction_n_m_s"), "wheel viscous friction (N m s/rad)");
        assert_eq!(label("goal_error.y_m"), "goal error y (m)");
        assert_eq!(label("torque_schedule.left_n_m[0]"), "torque schedule left [0] (N m)");
        assert_eq!(label("robot.gravity_m_s2"), "gravity (m/s\u{b2})");
    }

    #[test]
    fn two_rows_of_one_place_are_refused() {
        let entry = |row| Entry { row, at: [1.0, 2.0], cell: MapCell::Value(1.0) };
        let axes = [vec![1.0], vec![2.0]];
        assert_eq!(cells(&[entry(0)], &axes).unwrap(), [MapCell::Value(1.0)]);
        assert!(cells(&[entry(0), entry(3)], &axes).unwrap_err().to_string().contains("rows 0 and 3"));
    }
}
