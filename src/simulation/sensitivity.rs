//! Derivatives of a rollout's end state with respect to every torque and the final time, by the discrete adjoint method
//! (reverse accumulation over the steps).
//!
//! The converged steps are differentiated, not the iterations that computed them: in its contact pattern each step's
//! friction impulse is a differentiable function of the step's data (implicit function theorem), so a step is a
//! differentiable map
//!
//! ```text
//! u_E = u_A + dt a(u_A, torque) + P Lambda(free_slip, free_normal)       in the body frame of the midpoint
//! ```
//!
//! One backward sweep carries ten rows, the derivatives of the end state by the current state. Position and wheel
//! angles enter no step, so their rows and columns pass through unchanged. Transitions between sticking and slipping
//! are exact; at a slip reversal the derivative of every fixed-step scheme is wrong (`docs/model.md`).

use nalgebra::SVector;

use super::friction_law::FrictionLaw;
use super::moreau_step::{Step, StepModel};
use super::path_extremes::PathExtremes;
use super::path_quantity::PathQuantity;
use super::rollout::{Model, Rollout, Simulator, integrate_under};
use super::step_derivative::StepDerivative;
use super::tape::TapeEntry;
use super::torque_schedule::control_interval;
use crate::robot::{BodyVector, PerWheel, State};
use crate::stop::{Stop, Stopped};

/// A derivative of the ten components of the end state, in the order of [`State::to_vector`].
pub type EndDerivative = SVector<f64, { State::LEN }>;

/// Derivatives by each of the five body or generalized velocities.
type ByVelocity = [EndDerivative; 5];

/// The end state of a rollout with its derivatives; also the memory of the backward sweep.
#[derive(Debug, Clone, Default)]
pub struct EndSensitivity {
    /// The end state at the chassis centre of mass.
    pub end: State,
    /// By the left torque of each interval, per N m.
    pub by_left_torque: Vec<EndDerivative>,
    /// By the right torque of each interval, per N m.
    pub by_right_torque: Vec<EndDerivative>,
    /// By the final time, per s.
    pub by_final_time: EndDerivative,
    /// The largest values of the path quantities on the way.
    pub path: PathExtremes,
    pub(super) tape: Vec<TapeEntry>,
}

impl EndSensitivity {
    /// With the path extremes of these quantities beside the normal forces, for schedules of so many control intervals.
    pub fn watching(others: Vec<PathQuantity>, control_count: usize) -> Self {
        Self { path: PathExtremes::new(others, control_count), ..Self::default() }
    }
}

impl Simulator {
    /// Integrates a rollout and differentiates its end state, reusing the memory of `sensitivity`.
    ///
    /// # Errors
    /// When it was stopped before the end; `sensitivity` is then unusable.
    pub fn end_sensitivity(
        &self,
        rollout: &Rollout,
        law: FrictionLaw,
        sensitivity: &mut EndSensitivity,
        stop: Stop,
    ) -> Result<(), Stopped> {
        self.record(rollout, law, sensitivity, stop)?;
        self.differentiate(rollout, law, sensitivity, stop)
    }

    /// Integrates a rollout and keeps what its derivatives need: end state and path extremes are those of the
    /// rollout; the derivatives are valid only after [`Simulator::differentiate`]. Once the memory is there it allocates nothing
    /// but the step model of a robot with viscous friction.
    ///
    /// # Errors
    /// When it was stopped before the end; nothing usable is kept then.
    pub fn record(
        &self,
        rollout: &Rollout,
        law: FrictionLaw,
        sensitivity: &mut EndSensitivity,
        stop: Stop,
    ) -> Result<(), Stopped> {
        match &*self.model(rollout) {
            Model::Wheels(model) => record(model, rollout, law, sensitivity, stop),
            Model::WheelsAndFront(model) => record(model, rollout, law, sensitivity, stop),
        }
    }

    /// Differentiates the end state of the rollout that was recorded last, under the same `slip_smoothing`.
    ///
    /// # Errors
    /// When it was stopped before the end; the derivatives are not valid then.
    pub fn differentiate(
        &self,
        rollout: &Rollout,
        law: FrictionLaw,
        sensitivity: &mut EndSensitivity,
        stop: Stop,
    ) -> Result<(), Stopped> {
        match &*self.model(rollout) {
            Model::Wheels(model) => differentiate(model, rollout, law, sensitivity, stop),
            Model::WheelsAndFront(model) => differentiate(model, rollout, law, sensitivity, stop),
        }
    }
}

fn record<const N: usize>(
    model: &StepModel<N>,
    rollout: &Rollout,
    law: FrictionLaw,
    sensitivity: &mut EndSensitivity,
    stop: Stop,
) -> Result<(), Stopped> {
    let EndSensitivity { end, path, tape, .. } = sensitivity;
    tape.clear();
    tape.reserve(rollout.step_count);
    path.clear(rollout);
    let note = |index: usize, step: &Step<N>| {
        let entry = TapeEntry::new(step);
        path.note(index, step, &entry, rollout);
        tape.push(entry);
    };
    *end = integrate_under(law, model, rollout, stop, note)?;
    Ok(())
}

