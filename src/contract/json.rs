//! Strict reading of JSON: objects are objects, nothing is null, and every fault has its place.

mod answers;
mod whole_numbers;

use std::fmt;
use std::marker::PhantomData;
use std::mem;

use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserialize, Deserializer, MapAccess, Visitor};
use serde::{Serialize, Serializer};
use serde_json::error::Category;
use serde_json::value::RawValue;
use serde_json::{Map, Value};
use serde_path_to_error::{Path, Segment};

use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{self, ObjectBuilder, Schema, Type};

pub use self::answers::{Known, KnownField, keep_known};
pub(super) use self::answers::{
    known_object, object_or_none, objects_or_none, read_name_or_null, read_number, read_numbers, value_or_default,
    whole_or_zero,
};
pub use self::whole_numbers::Count;
pub(crate) use self::whole_numbers::some_long_count;
pub(super) use self::whole_numbers::{some_count, whole_number};
use super::error_table::ErrorCode;
use super::problem::{Problem, quoted_path, shortened};
use super::strict_value::StrictValue;

/// Reads a body that must be one JSON object of the form `T`.
///
/// # Errors
/// `malformed_body` with line and column when the bytes are no JSON, `invalid_field` with a pointer when they are, but
/// not of this form.
pub fn read_object<'de, T: Deserialize<'de>>(body: &'de [u8]) -> Result<T, Problem> {
    if body.is_empty() {
        return Err(Problem::new(ErrorCode::MalformedBody, "it is empty"));
    }
    let mut deserializer = serde_json::Deserializer::from_slice(body);
    let Object(value) =
        serde_path_to_error::deserialize(&mut deserializer).map_err(|error| problem_of(error.path(), error.inner()))?;
    deserializer.end().map_err(|error| malformed(&error))?;
    Ok(value)
}

/// Reads a body that must be one JSON object, of any fields, all objects in which have each field once.
///
/// # Errors
/// Those of [`read_object`].
pub fn read_any_object(body: &[u8]) -> Result<Map<String, Value>, Problem> {
    let StrictValue(mut value) = read_object(body)?;
    Ok(value.as_object_mut().map(mem::take).unwrap_or_default())
}

/// The fields of one JSON object, each value as it is written.
///
/// # Errors
/// `malformed_body` with the column when the bytes are no JSON, `invalid_field` when they are no object or name a field
/// twice.
pub fn read_fields(line: &[u8]) -> Result<Vec<(String, &RawValue)>, Problem> {
    let fields: Fields<'_> = serde_json::from_slice(line).map_err(|error| match error.classify() {
        Category::Syntax | Category::Eof | Category::Io => malformed(&error),
        Category::Data => faulty_field("", &without_position(&error)),
    })?;
    let Fields(fields) = fields;
    let twice = (1..fields.len()).find(|&index| fields[..index].iter().any(|(name, _)| *name == fields[index].0));
    match twice {
        Some(index) => Err(faulty_field(&fields[index].0, &format!("duplicate field `{}`", fields[index].0))),
        None => Ok(fields),
    }
}

/// The value of a field.
///
/// # Errors
/// `invalid_field` when it is of another type.
pub fn read_field<'a, T: Deserialize<'a>>(name: &str, value: &'a RawValue) -> Result<T, Problem> {
    serde_json::from_str(value.get()).map_err(|error| faulty_field(name, &without_position(&error)))
}

/// The problem of a field of the body, or of the body itself where the name is empty.
pub fn faulty_field(name: &str, fault: &str) -> Problem {
    let mut pointer = "#".to_owned();
    if !name.is_empty() {
        push_segment(&mut pointer, name);
    }
    let text = format!("{}: {fault}", quoted_path(&pointer));
    Problem::at_field(ErrorCode::InvalidField, pointer, text)
}

/// Most fields that are looked at one by one: far more than any request has.
const MAX_FIELDS: usize = 32;

/// The fields of an object, in their order.
struct Fields<'a>(Vec<(String, &'a RawValue)>);

impl<'de: 'a, 'a> Deserialize<'de> for Fields<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct FieldsVisitor;

        impl<'de> Visitor<'de> for FieldsVisitor {
            type Value = Fields<'de>;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Fields<'de>, A::Error> {
                let mut fields = Vec::new();
                while let Some(field) = map.next_entry()? {
                    fields.push(field);
                    if fields.len() > MAX_FIELDS {
                        return Err(de::Error::custom(format_args!("more than {MAX_FIELDS} fields")));
                    }
                }
                Ok(Fields(fields))
            }
        }

        deserializer.deserialize_any(FieldsVisitor)
    }
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
            let text = format!("{}: {}", quoted_path(&pointer), with_short_words(&message));
            Problem::at_field(ErrorCode::InvalidField, pointer, text)
        }
    }
}

/// What of a message tells what was found from what was expected.
const EXPECTED: &str = ", expected ";
/// Longest word of the caller that a message repeats with what was expected in its place, characters.
const MAX_WORD: usize = 200;

