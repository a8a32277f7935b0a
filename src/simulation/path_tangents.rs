//! Derivatives of chosen path quantities of a rollout with respect to every torque and the final time, by tangents (forward
//! accumulation over the steps).
//!
//! The adjoint method of `path_sensitivity` pays for each value, this one for each variable: where a plan follows limits, and
//! hundreds of values are near them, it takes a tenth of the time. One sweep carries the derivatives of the state by all variables
//! so far, velocities in the body frame of the step's midpoint:
//!
//! ```text
//! u_E = step(u_A, torque, dt)
//! u_A of the next step = Rot(-dt omega_E) u_E
//! q_E = q_A + dt/2 Rot(midpoint) (u_A + u_E)
//! ```

use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use super::friction_law::FrictionLaw;
use super::moreau_step::StepModel;
use super::path_row::{PathDerivative, PathRow};
use super::rollout::Rollout;
use super::sensitivity::EndSensitivity;
use super::step_derivative::{ByInput, StepDerivative};
use super::tape::TapeEntry;
use super::torque_schedule::control_interval;
use super::turn::turned;
use crate::robot::BodyVector;
use crate::stop::{Stop, Stopped};

/// Variables are handled so many at a time, in vector registers.
const LANES: usize = 4;
/// The place of the step length among the variables.
const STEP_LENGTH: usize = 0;

/// Derivatives of `K` components by `LANES` variables.
type Block<const K: usize> = [[f64; LANES]; K];

/// Derivatives of the state by all variables: the step length, then the two torques of each interval in turn.
struct Tangents {
    /// Of the body velocities.
    velocity: Vec<Block<5>>,
    /// Of x, y and heading.
    pose: Vec<Block<3>>,
    /// Blocks that hold variables of the steps so far.
    reached: usize,
    /// Memory for one row.
    values: Vec<f64>,
}

/// Of any quantities; as `path_sensitivity` of the simulator otherwise.
pub(super) fn differentiate<const N: usize>(
    model: &StepModel<N>,
    (rollout, law): (&Rollout, FrictionLaw),
    sensitivity: &EndSensitivity,
    chosen: &[usize],
    stop: Stop,
) -> Result<Vec<PathDerivative>, Stopped> {
    let path = &sensitivity.path;
    let control_count = rollout.schedule.control_count();
    let mut derivatives = vec![PathDerivative::zero(control_count); chosen.len()];
    let mut order: Vec<usize> = (0..chosen.len()).collect();
    order.sort_by_key(|&row| path.step(chosen[row]));
    let Some(&last) = order.last() else { return Ok(derivatives) };
    let last_step = path.step(chosen[last]);
    let has_pose = chosen.iter().any(|&index| path.quantity(index).depends_on_pose());
    let mut coming = order.into_iter().peekable();
    let dt = rollout.step_length();
    let mut tangents = Tangents::at_start(&sensitivity.tape[0], control_count);
    for (index, entry) in sensitivity.tape[..=last_step].iter().enumerate() {
        stop.check()?;
        let interval = control_interval(index, rollout.step_count, control_count);
        let controls = (rollout.schedule.torque(interval), dt);
        let by_step = StepDerivative::new(model, entry, controls, law);
        let motion = by_step.back(&unit_velocities());
        tangents.reach(interval);
        if has_pose {
            tangents.advance_pose(&motion, entry, dt, interval);
        }
        while let Some(row) = coming.next_if(|&row| path.step(chosen[row]) == index) {
            let value = (path.quantity(chosen[row]), &path.sample(index));
            let path_row = PathRow::new(value, (entry, dt), &by_step);
            tangents.write(&path_row, interval, rollout.step_count, &mut derivatives[row]);
        }
        tangents.advance_velocity(&motion, entry, dt, interval);
    }
    Ok(derivatives)
}

impl Tangents {
    /// The first midpoint is turned by half a step from the start.
    fn at_start(first: &TapeEntry, control_count: usize) -> Self {
        let blocks = (1 + 2 * control_count).div_ceil(LANES);
        let (velocity, pose) = (vec![[[0.0; LANES]; 5]; blocks], vec![[[0.0; LANES]; 3]; blocks]);
        let mut tangents = Self { velocity, pose, reached: 0, values: Vec::new() };
        let start = &first.start_velocity;
        for (of_component, by_angle) in tangents.velocity[0].iter_mut().zip(&by_angle(start[0], start[1])) {
            of_component[STEP_LENGTH] = 0.5 * start[2] * by_angle;
        }
        tangents
    }

    /// The torques of this interval, and all before, are variables.
    fn reach(&mut self, interval: usize) {
        self.reached = (right_torque(interval) + 1).div_ceil(LANES);
    }

