//! The motion of `base_link` at any time: pose and twist by REP-103, wheels and torques.
//!
//! Within a step the velocity of the chassis centre of mass, the yaw rate and the wheel rates are linear in time, as they are under
//! the forces of the step, which are its means. Their integrals are the step's own positions, `q_E = q_A + dt/2 (u_A + u_E)`, so the
//! twist is the derivative of the pose at all times and nodes are kept. Torques hold from a time on: those of the last step end with
//! a step to zero.

use nalgebra::Vector2;

use crate::jobs::plan::AcceptedPlan;
use crate::robot::{PerWheel, State};
use crate::shooting::ReferencePoint;
use crate::simulation::{Trajectory, control_interval};

/// How far the first of the two points of a torque step is before the second, ns.
const TORQUE_STEP_NS: u64 = 1_000;
const NS_PER_S: f64 = 1e9;

/// What holds at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    /// Since the start, s.
    pub(super) time: f64,
    /// The same, rounded to ns.
    pub(super) nanoseconds: u64,
    /// World x of the axle midpoint, m.
    pub(super) x: f64,
    /// World y, m.
    pub(super) y: f64,
    /// From world +x to forward, rad, not wrapped.
    pub(super) yaw: f64,
    /// Velocity of the axle midpoint.
    pub(super) twist: Twist,
    /// Wheel angles, rad.
    pub(super) wheel_angle: PerWheel<f64>,
    /// Wheel rates, rad/s.
    pub(super) wheel_rate: PerWheel<f64>,
    /// Wheel torques from this time on, N m.
    pub(super) torque: PerWheel<f64>,
}

/// A velocity along the axes of `base_link`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Twist {
    /// m/s.
    pub(super) forward: f64,
    /// m/s.
    pub(super) left: f64,
    /// rad/s.
    pub(super) yaw_rate: f64,
}

/// A motion that can be asked for any time.
pub(super) struct Motion {
    /// Node times, s.
    time: Vec<f64>,
    /// States at the nodes, at the chassis centre of mass.
    state: Vec<State>,
    /// From there to the axle midpoint, in the body frame (right, forward), m.
    to_axle: Vector2<f64>,
    /// From when on which torques hold, ns: the first at 0, the last, without torque, at the final time.
    torques: Vec<(u64, PerWheel<f64>)>,
}

impl Motion {
    /// The motion of a plan that was rolled out.
    pub(super) fn new(plan: &AcceptedPlan, trajectory: &Trajectory) -> Self {
        let (robot, schedule) = (plan.motion.robot.parameters(), &plan.motion.schedule);
        let to_center = -plan.motion.reference_point.offset(robot);
        let (time, steps) = (trajectory.time.clone(), trajectory.step_count());
        let mut torques: Vec<(u64, PerWheel<f64>)> = Vec::new();
        for (step, begin) in time.iter().take(steps).enumerate() {
            let torque = schedule.torque(control_interval(step, steps, schedule.control_count()));
            if torques.last().is_none_or(|(_, last)| *last != torque) {
                torques.push((nanoseconds(*begin), torque));
            }
        }
        torques.push((nanoseconds(time.last().copied().unwrap_or_default()), PerWheel::default()));
        let state = trajectory.state.iter().map(|state| state.moved_by(to_center)).collect();
        Self { time, state, to_axle: ReferencePoint::AxleMidpoint.offset(robot), torques }
    }

    /// Points at a constant rate, Hz, and one at the final time. A point after the first that would be less than the length of a
    /// torque step before the last one is left out.
    pub(super) fn points(&self, rate: f64) -> Vec<Point> {
        let end = self.end();
        let regular = (0_u32..).map(|index| nanoseconds(f64::from(index) / rate));
        let regular = regular.take_while(|time| time + TORQUE_STEP_NS <= end || *time == 0 && end > 0);
        regular.chain([end]).map(|time| self.at(time)).collect()
    }

    /// The points with two more at each step of a torque: the old one a microsecond before, and the new one.
    pub(super) fn with_torque_steps(&self, points: &[Point]) -> Vec<Point> {
        let mut all: Vec<Point> = Vec::with_capacity(points.len() + 2 * self.torques.len());
        let mut points = points.iter().peekable();
        for pair in self.torques.windows(2) {
            let ((begin, _), (step, _)) = (pair[0], pair[1]);
            // Of torques that hold for less than a microsecond there is the one point where they begin.
            let before = step.saturating_sub(TORQUE_STEP_NS).max(begin);
            while let Some(point) = points.next_if(|point| point.nanoseconds < before) {
                all.push(*point);
            }
            while points.next_if(|point| point.nanoseconds <= step).is_some() {}
            let is_new = all.last().is_none_or(|last| last.nanoseconds < before);
            all.extend(is_new.then(|| self.at(before)));
            all.push(self.at(step));
        }
        all.extend(points);
        all
    }

    /// When it ends, ns.
    fn end(&self) -> u64 {
        self.torques.last().map_or(0, |(time, _)| *time)
    }

    fn at(&self, nanoseconds: u64) -> Point {
        let steps = self.time.len().saturating_sub(1);
        let end = self.time.last().copied().unwrap_or_default();
        // The final time itself is no whole number of nanoseconds.
        let time = if nanoseconds == self.end() { end } else { nanoseconds as f64 / NS_PER_S };
        let state = if time < end { self.between(time, end / steps as f64) } else { self.state[steps] };
        let State { configuration: q, velocity: u } = state.moved_by(self.to_axle);
        let (sin, cos) = q.heading.sin_cos();
        let holds = self.torques.partition_point(|(begin, _)| *begin <= nanoseconds).saturating_sub(1);
        Point {
            time,
            nanoseconds,
            x: q.x,
            y: q.y,
            yaw: q.heading + std::f64::consts::FRAC_PI_2,
            // Forward is (-sin, cos) of the heading, left (-cos, -sin).
            twist: Twist { forward: cos * u.y - sin * u.x, left: 0.0 - (cos * u.x + sin * u.y), yaw_rate: u.yaw_rate },
            wheel_angle: q.wheel_angle,
            wheel_rate: u.wheel_rate,
            torque: self.torques[holds].1,
        }
    }

    /// The state at the chassis centre of mass at a time before the end.
    fn between(&self, time: f64, step_length: f64) -> State {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between 0 and the number of steps"
        )]
        let step = ((time / step_length) as usize).min(self.state.len() - 2);
        let elapsed = (time - self.time[step]).clamp(0.0, step_length);
        let (begin, end) = (self.state[step].to_vector(), self.state[step + 1].to_vector());
        let (rate, end_rate) = (begin.fixed_rows::<5>(5), end.fixed_rows::<5>(5));
        let gained = (end_rate - rate) * (elapsed / step_length);
        let mut state = begin;
        let mut position = state.fixed_rows_mut::<5>(0);
        position += (rate + gained * 0.5) * elapsed;
        let mut velocity = state.fixed_rows_mut::<5>(5);
        velocity += gained;
        State::from_vector(&state)
    }
}

/// A time in whole nanoseconds.
fn nanoseconds(time: f64) -> u64 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times are at least 0; hours fit")]
    let nanoseconds = (time * NS_PER_S).round() as u64;
    nanoseconds
}
