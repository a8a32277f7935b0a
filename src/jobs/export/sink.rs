//! Messages of ROS 2 written field by field: in CDR, as bags and topics carry them, or in JSON.

use std::fmt::Write as _;

/// Takes a message, field by field in the order of its definition.
pub(super) trait Sink {
    /// A message in a field; without a name the message itself, or one of an array.
    fn message(&mut self, name: &str, fields: impl FnOnce(&mut Self));
    /// An array of unbounded length.
    fn array<T>(&mut self, name: &str, items: impl ExactSizeIterator<Item = T>, each: impl FnMut(&mut Self, T));
    /// A `string`.
    fn text(&mut self, name: &str, text: &str);
    /// An `int32`.
    fn int32(&mut self, name: &str, value: i32);
    /// A `uint32`.
    fn uint32(&mut self, name: &str, value: u32);
    /// A `float64`; NaN where there is none.
    fn float64(&mut self, name: &str, value: f64);

    /// A `float64[]`.
    fn float64s(&mut self, name: &str, values: &[f64]) {
        self.array(name, values.iter(), |sink, value| sink.float64("", *value));
    }
}

/// Plain CDR, little-endian: each number is aligned to its own size, counted from behind the header of four bytes.
pub(super) struct Cdr(Vec<u8>);

/// Version 1, little-endian, no options.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

impl Cdr {
    /// A message in CDR.
    pub(super) fn of(message: impl FnOnce(&mut Self)) -> Vec<u8> {
        let mut cdr = Self(ENCAPSULATION.to_vec());
        message(&mut cdr);
        cdr.0
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        let length = self.0.len() - ENCAPSULATION.len();
        self.0.resize(ENCAPSULATION.len() + length.next_multiple_of(N), 0);
        self.0.extend(bytes);
    }

    fn length(&mut self, length: usize) {
        self.number(u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes());
    }
}

impl Sink for Cdr {
    fn message(&mut self, _name: &str, fields: impl FnOnce(&mut Self)) {
        fields(self);
    }

    fn array<T>(&mut self, _name: &str, items: impl ExactSizeIterator<Item = T>, mut each: impl FnMut(&mut Self, T)) {
        self.length(items.len());
        items.for_each(|item| each(self, item));
    }

    /// With the zero at its end, which counts.
    fn text(&mut self, _name: &str, text: &str) {
        self.length(text.len() + 1);
        self.0.extend(text.bytes().chain([0]));
    }

    fn int32(&mut self, _name: &str, value: i32) {
        self.number(value.to_le_bytes());
    }

    fn uint32(&mut self, _name: &str, value: u32) {
        self.number(value.to_le_bytes());
    }

    fn float64(&mut self, _name: &str, value: f64) {
        self.number(value.to_le_bytes());
    }
}

/// JSON with the names of the fields; null for numbers that are not finite.
pub(super) struct Json(String);

impl Json {
    /// A message in JSON.
    pub(super) fn of(message: impl FnOnce(&mut Self)) -> Vec<u8> {
        let mut json = Self(String::new());
        message(&mut json);
        json.0.push('\n');
        json.0.into_bytes()
    }

    /// What comes before a value: a comma after another one, and its name where it has one.
    fn begin(&mut self, name: &str) {
        if !(self.0.is_empty() || self.0.ends_with(['{', '['])) {
            self.0.push(',');
        }
        if !name.is_empty() {
            self.value(format_args!("\"{name}\":"));
        }
    }

    fn value(&mut self, value: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.0.write_fmt(value);
    }
}

impl Sink for Json {
    fn message(&mut self, name: &str, fields: impl FnOnce(&mut Self)) {
        self.begin(name);
        self.0.push('{');
        fields(self);
        self.0.push('}');
    }

    fn array<T>(&mut self, name: &str, items: impl ExactSizeIterator<Item = T>, mut each: impl FnMut(&mut Self, T)) {
        self.begin(name);
        self.0.push('[');
        items.for_each(|item| each(self, item));
        self.0.push(']');
    }

    fn text(&mut self, name: &str, text: &str) {
        self.begin(name);
        self.value(format_args!("{}", serde_json::Value::from(text)));
    }

    fn int32(&mut self, name: &str, value: i32) {
        self.begin(name);
        self.value(format_args!("{value}"));
    }

    fn uint32(&mut self, name: &str, value: u32) {
        self.begin(name);
        self.value(format_args!("{value}"));
    }

    fn float64(&mut self, name: &str, value: f64) {
        self.begin(name);
        if value.is_finite() {
            // Of large and small numbers this form is the short one.
            self.value(format_args!("{value:?}"));
        } else {
            self.0.push_str("null");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example(sink: &mut impl Sink) {
        sink.message("", |sink| {
            sink.text("name", "a\"b");
            sink.float64s("numbers", &[1.0, f64::NAN]);
            sink.float64s("none", &[]);
            sink.message("time", |sink| {
                sink.int32("sec", -1);
                sink.uint32("nanosec", 7);
            });
            sink.float64("large", 1e300);
        });
    }

    #[test]
    fn cdr_aligns_numbers_to_their_size_behind_the_header() {
        let mut bytes = vec![0, 1, 0, 0];
        bytes.extend([4, 0, 0, 0, b'a', b'"', b'b', 0, 2, 0, 0, 0, 0, 0, 0, 0]);
        bytes.extend(1.0_f64.to_le_bytes());
        bytes.extend(f64::NAN.to_le_bytes());
        bytes.extend([0, 0, 0, 0, 255, 255, 255, 255, 7, 0, 0, 0, 0, 0, 0, 0]);
        bytes.extend(1e300_f64.to_le_bytes());
        assert_eq!(Cdr::of(example), bytes);
    }

    #[test]
    fn json_has_null_for_absent_numbers() {
        let text = "{\"name\":\"a\\\"b\",\"numbers\":[1.0,null],\"none\":[],\"time\":{\"sec\":-1,\"nanosec\":7},\"large\":1e300}\n";
        assert_eq!(String::from_utf8(Json::of(example)).unwrap(), text);
    }
}
