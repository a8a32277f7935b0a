//! Derivatives of chosen normal forces of a rollout with respect to every torque and the final time, by the discrete
//! adjoint method.
//!
//! A normal force depends on the body velocity at the start of its step, on the torques and on the step length, but not on
//! position or heading. One backward sweep in the body frame carries a row per chosen force:
//!
//! ```text
//! u_E = step(u_A, torque, dt)               in the body frame of the midpoint
//! u_A of the next step = Rot(-dt omega_E) u_E
//! ```

use nalgebra::RowSVector;

use super::least_normal_forces::LeastNormalForces;
use super::moreau_step::StepModel;
use super::rollout::{Model, Rollout, Simulator};
use super::sensitivity::EndSensitivity;
use super::step_derivative::StepDerivative;
use super::tape::TapeEntry;
use super::torque_schedule::control_interval;
use crate::robot::{BodyVector, PerWheel};
use crate::stop::{Stop, Stopped};

/// Derivatives of one normal force.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NormalForceDerivative {
    /// By the left torque of each interval, 1/m.
    pub by_left_torque: Vec<f64>,
    /// By the right torque of each interval, 1/m.
    pub by_right_torque: Vec<f64>,
    /// By the final time, N/s.
    pub by_final_time: f64,
}

/// The derivatives of a chosen force by the current step, in the backward sweep.
struct Row {
    contact: usize,
    /// The step of the force.
    step: usize,
    by_velocity: RowSVector<f64, 5>,
    by_step_length: f64,
}

impl Simulator {
    /// Differentiates some of the least normal forces of a rollout that `sensitivity` has just been computed for, under the
    /// same `slip_smoothing` (0 for the exact law). `chosen` are indices into [`LeastNormalForces`].
    ///
    /// # Errors
    /// When it was stopped before the end.
    pub fn normal_force_sensitivity(
        &self,
        rollout: &Rollout,
        slip_smoothing: f64,
        sensitivity: &EndSensitivity,
        chosen: &[usize],
        stop: Stop,
    ) -> Result<Vec<NormalForceDerivative>, Stopped> {
        let rollout = (rollout, slip_smoothing);
        match self.model() {
            Model::Wheels(model) => differentiate(model, rollout, sensitivity, chosen, stop),
            Model::WheelsAndFront(model) => differentiate(model, rollout, sensitivity, chosen, stop),
        }
    }
}

fn differentiate<const N: usize>(
    model: &StepModel<N>,
    (rollout, slip_smoothing): (&Rollout, f64),
    sensitivity: &EndSensitivity,
    chosen: &[usize],
    stop: Stop,
) -> Result<Vec<NormalForceDerivative>, Stopped> {
    let control_count = rollout.schedule.control_count();
    let mut rows: Vec<Row> = chosen.iter().map(|&index| Row::new(sensitivity, index)).collect();
    let mut derivatives = vec![NormalForceDerivative::zero(control_count); chosen.len()];
    let last = rows.iter().map(|row| row.step).max().unwrap_or(0);
    let dt = rollout.schedule.final_time / rollout.step_count as f64;
    for (index, entry) in sensitivity.tape[..=last].iter().enumerate().rev() {
        stop.check()?;
        let interval = control_interval(index, rollout.step_count, control_count);
        let controls = (rollout.schedule.torque(interval), dt);
        let motion = StepDerivative::of_motion(model, entry, controls, slip_smoothing);
        for (row, derivative) in rows.iter_mut().zip(&mut derivatives).filter(|(row, _)| row.step >= index) {
            let by_torque = if row.step == index {
                row.begin(&StepDerivative::of_normal_impulse(model, entry, controls, slip_smoothing), entry, dt)
            } else {
                row.step_back(&motion, entry, &sensitivity.tape[index + 1], dt)
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

impl NormalForceDerivative {
    fn zero(control_count: usize) -> Self {
        Self { by_left_torque: vec![0.0; control_count], by_right_torque: vec![0.0; control_count], by_final_time: 0.0 }
    }
}

impl Row {
    fn new(sensitivity: &EndSensitivity, index: usize) -> Self {
        Self {
            contact: LeastNormalForces::contact(index),
            step: sensitivity.least_normal_forces.step(index),
            by_velocity: RowSVector::zeros(),
            by_step_length: 0.0,
        }
    }

    /// The step of the force itself: force = impulse / dt.
    fn begin(&mut self, derivative: &StepDerivative<3>, entry: &TapeEntry, dt: f64) -> PerWheel<f64> {
        let contact = self.contact;
        self.by_velocity = derivative.by_velocity.row(contact) / dt;
        self.by_step_length = (derivative.by_step_length[contact] - entry.normal_impulse[contact] / dt) / dt;
        PerWheel::new(derivative.by_torque.left[contact] / dt, derivative.by_torque.right[contact] / dt)
    }

    /// Back over an earlier step; `next` is the step after it.
    fn step_back(&mut self, motion: &StepDerivative<5>, entry: &TapeEntry, next: &TapeEntry, dt: f64) -> PerWheel<f64> {
        let yaw_rate = entry.end_velocity[2];
        let by_angle = self.by_angle(&next.start_velocity);
        let (sin, cos) = (dt * yaw_rate).sin_cos();
        let (right, forward) = (self.by_velocity[0], self.by_velocity[1]);
        self.by_velocity[0] = right * cos - forward * sin;
        self.by_velocity[1] = right * sin + forward * cos;
        self.by_velocity[2] += dt * by_angle;
        self.by_step_length += yaw_rate * by_angle;

        let by_end = self.by_velocity;
        self.by_step_length += (by_end * motion.by_step_length)[0];
        self.by_velocity = by_end * motion.by_velocity;
        PerWheel::new((by_end * motion.by_torque.left)[0], (by_end * motion.by_torque.right)[0])
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
