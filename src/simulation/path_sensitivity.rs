//! Derivatives of chosen path quantities of a rollout with respect to every torque and the final time, by the discrete
//! adjoint method.
//!
//! A quantity depends on the body velocity at the start of its step, on the torques and on the step length, some also on the
//! pose. One backward sweep in the body frame carries a row per chosen value:
//!
//! ```text
//! u_E = step(u_A, torque, dt)               in the body frame of the midpoint
//! u_A of the next step = Rot(-dt omega_E) u_E
//! ```

use nalgebra::RowSVector;

use super::friction_law::FrictionLaw;
use super::moreau_step::StepModel;
use super::path_quantity::{PathQuantity, PathSample};
use super::rollout::{Model, Rollout, Simulator};
use super::sensitivity::EndSensitivity;
use super::step_derivative::StepDerivative;
use super::tape::TapeEntry;
use super::torque_schedule::control_interval;
use crate::robot::{BodyVector, PerWheel};
use crate::stop::{Stop, Stopped};

/// Derivatives of one path quantity at one step, in its unit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PathDerivative {
    /// By the left torque of each interval, per N m.
    pub by_left_torque: Vec<f64>,
    /// By the right torque of each interval, per N m.
    pub by_right_torque: Vec<f64>,
    /// By the final time, per s.
    pub by_final_time: f64,
}

/// The derivatives of a chosen value by the current step, in the backward sweep.
struct Row {
    quantity: PathQuantity,
    /// The step of the value.
    step: usize,
    sample: PathSample,
    by_velocity: RowSVector<f64, 5>,
    by_step_length: f64,
    /// By x, y and heading; none where the value depends on neither.
    by_pose: Option<[f64; 3]>,
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
    let control_count = rollout.schedule.control_count();
    let mut rows: Vec<Row> = chosen.iter().map(|&index| Row::new(sensitivity, index)).collect();
    let mut derivatives = vec![PathDerivative::zero(control_count); chosen.len()];
    let last = rows.iter().map(|row| row.step).max().unwrap_or(0);
    let dt = rollout.step_length();
    for (index, entry) in sensitivity.tape[..=last].iter().enumerate().rev() {
        stop.check()?;
        let interval = control_interval(index, rollout.step_count, control_count);
        let controls = (rollout.schedule.torque(interval), dt);
        let motion = StepDerivative::of_motion(model, entry, controls, law);
        let turn = (dt * entry.end_velocity[2]).sin_cos();
        for (row, derivative) in rows.iter_mut().zip(&mut derivatives).filter(|(row, _)| row.step >= index) {
            let by_torque = if row.step == index {
                row.begin(model, entry, controls, law)
            } else {
                row.step_back(&motion, entry, (&sensitivity.tape[index + 1], turn), dt)
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

/// Derivatives through the pose at the end of one step.
#[derive(Default)]
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
struct PoseShare {
    by_start_velocity: RowSVector<f64, 5>,
    by_end_velocity: RowSVector<f64, 5>,
    by_step_length: f64,
}

impl PathDerivative {
    fn zero(control_count: usize) -> Self {
        Self { by_left_torque: vec![0.0; control_count], by_right_torque: vec![0.0; control_count], by_final_time: 0.0 }
    }
}

impl Row {
    fn new(sensitivity: &EndSensitivity, index: usize) -> Self {
        let step = sensitivity.path.step(index);
        Self {
            quantity: sensitivity.path.quantity(index),
            step,
            sample: sensitivity.path.sample(step),
            by_velocity: RowSVector::zeros(),
            by_step_length: 0.0,
            by_pose: None,
        }
    }

    /// The step of the value itself.
    fn begin<const N: usize>(
        &mut self,
        model: &StepModel<N>,
        entry: &TapeEntry,
        (torque, dt): (PerWheel<f64>, f64),
        law: FrictionLaw,
    ) -> PerWheel<f64> {
        let mut gradient = self.quantity.gradient(entry, &self.sample);
        self.by_pose = gradient.by_end_pose;
        let share = self.pose_share(entry, dt);
        gradient.by_end_velocity += share.by_end_velocity;
        let derivative = StepDerivative::of_quantity(model, entry, (torque, dt), (&gradient, law));
        self.by_velocity = derivative.by_velocity + gradient.by_start_velocity + share.by_start_velocity;
        self.by_step_length = derivative.by_step_length[0] + gradient.by_step_length + share.by_step_length;
        let PerWheel { left, right } = derivative.by_torque;
        let mut by_torque = PerWheel::new(left[0] + gradient.by_torque.left, right[0] + gradient.by_torque.right);
        if self.quantity.is_per_step_length() {
            self.by_velocity /= dt;
            self.by_step_length = (self.by_step_length - self.quantity.of_step(entry, &self.sample) / dt) / dt;
            by_torque = PerWheel::new(by_torque.left / dt, by_torque.right / dt);
        }
        by_torque
    }

    /// Back over an earlier step; `next` is the step after it, whose body frame is turned by the angle with this sine and cosine.
    fn step_back(
        &mut self,
        motion: &StepDerivative<5>,
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

        let share = self.pose_share(entry, dt);
        let by_end = self.by_velocity + share.by_end_velocity;
        self.by_step_length += (by_end * motion.by_step_length)[0] + share.by_step_length;
        self.by_velocity = by_end * motion.by_velocity + share.by_start_velocity;
        PerWheel::new((by_end * motion.by_torque.left)[0], (by_end * motion.by_torque.right)[0])
    }

    /// The path through the pose at the end of a step, `q_E = q_A + dt/2 (u_A + u_E)`; afterwards `by_pose` is by that at its start.
    #[inline]
    fn pose_share(&mut self, entry: &TapeEntry, dt: f64) -> PoseShare {
        let Some([by_x, by_y, by_heading]) = &mut self.by_pose else { return PoseShare::default() };
        let half = 0.5 * dt;
        let (sin, cos) = entry.rotation;
        let (right, forward) = (cos * *by_x + sin * *by_y, cos * *by_y - sin * *by_x);
        let sum = entry.start_velocity + entry.end_velocity;
        let by_midpoint_heading = half * (forward * sum[0] - right * sum[1]);
        let by_end_velocity = RowSVector::from([[half * right], [half * forward], [half * *by_heading], [0.0], [0.0]]);
        let mut by_start_velocity = by_end_velocity;
        by_start_velocity[2] += half * by_midpoint_heading;
        let along = right * sum[0] + forward * sum[1] + *by_heading * sum[2];
        let by_step_length = 0.5 * (along + entry.start_velocity[2] * by_midpoint_heading);
        *by_heading += by_midpoint_heading;
        PoseShare { by_start_velocity, by_end_velocity, by_step_length }
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