    /// From the pose at the start to that at the end of a step.
    fn advance_pose(&mut self, motion: &ByInput<BodyVector>, entry: &TapeEntry, dt: f64, interval: usize) {
        let change = PoseChange::new(entry, dt);
        let mut passage = motion.map(|end| change.of(&BodyVector::zeros(), end));
        for (by_velocity, start) in passage.by_velocity.iter_mut().zip(&unit_velocities()) {
            *by_velocity += change.of(start, &BodyVector::zeros());
        }
        passage.by_step_length += change.by_step_length(entry);
        let by_velocity = SMatrix::from_columns(&passage.by_velocity);
        let turned = change.by_midpoint_heading;
        for (pose, velocity) in self.pose.iter_mut().zip(&self.velocity).take(self.reached) {
            let heading = pose[2];
            for (axis, by_heading) in turned.iter().enumerate() {
                for (value, heading) in pose[axis].iter_mut().zip(heading) {
                    *value += by_heading * heading;
                }
            }
            add_product(pose, &by_velocity, velocity);
        }
        add_controls(&mut self.pose, &passage, interval);
    }

    /// From the velocity at the start of a step to that at the start of the next one, each in the frame of its own step.
    fn advance_velocity(&mut self, motion: &ByInput<BodyVector>, entry: &TapeEntry, dt: f64, interval: usize) {
        let end = &entry.end_velocity;
        let (sin, cos) = (dt * end[2]).sin_cos();
        let into_next = |of: &SVector<f64, 5>| Vector2::new(cos * of[0] + sin * of[1], cos * of[1] - sin * of[0]);
        let next = into_next(end);
        let by_angle = by_angle(next.x, next.y);
        let mut passage = motion.map(|of| {
            let planar = into_next(of) + by_angle * (dt * of[2]);
            SVector::from([planar.x, planar.y, of[2], of[3], of[4]])
        });
        let mut planar = passage.by_step_length.fixed_rows_mut::<2>(0);
        planar += by_angle * end[2];
        let by_velocity = SMatrix::from_columns(&passage.by_velocity);
        for velocity in &mut self.velocity[..self.reached] {
            let start = std::mem::replace(velocity, [[0.0; LANES]; 5]);
            add_product(velocity, &by_velocity, &start);
        }
        add_controls(&mut self.velocity, &passage, interval);
    }

    /// The derivatives of a value in this step by all variables so far.
    fn write(&mut self, row: &PathRow, interval: usize, step_count: usize, derivative: &mut PathDerivative) {
        let by_velocity = SMatrix::<f64, 1, 5>::from(row.by_input.by_velocity);
        let by_pose = row.by_end_pose.map(SMatrix::<f64, 1, 3>::from);
        self.values.clear();
        for (velocity, pose) in self.velocity.iter().zip(&self.pose).take(self.reached) {
            let mut values = [[0.0; LANES]];
            add_product(&mut values, &by_velocity, velocity);
            if let Some(by_pose) = &by_pose {
                add_product(&mut values, by_pose, pose);
            }
            self.values.extend(values[0]);
        }
        for interval in 0..=interval {
            derivative.by_left_torque[interval] = self.values[left_torque(interval)];
            derivative.by_right_torque[interval] = self.values[right_torque(interval)];
        }
        derivative.by_left_torque[interval] += row.by_input.by_torque.left;
        derivative.by_right_torque[interval] += row.by_input.by_torque.right;
        derivative.by_final_time = (self.values[STEP_LENGTH] + row.by_input.by_step_length) / step_count as f64;
    }
}

/// Adds the derivatives by the step's own torques and its length.
fn add_controls<const K: usize>(tangents: &mut [Block<K>], passage: &ByInput<SVector<f64, K>>, interval: usize) {
    for (variable, derivative) in [
        (left_torque(interval), &passage.by_torque.left),
        (right_torque(interval), &passage.by_torque.right),
        (STEP_LENGTH, &passage.by_step_length),
    ] {
        for (of_component, derivative) in tangents[variable / LANES].iter_mut().zip(derivative) {
            of_component[variable % LANES] += derivative;
        }
    }
}

/// One velocity each.
fn unit_velocities() -> [BodyVector; 5] {
    std::array::from_fn(|velocity| BodyVector::ith(velocity, 1.0))
}

/// How the pose changes in a step, `dt/2 (u_A + u_E)` in the world.
struct PoseChange {
    half: f64,
    /// Sine and cosine of the midpoint's heading.
    rotation: (f64, f64),
    /// `u_A + u_E` in the world: x, y and heading.
    sum: Vector3<f64>,
    /// Derivatives of x and y by the midpoint's heading.
    by_midpoint_heading: Vector2<f64>,
}

