//! Answers in gzip for callers who accept it.
//!
//! Whole answers are coded at once, on the worker that writes them, and documents once for all who ask: an encoder that
//! works while a caller reads would hold hundreds of kilobytes beside the budget for as long as that takes, and the
//! length would not be known. Streams are not coded, since their lines would wait for each other. Bodies hold no secrets
//! of the server, so their length tells nobody anything (BREACH).

use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use flate2::Compression;

use crate::contract::gzip;

/// Shorter bodies fit a packet as they are.
const LEAST_BYTES: usize = 1024;
/// The answer depends on what the caller accepts.
const VARIES: [(HeaderName, HeaderValue); 1] = [(header::VARY, HeaderValue::from_static("accept-encoding"))];
const IN_GZIP: [(HeaderName, HeaderValue); 1] = [(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"))];

/// How the bytes of an answer are coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coding {
    /// Not at all.
    Identity,
    /// RFC 1952.
    Gzip,
}

impl Coding {
    /// What the caller likes best (RFC 9110, section 12.5.3).
    pub(super) fn accepted(headers: &HeaderMap) -> Self {
        let values = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
        let (mut gzip, mut identity, mut any) = (None, None, None);
        for item in values.flat_map(|value| value.split(',')) {
            let mut parts = item.split(';').map(str::trim);
            let name = parts.next().unwrap_or_default();
            let weight = weight(parts);
            if name.eq_ignore_ascii_case("gzip") || name.eq_ignore_ascii_case("x-gzip") {
                gzip = Some(weight);
            } else if name.eq_ignore_ascii_case("identity") {
                identity = Some(weight);
            } else if name == "*" {
                any = Some(weight);
            }
        }
        let gzip = gzip.or(any).unwrap_or(0.0);
        if gzip > 0.0 && gzip >= identity.unwrap_or(0.0) { Self::Gzip } else { Self::Identity }
    }

    /// The same for so many bytes: short ones stay as they are.
    pub(super) fn of_length(self, bytes: usize) -> Self {
        if is_negotiable(bytes) { self } else { Self::Identity }
    }
}

/// How much a caller likes what has these parameters (RFC 9110, section 12.4.2).
pub(super) fn weight<'a>(parameters: impl IntoIterator<Item = &'a str>) -> f32 {
    let weight = parameters.into_iter().find_map(|parameter| {
        let (name, value) = parameter.split_once('=')?;
        name.trim().eq_ignore_ascii_case("q").then(|| value.trim())
    });
    weight.map_or(1.0, |weight| weight.parse().unwrap_or(0.0))
}

/// Whether so many bytes are worth coding, so that the answer depends on what the caller accepts.
pub(super) fn is_negotiable(bytes: usize) -> bool {
    bytes >= LEAST_BYTES
}

/// The head of an answer that is coded so, and that depends on what the caller accepts or not.
pub(super) fn with_head(mut response: Response, coding: Coding, is_negotiable: bool) -> Response {
    if is_negotiable {
        response.headers_mut().extend(VARIES);
    }
    if coding == Coding::Gzip {
        response.headers_mut().extend(IN_GZIP);
    }
    response
}

/// A whole body, coded.
#[derive(Debug)]
pub(super) struct Coded {
    coding: Coding,
    is_negotiable: bool,
    pub(super) bytes: Vec<u8>,
}

impl Coded {
    /// The bytes as the caller likes them.
    pub(super) fn new(bytes: Vec<u8>, accepted: Coding) -> Self {
        let (coding, is_negotiable) = (accepted.of_length(bytes.len()), is_negotiable(bytes.len()));
        let bytes = match coding {
            Coding::Identity => bytes,
            // Answers are made once and read once: the next levels take twice the time for a tenth less.
            Coding::Gzip => gzip(&bytes, Compression::fast()),
        };
        Self { coding, is_negotiable, bytes }
    }

    /// The answer.
    pub(super) fn respond(self, media_type: &'static str) -> Response {
        let Self { coding, is_negotiable, bytes } = self;
        with_head(([(header::CONTENT_TYPE, media_type)], bytes).into_response(), coding, is_negotiable)
    }
}

impl From<Coded> for Vec<u8> {
    fn from(coded: Coded) -> Self {
        coded.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn accepted(values: &[&'static str]) -> Coding {
        let values = values.iter().map(|value| (header::ACCEPT_ENCODING, HeaderValue::from_static(value)));
        Coding::accepted(&values.collect())
    }

    #[test]
    fn gzip_is_sent_to_those_who_accept_it() {
        let accepting: [&[&str]; 7] = [
            &["gzip"],
            &["deflate, GZip;q=0.5, br"],
            &["br", "x-gzip ; q=0.001"],
            &["*"],
            &["identity;q=0.5, gzip;q=0.5"],
            &["identity;q=0, *;q=0.1"],
            &["gzip; q=1.0, *;q=0"],
        ];
        for values in accepting {
            assert_eq!(accepted(values), Coding::Gzip, "{values:?}");
        }
        let refusing: [&[&str]; 9] = [
            &[],
            &[""],
            &["br, zstd"],
            &["gzip;q=0"],
            &["gzip;q=0.000, *"],
            &["gzip;q=x"],
            &["gzip;Q=0"],
            &["identity, gzip;q=0.9"],
            &["gzipped"],
        ];
        for values in refusing {
            assert_eq!(accepted(values), Coding::Identity, "{values:?}");
        }
    }

    #[test]
    fn short_bodies_stay_as_they_are() {
        for (length, coding) in [(LEAST_BYTES - 1, Coding::Identity), (LEAST_BYTES, Coding::Gzip)] {
            let coded = Coded::new(vec![b' '; length], Coding::Gzip);
            assert_eq!((coded.coding, coded.bytes.len() < length), (coding, coding == Coding::Gzip));
        }
    }
}
