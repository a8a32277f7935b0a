//! The end state as goals are judged: in the frame in which the scheme rolls.
//!
//! A step keeps the contact law at the heading of its midpoint. A robot that rolls exactly therefore ends with a velocity that
//! lags its heading by `omega_E dt / 2`, and a goal at speed on a curve would ask for a slip of that size. So the velocity of
//! the chassis centre of mass is turned by that angle before it is moved to the reference point. With restitution e the law holds
//! for the mean of the velocities at both ends of the step, of which the first one counts e times; on a steady curve that one
//! lags by a step more. The mean of the velocity turned by half a step forwards and, counting e times, backwards is what rolls.

use nalgebra::Vector2;

use super::rollout::{Rollout, Simulator};
use super::sensitivity::EndDerivative;
use super::turn::turned;
use crate::robot::State;

/// The frame of the end of one rollout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndFrame {
    /// Turn of the velocity per yaw rate: half a step, s.
    turn_time: f64,
    /// Its derivative by the final time.
    turn_time_by_final_time: f64,
    /// What of the sine of the turn is left with restitution e: (1 - e) / (1 + e).
    sine_share: f64,
    /// From the chassis centre of mass to the reference point, in the body frame (right, forward), m.
    offset: Vector2<f64>,
}

impl Simulator {
    /// The frame of the end of a rollout, for a reference point `offset` away from the chassis centre of mass.
    pub fn end_frame(&self, rollout: &Rollout, offset: Vector2<f64>) -> EndFrame {
        let restitution = self.robot().parameters().tangential_restitution;
        let turn_time_by_final_time = 0.5 / rollout.step_count as f64;
        EndFrame {
            turn_time: turn_time_by_final_time * rollout.schedule.final_time,
            turn_time_by_final_time,
            sine_share: (1.0 - restitution) / (1.0 + restitution),
            offset,
        }
    }
}

impl EndFrame {
    /// The end state at the reference point, from that of the scheme at the chassis centre of mass.
    pub fn state(&self, end: &State) -> State {
        let mut state = *end;
        let [turn_of_velocity, _] = self.turn_at(end);
        let velocity = turned(Vector2::new(end.velocity.x, end.velocity.y), turn_of_velocity);
        (state.velocity.x, state.velocity.y) = (velocity.x, velocity.y);
        state.moved_by(self.offset)
    }

    /// The turn of the velocity at an end state, as sine and cosine, and its derivative by the angle.
    fn turn_at(&self, end: &State) -> [(f64, f64); 2] {
        let (sin, cos) = (self.turn_time * end.velocity.yaw_rate).sin_cos();
        [(self.sine_share * sin, cos), (self.sine_share * cos, -sin)]
    }

    /// The frame at one end state of the scheme.
    pub fn at(&self, end: &State) -> EndFrameAt {
        let [turn_of_velocity, by_angle] = self.turn_at(end);
        EndFrameAt {
            frame: *self,
            turn: turn_of_velocity,
            velocity_by_angle: turned(Vector2::new(end.velocity.x, end.velocity.y), by_angle),
            yaw_rate: end.velocity.yaw_rate,
            arm: turned(self.offset, end.configuration.heading.sin_cos()),
        }
    }
}

/// An end frame at one end state, with the sines and cosines that all its derivatives need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndFrameAt {
    frame: EndFrame,
    /// The turn of the velocity, as sine and cosine.
    turn: (f64, f64),
    /// Derivative of the turned velocity by the angle of the turn.
    velocity_by_angle: Vector2<f64>,
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
        let of_angle = self.frame.turn_time * derivative[7] + self.frame.turn_time_by_final_time * self.yaw_rate;
        self.along(derivative, of_angle)
    }

    /// With the derivative of the angle of the turn.
    fn along(&self, derivative: &EndDerivative, of_angle: f64) -> EndDerivative {
        let Self { velocity_by_angle, yaw_rate: end_yaw_rate, arm, .. } = self;
        let change = turned(Vector2::new(derivative[5], derivative[6]), self.turn);
        let mut moved = *derivative;
        moved[5] = change.x + velocity_by_angle.x * of_angle;
        moved[6] = change.y + velocity_by_angle.y * of_angle;

        let (heading, yaw_rate) = (derivative[2], derivative[7]);
        moved[0] -= arm.y * heading;
        moved[1] += arm.x * heading;
        moved[5] -= arm.y * yaw_rate + arm.x * heading * end_yaw_rate;
        moved[6] += arm.x * yaw_rate - arm.y * heading * end_yaw_rate;
        moved
    }
}
