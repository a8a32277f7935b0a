//! Digests of JSON answers by their values.
//!
//! Values are hashed in the order in which they are written, with marks where arrays and objects begin and end. Names of
//! fields are not hashed: a rename in the contract keeps the digest, a changed value, order or nesting does not.

use std::fmt::{Formatter, Result as Formatted, Write as _};

use serde::Deserializer;
use serde::de::{DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use sha2::{Digest as _, Sha256};

/// Fields that differ between equal answers: wall time, and the version that a release changes.
const PASSED_OVER: [&str; 2] = ["solve_time_s", "solver_version"];
/// Integers up to this magnitude are exact as floating-point numbers.
const LARGEST_EXACT: u64 = 1 << 53;

/// Digest of a JSON document.
///
/// # Errors
/// Bytes that are no JSON document.
pub(crate) fn digest_of_values(json: &[u8]) -> serde_json::Result<String> {
    let mut hash = Sha256::new();
    let mut document = serde_json::Deserializer::from_slice(json);
    Values(&mut hash).deserialize(&mut document)?;
    document.end()?;
    Ok(hexadecimal(&hash.finalize()))
}

/// Digest of bytes.
pub(crate) fn digest(bytes: impl AsRef<[u8]>) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut digits, byte| {
        // Writing to a string cannot fail.
        let _ = write!(digits, "{byte:02x}");
        digits
    })
}

/// Hashes whatever value comes next.
struct Values<'a>(&'a mut Sha256);

impl Values<'_> {
    /// The kind keeps apart what has the same bytes, the length what follows.
    fn text(&mut self, kind: u8, text: &str) {
        self.0.update([kind]);
        self.0.update((text.len() as u64).to_le_bytes());
        self.0.update(text);
    }
}

impl<'de> DeserializeSeed<'de> for Values<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, document: D) -> Result<(), D::Error> {
        document.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Values<'_> {
    type Value = ();

    fn expecting(&self, formatter: &mut Formatter<'_>) -> Formatted {
        formatter.write_str("any value")
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        self.0.update(b"0");
        Ok(())
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        self.0.update(if value { b"t" } else { b"f" });
        Ok(())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        self.0.update(b"n");
        self.0.update(value.to_bits().to_le_bytes());
        Ok(())
    }

    // An integer and the equal floating-point number are the same value, whichever type a field has.
    fn visit_u64<E: Error>(mut self, value: u64) -> Result<(), E> {
        if value <= LARGEST_EXACT {
            return self.visit_f64(value as f64);
        }
        self.text(b'i', &value.to_string());
        Ok(())
    }

    fn visit_i64<E: Error>(mut self, value: i64) -> Result<(), E> {
        if value.unsigned_abs() <= LARGEST_EXACT {
            return self.visit_f64(value as f64);
        }
        self.text(b'i', &value.to_string());
        Ok(())
    }

    fn visit_str<E: Error>(mut self, value: &str) -> Result<(), E> {
        self.text(b's', value);
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<(), A::Error> {
        self.0.update(b"[");
        while items.next_element_seed(Values(self.0))?.is_some() {}
        self.0.update(b"]");
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<(), A::Error> {
        self.0.update(b"{");
        while let Some(name) = fields.next_key::<String>()? {
            if PASSED_OVER.contains(&name.as_str()) {
                fields.next_value::<IgnoredAny>()?;
            } else {
                fields.next_value_seed(Values(self.0))?;
            }
        }
        self.0.update(b"}");
        Ok(())
    }
}
