//! Rollouts: a torque schedule integrated from a start state.

use std::borrow::Cow;

use nalgebra::Vector2;

use super::friction_law::FrictionLaw;
use super::moreau_step::{Step, StepModel};
use super::torque_schedule::{TorqueSchedule, control_interval};
use super::trajectory::{ContactSample, Trajectory};
use crate::contact::{
    ContactSolution, DelassusOperator, ExactSolver, FixedPointSolver, OneStepProblem, PerContact, natural_map,
    solve_held, solve_smoothed,
};
use crate::robot::{Robot, State, TangentJacobian};
use crate::stop::{Stop, Stopped};

/// Most sweeps of the fixed point in one step: far above the 5,000 that hard steps were seen to take.
const FIXED_POINT_LIMIT: usize = 200_000;

/// The solver of the one-step friction problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactMethod {
    /// Contact patterns solved exactly.
    #[default]
    Exact,
    /// The paper's prox fixed point.
    FixedPoint,
}

/// Integrates torque schedules of one robot.
#[derive(Debug, Clone)]
pub struct Simulator {
    robot: Robot,
    model: Model,
}

/// The step model in as many friction directions as the robot has.
#[derive(Debug, Clone)]
pub(super) enum Model {
    /// The front support is frictionless.
    Wheels(Box<StepModel<3>>),
    /// The front support has friction.
    WheelsAndFront(Box<StepModel<5>>),
}

/// Start, torques and grid of one rollout.
#[derive(Debug, Clone, Copy)]
pub struct Rollout<'a> {
    /// Start state at the chassis centre of mass.
    pub start: &'a State,
    /// The torques, at least one interval.
    pub schedule: &'a TorqueSchedule,
    /// Number of time steps.
    pub step_count: usize,
}

impl Rollout<'_> {
    /// s.
    pub(crate) fn step_length(&self) -> f64 {
        self.schedule.final_time / self.step_count as f64
    }
}

impl Model {
    fn new(robot: &Robot, step_length: f64) -> Self {
        if robot.parameters().front_friction_coefficient > 0.0 {
            Self::WheelsAndFront(Box::new(StepModel::new(robot, step_length)))
        } else {
            Self::Wheels(Box::new(StepModel::new(robot, step_length)))
        }
    }
}

impl Simulator {
    /// Prepares the step model of a robot.
    pub fn new(robot: &Robot) -> Self {
        Self { robot: robot.clone(), model: Model::new(robot, 0.0) }
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The step model of a rollout: with viscous friction one of its own, since that depends on the step length.
    pub(super) fn model(&self, rollout: &Rollout) -> Cow<'_, Model> {
        if self.robot.parameters().wheel_viscous_friction > 0.0 {
            Cow::Owned(Model::new(&self.robot, rollout.step_length()))
        } else {
            Cow::Borrowed(&self.model)
        }
    }

    /// The state at the end of a rollout; allocates nothing in its steps, and nothing at all without viscous friction.
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn end_state(&self, rollout: &Rollout, stop: Stop) -> Result<State, Stopped> {
        match &*self.model(rollout) {
            Model::Wheels(model) => integrate_under(FrictionLaw::Exact, model, rollout, stop, |_, _| {}),
            Model::WheelsAndFront(model) => integrate_under(FrictionLaw::Exact, model, rollout, stop, |_, _| {}),
        }
    }

    /// As [`Simulator::end_state`], by the paper's fixed point: the slow reference.
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn end_state_by_fixed_point(&self, rollout: &Rollout, stop: Stop) -> Result<State, Stopped> {
        let mut solver = FixedPointSolver::new(FIXED_POINT_LIMIT);
        match &*self.model(rollout) {
            Model::Wheels(model) => integrate(model, rollout, by_fixed_point(&mut solver, stop), stop, |_, _| {}),
            Model::WheelsAndFront(model) => {
                integrate(model, rollout, by_fixed_point(&mut solver, stop), stop, |_, _| {})
            }
        }
    }

    /// The whole rollout: states, contacts, residuals.
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn trajectory(&self, rollout: &Rollout, method: ContactMethod, stop: Stop) -> Result<Trajectory, Stopped> {
        let jacobian = self.robot.tangent_jacobian();
        let mut trajectory = match &*self.model(rollout) {
            Model::Wheels(model) => record(model, jacobian, rollout, method, stop),
            Model::WheelsAndFront(model) => record(model, jacobian, rollout, method, stop),
        }?;
        trajectory.end_state = self.end_frame(rollout, Vector2::zeros()).state(&trajectory.end_state);
        Ok(trajectory)
    }

    /// In how many steps of a rollout a second solution of the friction problem is found; none where uniqueness is proved. Where it is not, a
    /// step takes twenty times as long as in another rollout.
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn indeterminate_steps(&self, rollout: &Rollout, stop: Stop) -> Result<usize, Stopped> {
        match &*self.model(rollout) {
            Model::Wheels(model) => indeterminate_steps(model, rollout, stop),
            Model::WheelsAndFront(model) => indeterminate_steps(model, rollout, stop),
        }
    }
}

