//! The messages, generated from `proto/`: protobuf and JSON are two ways to write them.

#![allow(missing_docs, unreachable_pub, clippy::all, clippy::pedantic, reason = "generated code")]

include!(concat!(env!("OUT_DIR"), "/contract/slipdrive.v1.rs"));
include!(concat!(env!("OUT_DIR"), "/contract/names.rs"));
