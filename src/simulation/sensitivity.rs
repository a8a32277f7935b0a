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
//! One backward sweep carries a row per component of the end state, its derivatives by the current state. Position and wheel
//! angles enter no step, so the derivatives by them stay what they are. Few goals ask for the wheel angles at the end: a sweep
//! can leave their two rows out. Transitions between sticking and slipping are exact; at a slip reversal the derivative of
//! every fixed-step scheme is wrong (`docs/model.md`).

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

/// The rows of the sweep, as places in [`State::to_vector`]: the wheel angles come last.
const ROWS: [usize; State::LEN] = [0, 1, 2, 5, 6, 7, 8, 9, 3, 4];
/// How many there are without the wheel angles.
const ROWS_WITHOUT_WHEEL_ANGLES: usize = State::LEN - 2;
/// Velocities with the rows of the positions and angles that they move, apart from the heading.
const MOVED: [(usize, usize); 4] = [(0, 0), (1, 1), (3, 8), (4, 9)];

/// A derivative of the first `R` rows.
type SweptDerivative<const R: usize> = SVector<f64, R>;

/// Derivatives by each of the five body or generalized velocities.
type ByVelocity<const R: usize> = [SweptDerivative<R>; 5];

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
    /// Whether the derivatives of the wheel angles are left out, and stay zero.
    pub omits_wheel_angles: bool,
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
        path.note(index, step, rollout);
        tape.push(TapeEntry::new(step));
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
    if sensitivity.omits_wheel_angles {
        sweep::<N, ROWS_WITHOUT_WHEEL_ANGLES>(model, rollout, law, sensitivity, stop)
    } else {
        sweep::<N, { State::LEN }>(model, rollout, law, sensitivity, stop)
    }
}

fn sweep<const N: usize, const R: usize>(
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
    let mut sweep = BackwardSweep::<R>::new(law);
    for (index, entry) in tape.iter().enumerate().rev() {
        stop.check()?;
        let interval = control_interval(index, rollout.step_count, control_count);
        let by_torque = sweep.step(model, entry, rollout.schedule.torque(interval), dt);
        add(&by_torque.left, &mut by_left_torque[interval]);
        add(&by_torque.right, &mut by_right_torque[interval]);
    }
    *by_final_time = EndDerivative::zeros();
    add(&(sweep.by_step_length / rollout.step_count as f64), by_final_time);
    Ok(())
}

#[inline]
fn add<const R: usize>(swept: &SweptDerivative<R>, sum: &mut EndDerivative) {
    for (value, place) in swept.iter().zip(ROWS) {
        sum[place] += value;
    }
}

/// Derivatives of the end state by the state at the end of the current step.
struct BackwardSweep<const R: usize> {
    by_heading: SweptDerivative<R>,
    by_velocity: ByVelocity<R>,
    by_step_length: SweptDerivative<R>,
    law: FrictionLaw,
}

impl<const R: usize> BackwardSweep<R> {
    fn new(law: FrictionLaw) -> Self {
        let zero = SweptDerivative::zeros();
        let mut by_heading = zero;
        by_heading[2] = 1.0;
        let mut by_velocity = [zero; 5];
        for (axis, derivative) in by_velocity.iter_mut().enumerate() {
            derivative[3 + axis] = 1.0;
        }
        Self { by_heading, by_velocity, by_step_length: zero, law }
    }

