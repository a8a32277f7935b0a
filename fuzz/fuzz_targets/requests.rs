//! Any bytes to all readers of requests. With a nightly compiler and `cargo install cargo-fuzz`:
//!
//! ```text
//! mkdir -p fuzz/corpus/requests
//! cargo +nightly fuzz run requests fuzz/corpus/requests tests/data/corpus -- -max_total_time=600
//! ```
//!
//! New inputs go to the first folder. What breaks a reader is worth a file in `tests/data/corpus`, named by what must
//! become of it: the tests replay them all.

#![no_main]

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../../tests/service/support/readers.rs"]
mod readers;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    readers::is_accepted(bytes);
});
