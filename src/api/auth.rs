//! API keys: who may call, decided before anything else of a request is read.

use axum::http::{HeaderMap, header};
use sha2::{Digest as _, Sha256};

/// The accepted keys, kept as hashes. None configured: everyone may call.
#[derive(Clone, Default)]
pub struct ApiKeys {
    hashes: Vec<[u8; 32]>,
}

impl std::fmt::Debug for ApiKeys {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("ApiKeys").field("count", &self.hashes.len()).finish_non_exhaustive()
    }
}

impl ApiKeys {
    /// The keys in a text, separated by commas or white space.
    pub fn parse(text: &str) -> Self {
        let keys = text.split(|character: char| character == ',' || character.is_whitespace());
        Self { hashes: keys.filter(|key| !key.is_empty()).map(hash).collect() }
    }

    /// Whether no key is configured.
    pub fn is_empty(&self) -> bool {
        self.hashes.is_empty()
    }

    /// How many keys are configured, if any.
    pub fn count(&self) -> Option<usize> {
        (!self.is_empty()).then_some(self.hashes.len())
    }

    /// Whether a request with these headers may pass: it bears one of the keys, or none is configured.
    pub fn admit(&self, headers: &HeaderMap) -> bool {
        self.is_empty() || bearer(headers).is_some_and(|key| self.contains(key))
    }

    /// Takes the same time whichever key matches, and wherever the first difference lies: hashes of equal length are
    /// compared to the end, all of them.
    fn contains(&self, key: &str) -> bool {
        let given = hash(key);
        self.hashes.iter().fold(false, |found, known| {
            let difference = known.iter().zip(given).fold(0, |difference, (known, given)| difference | (known ^ given));
            found | (std::hint::black_box(difference) == 0)
        })
    }
}

fn hash(key: &str) -> [u8; 32] {
    Sha256::digest(key.as_bytes()).into()
}

/// The key of an `Authorization: Bearer KEY` header.
fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, key) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| key.trim())
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn admits(keys: &ApiKeys, authorization: &'static str) -> bool {
        keys.admit(&HeaderMap::from_iter([(header::AUTHORIZATION, HeaderValue::from_static(authorization))]))
    }

    #[test]
    fn every_configured_key_is_admitted_and_nothing_else() {
        let keys = ApiKeys::parse("first, second\nthird\n");
        for key in ["Bearer first", "Bearer second", "bearer third"] {
            assert!(admits(&keys, key), "{key}");
        }
        for other in ["Bearer fourth", "Bearer ", "Basic first", "first", "Bearer first second"] {
            assert!(!admits(&keys, other), "{other}");
        }
        assert!(!keys.admit(&HeaderMap::new()));
    }

    #[test]
    fn no_configured_key_admits_everyone() {
        assert!(ApiKeys::parse(" \n").admit(&HeaderMap::new()));
    }

    #[test]
    fn keys_are_not_printed() {
        assert_eq!(format!("{:?}", ApiKeys::parse("secret")), "ApiKeys { count: 1, .. }");
    }
}
