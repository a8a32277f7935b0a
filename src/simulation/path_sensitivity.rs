//! Derivatives of chosen path quantities of a rollout with respect to every torque and the final time.
//!
//! Normal forces, which every plan must keep, are near their limits in few steps: the discrete adjoint method pays for each of
//! these values. A plan with other limits follows them throughout, and `path_tangents` pays for each variable instead.
//!
//! A normal force depends on the body velocity at the start of its step, on the torques and on the step length. One backward
//! sweep in the body frame carries a row per chosen value:
//!
//! ```text
//! u_E = step(u_A, torque, dt)               in the body frame of the midpoint
//! u_A of the next step = Rot(-dt omega_E) u_E
//! ```

use super::friction_law::FrictionLaw;
use super::moreau_step::StepModel;
use super::path_row::{PathDerivative, PathRow};
use super::path_tangents;
use super::rollout::{Model, Rollout, Simulator};
use super::sensitivity::EndSensitivity;
use super::step_derivative::StepDerivative;
use super::tape::TapeEntry;
use super::torque_schedule::control_interval;
use crate::robot::{BodyVector, PerWheel};
use crate::stop::{Stop, Stopped};

/// The derivatives of a chosen value by the current step, in the backward sweep.
struct Row {
    /// The step of the value.
    step: usize,
    by_velocity: [f64; 5],
    by_step_length: f64,
}

impl Simulator {
    /// Differentiates some of the path extremes of a rollout that `sensitivity` has just been computed for, under the same
    /// law. `chosen` are indices into [`PathExtremes`](super::PathExtremes).
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn path_sensitivity(
        &self,
        rollout: &Rollout,
        law: FrictionLaw,
        sensitivity: &EndSensitivity,
        chosen: &[usize],
        stop: Stop,
    ) -> Result<Vec<PathDerivative>, Stopped> {
        match &*self.model(rollout) {
            Model::Wheels(model) => differentiate(model, (rollout, law), sensitivity, chosen, stop),
            Model::WheelsAndFront(model) => differentiate(model, (rollout, law), sensitivity, chosen, stop),
        }
    }
}

fn differentiate<const N: usize>(
    model: &StepModel<N>,
    (rollout, law): (&Rollout, FrictionLaw),
    sensitivity: &EndSensitivity,
    chosen: &[usize],
    stop: Stop,
) -> Result<Vec<PathDerivative>, Stopped> {
    let path = &sensitivity.path;
    if path.has_others() {
        return path_tangents::differentiate(model, (rollout, law), sensitivity, chosen, stop);
    }
    let control_count = rollout.schedule.control_count();
    let mut rows: Vec<Row> = chosen.iter().map(|&index| Row::new(path.step(index))).collect();
    let mut derivatives = vec![PathDerivative::zero(control_count); chosen.len()];
    let last = rows.iter().map(|row| row.step).max().unwrap_or(0);
    let dt = rollout.step_length();
    for (index, entry) in sensitivity.tape[..=last].iter().enumerate().rev() {
        stop.check()?;
        let interval = control_interval(index, rollout.step_count, control_count);
        let controls = (rollout.schedule.torque(interval), dt);
        let by_step = StepDerivative::new(model, entry, controls, law);
        let turn = (dt * entry.end_velocity[2]).sin_cos();
        let reached = rows.iter_mut().zip(&mut derivatives).zip(chosen).filter(|((row, _), _)| row.step >= index);
        for ((row, derivative), &value) in reached {
            let by_torque = if row.step == index {
                let value = (path.quantity(value), &path.sample(index));
                row.begin(&PathRow::new(value, (entry, dt), &by_step))
            } else {
                row.step_back(&by_step, entry, (&sensitivity.tape[index + 1], turn), dt)
            };
            derivative.by_left_torque[interval] += by_torque.left;
            derivative.by_right_torque[interval] += by_torque.right;
        }
    }
    for (row, derivative) in rows.iter_mut().zip(&mut derivatives) {
        row.reach_start(&sensitivity.tape[0]);
        derivative.by_final_time = row.by_step_length / rollout.step_count as f64;
    }
    Ok(derivatives)
}

impl Row {
    fn new(step: usize) -> Self {
        Self { step, by_velocity: [0.0; 5], by_step_length: 0.0 }
    }

    /// The step of the value itself; returns the derivatives by its torques.
    fn begin(&mut self, row: &PathRow) -> PerWheel<f64> {
        (self.by_velocity, self.by_step_length) = (row.by_input.by_velocity, row.by_input.by_step_length);
        row.by_input.by_torque
    }

    /// Back over an earlier step; `next` is the step after it, whose body frame is turned by the angle with this sine and cosine.
    fn step_back<const N: usize>(
        &mut self,
        by_step: &StepDerivative<N>,
        entry: &TapeEntry,
        (next, (sin, cos)): (&TapeEntry, (f64, f64)),
        dt: f64,
    ) -> PerWheel<f64> {
        let by_angle = self.by_angle(&next.start_velocity);
        let (right, forward) = (self.by_velocity[0], self.by_velocity[1]);
        self.by_velocity[0] = right * cos - forward * sin;
        self.by_velocity[1] = right * sin + forward * cos;
        self.by_velocity[2] += dt * by_angle;
        self.by_step_length += entry.end_velocity[2] * by_angle;

        let by_input = by_step.back(&self.by_velocity);
        self.by_velocity = by_input.by_velocity;
        self.by_step_length += by_input.by_step_length;
        by_input.by_torque
    }

    /// The first midpoint is turned by half a step from the start.
    fn reach_start(&mut self, first: &TapeEntry) {
        self.by_step_length += 0.5 * first.start_velocity[2] * self.by_angle(&first.start_velocity);
    }

    /// By the angle through which the body frame turns against a fixed velocity, which is `velocity` in the turned frame.
    fn by_angle(&self, velocity: &BodyVector) -> f64 {
        self.by_velocity[0] * velocity[1] - self.by_velocity[1] * velocity[0]
    }
}
