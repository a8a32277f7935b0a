//! What is said between callers and this program, whichever way it travels: messages, rules and errors.
//!
//! The messages are generated from `proto/`; protobuf and JSON are two ways to write them. This module knows no transport.

pub(crate) mod convert;
mod error_table;
mod goal;
mod gzip;
mod hexadecimal;
mod indented;
pub mod json;
pub mod message;
mod numbers;
mod problem;
mod state;
mod strict_value;

pub use error_table::{ErrorCode, ErrorEntry, GrpcCode};
pub(crate) use gzip::gzip;
pub(crate) use hexadecimal::hexadecimal;
pub use indented::indented;
pub use numbers::Numbers;
pub use problem::{BodyLimit, FieldError, Problem};
pub(crate) use problem::{path_of_pointer, pointer_of_path};
pub(crate) use strict_value::StrictValue;
