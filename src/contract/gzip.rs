//! Bytes compressed (RFC 1952).

use std::io::Write as _;

use flate2::Compression;
use flate2::write::GzEncoder;

/// The bytes in gzip; the same each time.
pub(crate) fn gzip(bytes: &[u8], level: Compression) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::with_capacity(bytes.len() / 2), level);
    // Writing to memory cannot fail.
    let _ = encoder.write_all(bytes);
    encoder.finish().unwrap_or_default()
}
