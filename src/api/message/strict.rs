//! Strict reading of JSON: objects are objects, nothing is null, and every fault has its place.

use std::fmt;
use std::marker::PhantomData;

use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserialize, Deserializer, MapAccess, Visitor};
use serde::{Serialize, Serializer};
use serde_json::error::Category;
use serde_path_to_error::{Path, Segment};

use crate::api::error_table::ErrorCode;
use crate::api::problem::Problem;

/// Reads a body that must be one JSON object of the form `T`.
///
/// # Errors
/// `malformed_body` with line and column when the bytes are no JSON, `invalid_field` with a pointer when they are, but
/// not of this form.
pub(in crate::api) fn read_object<'de, T: Deserialize<'de>>(body: &'de [u8]) -> Result<T, Problem> {
    let mut deserializer = serde_json::Deserializer::from_slice(body);
    let Object(value) =
        serde_path_to_error::deserialize(&mut deserializer).map_err(|error| problem_of(error.path(), error.inner()))?;
    deserializer.end().map_err(|error| malformed(&error))?;
    Ok(value)
}

fn problem_of(path: &Path, error: &serde_json::Error) -> Problem {
    match error.classify() {
        Category::Syntax | Category::Eof | Category::Io => malformed(error),
        Category::Data => {
            let message = without_position(error);
            let mut pointer = pointer_of(path);
            // These two faults are found one level above the field that they speak of.
            if let Some(field) = field_named_in(&message, &["missing field `", "duplicate field `"]) {
                push_segment(&mut pointer, field);
            }
            let text = format!("`{}`: {message}", dotted(&pointer));
            Problem::at_field(ErrorCode::InvalidField, pointer, text)
        }
    }
}

fn malformed(error: &serde_json::Error) -> Problem {
    Problem::new(ErrorCode::MalformedBody, error.to_string())
}

fn without_position(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let position = format!(" at line {} column {}", error.line(), error.column());
    text.strip_suffix(&position).map_or_else(|| text.clone(), str::to_owned)
}

fn field_named_in<'a>(message: &'a str, beginnings: &[&str]) -> Option<&'a str> {
    let rest = beginnings.iter().find_map(|beginning| message.strip_prefix(beginning))?;
    rest.strip_suffix('`')
}

fn pointer_of(path: &Path) -> String {
    let mut pointer = "#".to_owned();
    for segment in path {
        match segment {
            Segment::Seq { index } => push_segment(&mut pointer, &index.to_string()),
            Segment::Map { key } => push_segment(&mut pointer, key),
            Segment::Enum { variant } => push_segment(&mut pointer, variant),
            // Where the key itself is unreadable the pointer ends at its object.
            Segment::Unknown => {}
        }
    }
    pointer
}

/// Longest key of the caller that a pointer repeats, characters.
const MAX_KEY: usize = 100;

fn push_segment(pointer: &mut String, segment: &str) {
    pointer.push('/');
    for character in segment.chars().take(MAX_KEY) {
        match character {
            '~' => pointer.push_str("~0"),
            '/' => pointer.push_str("~1"),
            _ => pointer.push(character),
        }
    }
}

fn dotted(pointer: &str) -> String {
    let path = pointer.trim_start_matches(['#', '/']);
    if path.is_empty() { "body".to_owned() } else { path.replace('/', ".") }
}

/// A `T` that is written as a JSON object; serde alone would take an array of the fields too.
struct Object<T>(T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Object<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        object(deserializer).map(Object)
    }
}

/// Reads an object and nothing else.
pub(in crate::api) fn object<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
    struct ObjectVisitor<T>(PhantomData<T>);

    impl<'de, T: Deserialize<'de>> Visitor<'de> for ObjectVisitor<T> {
        type Value = T;

        fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
            formatter.write_str("an object")
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
            T::deserialize(MapAccessDeserializer::new(map))
        }
    }

    deserializer.deserialize_any(ObjectVisitor(PhantomData))
}

/// Reads the object of an optional field that is present.
pub(in crate::api) fn some_object<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    object(deserializer).map(Some)
}

/// Reads the value of an optional field that is present; `null` is no value.
pub(in crate::api) fn some_value<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    T::deserialize(deserializer).map(Some)
}

/// An enum of the domain that the contract writes by name.
pub(in crate::api) trait Named: Copy + 'static {
    /// All its values.
    const ALL: &'static [Self];

    /// The name in the contract.
    fn name(self) -> &'static str;
}

/// Writes a named enum.
pub(in crate::api) fn write_name<T: Named, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    value.name().serialize(serializer)
}

/// Reads a named enum from its name and nothing else.
pub(in crate::api) fn read_name<'de, D: Deserializer<'de>, T: Named>(deserializer: D) -> Result<T, D::Error> {
    struct NameVisitor<T>(PhantomData<T>);

    impl<T: Named> Visitor<'_> for NameVisitor<T> {
        type Value = T;

        fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
            let names: Vec<_> = T::ALL.iter().map(|value| format!("\"{}\"", value.name())).collect();
            write!(formatter, "{}", names.join(" or "))
        }

        fn visit_str<E: de::Error>(self, text: &str) -> Result<T, E> {
            let found = T::ALL.iter().copied().find(|value| value.name() == text);
            found.ok_or_else(|| E::invalid_value(de::Unexpected::Str(text), &self))
        }
    }

    deserializer.deserialize_str(NameVisitor(PhantomData))
}
