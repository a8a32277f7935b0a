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
use super::step_derivative::{ByInput, StepDerivative};
use super::tape::TapeEntry;
use super::torque_schedule::control_interval;
use crate::robot::{BodyVector, PerWheel, State};
use crate::stop::{Stop, Stopped};

/// A derivative of the ten components of the end state, in the order of [`State::to_vector`].
pub type EndDerivative = SVector<f64, { State::LEN }>;

/// The rows of the sweep, as places in [`State::to_vector`], a pair at a time: the wheel angles come last.
const ROWS: [usize; State::LEN] = [0, 1, 2, 5, 6, 7, 8, 9, 3, 4];
const PAIRS: usize = State::LEN / 2;
const PAIRS_WITHOUT_WHEEL_ANGLES: usize = PAIRS - 1;
/// Velocities with the rows of the positions and angles that they move, apart from the heading.
const MOVED: [(usize, usize); 4] = [(0, 0), (1, 1), (3, 8), (4, 9)];
/// The row of the heading.
const HEADING: usize = 2;

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
    /// Where motions are proved to be unique, and the last recorded rollout had as many steps, Newton starts from the last impulse moved
    /// on as that rollout went on there: what is left to find is a difference of differences. So the end state depends on that
    /// rollout, but by rounding alone under the exact law, and by what Newton leaves (1e-8) under a smoothed one.
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

    /// Differentiates the end state of the rollout that was recorded last, under the same `law`.
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
    // Where motions are not proved to be unique, the rollout must be the one that answers show.
    let follows_last = tape.len() == rollout.step_count && model.operator.has_unique_solutions();
    if !follows_last {
        tape.clear();
        tape.reserve(rollout.step_count);
    }
    path.clear(rollout);
    let note = |index: usize, step: &mut Step<N>| {
        path.note(index, step, rollout);
        let entry = TapeEntry::new(step);
        if follows_last {
            if let [last, next, ..] = &tape[index..] {
                step.contact.impulse += (next.impulse - last.impulse).fixed_rows::<N>(0);
            }
            tape[index] = entry;
        } else {
            tape.push(entry);
        }
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
        sweep::<N, PAIRS_WITHOUT_WHEEL_ANGLES>(model, rollout, law, sensitivity, stop)
    } else {
        sweep::<N, PAIRS>(model, rollout, law, sensitivity, stop)
    }
}

fn sweep<const N: usize, const P: usize>(
    model: &StepModel<N>,
    rollout: &Rollout,
    law: FrictionLaw,
    sensitivity: &mut EndSensitivity,
    stop: Stop,
) -> Result<(), Stopped> {
    let EndSensitivity { end, by_left_torque, by_right_torque, by_final_time, tape, .. } = sensitivity;
    let control_count = rollout.schedule.control_count();
    for derivatives in [&mut *by_left_torque, &mut *by_right_torque] {
        derivatives.clear();
        derivatives.resize(control_count, EndDerivative::zeros());
    }
    let dt = rollout.step_length();
    let mut pairs: [RowPair; P] = std::array::from_fn(|pair| RowPair::new(pair, dt));
    for (index, entry) in tape.iter().enumerate().rev() {
        stop.check()?;
        let interval = control_interval(index, rollout.step_count, control_count);
        let step = BackwardStep::new(model, entry, (rollout.schedule.torque(interval), dt), law);
        let sums = (by_left_torque[interval].as_mut_slice(), by_right_torque[interval].as_mut_slice());
        for ((pair, left), right) in pairs.iter_mut().zip(sums.0.chunks_exact_mut(2)).zip(sums.1.chunks_exact_mut(2)) {
            let by_torque = pair.step(&step);
            add(&by_torque.left, left);
            add(&by_torque.right, right);
        }
    }
    for derivative in by_left_torque.iter_mut().chain(by_right_torque) {
        *derivative = in_order_of_state(derivative);
    }
    let mut by_step_length = EndDerivative::zeros();
    for (pair, sum) in pairs.iter().zip(by_step_length.as_mut_slice().chunks_exact_mut(2)) {
        add(&pair.by_step_length, sum);
    }
    // With the velocities as they are, a longer step moves positions and wheel angles by their mean.
    let (start, end) = (rollout.start.to_vector(), end.to_vector());
    for (_, row) in MOVED.into_iter().filter(|(_, row)| *row < 2 * P) {
        by_step_length[row] += (end[ROWS[row]] - start[ROWS[row]]) / dt;
    }
    *by_final_time = in_order_of_state(&(by_step_length / rollout.step_count as f64));
    Ok(())
}

