//! Answers that are the same for all who ask: the files of the page, and what the server says of itself.

use std::sync::OnceLock;

use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use flate2::Compression;
use sha2::{Digest as _, Sha256};

use super::coding::{self, Coding};
use crate::api::server::Shared;
use crate::contract::{gzip, hexadecimal};

/// Nothing is loaded or called but from this server, and nothing of it stands in the pages themselves.
const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; base-uri 'none'; \
     form-action 'none'; frame-ancestors 'none'",
);
/// Kept, but asked for again each time: the next version of the server has others.
const CACHED: HeaderValue = HeaderValue::from_static("no-cache");

/// One of them, in memory once.
pub(super) struct Document {
    media_type: &'static str,
    bytes: Bytes,
    /// Its hash, in quotes.
    tag: String,
    /// The same bytes in gzip, once somebody has asked for them so.
    in_gzip: OnceLock<Bytes>,
}

impl Document {
    pub(super) fn new(media_type: &'static str, bytes: impl Into<Bytes>) -> Self {
        let bytes = bytes.into();
        let tag = format!("\"{}\"", hexadecimal(&Sha256::digest(&bytes)));
        Self { media_type, bytes, tag, in_gzip: OnceLock::new() }
    }

    /// The document, or that the caller has it already.
    pub(super) fn answer(&self, asked: &HeaderMap) -> Response {
        let headers: [(HeaderName, HeaderValue); 2] =
            [(header::CONTENT_SECURITY_POLICY, POLICY), (header::CACHE_CONTROL, CACHED)];
        let (coding, is_negotiable) =
            (Coding::accepted(asked).of_length(self.bytes.len()), coding::is_negotiable(self.bytes.len()));
        let (bytes, tag) = match coding {
            Coding::Identity => (&self.bytes, self.tag.clone()),
            // Other bytes with the same meaning have a tag that is weak.
            Coding::Gzip => (self.in_gzip.get_or_init(|| self.gzip()), format!("W/{}", self.tag)),
        };
        let tag = [(header::ETAG, tag)];
        if self.is_known(asked) {
            let response = (StatusCode::NOT_MODIFIED, headers, tag).into_response();
            return coding::with_head(response, Coding::Identity, is_negotiable);
        }
        let mut response = (headers, tag, [(header::CONTENT_TYPE, self.media_type)], bytes.clone()).into_response();
        response.extensions_mut().insert(Shared);
        coding::with_head(response, coding, is_negotiable)
    }

    fn gzip(&self) -> Bytes {
        gzip(&self.bytes, Compression::best()).into()
    }

    /// Whether `If-None-Match` names it (RFC 9110, section 13.1.2), also as one that is only alike.
    fn is_known(&self, asked: &HeaderMap) -> bool {
        let given = asked.get_all(header::IF_NONE_MATCH).into_iter().filter_map(|value| value.to_str().ok());
        let mut tags = given.flat_map(|list| list.split(',')).map(str::trim);
        tags.any(|tag| tag == "*" || tag.strip_prefix("W/").unwrap_or(tag) == self.tag)
    }
}
