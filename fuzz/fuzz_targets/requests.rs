//! Any bytes to all readers of requests. With a nightly compiler and `cargo install cargo-fuzz`:
//!
//! ```text
//! cargo +nightly fuzz run requests -- -max_total_time=600 tests/data/corpus
//! ```
//!
//! What it finds is worth a file in `tests/data/corpus`, named by what must become of it: the tests replay them all.

#![no_main]

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../../tests/service/support/readers.rs"]
mod readers;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    readers::is_accepted(bytes);
});
