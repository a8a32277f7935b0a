//! One rollout of a given torque schedule.

use std::sync::Arc;
use std::time::Duration;

use super::table::{line, row, separations, write_limits, write_timeline};
use super::{ARRAYS_OF_STEPS, Kind, Limits, ManeuverSolver, STEP_S};
use crate::contract::convert::{aisle_corners, contacts, count, named, payload, required, robot, schedule};
use crate::contract::message::{
    ContactSolver, PresentRequest, PresentedPlan, ReferencePoint, SimulateGrid, SimulateRequest, SimulateResponse,
    SimulatedPlan,
};
use crate::contract::{Problem, json};
use crate::metrics::Metrics;
use crate::motion::{self, LimitUse, SimulateInput, SimulateParameters, Simulation};
use crate::rules::{Checks, RuleSet};
use crate::service::{Cost, Done, Job, JobControl, Stopped};
use crate::shooting::StateComponent;

const ARRAYS: [&str; 2] = ["torque_schedule.left_n_m", "torque_schedule.right_n_m"];

/// Simulates torque schedules.
pub struct Simulate(Arc<dyn ManeuverSolver>);

impl Simulate {
    /// Simulates with this solver.
    pub fn new(solver: Arc<dyn ManeuverSolver>, _metrics: &Metrics) -> Self {
        Self(solver)
    }
}

/// A valid simulation with what this server adds.
#[derive(Debug)]
pub struct AcceptedSimulation {
    /// What is simulated.
    pub input: SimulateInput,
    /// How long it may run; none where no clock ends it.
    time_limit: Option<Duration>,
}

impl Job for Simulate {
    const NAME: &'static str = "simulate";
    type Input = AcceptedSimulation;
    type Output = Simulation;
    type Progress = ();

    fn cost(&self, accepted: &AcceptedSimulation) -> Cost {
        Cost::seconds(accepted.input.step_count as f64 * STEP_S)
    }

    /// Where friction is hard to resolve a step takes a hundred times as long as usual.
    fn time_limit(&self, accepted: &AcceptedSimulation) -> Option<Duration> {
        accepted.time_limit
    }

    fn run(&self, accepted: &AcceptedSimulation, control: &JobControl<'_, ()>) -> Result<Simulation, Stopped> {
        self.0.simulate(&accepted.input, control.stop().cut_flag().into()).map_err(|_| control.cut_off())
    }
}

impl Kind for Simulate {
    const SUMMARY: &'static str = "integrates one torque schedule";
    const METHODS: &'static [&'static str] = &["Simulate"];
    const HAS_FIGURES: bool = true;
    type Request = SimulateRequest;
    type Answer = SimulateResponse;
    type Report = ();

    fn rules(limits: &Limits) -> RuleSet {
        limits.on_arrays(SimulateParameters::rules().at_most("grid.steps", limits.max_steps as f64), ARRAYS)
    }

    fn validate(request: SimulateRequest, limits: &Limits) -> Result<AcceptedSimulation, Problem> {
        let SimulateRequest {
            robot: given_robot,
            payload: given_payload,
            reference_point,
            start,
            torque_schedule,
            grid,
            contact_solver,
            limits: given_limits,
            keep_in,
        } = request;
        let given_robot = given_robot.unwrap_or_default();
        let reference_point: ReferencePoint = named(reference_point, "reference_point")?;
        let contact_solver: ContactSolver = named(contact_solver, "contact_solver")?;
        let SimulateGrid { steps } = grid.unwrap_or_default();
        let mut schedule = schedule(required(torque_schedule, "torque_schedule")?, "torque_schedule")?;
        // Absent: the paper's number of steps, or the next one that gives all intervals as many.
        let interval_count = schedule.control_count().clamp(1, limits.max_control_intervals);
        let step_count = steps.map_or(motion::first_step_count(interval_count), |steps| steps as usize);
        let mut checks = Checks::new();
        checks.server_limit("grid.steps", step_count as f64, limits.max_steps as f64);
        if !limits.check_arrays(&mut checks, [(ARRAYS[0], &schedule.left), (ARRAYS[1], &schedule.right)]) {
            schedule.left.truncate(1);
            schedule.right.truncate(1);
        }
        let parameters = SimulateParameters {
            robot: robot(&given_robot, &mut checks),
            payload: given_payload.map(payload).transpose()?,
            reference_point: reference_point.into(),
            start: start.unwrap_or_default().into(),
            schedule,
            step_count,
            contact_method: contact_solver.into(),
            limits: given_limits.unwrap_or_default().into(),
            aisle: aisle_corners(&keep_in, &given_robot.footprint),
        };
        let input = checks.and(SimulateInput::new(parameters))?;
        Ok(AcceptedSimulation { input, time_limit: limits.time_limit() })
    }

    fn answer_bytes(accepted: &AcceptedSimulation, number_bytes: usize) -> usize {
        number_bytes * ARRAYS_OF_STEPS * accepted.input.step_count
    }

    fn answer(_accepted: &AcceptedSimulation, done: &Done<Simulation>) -> SimulateResponse {
        // The same request gives the same bytes: the duration goes to the log only.
        let Simulation { trajectory, indeterminate_steps, limits } = &done.output;
        SimulateResponse {
            end_state: Some((&trajectory.end_state).into()),
            trajectory: Some(trajectory.into()),
            contacts: Some(contacts(&trajectory.contact)),
            contact_modes: trajectory.contact_modes().iter().map(Into::into).collect(),
            separations: trajectory.separations().iter().map(Into::into).collect(),
            worst_contact_residual: trajectory.worst_contact_residual,
            indeterminate_steps: count(*indeterminate_steps),
            slip_reversals: count(trajectory.slip_reversals()),
            limits: limits.iter().map(at_root).map(|used| (&used).into()).collect(),
        }
    }

    fn presentation(body: &[u8], answer: SimulateResponse) -> Option<PresentRequest> {
        let simulate = SimulatedPlan { request: Some(json::read_object(body).ok()?), answer: Some(answer) };
        Some(PresentRequest {
            plans: vec![PresentedPlan { solve: None, simulate: Some(simulate.into()) }],
            report: false,
        })
    }

    /// Duration, end state, use of limits and the timeline of contact modes.
    fn table(_accepted: &AcceptedSimulation, done: &Done<Simulation>) -> String {
        let simulation = &done.output;
        let trajectory = &simulation.trajectory;
        let mut table = String::new();
        let end_time = trajectory.time.last().copied().unwrap_or_default();
        row(&mut table, "duration", &format!("{end_time:.6} s in {} steps", trajectory.step_count()));
        if trajectory.diverges() {
            row(&mut table, "motion", "diverges");
        }
        row(&mut table, "separations", &separations(&trajectory.separations()));
        row(&mut table, "slip reversals", &trajectory.slip_reversals().to_string());
        row(&mut table, "indeterminate", &format!("{} steps", simulation.indeterminate_steps));
        row(&mut table, "contact residual", &format!("{:.1e}", trajectory.worst_contact_residual));
        table.push_str("\nend state\n");
        let values = trajectory.end_state.to_vector();
        for component in StateComponent::ALL {
            line(&mut table, &format!("  {:<22} {:>12.6}", component.field(), values[component.index()]));
        }
        let limits: Vec<_> = simulation.limits.iter().map(at_root).collect();
        write_limits(&mut table, &limits);
        write_timeline(&mut table, &trajectory.contact_modes());
        table
    }
}

