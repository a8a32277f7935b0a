//! Axes of a sweep: fields and the values that they take.

use serde::Deserialize;
use serde_json::{Number, Value};

use super::path::FieldPath;
use crate::contract::{StrictValue, json};
use crate::rules::{Checks, Rule};

/// How many values an axis may have.
const LENGTH_RULE: Rule = Rule::between(1.0, super::MOST_ROWS as f64, Rule::ITEMS);
const COUNT_RULE: Rule = Rule::between(2.0, super::MOST_ROWS as f64, "");
const FORM_RULE: &str = "`field` with `values`, `field` with `from`, `to` and `count`, or `paired` alone";

/// An axis as files have it: one of three forms.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AxisForm {
    #[serde(default, deserialize_with = "json::some_value")]
    field: Option<String>,
    #[serde(default, deserialize_with = "json::some_value")]
    values: Option<Vec<StrictValue>>,
    #[serde(default, deserialize_with = "json::some_value")]
    from: Option<Number>,
    #[serde(default, deserialize_with = "json::some_value")]
    to: Option<Number>,
    #[serde(default, deserialize_with = "json::some_long_count")]
    count: Option<u64>,
    #[serde(default, deserialize_with = "json::some_value")]
    paired: Option<Vec<AxisForm>>,
}

/// Fields that take their values together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    fields: Vec<Field>,
    length: u64,
}

/// A field and its values.
#[derive(Debug, Clone, PartialEq)]
struct Field {
    name: String,
    path: FieldPath,
    values: Values,
}

#[derive(Debug, Clone, PartialEq)]
enum Values {
    List(Vec<Value>),
    /// From one number to another in so many equal steps less one.
    Range {
        from: f64,
        to: f64,
        count: u64,
    },
    /// The same from one whole number to another: values that are whole stay such.
    WholeRange {
        from: i64,
        to: i64,
        count: u64,
    },
}

impl Values {
    fn len(&self) -> u64 {
        match self {
            Self::List(values) => values.len() as u64,
            Self::Range { count, .. } | Self::WholeRange { count, .. } => *count,
        }
    }

    /// The value at a place below the length.
    fn at(&self, place: u64) -> Value {
        match *self {
            Self::List(ref values) => usize::try_from(place).ok().and_then(|place| values.get(place)).cloned(),
            Self::Range { from, to, count } => Some(Value::from(between(from, to, place, count - 1))),
            Self::WholeRange { from, to, count } => Some(whole_between(from, to, place, count - 1)),
        }
        .unwrap_or_default()
    }
}

/// A double tells whole numbers up to this from all their neighbours.
const LARGEST_WHOLE: f64 = 9_007_199_254_740_991.0;

/// The number at `place` of `steps` from one end to the other; both ends exactly.
fn between(from: f64, to: f64, place: u64, steps: u64) -> f64 {
    let (place, steps) = (place as f64, steps as f64);
    let sum = |from: f64, to: f64| from * (steps - place) + to * place;
    if place == 0.0 {
        return from;
    }
    if place == steps {
        return to;
    }
    // Ends that are decimals have decimals between them, as one would write them: one division of whole numbers.
    let of_decimals = (0..=12).map(|digits| 10_f64.powi(digits)).find_map(|scale| {
        let [whole_from, whole_to] = [from, to].map(|end| (end * scale).round());
        let (sum, divisor) = (sum(whole_from, whole_to), steps * scale);
        let is_exact = whole_from / scale == from && whole_to / scale == to;
        let fits = (whole_from.abs().max(whole_to.abs()) * steps).max(divisor) < LARGEST_WHOLE;
        (is_exact && fits).then_some(sum / divisor)
    });
    of_decimals.unwrap_or_else(|| sum(from, to) / steps)
}

/// As [`between`], of whole ends: whole where the steps divide it.
fn whole_between(from: i64, to: i64, place: u64, steps: u64) -> Value {
    let sum = i128::from(from) * i128::from(steps - place) + i128::from(to) * i128::from(place);
    let steps = i128::from(steps);
    match i64::try_from(sum / steps) {
        Ok(whole) if sum % steps == 0 => Value::from(whole),
        Ok(_) | Err(_) => Value::from(sum as f64 / steps as f64),
    }
}

impl Axis {
    /// Reads an axis; what is wrong with it is added to `checks`.
    pub(super) fn of(form: AxisForm, checks: &mut Checks) -> Option<Self> {
        let AxisForm { paired, .. } = form;
        let Some(paired) = paired else { return Self::single(AxisForm { paired: None, ..form }, checks) };
        let is_alone = form.field.is_none() && form.values.is_none() && form.from.is_none();
        checks.require("paired", "not alone", is_alone && form.to.is_none() && form.count.is_none(), FORM_RULE, None);
        checks.length("paired", paired.len(), &LENGTH_RULE);
        let axes = paired.into_iter().enumerate().map(|(index, form)| {
            checks.within(&format!("paired[{index}]"), |checks| {
                checks.require("paired", "paired again", form.paired.is_none(), "`field` with its values", None);
                Self::single(form, checks)
            })
        });
        let axes: Option<Vec<_>> = axes.collect::<Vec<_>>().into_iter().collect();
        let axes = axes?;
        let length = axes.first()?.length;
        for (index, axis) in axes.iter().enumerate() {
            let (field, rule) = (format!("paired[{index}]"), format!("as long as the first: {length} items"));
            checks.require(&field, format!("{} items long", axis.length), axis.length == length, &rule, None);
        }
        Some(Self { fields: axes.into_iter().flat_map(|axis| axis.fields).collect(), length })
    }