impl PoseChange {
    fn new(entry: &TapeEntry, dt: f64) -> Self {
        let half = 0.5 * dt;
        let sum = in_world(&(entry.start_velocity + entry.end_velocity), entry.rotation);
        let by_midpoint_heading = Vector2::new(-half * sum.y, half * sum.x);
        Self { half, rotation: entry.rotation, sum, by_midpoint_heading }
    }

    /// By something that the body velocities at the start and the end have these derivatives by.
    fn of(&self, start: &BodyVector, end: &BodyVector) -> Vector3<f64> {
        let turned = self.by_midpoint_heading * (self.half * start[2]);
        in_world(&(start + end), self.rotation) * self.half + turned.push(0.0)
    }

    /// By the step length alone.
    fn by_step_length(&self, entry: &TapeEntry) -> Vector3<f64> {
        0.5 * (self.sum + (self.by_midpoint_heading * entry.start_velocity[2]).push(0.0))
    }
}

/// Rates of x, y and heading.
fn in_world(velocity: &BodyVector, rotation: (f64, f64)) -> Vector3<f64> {
    turned(velocity.xy(), rotation).push(velocity[2])
}

/// Derivatives of (right, forward) of a fixed vector by the angle through which the body frame turns.
fn by_angle(right: f64, forward: f64) -> Vector2<f64> {
    Vector2::new(forward, -right)
}

fn left_torque(interval: usize) -> usize {
    STEP_LENGTH + 1 + 2 * interval
}

fn right_torque(interval: usize) -> usize {
    left_torque(interval) + 1
}

/// With indices: iterators over these small arrays are not unrolled.
#[inline]
#[expect(clippy::needless_range_loop, reason = "unrolled and vectorised as it stands")]
fn add_product<const K: usize, const C: usize>(sum: &mut Block<K>, matrix: &SMatrix<f64, K, C>, of: &Block<C>) {
    for column in 0..C {
        for row in 0..K {
            let factor = matrix.data.0[column][row];
            for lane in 0..LANES {
                sum[row][lane] += factor * of[column][lane];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, RobotParameters, State};
    use crate::simulation::rollout::Model;
    use crate::simulation::{Simulator, TorqueSchedule};

    /// The derivatives of all normal forces both ways, front with friction or not, over all modes of contact.
    fn compare(law: FrictionLaw, front_friction_coefficient: f64) {
        let parameters = RobotParameters { front_friction_coefficient, ..RobotParameters::default() };
        let simulator = Simulator::new(&Robot::new(parameters).unwrap());
        let torque = |interval: usize, phase: f64| 1.2 * (0.9 * interval as f64 + phase).sin();
        let schedule = TorqueSchedule {
            final_time: 2.0,
            left: (0..12).map(|interval| torque(interval, 0.0)).collect(),
            right: (0..12).map(|interval| torque(interval, 0.7)).collect(),
        };
        let mut start = State::default();
        (start.velocity.y, start.velocity.yaw_rate) = (0.3, 0.8);
        let rollout = Rollout { start: &start, schedule: &schedule, step_count: 60 };
        let mut sensitivity = EndSensitivity::default();
        simulator.record(&rollout, law, &mut sensitivity, Stop::never()).unwrap();
        let chosen: Vec<usize> = (0..sensitivity.path.count()).collect();
        let backwards = simulator.path_sensitivity(&rollout, law, &sensitivity, &chosen, Stop::never()).unwrap();
        let motion = (&rollout, law);
        let forwards = match &*simulator.model(&rollout) {
            Model::Wheels(model) => differentiate(model, motion, &sensitivity, &chosen, Stop::never()),
            Model::WheelsAndFront(model) => differentiate(model, motion, &sensitivity, &chosen, Stop::never()),
        };
        let entries = |row: &PathDerivative| {
            let torques = row.by_left_torque.iter().chain(&row.by_right_torque);
            torques.chain([&row.by_final_time]).copied().collect::<Vec<f64>>()
        };
        for (forward, backward) in forwards.unwrap().iter().zip(&backwards) {
            let (forward, backward) = (entries(forward), entries(backward));
            let largest = backward.iter().fold(1.0, |largest: f64, value| largest.max(value.abs()));
            for (forward, backward) in forward.iter().zip(&backward) {
                // Both round differently, in sums of some hundred terms.
                assert!((forward - backward).abs() < 1e-11 * largest, "{forward} {backward}");
            }
        }
    }

    #[test]
    fn tangents_and_adjoints_agree() {
        for law in [FrictionLaw::Exact, FrictionLaw::Smoothed(0.05), FrictionLaw::Held(0.0)] {
            for front_friction_coefficient in [0.0, 0.3] {
                compare(law, front_friction_coefficient);
            }
        }
    }
}
