//! What a map is asked to show, and whether the axes of a sweep have such a map.

use std::collections::HashSet;
use std::str::FromStr;

use serde_json::Value;

use super::{MOST_CELLS, MapError};
use crate::sweep::axis::Axis;
use crate::sweep::path::FieldPath;

/// Most values of a field that a refusal lists.
const MOST_LISTED: usize = 8;

/// What a map shows: `X,Y,VALUE`, and `FIELD=VALUE` for what else differs. Fields may be named by the ends of their paths;
/// a `VALUE` of a field is JSON, or else a text.
#[derive(Debug, Clone, PartialEq)]
pub struct MapOf {
    across: String,
    up: String,
    pub(super) value: String,
    /// Rows of other values of these fields are left out.
    only: Vec<(String, Value)>,
}

impl FromStr for MapOf {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<_> = parts(text).into_iter().map(str::trim).collect();
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

/// The axes of a map and what else is chosen, by the full names of their fields.
pub(super) struct Named<'a> {
    pub(super) axes: [&'a str; 2],
    pub(super) only: Vec<(&'a str, Value)>,
}

impl Named<'_> {
    /// Whether fields have the values that are chosen for them; a field that is not there does not speak against it.
    pub(super) fn admits<'f>(&self, fields: impl Fn(&str) -> Option<&'f Value>, must_be_there: bool) -> bool {
        let admits =
            |(name, chosen): &(&str, Value)| fields(name).map_or(!must_be_there, |value| is_same(value, chosen));
        self.only.iter().all(admits)
    }

    /// Where a row is on the map.
    pub(super) fn place<'f>(&self, row: u64, fields: impl Fn(&str) -> Option<&'f Value>) -> Result<[f64; 2], MapError> {
        let number = |name: &str| {
            let number = fields(name).and_then(Value::as_f64);
            number.ok_or_else(|| MapError::Unfit(format!("`{name}` is no number in row {row}")))
        };
        Ok([number(self.axes[0])?, number(self.axes[1])?])
    }

    /// That no row has what is chosen.
    pub(super) fn nothing_chosen(&self, of: impl Fn(&str) -> bool) -> String {
        let chosen = self.only.iter().filter(|(name, _)| of(name)).map(|(name, value)| format!("`{name}` = {value}"));
        format!("no row has {}", chosen.collect::<Vec<_>>().join(" and "))
    }

    /// Whether each place of the map has one row at most, where all combinations of these axes are the rows.
    ///
    /// # Errors
    /// Where nothing is chosen of an axis that the map does not show, something that it does not have, or what is no number.
    pub(super) fn check_crossed(&self, axes: &[Axis]) -> Result<(), MapError> {
        let mut cells = 1_usize;
        for axis in axes {
            let is_here = |name: &str| axis.fields().any(|(field, _)| field == name);
            let shown = self.axes.map(|name| is_here(name).then_some(name));
            let mut places = HashSet::new();
            for place in 0..axis.len() {
                let values: Vec<_> = axis.at(place).map(|(name, _, value)| (name, value)).collect();
                let of = |name: &str| values.iter().find(|(field, _)| *field == name).map(|(_, value)| value);
                if !self.admits(of, false) {
                    continue;
                }
                let number = |name: &str| {
                    let number = of(name).and_then(Value::as_f64);
                    let text = || format!("`{name}` is {}, must be a number", of(name).unwrap_or(&Value::Null));
                    number.ok_or_else(|| MapError::Unfit(text()))
                };
                let at = [shown[0].map(number).transpose()?, shown[1].map(number).transpose()?];
                // The two zeros are one.
                if !places.insert(at.map(|number| number.map(|number| (number + 0.0).to_bits()))) {
                    return Err(MapError::Unfit(self.open(axis)));
                }
                if places.len() > MOST_CELLS {
                    return Err(too_many_cells());
                }
            }
            if places.is_empty() {
                let chosen = self.only.iter().find(|(name, _)| is_here(name)).map_or("", |(name, _)| name);
                return Err(MapError::Unfit(format!("{}: {}", self.nothing_chosen(is_here), listed(axis, chosen))));
            }
            cells = cells.saturating_mul(places.len());
        }
        if cells > MOST_CELLS { Err(too_many_cells()) } else { Ok(()) }
    }

    /// That rows of an axis have one place.
    fn open(&self, axis: &Axis) -> String {
        let is_free = |name: &&str| !self.axes.contains(name) && self.only.iter().all(|(chosen, _)| chosen != name);
        match axis.fields().map(|(name, _)| name).find(is_free) {
            Some(free) => {
                let values = listed(axis, free);
                format!("several rows have one place, as `{free}` differs too; add {free}=VALUE: {values}")
            }
            None => format!("several rows have one place, as `{}` has a value twice", self.axes.join("` or `")),
        }
    }
}

