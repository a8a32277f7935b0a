//! The transports: they turn wire types into domain types and back, and errors into one table of codes.

pub mod error_table;
mod message;
mod problem;
pub mod rest;
