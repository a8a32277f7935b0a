//! The digests of the benchmark suite: what they tell apart, and what they pass over.

#![allow(dead_code, reason = "the runner uses more of the digests")]

#[path = "../../benches/maneuvers/values.rs"]
mod values;

use values::digest_of_values;

fn assert_same(one: &str, other: &str) {
    assert_eq!(digest_of_values(one.as_bytes()).unwrap(), digest_of_values(other.as_bytes()).unwrap(), "{one} {other}");
}

fn assert_different(one: &str, other: &str) {
    assert_ne!(digest_of_values(one.as_bytes()).unwrap(), digest_of_values(other.as_bytes()).unwrap(), "{one} {other}");
}

#[test]
fn names_wall_time_and_version_are_passed_over() {
    assert_same(r#"{"a": 1, "b": [true, null]}"#, r#"{"c": 1, "d": [true, null]}"#);
    assert_same(r#"{"solve_time_s": 0.1, "a": 1}"#, r#"{"a": 1, "solver_version": "0.1.0"}"#);
}

#[test]
fn numbers_are_equal_however_they_are_written() {
    assert_same("[3, -3, 0]", "[3.0, -3e0, 0.0]");
    assert_same("9007199254740992", "9007199254740992.0");
}

#[test]
fn values_order_and_nesting_tell_apart() {
    let different = [
        ("0.1", "0.10000000000000002"),
        ("0.0", "-0.0"),
        // As floating-point numbers these are equal.
        ("9007199254740993", "9007199254740994"),
        ("18446744073709551614", "18446744073709551615"),
        ("null", "0"),
        ("1", r#""1""#),
        ("true", "false"),
        (r#"{"a": 1, "b": 2}"#, r#"{"b": 2, "a": 1}"#),
        ("[[1], 2]", "[[1, 2]]"),
        ("[1]", r#"{"a": 1}"#),
        (r#"["ab", "c"]"#, r#"["a", "bc"]"#),
    ];
    for (one, other) in different {
        assert_different(one, other);
    }
}

#[test]
fn half_a_document_has_no_digest() {
    assert!(digest_of_values(b"[1").is_err());
    assert!(digest_of_values(b"1 2").is_err());
}
