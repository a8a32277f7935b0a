//! The end state as goals are judged: in the frame in which the scheme rolls.
//!
//! A step keeps the contact law at the heading of its midpoint. A robot that rolls exactly therefore ends with a velocity that
//! lags its heading by `omega_E dt / 2`, and a goal at speed on a curve would ask for a slip of that size. So the velocity of
//! the chassis centre of mass is turned by that angle before it is moved to the reference point. With restitution the law
//! mixes the velocities at both ends of the step and no frame rolls: the velocity stays as it is.

use nalgebra::Vector2;

use super::rollout::{Rollout, Simulator};
use super::sensitivity::EndDerivative;
use crate::robot::State;

/// The frame of the end of one rollout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndFrame {
    /// Turn of the velocity per yaw rate: half a step, s; 0 with restitution.
    turn_time: f64,
    /// Its derivative by the final time.
    turn_time_by_final_time: f64,
    /// From the chassis centre of mass to the reference point, in the body frame (right, forward), m.
    offset: Vector2<f64>,
}

impl Simulator {
    /// The frame of the end of a rollout, for a reference point `offset` away from the chassis centre of mass.
    pub fn end_frame(&self, rollout: &Rollout, offset: Vector2<f64>) -> EndFrame {
        let rolls = self.robot().parameters().tangential_restitution == 0.0;
        let turn_time_by_final_time = if rolls { 0.5 / rollout.step_count as f64 } else { 0.0 };
        EndFrame { turn_time: turn_time_by_final_time * rollout.schedule.final_time, turn_time_by_final_time, offset }
    }
}

impl EndFrame {
    /// The end state at the reference point, from that of the scheme at the chassis centre of mass.
    pub fn state(&self, end: &State) -> State {
        let mut turned = *end;
        (turned.velocity.x, turned.velocity.y) = turn((end.velocity.x, end.velocity.y), self.angle(end).sin_cos());
        turned.moved_by(self.offset)
    }

    /// The turn of the velocity at an end state.
    fn angle(&self, end: &State) -> f64 {
        self.turn_time * end.velocity.yaw_rate
    }

    /// The frame at one end state of the scheme.
    pub fn at(&self, end: &State) -> EndFrameAt {
        let angle = self.angle(end).sin_cos();
        let (sin, cos) = end.configuration.heading.sin_cos();
        EndFrameAt {
            frame: *self,
            angle,
            velocity: turn((end.velocity.x, end.velocity.y), angle),
            yaw_rate: end.velocity.yaw_rate,
            arm: Vector2::new(cos * self.offset.x - sin * self.offset.y, sin * self.offset.x + cos * self.offset.y),
        }
    }
}

/// Turns a vector by the angle with this sine and cosine.
fn turn((x, y): (f64, f64), (sin, cos): (f64, f64)) -> (f64, f64) {
    (cos * x - sin * y, sin * x + cos * y)
}

/// An end frame at one end state, with the sines and cosines that all its derivatives need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndFrameAt {
    frame: EndFrame,
    /// Sine and cosine of the turn of the velocity.
    angle: (f64, f64),
    /// The turned velocity.
    velocity: (f64, f64),
    yaw_rate: f64,
    /// The offset in the world frame.
    arm: Vector2<f64>,
}

impl EndFrameAt {
    /// Derivative of [`EndFrame::state`] along a derivative of the scheme's end state.
    pub fn derivative(&self, derivative: &EndDerivative) -> EndDerivative {
        self.along(derivative, self.frame.turn_time * derivative[7])
    }

    /// As [`EndFrameAt::derivative`] by the final time, which also changes the step.
    pub fn derivative_by_final_time(&self, derivative: &EndDerivative) -> EndDerivative {
        let by_turn = self.frame.turn_time * derivative[7] + self.frame.turn_time_by_final_time * self.yaw_rate;
        self.along(derivative, by_turn)
    }

    /// With the derivative of the turn.
    fn along(&self, derivative: &EndDerivative, by_turn: f64) -> EndDerivative {
        let Self { velocity, yaw_rate: end_yaw_rate, arm, .. } = self;
        let change = turn((derivative[5], derivative[6]), self.angle);
        let mut moved = *derivative;
        moved[5] = change.0 - velocity.1 * by_turn;
        moved[6] = change.1 + velocity.0 * by_turn;

        let (heading, yaw_rate) = (derivative[2], derivative[7]);
        moved[0] -= arm.y * heading;
        moved[1] += arm.x * heading;
        moved[5] -= arm.y * yaw_rate + arm.x * heading * end_yaw_rate;
        moved[6] += arm.x * yaw_rate - arm.y * heading * end_yaw_rate;
        moved
    }
}