    /// Goes back over one step; returns the derivatives by its torques.
    #[inline]
    fn step<const N: usize>(
        &mut self,
        model: &StepModel<N>,
        entry: &TapeEntry,
        torque: PerWheel<f64>,
        dt: f64,
    ) -> PerWheel<SweptDerivative<R>> {
        let half = 0.5 * dt;
        let (sin, cos) = entry.rotation;
        let (v, w) = (&entry.start_velocity, &entry.end_velocity);

        // q_E = q_A + dt/2 (u_A + u_E): the step length, then u_E. Only x, y, heading, psi of q_E are touched.
        let (start, end) = (world(v, entry.rotation), world(w, entry.rotation));
        let mean = 0.5 * (start + end);
        self.by_step_length += self.by_heading * mean[2];
        for (velocity, row) in MOVED {
            if row < R {
                self.by_step_length += unit(row) * mean[velocity];
            }
        }
        self.add_position_share(half);

        // u_E from the body frame of the midpoint into the world: rotate the derivatives back.
        let mut by_midpoint_heading = self.by_velocity[1] * end[0] - self.by_velocity[0] * end[1];
        rotate_into_body(&mut self.by_velocity, sin, cos);

        let derivative = StepDerivative::of_motion(model, entry, (torque, dt), self.law);
        let by_end = &self.by_velocity;
        let PerWheel { left, right } = &derivative.by_torque;
        let by_torque = PerWheel::new(through(by_end, left.as_ref()), through(by_end, right.as_ref()));
        self.by_step_length += through(by_end, derivative.by_step_length.as_ref());
        self.by_velocity = derivative.by_velocity.data.0.map(|by_start_velocity| through(by_end, &by_start_velocity));

        // u_A into the body frame, and the heading of the midpoint.
        by_midpoint_heading += self.by_velocity[0] * v[1] - self.by_velocity[1] * v[0];
        rotate_into_world(&mut self.by_velocity, sin, cos);
        self.add_position_share(half);
        self.by_velocity[2] += by_midpoint_heading * half;
        self.by_step_length += by_midpoint_heading * (0.5 * v[2]);
        self.by_heading += by_midpoint_heading;
        by_torque
    }

    /// Adds the path from a velocity through the end configuration: `half` times the derivatives by the configuration.
    #[inline]
    fn add_position_share(&mut self, half: f64) {
        self.by_velocity[2] += self.by_heading * half;
        for (velocity, row) in MOVED {
            if row < R {
                self.by_velocity[velocity] += unit(row) * half;
            }
        }
    }
}

/// One in this row: a sum of whole vectors, where that of one component would be stored by itself and be waited for.
#[inline]
fn unit<const R: usize>(row: usize) -> SweptDerivative<R> {
    SweptDerivative::from_fn(|other, _| if other == row { 1.0 } else { 0.0 })
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
fn through<const R: usize>(by_velocity: &ByVelocity<R>, of_velocity: &[f64; 5]) -> SweptDerivative<R> {
    let [right, forward, yaw, left_wheel, right_wheel] = by_velocity;
    let of = of_velocity;
    right * of[0] + forward * of[1] + yaw * of[2] + left_wheel * of[3] + right_wheel * of[4]
}

/// Derivatives by world velocities become derivatives by body velocities.
#[inline]
fn rotate_into_body<const R: usize>(by_velocity: &mut ByVelocity<R>, sin: f64, cos: f64) {
    let [by_right, by_forward, ..] = by_velocity;
    for (right, forward) in by_right.as_mut_slice().iter_mut().zip(by_forward.as_mut_slice()) {
        let (x, y) = (*right, *forward);
        *right = x * cos + y * sin;
        *forward = y * cos - x * sin;
    }
}

/// The inverse of [`rotate_into_body`].
#[inline]
fn rotate_into_world<const R: usize>(by_velocity: &mut ByVelocity<R>, sin: f64, cos: f64) {
    rotate_into_body(by_velocity, -sin, cos);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, RobotParameters};
    use crate::simulation::TorqueSchedule;

    #[test]
    fn leaving_out_wheel_angles_changes_no_other_derivative() {
        let simulator = Simulator::new(&Robot::new(RobotParameters::default()).unwrap());
        let schedule = TorqueSchedule { final_time: 1.5, left: vec![0.9, -0.4], right: vec![0.7, -0.8] };
        let rollout = Rollout { start: &State::default(), schedule: &schedule, step_count: 40 };
        let of = |omits_wheel_angles| {
            let mut sensitivity = EndSensitivity { omits_wheel_angles, ..EndSensitivity::default() };
            simulator.end_sensitivity(&rollout, FrictionLaw::Exact, &mut sensitivity, Stop::never()).unwrap();
            [&sensitivity.by_left_torque[..], &sensitivity.by_right_torque, &[sensitivity.by_final_time]].concat()
        };
        for (whole, mut shorter) in of(false).into_iter().zip(of(true)) {
            assert_eq!((shorter[3], shorter[4]), (0.0, 0.0));
            (shorter[3], shorter[4]) = (whole[3], whole[4]);
            assert_eq!(shorter, whole);
            assert!(whole[3] != 0.0);
        }
    }
}
