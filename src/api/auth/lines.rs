//! The text of a key file: which keys there are, and whose they are.
//!
//! Keys stand on lines of their own, or are separated by commas or white space: `NAME:KEY`, `NAME:sha256:HEX`,
//! `sha256:HEX`, or a key alone. `HEX` is the SHA-256 of a key, so that the file need not hold the key itself. From `#`, where an entry
//! could begin, to the end of its line is a comment.

use super::{Hash, hash};

/// Longest name, characters: short enough for lines of the log and labels of metrics.
const MAX_NAME: usize = 32;
/// Stands before a hash, and is therefore no name.
const HASH_MARK: &str = "sha256";

/// All faults of a text with keys; none of them repeats a key.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the API keys cannot be used: {}", .faults.join("; "))]
pub struct KeyFaults {
    /// One sentence for each fault, with its line.
    pub faults: Vec<String>,
}

/// One key of a text.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct KeyLine {
    /// Whose it is; none: nobody's in particular.
    pub(super) name: Option<String>,
    pub(super) hash: Hash,
}

/// All keys of a text.
///
/// # Errors
/// Every key that cannot be read, and every key that two callers would share.
pub(super) fn read(text: &str) -> Result<Vec<KeyLine>, KeyFaults> {
    let (mut keys, mut faults) = (Vec::new(), Vec::new());
    for (place, entry) in entries(text) {
        match key_of(entry) {
            Ok(key) => keys.push((place, key)),
            Err(fault) => faults.push(format!("{place}: {fault}")),
        }
    }
    for (index, (place, key)) in keys.iter().enumerate() {
        let shared = keys[..index].iter().find(|(_, other)| other.hash == key.hash && other.name != key.name);
        faults.extend(shared.map(|(other, _)| format!("{place}: the same key as in {other}, with another name")));
    }
    if faults.is_empty() { Ok(keys.into_iter().map(|(_, key)| key).collect()) } else { Err(KeyFaults { faults }) }
}

/// The entries of a text, each with its place in words.
fn entries(text: &str) -> impl Iterator<Item = (String, &str)> {
    text.lines().enumerate().flat_map(|(line, content)| {
        let separated = content.split(|character: char| character == ',' || character.is_whitespace());
        let written = separated.filter(|entry| !entry.is_empty());
        let entries: Vec<_> = written.take_while(|entry| !entry.starts_with('#')).collect();
        let is_alone = entries.len() == 1;
        entries.into_iter().enumerate().map(move |(index, entry)| {
            let place = format!("line {}", line + 1);
            (if is_alone { place } else { format!("{place}, key {}", index + 1) }, entry)
        })
    })
}

fn key_of(entry: &str) -> Result<KeyLine, String> {
    // A header of a request holds no others that would be compared.
    if !entry.bytes().all(|byte| byte.is_ascii_graphic()) {
        return Err("a key has visible ASCII characters alone".to_owned());
    }
    let Some((first, rest)) = entry.split_once(':') else { return Ok(KeyLine { name: None, hash: hash(entry) }) };
    if first == HASH_MARK {
        return Ok(KeyLine { name: None, hash: hash_in(rest)? });
    }
    if !is_name(first) {
        let rule =
            "a key with a colon needs a name before it (NAME:KEY) of 1 to 32 of the characters a-z, 0-9, _ and -";
        return Err(rule.to_owned());
    }
    let hash = match rest.split_once(':') {
        Some((HASH_MARK, digits)) => hash_in(digits)?,
        _ if rest.is_empty() => return Err("after the name there is no key".to_owned()),
        _ => hash(rest),
    };
    Ok(KeyLine { name: Some(first.to_owned()), hash })
}

fn is_name(text: &str) -> bool {
    let is_allowed = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || matches!(byte, b'_' | b'-');
    (1..=MAX_NAME).contains(&text.len()) && text.bytes().all(is_allowed)
}

/// The hash that 64 hexadecimal digits say. Anything else after the mark is a hash that was cut off, not a key.
fn hash_in(digits: &str) -> Result<Hash, String> {
    let fault = || format!("after `{HASH_MARK}:` there must be 64 hexadecimal digits");
    let (pairs, rest) = digits.as_bytes().as_chunks::<2>();
    let bytes: Option<Vec<u8>> = pairs.iter().map(|&[high, low]| Some(digit(high)? << 4 | digit(low)?)).collect();
    bytes.filter(|_| rest.is_empty()).and_then(|bytes| bytes.try_into().ok()).ok_or_else(fault)
}

fn digit(character: u8) -> Option<u8> {
    char::from(character).to_digit(16).and_then(|digit| u8::try_from(digit).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SHA-256 of `abc` (FIPS 180-2, appendix B.1).
    const ABC: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

    fn key(name: Option<&str>, key: &str) -> KeyLine {
        KeyLine { name: name.map(str::to_owned), hash: hash(key) }
    }

    fn faults(text: &str) -> Vec<String> {
        read(text).unwrap_err().faults
    }

    #[test]
    fn every_form_of_a_key_is_read() {
        let text = format!("plain\nfleet-1:named\r\nfleet_2:with:colon, second\n\nsha256:{ABC}\n");
        let expected = [
            key(None, "plain"),
            key(Some("fleet-1"), "named"),
            key(Some("fleet_2"), "with:colon"),
            key(None, "second"),
            key(None, "abc"),
        ];
        assert_eq!(read(&text).unwrap(), expected);
        assert_eq!(read(&format!("a:sha256:{}", ABC.to_uppercase())).unwrap(), [key(Some("a"), "abc")]);
        assert_eq!(read(" ,\n").unwrap(), []);
        let text = "# keys of the north fleet\nfleet-1:a#b # since Monday, fleet-1:old\n#fleet-1:leaked\nplain,#";
        assert_eq!(read(text).unwrap(), [key(Some("fleet-1"), "a#b"), key(None, "plain")]);
    }

    #[test]
    fn a_name_may_have_several_keys_but_a_key_only_one_name() {
        assert_eq!(read("a:old\na:new\na:new").unwrap().len(), 3);
        let found = faults(&format!("a:abc\nb:other\nsha256:{ABC}"));
        assert_eq!(found, ["line 3: the same key as in line 1, with another name"]);
    }

    #[test]
    fn all_faults_are_found_with_their_lines_and_without_the_keys() {
        let cut = &ABC[..63];
        let long = "n".repeat(33);
        let text = format!(
            "good\nsha256:{cut}\nFleet:secret\na:sha256:secret\na:\n:secret, good\n{long}:secret\nfleet:secrét"
        );
        let found = faults(&text);
        let places: Vec<_> = found.iter().filter_map(|fault| fault.split(": ").next()).collect();
        assert_eq!(places, ["line 2", "line 3", "line 4", "line 5", "line 6, key 1", "line 7", "line 8"]);
        let all = found.join("\n");
        assert!(!all.contains("secret") && !all.contains(cut), "{all}");
        assert!(found[0].contains("64 hexadecimal digits") && found[1].contains("needs a name"), "{all}");
    }
}