    fn single(form: AxisForm, checks: &mut Checks) -> Option<Self> {
        let AxisForm { field, values, from, to, count, paired: _ } = form;
        let is_missing = [("from", from.is_none()), ("to", to.is_none()), ("count", count.is_none())];
        let (fault, values) = match (values, from, to, count) {
            (Some(values), None, None, None) => {
                checks.length("values", values.len(), &LENGTH_RULE);
                (None, Some(Values::List(values.into_iter().map(|StrictValue(value)| value).collect())))
            }
            (None, Some(from), Some(to), Some(count)) => (None, range(&from, &to, count, checks)),
            (Some(_), ..) => (Some(("values", "beside others")), None),
            (None, None, None, None) => (Some(("values", "absent")), None),
            (None, ..) => {
                let missing = is_missing.into_iter().find_map(|(name, is_missing)| is_missing.then_some(name));
                (missing.map(|name| (name, "absent")), None)
            }
        };
        let path = field.as_deref().and_then(FieldPath::parse);
        match &field {
            Some(name) => {
                checks.require(
                    "field",
                    format!("`{name}`"),
                    path.is_some(),
                    "a path such as `maneuver.goal.x_m`",
                    None,
                );
            }
            None => checks.require("field", "absent", false, FORM_RULE, None),
        }
        if let Some((field, is)) = fault {
            checks.require(field, is, false, FORM_RULE, None);
        }
        let (name, path, values) = (field?, path?, values?);
        let length = values.len();
        Some(Self { fields: vec![Field { name, path, values }], length })
    }

    /// How many values it has.
    pub(super) fn len(&self) -> u64 {
        self.length
    }

    /// Its fields.
    pub(super) fn fields(&self) -> impl Iterator<Item = (&str, &FieldPath)> {
        self.fields.iter().map(|field| (field.name.as_str(), &field.path))
    }

    /// Its fields with their values at a place below the length.
    pub(super) fn at(&self, place: u64) -> impl Iterator<Item = (&str, &FieldPath, Value)> {
        self.fields.iter().map(move |field| (field.name.as_str(), &field.path, field.values.at(place)))
    }
}

fn range(from: &Number, to: &Number, count: u64, checks: &mut Checks) -> Option<Values> {
    checks.bounds("count", count as f64, &COUNT_RULE);
    let ends = [("from", from), ("to", to)];
    let values = ends.map(|(name, end)| {
        let value = end.as_f64().unwrap_or(f64::NAN);
        // Far from the largest double, so that sums of the two are numbers.
        let rule = Rule::within_magnitude(if end.is_f64() { 1e150 } else { LARGEST_WHOLE }, "");
        checks.bounds(name, value, &rule);
        rule.admits(value).then_some(value)
    });
    let ([Some(start), Some(end)], true) = (values, COUNT_RULE.admits(count as f64)) else { return None };
    Some(match (from.as_i64(), to.as_i64()) {
        (Some(from), Some(to)) => Values::WholeRange { from, to, count },
        _ => Values::Range { from: start, to: end, count },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_between_are_what_one_would_write() {
        let values = |from, to, steps| (0..=steps).map(|place| between(from, to, place, steps)).collect::<Vec<_>>();
        assert_eq!(values(0.2, 0.7, 5), [0.2, 0.3, 0.4, 0.5, 0.6, 0.7]);
        assert_eq!(values(-0.1, 0.3, 4), [-0.1, 0.0, 0.1, 0.2, 0.3]);
        assert_eq!(values(1.0, 2.0, 3), [1.0, 4.0 / 3.0, 5.0 / 3.0, 2.0]);
        assert_eq!(values(1e150, 3e150, 2), [1e150, 2e150, 3e150]);
    }

    #[test]
    fn whole_ends_have_whole_values_between() {
        let range = Values::WholeRange { from: 0, to: 6, count: 5 };
        let values: Vec<_> = (0..5).map(|place| range.at(place).to_string()).collect();
        assert_eq!(values, ["0", "1.5", "3", "4.5", "6"]);
        // Sums of the two ends are beyond what doubles hold.
        let from = 1_482_007_292_733;
        let range = Values::WholeRange { from, to: 1_488_195_718_263, count: 7416 };
        let expected = (0..7416).map(|place| Value::from(from + 834_582 * place));
        assert!((0..7416).map(|place| range.at(place)).eq(expected));
    }
}
