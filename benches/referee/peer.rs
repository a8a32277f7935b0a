//! The peer of `benches/peer`, `CasADi` and IPOPT, as one more searcher.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs, process};

use anyhow::{Context as _, Result, bail};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::maneuvers::Maneuver;

/// Exit code for a maneuver that the peer does not cover.
const NOT_COVERED: i32 = 64;

/// What the peer answers, as far as it is of use.
#[derive(Debug, Deserialize)]
struct Answer {
    final_time_s: f64,
    torque_left_n_m: Vec<f64>,
    torque_right_n_m: Vec<f64>,
}

/// A plan of the peer as the start of a search (`initial_guess`); none where the peer does not cover the maneuver.
///
/// # Errors
/// A peer that gives no answer.
pub(crate) fn plan(python: &Path, maneuver: &Maneuver) -> Result<Option<Value>> {
    let request = env::temp_dir().join(format!("referee-{}.json", process::id()));
    fs::write(&request, serde_json::to_vec(&maneuver.request)?)
        .with_context(|| format!("{} cannot be written", request.display()))?;
    let ended = Command::new(python).arg(script()).arg(&request).output();
    fs::remove_file(&request)?;
    let ended = ended.with_context(|| format!("{} cannot be run", python.display()))?;
    if ended.status.code() == Some(NOT_COVERED) {
        return Ok(None);
    }
    if !ended.status.success() {
        bail!("the peer gave no answer ({}): {}", ended.status, String::from_utf8_lossy(&ended.stderr).trim());
    }
    let Answer { final_time_s, torque_left_n_m, torque_right_n_m } = serde_json::from_slice(&ended.stdout)?;
    let guess = json!({
        "final_time_s": final_time_s,
        "torque_left_n_m": torque_left_n_m,
        "torque_right_n_m": torque_right_n_m,
    });
    Ok(Some(guess))
}

fn script() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "benches", "peer", "peer.py"].iter().collect()
}
