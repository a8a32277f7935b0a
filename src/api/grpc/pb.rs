//! The service generated from `proto/`, over the messages of the contract.

#![allow(missing_docs, unreachable_pub, clippy::all, clippy::pedantic, reason = "generated code")]

pub use crate::contract::message::*;
pub use crate::contract::message::{SolveRequest as SolveStreamRequest, SolveRequest as ValidateRequest};

include!(concat!(env!("OUT_DIR"), "/grpc/slipdrive.v1.rs"));

/// The files of `proto/`, encoded, for reflection.
pub(super) const FILE_DESCRIPTOR_SET: &[u8] = tonic::include_file_descriptor_set!("descriptor");
