//! The suite as it lies on the disc: robots, cases, and the best plan known for each case.

mod case;
mod witness;

use std::path::PathBuf;

use case::reading;
pub(crate) use case::{Case, read_cases, simulate_body};
pub(crate) use witness::Witness;

/// Steps of every case and witness, the paper's.
pub(crate) const STEP_COUNT: usize = 200;
/// Torques per wheel of every case and witness, the paper's.
pub(crate) const CONTROL_COUNT: usize = 40;
/// Least load of each contact in all cases, as a share of the weight.
pub(crate) const NORMAL_LOAD_SHARE: f64 = 0.001;
/// Largest accepted goal error (m, rad, m/s, rad/s).
pub(crate) const GOAL_TOLERANCE: f64 = 1e-6;

/// A file of the suite.
pub(crate) fn path_of(file: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "benches", "maneuvers", file].iter().collect()
}