/// The time-stepping loop: allocates nothing, prints nothing, reads no clock. `solve` is as in [`StepModel::advance`]; `on_step` may move
/// the contact solution of its step, from which the next one is solved.
///
/// It asks after each step whether it is stopped, because the contact solver of a stopped step may end early.
#[inline]
pub(super) fn integrate<const N: usize>(
    model: &StepModel<N>,
    rollout: &Rollout,
    mut solve: impl FnMut(&DelassusOperator<N>, &OneStepProblem<N>, &mut ContactSolution<N>),
    stop: Stop,
    mut on_step: impl FnMut(usize, &mut Step<N>),
) -> Result<State, Stopped> {
    let steps = rollout.step_count;
    let dt = rollout.step_length();
    let mut step = Step::before(rollout.start, dt);
    for index in 0..steps {
        let interval = control_interval(index, steps, rollout.schedule.control_count());
        model.advance(&mut step, rollout.schedule.torque(interval), dt, &mut solve);
        stop.check()?;
        on_step(index, &mut step);
    }
    Ok(step.end)
}

/// The same under a friction law. A step takes at most some hundred small linear solves, and need not ask whether it is stopped.
#[inline]
pub(super) fn integrate_under<const N: usize>(
    law: FrictionLaw,
    model: &StepModel<N>,
    rollout: &Rollout,
    stop: Stop,
    on_step: impl FnMut(usize, &mut Step<N>),
) -> Result<State, Stopped> {
    match law {
        FrictionLaw::Exact => integrate(model, rollout, exactly, stop, on_step),
        FrictionLaw::Smoothed(slip_smoothing) => {
            let solve = |operator: &_, problem: &_, solution: &mut _| {
                solve_smoothed(operator, problem, slip_smoothing, solution);
            };
            integrate(model, rollout, solve, stop, on_step)
        }
        FrictionLaw::Held(slip_smoothing) => {
            let solve = |operator: &_, problem: &_, solution: &mut _| {
                solve_held(operator, problem, slip_smoothing, solution);
            };
            integrate(model, rollout, solve, stop, on_step)
        }
    }
}

#[inline]
fn exactly<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    solution: &mut ContactSolution<N>,
) {
    ExactSolver.solve(operator, problem, solution);
}

fn by_fixed_point<const N: usize>(
    solver: &mut FixedPointSolver,
    stop: Stop,
) -> impl FnMut(&DelassusOperator<N>, &OneStepProblem<N>, &mut ContactSolution<N>) {
    move |operator, problem, solution| *solution = solver.solve(operator, problem, &stop)
}

fn indeterminate_steps<const N: usize>(model: &StepModel<N>, rollout: &Rollout, stop: Stop) -> Result<usize, Stopped> {
    let mut count = 0;
    if !model.operator.has_unique_solutions() {
        let solve = |operator: &_, problem: &_, solution: &mut _| {
            ExactSolver.solve(operator, problem, solution);
            count += usize::from(ExactSolver.is_indeterminate(operator, problem, solution));
        };
        integrate(model, rollout, solve, stop, |_, _| {})?;
    }
    Ok(count)
}

fn record<const N: usize>(
    model: &StepModel<N>,
    jacobian: &TangentJacobian,
    rollout: &Rollout,
    method: ContactMethod,
    stop: Stop,
) -> Result<Trajectory, Stopped> {
    match method {
        ContactMethod::Exact => record_with(model, jacobian, rollout, exactly, stop),
        ContactMethod::FixedPoint => {
            let mut solver = FixedPointSolver::new(FIXED_POINT_LIMIT);
            record_with(model, jacobian, rollout, by_fixed_point(&mut solver, stop), stop)
        }
    }
}

fn record_with<const N: usize>(
    model: &StepModel<N>,
    jacobian: &TangentJacobian,
    rollout: &Rollout,
    solve: impl FnMut(&DelassusOperator<N>, &OneStepProblem<N>, &mut ContactSolution<N>),
    stop: Stop,
) -> Result<Trajectory, Stopped> {
    let steps = rollout.step_count;
    let dt = rollout.step_length();
    let mut trajectory = Trajectory {
        time: (0..=steps).map(|node| rollout.schedule.final_time * (node as f64 / steps as f64)).collect(),
        state: Vec::with_capacity(steps + 1),
        end_state: *rollout.start,
        contact: Vec::with_capacity(steps),
        degrees_of_freedom: Vec::with_capacity(steps),
        worst_contact_residual: 0.0,
    };
    trajectory.state.push(*rollout.start);
    trajectory.end_state = integrate(model, rollout, solve, stop, |_, step| {
        trajectory.state.push(step.end);
        trajectory.contact.push(contact_samples(model, jacobian, step, dt));
        trajectory.degrees_of_freedom.push(step.contact.pattern.degrees_of_freedom());
        let (worst, residual) = (&mut trajectory.worst_contact_residual, step.contact.residual);
        // What is not a number stays.
        if residual > *worst || residual.is_nan() {
            *worst = residual;
        }
    })?;
    Ok(trajectory)
}

fn contact_samples<const N: usize>(
    model: &StepModel<N>,
    jacobian: &TangentJacobian,
    step: &Step<N>,
    dt: f64,
) -> PerContact<ContactSample> {
    let impulse = natural_map::contact_impulses_by_utilization(&model.operator, &step.contact);
    let [left, right, axle] = jacobian.wheel_slip(&step.end_velocity);
    let [front_longitudinal, front_lateral] = jacobian.front_slip(&step.end_velocity);
    let slip = [[left, axle], [right, axle], [front_longitudinal, front_lateral]];
    let modes = step.contact.pattern.modes();
    PerContact::from_array(std::array::from_fn(|contact| ContactSample {
        normal_force: step.contact.normal_impulse[contact] / dt,
        lateral_force: impulse[contact][1] / dt,
        longitudinal_force: impulse[contact][0] / dt,
        lateral_slip: slip[contact][1],
        longitudinal_slip: slip[contact][0],
        mode: modes[contact],
    }))
}

#[cfg(test)]
mod tests;