fn at_root(used: &LimitUse) -> LimitUse {
    LimitUse { limit: name_at_root(used.limit), ..*used }
}

/// What a solve has below its maneuver a simulation has at its root.
pub(super) fn name_at_root(limit: &'static str) -> &'static str {
    limit.strip_prefix("maneuver.").unwrap_or(limit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::simulate;
    use crate::stop::Stop;

    #[test]
    fn table_names_limits_as_the_answer_does() {
        let body = br#"{"torque_schedule": {"interval_s": 0.1, "left_n_m": [0.1, 0], "right_n_m": [0.1, 0]},
                        "limits": {"speed_m_s": 1, "torque_rate_n_m_s": 1}}"#;
        let accepted = Simulate::read(body, &Limits::default()).unwrap();
        let output = simulate(&accepted.input, Stop::never()).unwrap();
        let done = Done { output, queue_wait: Duration::ZERO, duration: Duration::ZERO };
        let (table, uses) = (Simulate::table(&accepted, &done), Simulate::answer(&accepted, &done).limits);
        let names: Vec<_> = uses.iter().map(|used| used.limit.as_str()).collect();
        assert_eq!(names, ["limits.speed_m_s", "limits.torque_rate_n_m_s"]);
        assert!(names.iter().all(|name| table.contains(&format!("\n  {name} "))), "{table}");
    }

    #[test]
    fn interval_in_which_nothing_moves_is_refused() {
        let body = br#"{"torque_schedule": {"interval_s": 1e-300, "left_n_m": [1], "right_n_m": [1]}}"#;
        let problem = Simulate::read(body, &Limits::default()).unwrap_err();
        assert_eq!(problem.errors()[0].pointer, "#/torque_schedule/interval_s");
    }

    #[test]
    fn long_schedule_is_refused_before_its_numbers_are_judged() {
        let zeros = vec!["9e99"; 2000].join(",");
        let body =
            format!(r#"{{"torque_schedule": {{"interval_s": 1, "left_n_m": [{zeros}], "right_n_m": [{zeros}]}}}}"#);
        let problem = Simulate::read(body.as_bytes(), &Limits::default()).unwrap_err();
        let pointers: Vec<_> = problem.errors().iter().map(|error| error.pointer.as_str()).collect();
        assert_eq!(pointers, ["#/torque_schedule/left_n_m", "#/torque_schedule/right_n_m"]);
    }
}
