//! Whole numbers, also where a table of numbers has written 200 as 200.0.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{self, Deserialize, Deserializer, Unexpected, Visitor};

/// A whole number of its type.
pub(super) struct Whole<T>(pub(super) T);

impl<'de, T: TryFrom<i128>> Deserialize<'de> for Whole<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(WholeVisitor(PhantomData)).map(Self)
    }
}

struct WholeVisitor<T>(PhantomData<T>);

impl<T: TryFrom<i128>> Visitor<'_> for WholeVisitor<T> {
    type Value = T;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let has_sign = T::try_from(-1).is_ok();
        formatter.write_str(if has_sign { "a whole number" } else { "a whole number, at least 0" })
    }

    fn visit_u64<E: de::Error>(self, number: u64) -> Result<T, E> {
        T::try_from(number.into()).map_err(|_| E::invalid_value(Unexpected::Unsigned(number), &self))
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<T, E> {
        T::try_from(number.into()).map_err(|_| E::invalid_value(Unexpected::Signed(number), &self))
    }

    fn visit_f64<E: de::Error>(self, number: f64) -> Result<T, E> {
        if number.fract() != 0.0 {
            return Err(E::invalid_type(Unexpected::Float(number), &self));
        }
        #[expect(clippy::cast_possible_truncation, reason = "whole, and casts saturate")]
        T::try_from(number as i128).map_err(|_| E::invalid_value(Unexpected::Float(number), &self))
    }
}

/// A count; one beyond the type is far above every limit, and the largest is refused just the same.
pub struct Count(pub u64);

impl TryFrom<i128> for Count {
    type Error = ();

    fn try_from(number: i128) -> Result<Self, ()> {
        if number < 0 { Err(()) } else { Ok(Self(u64::try_from(number).unwrap_or(u64::MAX))) }
    }
}

impl Count {
    /// The same, as far as fewer bits hold it.
    pub fn saturated(&self) -> u32 {
        u32::try_from(self.0).unwrap_or(u32::MAX)
    }
}

impl<'de> Deserialize<'de> for Count {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Whole::deserialize(deserializer).map(|Whole(count)| count)
    }
}

/// Reads a count that is present.
pub(in crate::contract) fn some_count<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u32>, D::Error> {
    Count::deserialize(deserializer).map(|count| Some(count.saturated()))
}

/// Reads a long count that is present.
pub(crate) fn some_long_count<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u64>, D::Error> {
    Count::deserialize(deserializer).map(|Count(count)| Some(count))
}

/// Reads a whole number that keeps each of its digits.
pub(in crate::contract) fn whole_number<'de, D: Deserializer<'de>, T: TryFrom<i128>>(
    deserializer: D,
) -> Result<T, D::Error> {
    Whole::deserialize(deserializer).map(|Whole(number)| number)
}
