//! One case through the service, and what its answer is worth.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use serde::Serialize;
use slipdrive::contract::json;
use slipdrive::contract::message::Solution as SolveAnswer;
use slipdrive::jobs::solve::{AcceptedSolve, Solve, Solved, StopReason};
use slipdrive::jobs::{InProcessSolver, Jobs, Kind as _, Limits};
use slipdrive::service::{Class, Done, Service, ServiceSettings};
use slipdrive::solver::{Solution, Status};

use crate::arguments::Effort;
use crate::suite::Case;
use crate::values::digest_of_values;

/// Solves cases as the service does: queue, worker, watchdog and default time limit included.
pub(crate) struct Runner {
    service: Service,
    jobs: Jobs,
    effort: Effort,
}

/// The figures of one answer.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Answer {
    pub(crate) case: String,
    pub(crate) status: &'static str,
    pub(crate) stop_reason: &'static str,
    pub(crate) replay_confirmed: bool,
    pub(crate) final_time_s: f64,
    pub(crate) largest_goal_error: f64,
    /// The same after `/simulate` has taken the answer's torques.
    pub(crate) simulated_goal_error: f64,
    /// Largest difference of any goal error component between answer and simulation.
    pub(crate) simulation_difference: f64,
    pub(crate) steps: usize,
    pub(crate) starts_tried: usize,
    pub(crate) rollouts: u64,
    pub(crate) solve_time_ms: f64,
    pub(crate) replay_miss_m: f64,
    pub(crate) replay_miss_rad: f64,
    pub(crate) lower_bound_s: f64,
    /// The criticality measure over the final time.
    pub(crate) predicted_decrease: f64,
    pub(crate) worst_contact_residual: f64,
    /// Separations: steps and contacts with a negative normal force.
    pub(crate) separations: usize,
    /// Smallest normal force of a separation, N.
    pub(crate) deepest_separation_n: f64,
    /// The answer's own reason.
    pub(crate) reason: Option<String>,
    /// Of all values of the answer except wall time: equal for equal answers.
    pub(crate) digest: String,
}

impl Runner {
    /// Starts the service.
    ///
    /// # Errors
    /// Threads that cannot be started.
    pub(crate) fn start(effort: &Effort) -> Result<Self> {
        let settings = ServiceSettings { workers: effort.threads, queue_length: 0, ..ServiceSettings::default() };
        let service = Service::start(settings).context("the service cannot be started")?;
        let jobs = Jobs::new(Limits::default(), Arc::new(InProcessSolver), service.metrics());
        Ok(Self { service, jobs, effort: effort.clone() })
    }

    /// Solves a case and simulates the answer.
    ///
    /// # Errors
    /// A service that fails, or an answer that it does not accept back.
    pub(crate) fn solve(&self, case: &Case) -> Result<Answer> {
        let mut accepted = case.accepted.clone();
        self.effort.apply(&mut accepted.input.settings);
        let both = |accepted: &AcceptedSolve, done: &Done<Solved>| (done.clone(), Solve::answer(accepted, done));
        let running =
            self.service.reserve(Class::Heavy)?.submit(Arc::clone(&self.jobs.solve), accepted.clone(), None, both)?;
        let (solved, answer) = running.blocking_outcome()?;
        Answer::new(case, &accepted, &solved, &answer)
    }
}

impl Answer {
    fn new(case: &Case, accepted: &AcceptedSolve, done: &Done<Solved>, answer: &SolveAnswer) -> Result<Self> {
        let Solved { solution, stop_reason, .. } = &done.output;
        let report = &solution.report;
        let (simulated_goal_error, simulation_difference) = simulated(case, accepted, solution, answer)?;
        let separations = solution.trajectory.separations();
        let forces = separations.iter().map(|separation| separation.normal_force);
        Ok(Self {
            case: case.name.clone(),
            status: solution.status.as_str(),
            stop_reason: stop_reason.as_str(),
            replay_confirmed: solution.replay_confirmed,
            final_time_s: solution.schedule.final_time,
            largest_goal_error: solution.goal_error.amax(),
            simulated_goal_error,
            simulation_difference,
            steps: report.step_count,
            starts_tried: report.starts_tried,
            rollouts: report.rollouts,
            solve_time_ms: done.duration.as_secs_f64() * 1e3,
            replay_miss_m: report.replay.map_or(f64::NAN, |replay| replay.miss_position),
            replay_miss_rad: report.replay.map_or(f64::NAN, |replay| replay.miss_heading),
            lower_bound_s: report.lower_bound.unwrap_or(f64::NAN),
            predicted_decrease: report.predicted_decrease / solution.schedule.final_time,
            worst_contact_residual: solution.trajectory.worst_contact_residual,
            separations: separations.len(),
            deepest_separation_n: forces.fold(0.0, f64::min),
            reason: solution.reason.as_ref().map(|reason| reason.message.clone()),
            digest: digest_of_values(&json::write(answer))?,
        })
    }

    /// Whether the plan is what was asked for.
    pub(crate) fn is_converged(&self) -> bool {
        self.status == Status::Converged.as_str()
    }

    /// Whether the watchdog ended the solve.
    pub(crate) fn ran_out_of_time(&self) -> bool {
        self.stop_reason == StopReason::TimeLimit.as_str()
    }

    /// Why the answer is not converged, as far as the answer reports it.
    pub(crate) fn shortfall(&self) -> Option<String> {
        if self.is_converged() {
            return None;
        }
        let mut reasons: Vec<String> = self.reason.iter().cloned().collect();
        if self.separations > 0 {
            let force = self.deepest_separation_n;
            reasons.push(format!("{} separations, down to {force:.2} N", self.separations));
        }
        if self.predicted_decrease > 1e-4 {
            reasons.push(format!("criticality measure {:.1e} of the final time", self.predicted_decrease));
        }
        if self.ran_out_of_time() {
            reasons.push("time limit".to_owned());
        }
        if reasons.is_empty() {
            reasons.push(format!("contact residual {:.1e}", self.worst_contact_residual));
        }
        Some(reasons.join("; "))
    }
}

/// Largest goal error after `/simulate`, and the largest difference of any of its components from the answer's.
fn simulated(case: &Case, accepted: &AcceptedSolve, solution: &Solution, answer: &SolveAnswer) -> Result<(f64, f64)> {
    if solution.schedule.left.is_empty() {
        return Ok((solution.goal_error.amax(), 0.0));
    }
    let schedule = serde_json::to_value(&answer.torque_schedule)?;
    let simulation = case.simulated_over_the_wire(&schedule, solution.report.step_count)?;
    let error = accepted.input.maneuver.goal_error(&simulation.trajectory.end_state);
    Ok((error.amax(), (error - solution.goal_error).amax()))
}
