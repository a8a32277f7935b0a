//! The messages of the contract: how they are written, what they mean in domain types, and back.
//!
//! The types of this module are the JSON that REST speaks; gRPC turns its protobuf messages into them, field by field,
//! so that defaults, rules and hashes exist once.

pub(super) mod accept;
pub(super) mod answer;
mod goal;
pub(super) mod limits;
pub(super) mod request;
pub(super) mod response;
mod schema;
pub(super) mod strict;
