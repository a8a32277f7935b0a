//! Answers that callers hand back: null is a default, and what is not known is ignored.

use std::marker::PhantomData;

use serde::de::{self, Deserialize, DeserializeOwned, Deserializer};
use serde_json::Value;

use super::whole_numbers::Whole;
use super::{Named, Object, in_words_of_json, pointer_of, read_name};
use crate::contract::StrictValue;
use crate::contract::problem::quoted_path;

/// Reads a number of an answer; null is one that is not finite.
pub(in crate::contract) fn read_number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Option::deserialize(deserializer).map(|number| number.unwrap_or(f64::NAN))
}

/// Reads numbers of an answer; null is one that is not finite.
pub(in crate::contract) fn read_numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    let numbers = Vec::<Option<f64>>::deserialize(deserializer)?;
    Ok(numbers.into_iter().map(|number| number.unwrap_or(f64::NAN)).collect())
}

/// Reads a value of an answer; null is its default.
pub(in crate::contract) fn value_or_default<'de, D: Deserializer<'de>, T: Deserialize<'de> + Default>(
    deserializer: D,
) -> Result<T, D::Error> {
    Option::deserialize(deserializer).map(Option::unwrap_or_default)
}

/// A field of an object, and how to forget what is not known in its own objects.
pub type KnownField = (&'static str, Option<fn(&mut Value)>);

/// A message that is strict in requests; implemented for all of them by the build.
pub trait Known {
    /// All fields.
    const FIELDS: &'static [KnownField];
}

/// Forgets null and what is not known in an object, or in each of an array.
pub fn keep_known<T: Known>(value: &mut Value) {
    if let Some(object) = value.as_object_mut() {
        object.retain(|name, value| {
            let known = T::FIELDS.iter().find(|(field, _)| field == name);
            if let Some((_, Some(keep_known))) = known {
                keep_known(value);
            }
            known.is_some() && !value.is_null()
        });
    }
    value.as_array_mut().into_iter().flatten().for_each(keep_known::<T>);
}

/// Reads an object of an answer that would be strict in a request; null is none.
pub(in crate::contract) fn known_object<'de, D: Deserializer<'de>, T: Known + DeserializeOwned>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    let Some(Object(StrictValue(mut value))) = Option::deserialize(deserializer)? else { return Ok(None) };
    keep_known::<T>(&mut value);
    serde_path_to_error::deserialize(value).map(Some).map_err(|fault| {
        let (pointer, words) = (pointer_of(fault.path()), in_words_of_json(&fault.inner().to_string()));
        // The path that the caller is told ends at the object.
        if pointer == "#" { de::Error::custom(words) } else { de::Error::custom(quoted_path(&pointer) + ": " + &words) }
    })
}

/// Reads an object of an answer; null is none.
pub(in crate::contract) fn object_or_none<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    let object = Option::<Object<T>>::deserialize(deserializer)?;
    Ok(object.map(|Object(object)| object))
}

/// Reads an array of objects of an answer; null is an empty one.
pub(in crate::contract) fn objects_or_none<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    let objects = Option::<Vec<Object<T>>>::deserialize(deserializer)?;
    Ok(objects.unwrap_or_default().into_iter().map(|Object(object)| object).collect())
}

/// Reads a whole number of an answer; null is 0.
pub(in crate::contract) fn whole_or_zero<'de, D: Deserializer<'de>, T: TryFrom<i128> + Default>(
    deserializer: D,
) -> Result<T, D::Error> {
    Option::deserialize(deserializer).map(|number| number.map_or_else(T::default, |Whole(number)| number))
}

/// Reads the number of an enum of an answer from its name; null is the unspecified one.
pub(in crate::contract) fn read_name_or_null<'de, D: Deserializer<'de>, T: Named>(
    deserializer: D,
) -> Result<i32, D::Error> {
    struct Name<T>(i32, PhantomData<T>);

    impl<'de, T: Named> Deserialize<'de> for Name<T> {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            read_name::<D, T>(deserializer).map(|number| Self(number, PhantomData))
        }
    }

    let name = Option::<Name<T>>::deserialize(deserializer)?;
    Ok(name.map_or(0, |Name(number, _)| number))
}