#[inline]
fn add(pair: &Pair, sum: &mut [f64]) {
    sum[0] += pair[0];
    sum[1] += pair[1];
}

fn in_order_of_state(swept: &EndDerivative) -> EndDerivative {
    let mut derivative = EndDerivative::zeros();
    for (value, place) in swept.iter().zip(ROWS) {
        derivative[place] = *value;
    }
    derivative
}

/// Two rows of the sweep side by side: what a step makes of them fits into registers.
type Pair = SVector<f64, 2>;

/// Derivatives of two components of the end state by the state at the end of the current step.
#[expect(clippy::struct_field_names, reason = "each field is a derivative by what its name says")]
struct RowPair {
    by_heading: Pair,
    /// By each of the five generalized velocities, with the path that they make in this step and the next one.
    by_velocity: [Pair; 5],
    by_step_length: Pair,
    /// Of the derivatives by the velocities, apart from that by the yaw rate: the path that one makes in a whole step.
    by_path: [Pair; 5],
}

/// What all rows need of a step.
struct BackwardStep<'a, const N: usize> {
    derivative: StepDerivative<'a, N>,
    /// Sine and cosine of the midpoint's heading.
    rotation: (f64, f64),
    start_velocity: BodyVector,
    /// In the world frame.
    end_velocity: (f64, f64),
    mean_yaw_rate: f64,
    step_length: f64,
}

impl<'a, const N: usize> BackwardStep<'a, N> {
    #[expect(clippy::inline_always, reason = "a call would take derivatives through memory")]
    #[inline(always)]
    fn new(model: &'a StepModel<N>, entry: &TapeEntry, controls: (PerWheel<f64>, f64), law: FrictionLaw) -> Self {
        let ((sin, cos), w) = (entry.rotation, &entry.end_velocity);
        Self {
            derivative: StepDerivative::new(model, entry, controls, law),
            rotation: entry.rotation,
            start_velocity: entry.start_velocity,
            end_velocity: (cos * w[0] - sin * w[1], sin * w[0] + cos * w[1]),
            mean_yaw_rate: 0.5 * (entry.start_velocity[2] + w[2]),
            step_length: controls.1,
        }
    }
}

impl RowPair {
    /// At the end of a rollout with steps of length `dt`.
    fn new(pair: usize, dt: f64) -> Self {
        let unit = |row: usize| Pair::from_fn(|side, _| if 2 * pair + side == row { 1.0 } else { 0.0 });
        let mut by_path = [Pair::zeros(); 5];
        for (velocity, row) in MOVED {
            by_path[velocity] = unit(row) * dt;
        }
        let mut by_velocity = by_path.map(|by_path| by_path * 0.5);
        by_velocity[2] = unit(HEADING) * (0.5 * dt);
        for (velocity, derivative) in by_velocity.iter_mut().enumerate() {
            *derivative += unit(HEADING + 1 + velocity);
        }
        Self { by_heading: unit(HEADING), by_velocity, by_step_length: Pair::zeros(), by_path }
    }

