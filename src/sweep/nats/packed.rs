//! What messages carry: compressed.

use std::io::{self, Read as _};

use flate2::Compression;
use flate2::read::GzDecoder;

use crate::contract::gzip;

/// Most bytes that a message may become: more than the largest chunk or answer has.
const MOST_UNPACKED_BYTES: u64 = 256 << 20;

pub(super) fn packed(content: &[u8]) -> Vec<u8> {
    // Answers are digits: higher levels cost twice the time and save a twentieth.
    gzip(content, Compression::fast())
}

/// The content of a message.
///
/// # Errors
/// What is no gzip, and what is too large.
pub(super) fn unpacked(message: &[u8]) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    GzDecoder::new(message).take(MOST_UNPACKED_BYTES + 1).read_to_end(&mut content)?;
    if content.len() as u64 > MOST_UNPACKED_BYTES {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "it is larger than any message of a sweep"));
    }
    Ok(content)
}
