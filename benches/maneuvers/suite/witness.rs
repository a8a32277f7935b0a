//! Witnesses: the fastest plan known for a case, one file each under `best_known`.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};
use slipdrive::simulation::TorqueSchedule;

use super::{CONTROL_COUNT, Case, GOAL_TOLERANCE, path_of, reading};

/// Largest accepted residual of the contact law, relative to m g dt, as for the service's answers.
const CONTACT_RESIDUAL_TOLERANCE: f64 = 1e-10;

/// A plan that proves a final time. Its numbers are the shortest that give the same bits back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Witness {
    /// Its final time, s.
    pub(crate) final_time_s: f64,
    /// Starts that were spent on this case so far.
    pub(crate) starts: u64,
    torque_left_n_m: Vec<f64>,
    torque_right_n_m: Vec<f64>,
}

impl Witness {
    /// A schedule as a witness, after that many starts.
    pub(crate) fn new(schedule: &TorqueSchedule, starts: u64) -> Self {
        Self {
            final_time_s: schedule.final_time,
            starts,
            torque_left_n_m: schedule.left.clone(),
            torque_right_n_m: schedule.right.clone(),
        }
    }

    /// The witness on file, if there is one.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(crate) fn read(case: &str) -> Result<Option<Self>> {
        if file_of(case).exists() { reading(&name_of(case)).map(Some) } else { Ok(None) }
    }

    /// Writes the file of a case in one move, so that a run may be stopped at any time.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn write(&self, case: &str) -> Result<()> {
        let path = file_of(case);
        fs::create_dir_all(path.parent().expect("a file of the suite lies in a folder"))?;
        let unfinished = path.with_extension("unfinished");
        fs::write(&unfinished, serde_json::to_string(self)? + "\n")?;
        fs::rename(&unfinished, &path).with_context(|| format!("{} cannot be written", path.display()))
    }

    /// The plan.
    pub(crate) fn schedule(&self) -> TorqueSchedule {
        TorqueSchedule {
            final_time: self.final_time_s,
            left: self.torque_left_n_m.clone(),
            right: self.torque_right_n_m.clone(),
        }
    }

    /// Simulates the plan: it must keep the torque limits, meet the goal, keep the contact law, and separate nowhere.
    ///
    /// # Errors
    /// The first of these that fails.
    pub(crate) fn verify(&self, case: &Case) -> Result<()> {
        let limit = case.accepted.input.maneuver.torque_limit;
        for (torques, limit) in [(&self.torque_left_n_m, limit.left), (&self.torque_right_n_m, limit.right)] {
            ensure!(torques.len() == CONTROL_COUNT, "{} torques instead of {CONTROL_COUNT}", torques.len());
            ensure!(torques.iter().all(|torque| torque.abs() <= limit), "a torque exceeds its limit of {limit} N m");
        }
        ensure!(self.final_time_s > 0.0, "the final time is {} s", self.final_time_s);
        let simulation = case.simulated(&self.schedule());
        let miss = case.largest_goal_error(&simulation);
        ensure!(miss <= GOAL_TOLERANCE, "the goal is missed by {miss:e}");
        let end = simulation.trajectory.time.last().copied().unwrap_or(f64::NAN);
        ensure!(end == self.final_time_s, "the simulation ends at {end} s instead of {} s", self.final_time_s);
        let residual = simulation.trajectory.worst_contact_residual;
        ensure!(residual <= CONTACT_RESIDUAL_TOLERANCE, "the contact law is missed by {residual:e}");
        let separations = simulation.trajectory.separations().len();
        ensure!(separations == 0, "{separations} steps with a separation");
        Ok(())
    }
}

fn name_of(case: &str) -> String {
    format!("best_known/{case}.json")
}

fn file_of(case: &str) -> PathBuf {
    path_of(&name_of(case))
}
