//! The one-step friction problem.
mod solution;
pub use solution::{ContactMode, ContactName, PerContact};
