//! API keys: who may call, decided before anything else of a request is read.
//!
//! Keys are kept as hashes. A new set takes the place of the old one while the server runs: a caller keeps what is counted
//! for its name, and who bears a key that is gone is told so at its next request, or in the middle of a batch.

mod credential;
mod lines;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use axum::http::{HeaderMap, header};
use sha2::{Digest as _, Sha256};
use tokio::sync::watch;

use credential::Principal;
pub(super) use credential::{Credential, OpenRequest};
pub use lines::KeyFaults;
use lines::KeyLine;

/// SHA-256 of a key.
type Hash = [u8; 32];

/// The accepted keys; clones are the same set. None configured: everyone may call.
#[derive(Clone, Default)]
pub struct ApiKeys(Arc<watch::Sender<Keys>>);

/// One set of keys.
#[derive(Clone, Default)]
struct Keys(Arc<[Key]>);

struct Key {
    hash: Hash,
    principal: Arc<Principal>,
}

impl std::fmt::Debug for ApiKeys {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("ApiKeys").field("count", &self.0.borrow().0.len()).finish_non_exhaustive()
    }
}

impl ApiKeys {
    /// The keys of a text: `NAME:KEY`, `NAME:sha256:HEX`, `sha256:HEX` or a key alone, on lines of their own or separated
    /// by commas or white space; maybe none.
    ///
    /// # Errors
    /// Every fault of the text, by its line.
    pub fn parse(text: &str) -> Result<Self, KeyFaults> {
        let keys = Self::default();
        keys.0.send_replace(Keys::of(lines::read(text)?, &Keys::default()));
        Ok(keys)
    }

    /// Puts the keys of a text in the place of the present ones.
    ///
    /// # Errors
    /// Every fault of the text, or that there is no key in it, which would open the server; the keys are then the same as
    /// before.
    pub fn replace(&self, text: &str) -> Result<(), KeyFaults> {
        let lines = lines::read(text)?;
        if lines.is_empty() {
            return Err(KeyFaults { faults: vec!["there is no key in it".to_owned()] });
        }
        self.0.send_modify(|keys| *keys = Keys::of(lines, keys));
        Ok(())
    }

    /// What logs and metrics call the callers, each once.
    pub fn callers(&self) -> BTreeSet<String> {
        self.0.borrow().0.iter().map(|key| key.principal.share().label().to_owned()).collect()
    }

    /// Whether no key is configured.
    pub fn is_empty(&self) -> bool {
        self.0.borrow().0.is_empty()
    }

    /// How many keys are configured, if any.
    pub fn count(&self) -> Option<usize> {
        (!self.is_empty()).then(|| self.0.borrow().0.len())
    }

    /// Who sent a request with these headers; none where it bears none of the keys, but some are configured.
    pub(super) fn admit(&self, headers: &HeaderMap) -> Option<Credential> {
        if self.is_empty() {
            return Some(Credential::anybody());
        }
        let hash = hash(bearer(headers)?);
        let principal = self.0.borrow().find(&hash)?;
        Some(Credential::new(principal, hash, self.clone()))
    }

    /// Waits until this key is none of the accepted ones any more.
    async fn revoked(&self, hash: &Hash) {
        // The sender lives as long as this.
        let _ = self.0.subscribe().wait_for(|keys| keys.find(hash).is_none()).await;
    }
}

impl Keys {
    /// These keys; callers who were known before stay who they are.
    fn of(lines: Vec<KeyLine>, before: &Self) -> Self {
        let known = before.0.iter().map(|key| (key.principal.name().map(str::to_owned), Arc::clone(&key.principal)));
        let mut principals: BTreeMap<_, _> = known.collect();
        let of_one = lines.iter().all(|line| line.name == lines[0].name);
        let keys = lines.into_iter().map(|KeyLine { name, hash }| {
            let new = || Arc::new(Principal::new(name.as_deref()));
            let principal = Arc::clone(principals.entry(name.clone()).or_insert_with(new));
            principal.share().set_bounded(!of_one);
            Key { hash, principal }
        });
        Self(keys.collect())
    }

    /// Takes the same time whichever key matches, and wherever the first difference lies: hashes of equal length are
    /// compared to the end, all of them.
    fn find(&self, given: &Hash) -> Option<Arc<Principal>> {
        let found = self.0.iter().fold(None, |found, key| {
            let difference =
                key.hash.iter().zip(given).fold(0, |difference, (known, given)| difference | (known ^ given));
            if std::hint::black_box(difference) == 0 { Some(&key.principal) } else { found }
        });
        found.cloned()
    }
}

fn hash(key: &str) -> Hash {
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

    fn credential(keys: &ApiKeys, authorization: &'static str) -> Option<Credential> {
        keys.admit(&HeaderMap::from_iter([(header::AUTHORIZATION, HeaderValue::from_static(authorization))]))
    }

    #[test]
    fn every_configured_key_is_admitted_and_nothing_else() {
        let keys = ApiKeys::parse("first, second\nthird\n").unwrap();
        for key in ["Bearer first", "Bearer second", "bearer third"] {
            assert!(credential(&keys, key).is_some(), "{key}");
        }
        for other in ["Bearer fourth", "Bearer ", "Basic first", "first", "Bearer first second"] {
            assert!(credential(&keys, other).is_none(), "{other}");
        }
        assert!(keys.admit(&HeaderMap::new()).is_none());
    }

    #[test]
    fn no_configured_key_admits_everyone() {
        assert!(ApiKeys::parse(" \n").unwrap().admit(&HeaderMap::new()).is_some());
    }

    #[test]
    fn keys_are_not_printed() {
        assert_eq!(format!("{:?}", ApiKeys::parse("secret").unwrap()), "ApiKeys { count: 1, .. }");
    }

    #[test]
    fn a_hash_in_the_file_is_no_key_itself() {
        const HASH_OF_ABC: &str = "Bearer sha256:ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let keys = ApiKeys::parse(&HASH_OF_ABC["Bearer ".len()..]).unwrap();
        assert!(credential(&keys, "Bearer abc").is_some());
        assert!(credential(&keys, HASH_OF_ABC).is_none());
    }

    #[tokio::test]
    async fn new_keys_take_the_place_of_the_old_ones_and_callers_stay_who_they_are() {
        let keys = ApiKeys::parse("a:old\nb:other").unwrap();
        let (old, other) = (credential(&keys, "Bearer old").unwrap(), credential(&keys, "Bearer other").unwrap());
        keys.clone().replace("a:new\nb:other").unwrap();
        old.revoked().await;
        assert!(credential(&keys, "Bearer old").is_none());
        let new = credential(&keys, "Bearer new").unwrap();
        assert!(Arc::ptr_eq(new.principal().unwrap(), old.principal().unwrap()));
        let still = tokio::time::timeout(std::time::Duration::ZERO, other.revoked()).await;
        assert!(still.is_err(), "that key is as good as before");
    }

    #[test]
    fn keys_that_cannot_be_used_leave_the_old_ones() {
        let keys = ApiKeys::parse("a:old").unwrap();
        for text in ["", "a:new\nA:b"] {
            assert!(keys.replace(text).is_err());
            assert!(credential(&keys, "Bearer old").is_some() && credential(&keys, "Bearer new").is_none());
        }
    }
}