/// A message in which the caller's words are cut, and what was expected is not.
fn with_short_words(message: &str) -> String {
    match message.rsplit_once(EXPECTED) {
        Some((found, expected)) => shortened(found.to_owned(), MAX_WORD) + EXPECTED + expected,
        None => message.to_owned(),
    }
}

fn malformed(error: &serde_json::Error) -> Problem {
    Problem::new(ErrorCode::MalformedBody, error.to_string())
}

fn without_position(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let position = format!(" at line {} column {}", error.line(), error.column());
    in_words_of_json(text.strip_suffix(&position).unwrap_or(&text))
}

/// With types by the names that callers know them by, in place of those of Rust.
fn in_words_of_json(message: &str) -> String {
    let Some((found, expected)) = message.rsplit_once(EXPECTED) else { return message.to_owned() };
    let found = match found {
        "invalid type: sequence" => "invalid type: list",
        "invalid type: map" => "invalid type: object",
        other => other,
    };
    let expected = match expected {
        "f64" => "a number",
        "u32" | "u64" => "a whole number, at least 0",
        "i32" | "i64" => "a whole number",
        "a sequence" => "a list",
        other => other,
    };
    [found, EXPECTED, expected].concat()
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

/// A `T` that is written as a JSON object; serde alone would take an array of the fields too.
struct Object<T>(T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Object<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        object(deserializer).map(Object)
    }
}

/// Reads an object and nothing else.
fn object<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
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
pub(super) fn some_object<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    object(deserializer).map(Some)
}

/// Reads an array of objects and nothing else.
pub(super) fn objects<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    let objects = Vec::<Object<T>>::deserialize(deserializer)?;
    Ok(objects.into_iter().map(|Object(object)| object).collect())
}

/// Reads an array of objects of an optional field that is present.
pub(crate) fn some_objects<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<Vec<T>>, D::Error> {
    objects(deserializer).map(Some)
}

/// Reads the value of an optional field that is present; `null` is no value.
pub(crate) fn some_value<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    T::deserialize(deserializer).map(Some)
}

/// An enum that JSON writes by name; implemented for all enums of `proto/` by the build.
pub trait Named: TryFrom<i32> + 'static {
    /// What it is about.
    const MEANING: &'static str;
    /// Number, name and meaning of each value; the unspecified one has no name.
    const NAMES: &'static [(i32, &'static str, &'static str)];

    /// The name of a value, if it has one.
    fn name_of(number: i32) -> Option<&'static str> {
        Self::NAMES.iter().find(|(of, ..)| *of == number).map(|(_, name, _)| *name)
    }
}

/// Writes the number of an enum as its name; the unspecified one as null.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes fields by reference")]
pub(super) fn write_name<S: Serializer, T: Named>(number: &i32, serializer: S) -> Result<S::Ok, S::Error> {
    T::name_of(*number).serialize(serializer)
}

/// Whether an enum has the value without a name.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes fields by reference")]
pub(super) fn is_unspecified(number: &i32) -> bool {
    *number == 0
}

/// Reads the number of an enum from its name and nothing else.
pub(super) fn read_name<'de, D: Deserializer<'de>, T: Named>(deserializer: D) -> Result<i32, D::Error> {
    struct NameVisitor<T>(PhantomData<T>);

    impl<T: Named> Visitor<'_> for NameVisitor<T> {
        type Value = i32;

        fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
            let names: Vec<_> = T::NAMES.iter().map(|(_, name, _)| format!("\"{name}\"")).collect();
            write!(formatter, "{}", names.join(" or "))
        }

        fn visit_str<E: de::Error>(self, text: &str) -> Result<i32, E> {
            let found = T::NAMES.iter().find(|(_, name, _)| *name == text);
            found.map(|(number, ..)| *number).ok_or_else(|| E::invalid_value(de::Unexpected::Str(text), &self))
        }
    }

    deserializer.deserialize_str(NameVisitor(PhantomData::<T>))
}

/// Gives an enum the schema of its names.
macro_rules! schema_of_names {
    ($name:ident) => {
        impl ::utoipa::PartialSchema for $name {
            fn schema() -> ::utoipa::openapi::RefOr<::utoipa::openapi::Schema> {
                crate::contract::json::schema_of::<Self>()
            }
        }

        impl ::utoipa::ToSchema for $name {}
    };
}
pub(super) use schema_of_names;

pub(super) fn schema_of<T: Named>() -> RefOr<Schema> {
    let meanings = T::NAMES.iter().map(|(_, name, meaning)| format!("- `{name}`: {meaning}"));
    let description = std::iter::once(T::MEANING.to_owned()).chain(meanings).collect::<Vec<_>>().join("\n");
    let object = ObjectBuilder::new()
        .schema_type(schema::SchemaType::Type(Type::String))
        .description(Some(description))
        .enum_values(Some(T::NAMES.iter().map(|(_, name, _)| *name)));
    RefOr::T(object.build().into())
}

/// A message as JSON.
///
/// # Panics
/// Never: messages are names and numbers.
pub fn write<T: Serialize>(message: &T) -> Vec<u8> {
    serde_json::to_vec(message).expect("a message of names and numbers is valid JSON")
}