    /// Goes back over one step; returns the derivatives by its torques.
    #[expect(clippy::inline_always, reason = "a call would take derivatives through memory")]
    #[inline(always)]
    fn step<const N: usize>(&mut self, step: &BackwardStep<N>) -> PerWheel<Pair> {
        let BackwardStep { derivative, rotation: (sin, cos), start_velocity: v, end_velocity: w, .. } = step;
        // u_E from the body frame of the midpoint into the world: rotate the derivatives back.
        let [x, y, yaw, left, right] = self.by_velocity;
        let mut by_midpoint_heading = y * w.0 - x * w.1;
        let by_end = [x * *cos + y * *sin, y * *cos - x * *sin, yaw, left, right];

        let ByInput { by_velocity, by_torque, by_step_length } = derivative.back(&by_end);
        self.by_step_length += by_step_length + self.by_heading * step.mean_yaw_rate;

        // u_A into the body frame, and the heading of the midpoint.
        let [right, forward, yaw, left, right_wheel] = by_velocity;
        by_midpoint_heading += right * v[1] - forward * v[0];
        self.by_step_length += by_midpoint_heading * (0.5 * v[2]);
        self.by_heading += by_midpoint_heading;
        // q_E = q_A + dt/2 (u_A + u_E), here and in the step before.
        self.by_velocity = [
            right * *cos - forward * *sin + self.by_path[0],
            forward * *cos + right * *sin + self.by_path[1],
            yaw + self.by_heading * step.step_length,
            left + self.by_path[3],
            right_wheel + self.by_path[4],
        ];
        by_torque
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, RobotParameters};
    use crate::simulation::TorqueSchedule;

    /// What a rollout ends with after another, and by itself.
    fn after_and_alone(parameters: RobotParameters, law: FrictionLaw, last: &TorqueSchedule) -> [State; 2] {
        let simulator = Simulator::new(&Robot::new(parameters).unwrap());
        let schedule = TorqueSchedule { final_time: 1.5, left: vec![0.9, -0.4, 0.1], right: vec![-0.7, 0.8, -0.9] };
        [Some(last), None].map(|last| {
            let mut sensitivity = EndSensitivity::default();
            for schedule in last.into_iter().chain([&schedule]) {
                let rollout = Rollout { start: &State::default(), schedule, step_count: 60 };
                simulator.record(&rollout, law, &mut sensitivity, Stop::never()).unwrap();
            }
            sensitivity.end
        })
    }

    /// What may come before that rollout in a search.
    fn similar() -> TorqueSchedule {
        TorqueSchedule { final_time: 1.48, left: vec![0.9, -0.5, 0.1], right: vec![-0.6, 0.8, -0.9] }
    }

    #[test]
    fn a_rollout_ends_where_it_does_whatever_was_recorded_before() {
        let slippery = RobotParameters { wheel_friction_coefficient: 0.15, ..RobotParameters::default() };
        let other = TorqueSchedule { final_time: 0.2, left: vec![-1.0, 1.0, 0.0], right: vec![1.0, 1.0, 1.0] };
        let diverging = TorqueSchedule { final_time: 1.0, left: vec![f64::NAN; 3], right: vec![0.0; 3] };
        for parameters in [slippery, RobotParameters { front_friction_coefficient: 0.1, ..slippery }] {
            for last in [&similar(), &other, &diverging] {
                for (law, tolerance) in [(FrictionLaw::Exact, 1e-8), (FrictionLaw::Smoothed(0.05), 1e-5)] {
                    let [after, alone] = after_and_alone(parameters, law, last).map(|end| end.to_vector());
                    assert!((after - alone).amax() <= tolerance, "{law:?} {last:?}: {after} {alone}");
                }
            }
        }
    }

    #[test]
    fn motions_that_are_not_unique_follow_no_other() {
        let parameters = RobotParameters { wheel_friction_coefficient: 1.35, ..RobotParameters::default() };
        let last = similar();
        let rollout = Rollout { start: &State::default(), schedule: &last, step_count: 60 };
        let simulator = Simulator::new(&Robot::new(parameters).unwrap());
        let Model::Wheels(model) = &*simulator.model(&rollout) else { panic!("the front support is frictionless") };
        assert!(!model.operator.has_unique_solutions());
        let [after, alone] = after_and_alone(parameters, FrictionLaw::Exact, &last);
        assert_eq!(after, alone);
    }

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
