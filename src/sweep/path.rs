//! Paths of fields as refusals write them: `maneuver.goal.x_m`, `robot.footprint[0].right_m`.

use std::fmt;

use serde_json::{Map, Value};

/// The path of a field in a request or an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct FieldPath(Vec<Segment>);

#[derive(Debug, Clone, PartialEq, Eq)]
enum Segment {
    Name(String),
    Index(usize),
}

impl FieldPath {
    /// Reads a path: names with dots between them, places of arrays in brackets.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let mut segments = Vec::new();
        for part in text.split('.') {
            let (name, places) = part.split_at(part.find('[').unwrap_or(part.len()));
            if name.is_empty() || name.contains(']') {
                return None;
            }
            segments.push(Segment::Name(name.to_owned()));
            for place in places.split_terminator(']') {
                segments.push(Segment::Index(place.strip_prefix('[')?.parse().ok()?));
            }
            if !places.is_empty() && !places.ends_with(']') {
                return None;
            }
        }
        Some(Self(segments))
    }

    /// The value at this path, if there is one.
    pub(super) fn of<'a>(&self, root: &'a Value) -> Option<&'a Value> {
        self.0.iter().try_fold(root, |value, segment| match segment {
            Segment::Name(name) => value.get(name),
            Segment::Index(index) => value.get(index),
        })
    }

    /// Puts a value at this path; objects on the way that are not there are made.
    ///
    /// # Errors
    /// Where something on the way is no object or no such place of an array: its path, and what it is.
    pub(super) fn put(&self, root: &mut Value, value: Value) -> Result<(), String> {
        let mut at = root;
        for (depth, segment) in self.0.iter().enumerate() {
            let here = || Self(self.0[..depth].to_vec());
            at = match segment {
                Segment::Name(name) => {
                    if at.is_null() {
                        *at = Value::Object(Map::new());
                    }
                    let kind = kind_of(at);
                    let object = at.as_object_mut();
                    let object = object.ok_or_else(|| format!("`{}` is {kind}", here()))?;
                    object.entry(name).or_insert(Value::Null)
                }
                Segment::Index(index) => {
                    let length = at.as_array().map(Vec::len);
                    let found = at.get_mut(index);
                    found.ok_or_else(|| match length {
                        Some(length) => format!("`{}` has {length} items", here()),
                        None => format!("`{}` is no array", here()),
                    })?
                }
            };
        }
        *at = value;
        Ok(())
    }

    /// Whether one of the two fields is the other or holds it.
    pub(super) fn overlaps(&self, other: &Self) -> bool {
        self.0.iter().zip(&other.0).all(|(one, another)| one == another)
    }
}

impl fmt::Display for FieldPath {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (depth, segment) in self.0.iter().enumerate() {
            match segment {
                Segment::Name(name) if depth == 0 => write!(formatter, "{name}")?,
                Segment::Name(name) => write!(formatter, ".{name}")?,
                Segment::Index(index) => write!(formatter, "[{index}]")?,
            }
        }
        Ok(())
    }
}

fn kind_of(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a text",
        Value::Array(_) => "an array",
        Value::Object(_) => "an object",
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn paths_are_read_and_written_alike() {
        for text in ["view", "maneuver.goal.x_m", "robot.footprint[0].right_m", "a[1][2].b"] {
            assert_eq!(FieldPath::parse(text).unwrap().to_string(), text);
        }
        for text in ["", ".", "a..b", "a.", "[0]", "a[", "a[]", "a[x]", "a[0]b", "a]", "a[-1]"] {
            assert_eq!(FieldPath::parse(text), None, "{text}");
        }
    }

    #[test]
    fn values_are_put_where_objects_lead() {
        let mut root = json!({"a": {"b": 1}, "list": [{"c": 2}]});
        let put = |root: &mut Value, path: &str, value: Value| FieldPath::parse(path).unwrap().put(root, value);
        put(&mut root, "a.d.e", json!(3)).unwrap();
        put(&mut root, "list[0].c", json!(4)).unwrap();
        assert_eq!(root, json!({"a": {"b": 1, "d": {"e": 3}}, "list": [{"c": 4}]}));
        assert_eq!(FieldPath::parse("list[0].c").unwrap().of(&root), Some(&json!(4)));
        assert_eq!(FieldPath::parse("list[1].c").unwrap().of(&root), None);
        let fault = |root: &mut Value, path: &str| put(root, path, json!(5)).unwrap_err();
        assert_eq!(fault(&mut root, "a.b.c"), "`a.b` is a number");
        assert_eq!(fault(&mut root, "list[1].c"), "`list` has 1 items");
        assert_eq!(fault(&mut root, "a[0]"), "`a` is no array");
    }

    #[test]
    fn a_field_overlaps_what_holds_it() {
        let overlap =
            |one: &str, other: &str| FieldPath::parse(one).unwrap().overlaps(&FieldPath::parse(other).unwrap());
        assert!(overlap("maneuver.goal", "maneuver.goal.x_m") && overlap("a[0].b", "a"));
        assert!(!overlap("maneuver.goal", "maneuver.start") && !overlap("a[0]", "a[1]"));
    }
}
