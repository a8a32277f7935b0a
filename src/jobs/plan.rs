//! A request with its answer as a motion that can be rolled out again: what kinds of jobs begin with that are about a plan.

mod contradiction;

pub(super) use contradiction::{claims_goal, largest_goal_error, other_end};
use serde_json::Value;

use super::simulate::Simulate;
use super::solve::Solve;
use super::table::word;
use super::{Clock, Kind, Limits, ManeuverSolver};
use crate::contract::Problem;
use crate::contract::convert::{aisle_corners, required, schedule};
use crate::contract::json;
use crate::contract::message::{SimulateResponse, SimulatedPlan, Solution, SolvedPlan, Status};
use crate::motion::{SimulateInput, SimulateParameters};
use crate::rules::{Checks, Rule};
use crate::shooting::{AisleCorners, ManeuverLimits};
use crate::simulation::{TorqueSchedule, Trajectory};
use crate::solver::SolveInput;
use crate::stop::{Stop, Stopped};

/// A plan whose request is valid and whose answer has a motion, or none where nothing moves.
#[derive(Debug)]
pub struct AcceptedPlan {
    /// What the request and its answer say.
    pub(super) said: Said,
    /// The motion; the schedule is empty where nothing moves.
    pub(super) motion: SimulateInput,
    /// The corners of aisle and robot, as they were given.
    pub(super) corners: AisleCorners,
}

/// What the request and its answer say.
#[derive(Debug)]
pub(super) enum Said {
    /// A solve.
    Solve(Box<SolveInput>, Box<Solution>),
    /// A simulation.
    Simulate(Box<SimulateResponse>),
}

impl AcceptedPlan {
    /// Validates a plan, which is one of the two.
    ///
    /// # Errors
    /// `invalid_field`, or all violated rules and limits of its request at once.
    pub(super) fn of(
        solve: Option<Box<SolvedPlan>>,
        simulate: Option<Box<SimulatedPlan>>,
        limits: &Limits,
    ) -> Result<Self, Problem> {
        match (solve, simulate) {
            (Some(solved), None) => accept_solved(*solved, limits).map_err(|fault| fault.below("solve")),
            (None, Some(simulated)) => accept_simulated(*simulated, limits).map_err(|fault| fault.below("simulate")),
            (Some(_), Some(_)) => {
                Err(json::faulty_field("", "there are both `solve` and `simulate`, must be one of them"))
            }
            (None, None) => Err(json::faulty_field("", "there is neither `solve` nor `simulate`, must be one of them")),
        }
    }

    /// The same, of whose answer only what its motion is compared with is left: all that a job needs while it waits that says
    /// nothing of the rest.
    pub(super) fn without_report(self) -> Self {
        let said = match self.said {
            Said::Solve(asked, answer) => {
                let Solution { status, replay_confirmed, final_time_s, end_state, .. } = *answer;
                let rest = Solution::default();
                Said::Solve(asked, Box::new(Solution { status, replay_confirmed, final_time_s, end_state, ..rest }))
            }
            Said::Simulate(answer) => {
                let end_state = answer.end_state;
                Said::Simulate(Box::new(SimulateResponse { end_state, ..SimulateResponse::default() }))
            }
        };
        Self { said, ..self }
    }

    /// What the answer says that it is worth.
    pub(super) fn standing(&self) -> String {
        match &self.said {
            Said::Simulate(_) => "simulated".to_owned(),
            Said::Solve(_, answer) => {
                let replay = if answer.replay_confirmed { "confirmed" } else { "not confirmed" };
                format!("{}, replay {replay}", word::<Status>(answer.status()))
            }
        }
    }

    /// Steps of its motion; 0 where nothing moves.
    pub(super) fn step_count(&self) -> usize {
        if self.motion.schedule.final_time > 0.0 { self.motion.step_count } else { 0 }
    }

    /// Its motion at the reference point; the start alone where nothing moves.
    pub(super) fn trajectory(&self, solver: &dyn ManeuverSolver, stop: Stop<'_>) -> Result<Trajectory, Stopped> {
        if self.step_count() == 0 {
            let start = self.motion.start;
            return Ok(Trajectory { time: vec![0.0], state: vec![start], end_state: start, ..Trajectory::default() });
        }
        solver.simulate(&self.motion, stop).map(|simulation| simulation.trajectory)
    }
}

/// A saved plan, or a whole request about one, without what is rolled out again anyway.
///
/// # Errors
/// `malformed_body` where it is no JSON, `invalid_field` where it is no object or has one with a field twice.
pub(super) fn without_motion(file: &[u8]) -> Result<Vec<u8>, Problem> {
    let mut plan = Value::Object(json::read_any_object(file)?);
    forget_motion(&mut plan);
    Ok(json::write(&plan))
}

/// Forgets what of a request with its answer is rolled out again anyway, as any caller would.
pub(super) fn forget_motion(plan: &mut Value) {
    for answer in plan.as_object_mut().into_iter().flat_map(|plan| plan.values_mut()) {
        if let Some(answer) = answer.get_mut("answer").and_then(Value::as_object_mut) {
            answer.retain(|field, _| field != "trajectory" && field != "contacts");
        }
    }
}

