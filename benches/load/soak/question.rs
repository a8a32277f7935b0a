//! What the good callers of the soak ask, and what an answer must say; the same over both doors.

use std::time::Duration;

use slipdrive::api::grpc::pb;

use crate::callers::Transport;

/// Goal of all drives, m.
const GOAL_Y_M: f64 = 5.0;
/// Largest answer: one node per step.
const SIMULATION_STEPS: u32 = 10_000;
/// As in the paper.
const STEPS: u32 = 200;
/// Steps of a solve that lasts until its caller leaves.
const LONG_STEPS: u32 = 2_000;
/// Items of a batch: more than its window, so that some wait.
pub const BATCH_ITEMS: usize = 20;
/// Time for some of the starts, not for all.
pub const DEADLINE: Duration = Duration::from_millis(300);
/// When a caller leaves a solve that would go on for seconds.
pub const STAY: Duration = Duration::from_millis(200);
/// What a caller may be told to try again later.
const RETRYABLE: [&str; 3] = ["queue_full", "deadline_unreachable", "memory_full"];

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Question {
    Validate,
    /// `/livez` over REST, `Check` over gRPC.
    Health,
    Solve,
    /// The same without trajectory.
    SolvePlan,
    SolveUntilDeadline,
    Simulate,
    Batch,
    /// A solve with its progress.
    Events,
    /// A solve that is left in the middle.
    HangUp,
}

impl Question {
    pub const ALL: [Self; 9] = [
        Self::Validate,
        Self::Health,
        Self::Solve,
        Self::SolvePlan,
        Self::SolveUntilDeadline,
        Self::Simulate,
        Self::Batch,
        Self::Events,
        Self::HangUp,
    ];

    /// Between an answer and the next question of one caller; all together keep the worker busy half of the time.
    pub fn interval(self) -> Duration {
        Duration::from_secs(match self {
            Self::Validate | Self::Health => 1,
            Self::Solve | Self::SolvePlan => 2,
            Self::Simulate | Self::Events => 3,
            Self::SolveUntilDeadline | Self::Batch | Self::HangUp => 5,
        })
    }

    /// Batches are calls of gRPC alone.
    pub fn is_asked_over(self, door: Transport) -> bool {
        self != Self::Batch || door == Transport::Grpc
    }

    pub fn may_be_refused_with(self, code: &str) -> bool {
        let is_late = self == Self::SolveUntilDeadline && code == "deadline_exceeded";
        self != Self::Health && (is_late || RETRYABLE.contains(&code))
    }

    /// The maneuver of this question. Enums are always given: JSON has no name for an absent one.
    pub fn solve(self) -> pb::SolveRequest {
        let (view, steps, starts) = match self {
            Self::Validate | Self::Health | Self::Solve | Self::Simulate => (pb::View::Full, STEPS, 1),
            Self::SolvePlan | Self::Batch | Self::Events => (pb::View::Plan, STEPS, 1),
            Self::SolveUntilDeadline => (pb::View::Full, STEPS, 24),
            Self::HangUp => (pb::View::Full, LONG_STEPS, 64),
        };
        pb::SolveRequest {
            maneuver: Some(pb::Maneuver {
                reference_point: pb::ReferencePoint::ChassisCenterOfMass.into(),
                goal: Some(pb::Goal { y_m: Some(GOAL_Y_M), ..pb::Goal::default() }),
                ..pb::Maneuver::default()
            }),
            grid: Some(pb::SolveGrid { steps: Some(steps), ..pb::SolveGrid::default() }),
            solver: Some(pb::Solver {
                method: pb::Method::SequentialLinear.into(),
                starts: Some(starts),
                ..pb::Solver::default()
            }),
            view: view.into(),
            ..pb::SolveRequest::default()
        }
    }

    /// What a plan says: the same for the same question, unless the deadline cut the search off.
    pub fn content_of(self, solution: &pb::Solution) -> Result<String, Failure> {
        let (status, reason) = (solution.status().as_str_name(), solution.stop_reason().as_str_name());
        if self != Self::SolveUntilDeadline {
            let nodes = solution.trajectory.as_ref().map_or(0, |trajectory| trajectory.time_s.len());
            return Ok(format!("{status}, {reason}, {} s, {nodes} nodes", solution.final_time_s));
        }
        let is_cut = matches!(solution.stop_reason(), pb::StopReason::Deadline | pb::StopReason::Finished);
        let is_best =
            matches!(solution.status(), pb::Status::Converged | pb::Status::Feasible | pb::Status::NotConverged);
        let has_torques = solution.torque_schedule.as_ref().is_some_and(|schedule| !schedule.left_n_m.is_empty());
        let is_plan = is_cut && is_best && has_torques && solution.final_time_s > 0.0;
        let unexpected = || Failure::Unexpected(format!("{status}, {reason}, {} s", solution.final_time_s));
        if is_plan { Ok("a plan".to_owned()) } else { Err(unexpected()) }
    }
}

/// The torques whose motion is asked for.
pub fn simulation() -> pb::SimulateRequest {
    let torques = vec![0.3, 0.4, 0.2, -0.1];
    let schedule = pb::TorqueSchedule { interval_s: Some(0.5), left_n_m: torques.clone(), right_n_m: torques };
    pb::SimulateRequest {
        reference_point: pb::ReferencePoint::ChassisCenterOfMass.into(),
        torque_schedule: Some(schedule),
        grid: Some(pb::SimulateGrid { steps: Some(SIMULATION_STEPS) }),
        contact_solver: pb::ContactSolver::Exact.into(),
        ..pb::SimulateRequest::default()
    }
}

/// What a motion says.
pub fn content_of_motion(motion: &pb::SimulateResponse) -> Result<String, Failure> {
    let (Some(trajectory), Some(contacts)) = (&motion.trajectory, &motion.contacts) else {
        return Err(Failure::Unexpected("no motion".to_owned()));
    };
    let forces = contacts.left.as_ref().map_or(0, |left| left.normal_force_n.len());
    Ok(format!("{} nodes to {:?} m, {forces} forces", trajectory.y_m.len(), trajectory.y_m.last()))
}

/// Why there is no answer.
#[derive(Debug)]
pub enum Failure {
    /// With a code that asks to try again.
    Refused(String),
    /// Before any byte of an answer.
    Cut,
    Unexpected(String),
}

impl Failure {
    /// A refusal, expected or not.
    pub fn refusal(question: Question, code: String) -> Self {
        if question.may_be_refused_with(&code) { Self::Refused(code) } else { Self::Unexpected(code) }
    }

    pub fn cut_in_the_answer() -> Self {
        Self::Unexpected("cut in the answer".to_owned())
    }
}