fn differentiate<const N: usize>(
    model: &StepModel<N>,
    rollout: &Rollout,
    law: FrictionLaw,
    sensitivity: &mut EndSensitivity,
    stop: Stop,
) -> Result<(), Stopped> {
    let EndSensitivity { by_left_torque, by_right_torque, by_final_time, tape, .. } = sensitivity;
    let control_count = rollout.schedule.control_count();
    for derivatives in [&mut *by_left_torque, &mut *by_right_torque] {
        derivatives.clear();
        derivatives.resize(control_count, EndDerivative::zeros());
    }
    let dt = rollout.step_length();
    let mut sweep = BackwardSweep::new(law);
    for (index, entry) in tape.iter().enumerate().rev() {
        stop.check()?;
        let interval = control_interval(index, rollout.step_count, control_count);
        let by_torque = sweep.step(model, entry, rollout.schedule.torque(interval), dt);
        by_left_torque[interval] += by_torque.left;
        by_right_torque[interval] += by_torque.right;
    }
    *by_final_time = sweep.by_step_length / rollout.step_count as f64;
    Ok(())
}

/// Derivatives of the end state by the state at the end of the current step.
struct BackwardSweep {
    by_heading: EndDerivative,
    by_velocity: ByVelocity,
    by_step_length: EndDerivative,
    law: FrictionLaw,
}

impl BackwardSweep {
    fn new(law: FrictionLaw) -> Self {
        let mut by_heading = EndDerivative::zeros();
        by_heading[2] = 1.0;
        let mut by_velocity = ByVelocity::default();
        for (axis, derivative) in by_velocity.iter_mut().enumerate() {
            derivative[5 + axis] = 1.0;
        }
        Self { by_heading, by_velocity, by_step_length: EndDerivative::zeros(), law }
    }

    /// Goes back over one step; returns the derivatives by its torques.
    #[inline]
    fn step<const N: usize>(
        &mut self,
        model: &StepModel<N>,
        entry: &TapeEntry,
        torque: PerWheel<f64>,
        dt: f64,
    ) -> PerWheel<EndDerivative> {
        let half = 0.5 * dt;
        let (sin, cos) = entry.rotation;
        let (v, w) = (&entry.start_velocity, &entry.end_velocity);

        // q_E = q_A + dt/2 (u_A + u_E): the step length, then u_E. Only x, y, heading, psi of q_E are touched.
        let (start, end) = (world(v, entry.rotation), world(w, entry.rotation));
        let mean = 0.5 * (start + end);
        self.by_step_length += self.by_heading * mean[2];
        for (row, velocity) in [(0, mean[0]), (1, mean[1]), (3, mean[3]), (4, mean[4])] {
            self.by_step_length[row] += velocity;
        }
        let mut by_end = self.by_velocity;
        self.add_position_share(&mut by_end, half);

        // u_E from the body frame of the midpoint into the world: rotate the derivatives back.
        let mut by_midpoint_heading = by_end[1] * end[0] - by_end[0] * end[1];
        rotate_into_body(&mut by_end, sin, cos);

        let derivative = StepDerivative::of_motion(model, entry, (torque, dt), self.law);
        let PerWheel { left, right } = &derivative.by_torque;
        let by_torque = PerWheel::new(through(&by_end, left.as_ref()), through(&by_end, right.as_ref()));
        self.by_step_length += through(&by_end, derivative.by_step_length.as_ref());
        let mut by_start = derivative.by_velocity.data.0.map(|by_start_velocity| through(&by_end, &by_start_velocity));

        // u_A into the body frame, and the heading of the midpoint.
        by_midpoint_heading += by_start[0] * v[1] - by_start[1] * v[0];
        rotate_into_world(&mut by_start, sin, cos);
        self.add_position_share(&mut by_start, half);
        by_start[2] += by_midpoint_heading * half;
        self.by_step_length += by_midpoint_heading * (0.5 * v[2]);
        self.by_heading += by_midpoint_heading;
        self.by_velocity = by_start;
        by_torque
    }

    /// Adds the path from a velocity through the end configuration: `half` times the derivatives by the configuration.
    #[inline]
    fn add_position_share(&self, by_velocity: &mut ByVelocity, half: f64) {
        by_velocity[0][0] += half;
        by_velocity[1][1] += half;
        by_velocity[2] += self.by_heading * half;
        by_velocity[3][3] += half;
        by_velocity[4][4] += half;
    }
}

/// A body velocity in the world frame.
#[inline]
fn world(velocity: &BodyVector, (sin, cos): (f64, f64)) -> BodyVector {
    BodyVector::from([
        cos * velocity[0] - sin * velocity[1],
        sin * velocity[0] + cos * velocity[1],
        velocity[2],
        velocity[3],
        velocity[4],
    ])
}

/// The chain rule: derivatives by the velocities, and those velocities' derivatives by one variable.
///
/// Vector by vector: nalgebra's matrix product, whose strides are not known at compile time, takes three times as long.
#[inline]
fn through(by_velocity: &ByVelocity, of_velocity: &[f64; 5]) -> EndDerivative {
    let [right, forward, yaw, left_wheel, right_wheel] = by_velocity;
    let of = of_velocity;
    right * of[0] + forward * of[1] + yaw * of[2] + left_wheel * of[3] + right_wheel * of[4]
}

/// Derivatives by world velocities become derivatives by body velocities.
#[inline]
fn rotate_into_body(by_velocity: &mut ByVelocity, sin: f64, cos: f64) {
    let [x, y, ..] = *by_velocity;
    by_velocity[0] = x * cos + y * sin;
    by_velocity[1] = y * cos - x * sin;
}

/// The inverse of [`rotate_into_body`].
#[inline]
fn rotate_into_world(by_velocity: &mut ByVelocity, sin: f64, cos: f64) {
    rotate_into_body(by_velocity, -sin, cos);
}