/// What a field of an axis may be.
fn listed(axis: &Axis, name: &str) -> String {
    let places = (0..axis.len()).take(MOST_LISTED);
    let values = places.filter_map(|place| axis.at(place).find(|(field, ..)| *field == name));
    let values: Vec<_> = values.map(|(.., value)| value.to_string()).collect();
    let more = if axis.len() > MOST_LISTED as u64 { ", ..." } else { "" };
    format!("`{name}` is one of {}{more}", values.join(", "))
}

fn too_many_cells() -> MapError {
    MapError::Unfit(format!("it has more than {MOST_CELLS} cells"))
}

/// The parts between commas; commas inside JSON values are none.
fn parts(text: &str) -> Vec<&str> {
    let (mut depth, mut is_in_text, mut is_escaped) = (0_usize, false, false);
    text.split(|character| {
        match character {
            _ if is_escaped => is_escaped = false,
            '\\' if is_in_text => is_escaped = true,
            '"' => is_in_text = !is_in_text,
            '{' | '[' if !is_in_text => depth += 1,
            '}' | ']' if !is_in_text => depth = depth.saturating_sub(1),
            _ => {}
        }
        character == ',' && depth == 0 && !is_in_text
    })
    .collect()
}

impl MapOf {
    pub(super) fn named<'a>(&self, fields: &'a [String]) -> Result<Named<'a>, MapError> {
        let named = |name: &str| full_name(name, fields);
        let axes = [named(&self.across)?, named(&self.up)?];
        if axes[0] == axes[1] {
            return Err(MapError::Unfit(format!("both axes are `{}`, must differ", axes[0])));
        }
        let only = self.only.iter().map(|(name, value)| Ok((named(name)?, value.clone())));
        Ok(Named { axes, only: only.collect::<Result<_, MapError>>()? })
    }
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

/// Whether two values are one: 1 and 1.0 are.
fn is_same(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::Number(one), Value::Number(other)) => one.as_f64() == other.as_f64(),
        (Value::Array(one), Value::Array(other)) => {
            one.len() == other.len() && one.iter().zip(other).all(|(one, other)| is_same(one, other))
        }
        (Value::Object(one), Value::Object(other)) => {
            let has = |(name, value): (&String, &Value)| other.get(name).is_some_and(|other| is_same(value, other));
            one.len() == other.len() && one.iter().all(has)
        }
        _ => one == other,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

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
    fn maps_are_asked_for_by_three_names_and_more() {
        let of: MapOf = "x_m,y_m,final_time_s,mass_kg=3".parse().unwrap();
        assert_eq!(of.only, [("mass_kg".to_owned(), Value::from(3))]);
        assert!("x_m,y_m".parse::<MapOf>().is_err() && "x,y,,z".parse::<MapOf>().is_err());
        assert!("x,y,z,mass".parse::<MapOf>().unwrap_err().contains("FIELD=VALUE"));
        let of: MapOf = r#"x,y,z,a={"b": [1,2], "c": "},\","},view=plan"#.parse().unwrap();
        let expected = [("a", json!({"b": [1, 2], "c": "},\","})), ("view", json!("plan"))];
        assert_eq!(of.only, expected.map(|(name, value)| (name.to_owned(), value)));
    }

    #[test]
    fn numbers_are_the_same_however_they_are_written() {
        assert!(is_same(&json!({"a": [1, 2.5]}), &json!({"a": [1.0, 2.5]})));
        assert!(!is_same(&json!({"a": 1}), &json!({"a": 1, "b": 2})) && !is_same(&json!([1]), &json!([1, 2])));
        assert!(!is_same(&json!("1"), &json!(1)));
    }
}