fn accept_simulated(plan: SimulatedPlan, limits: &Limits) -> Result<AcceptedPlan, Problem> {
    let SimulatedPlan { request, answer } = plan;
    let (request, answer) = Problem::both(required(request, "request"), required(answer, "answer"))?;
    let footprint = request.robot.iter().flat_map(|robot| robot.footprint.clone()).collect::<Vec<_>>();
    let corners = aisle_corners(&request.keep_in, &footprint);
    let accepted = Simulate::accept(request, limits).map_err(|fault| fault.below("request"))?;
    let answer = SimulateResponse { trajectory: None, contacts: None, ..answer };
    Ok(AcceptedPlan { said: Said::Simulate(Box::new(answer)), motion: accepted.input, corners })
}

fn accept_solved(plan: SolvedPlan, limits: &Limits) -> Result<AcceptedPlan, Problem> {
    let SolvedPlan { request, answer } = plan;
    let (request, answer) = Problem::both(required(request, "request"), required(answer, "answer"))?;
    // The plan was found already: its time limit is over.
    let limits = &Limits { clock: Clock::Limits, ..*limits };
    let accepted = Solve::accept(request, limits).map_err(|fault| fault.below("request"));
    let answered = torques_of(&answer, limits).map_err(|fault| fault.below("answer"));
    let (accepted, (schedule, step_count)) = Problem::both(accepted, answered)?;
    let (given_robot, maneuver) = (accepted.completed.robot, accepted.completed.maneuver);
    let given_robot = given_robot.unwrap_or_default();
    let corners = aisle_corners(&maneuver.unwrap_or_default().keep_in, &given_robot.footprint);
    // What the plan uses of its limits is in its report.
    let motion = accepted.input.motion_of(schedule, step_count);
    let motion = SimulateInput { limits: ManeuverLimits::default(), aisle: None, ..motion };
    let answer = Solution { trajectory: None, contacts: None, ..answer };
    Ok(AcceptedPlan { said: Said::Solve(Box::new(accepted.input), Box::new(answer)), motion, corners })
}

/// The torques that were answered, and the steps of the plan's grid; one where nothing moves.
fn torques_of(answer: &Solution, limits: &Limits) -> Result<(TorqueSchedule, usize), Problem> {
    let schedule = schedule(required(answer.torque_schedule.clone(), "torque_schedule")?, "torque_schedule")?;
    let TorqueSchedule { left, right, .. } = &schedule;
    if left.is_empty() && right.is_empty() {
        return Ok((schedule, 1));
    }
    let report = required(answer.report.as_ref(), "report")?;
    let mut checks = Checks::new();
    let arrays = [("torque_schedule.left_n_m", &left[..]), ("torque_schedule.right_n_m", &right[..])];
    if limits.check_arrays(&mut checks, arrays) {
        let steps = Rule::between(left.len().max(1) as f64, limits.max_steps as f64, "");
        checks.bounds("report.steps", report.steps.into(), &steps);
    }
    checks.finish()?;
    // The reference robot in place of the joined one, which keeps its rules by itself: those of the torques are left.
    let step_count = report.steps as usize;
    SimulateInput::new(SimulateParameters { schedule: schedule.clone(), step_count, ..SimulateParameters::default() })?;
    Ok((schedule, step_count))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use serde_json::json;

    use super::*;
    use crate::contract::message::PresentedPlan;
    use crate::jobs::InProcessSolver;
    use crate::jobs::export::Export;
    use crate::jobs::present::Present;
    use crate::metrics::Metrics;
    use crate::service::Job as _;

    #[test]
    fn plan_that_waits_holds_no_more_of_a_long_answer_than_is_compared() {
        let torques = json!({"interval_s": 1, "left_n_m": [0], "right_n_m": [0]});
        let answer = json!({"contact_modes": vec![json!({}); 1000], "end_state": {"y_m": 1}});
        let plan = json!({"simulate": {"request": {"torque_schedule": torques}, "answer": answer}});
        let plan: PresentedPlan = serde_json::from_value(plan).unwrap();
        let plan = AcceptedPlan::of(None, plan.simulate, &Limits::default()).unwrap();
        let Said::Simulate(answer) = plan.without_report().said else { panic!("a simulation") };
        assert_eq!((answer.contact_modes.len(), answer.end_state.map(|end| end.y_m)), (0, Some(1.0)));
    }

    #[test]
    fn light_jobs_have_two_seconds_where_a_clock_runs() {
        let torques = json!({"interval_s": 1, "left_n_m": [0], "right_n_m": [0]});
        let plan = json!({"simulate": {"request": {"torque_schedule": torques}, "answer": {}}});
        let presented = json!({"plans": [plan]}).to_string();
        let mut exported = plan;
        exported["format"] = json!("csv");
        exported["rate_hz"] = json!(100);
        let exported = exported.to_string();
        for (limits, expected) in
            [(Limits::default(), Some(Duration::from_secs(2))), (Limits::default().without_clock(), None)]
        {
            let export = Export::read(exported.as_bytes(), &limits).unwrap();
            assert_eq!(Export::new(Arc::new(InProcessSolver), &Metrics::new()).time_limit(&export), expected);
            let present = Present::read(presented.as_bytes(), &limits).unwrap();
            assert_eq!(Present::new(Arc::new(InProcessSolver), &Metrics::new()).time_limit(&present), expected);
        }
    }
}
