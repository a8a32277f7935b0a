//! Configuration and velocity of the robot, (2) of the paper.

use nalgebra::{SVector, Vector2};

/// One value per driven wheel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PerWheel<T> {
    /// The left wheel's value.
    pub left: T,
    /// The right wheel's value.
    pub right: T,
}

impl<T> PerWheel<T> {
    /// Left, then right.
    pub fn new(left: T, right: T) -> Self {
        Self { left, right }
    }
}

/// Generalized coordinates q = (x, y, phi, `psi_L`, `psi_R`).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Configuration {
    /// World x of the chassis centre of mass, m.
    pub x: f64,
    /// World y of the chassis centre of mass, m.
    pub y: f64,
    /// Heading, rad: 0 faces world +y, positive turns left.
    pub heading: f64,
    /// Wheel angles, rad, positive when rolling forward.
    pub wheel_angle: PerWheel<f64>,
}

/// Generalized velocities u = dq/dt.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Velocity {
    /// World x velocity of the chassis centre of mass, m/s.
    pub x: f64,
    /// World y velocity of the chassis centre of mass, m/s.
    pub y: f64,
    /// Yaw rate, rad/s, positive turns left.
    pub yaw_rate: f64,
    /// Wheel rates, rad/s, positive when rolling forward.
    pub wheel_rate: PerWheel<f64>,
}

/// Configuration and velocity at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct State {
    /// Generalized coordinates.
    pub configuration: Configuration,
    /// Generalized velocities.
    pub velocity: Velocity,
}

impl State {
    /// Length of [`State::to_vector`].
    pub const LEN: usize = 10;

    /// (x, y, heading, left angle, right angle) and their rates in the same order.
    pub fn to_vector(&self) -> SVector<f64, 10> {
        let (q, u) = (&self.configuration, &self.velocity);
        SVector::from([
            q.x,
            q.y,
            q.heading,
            q.wheel_angle.left,
            q.wheel_angle.right,
            u.x,
            u.y,
            u.yaw_rate,
            u.wheel_rate.left,
            u.wheel_rate.right,
        ])
    }

    /// The inverse of [`State::to_vector`].
    pub fn from_vector(vector: &SVector<f64, 10>) -> Self {
        Self {
            configuration: Configuration {
                x: vector[0],
                y: vector[1],
                heading: vector[2],
                wheel_angle: PerWheel::new(vector[3], vector[4]),
            },
            velocity: Velocity {
                x: vector[5],
                y: vector[6],
                yaw_rate: vector[7],
                wheel_rate: PerWheel::new(vector[8], vector[9]),
            },
        }
    }

    /// The same motion described at another point of the chassis.
    ///
    /// `offset` is the new point relative to the current one in the body frame (right, forward), m; position and
    /// velocity become those of the new point, heading and wheels stay.
    #[must_use]
    pub fn moved_by(&self, offset: Vector2<f64>) -> Self {
        let (sin, cos) = self.configuration.heading.sin_cos();
        let (x, y) = (cos * offset.x - sin * offset.y, sin * offset.x + cos * offset.y);
        let mut moved = *self;
        moved.configuration.x += x;
        moved.configuration.y += y;
        moved.velocity.x -= y * self.velocity.yaw_rate;
        moved.velocity.y += x * self.velocity.yaw_rate;
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vector_round_trips() {
        let vector = SVector::<f64, 10>::from_fn(|row, _| row as f64 + 0.5);
        assert_eq!(State::from_vector(&vector).to_vector(), vector);
    }

    #[test]
    fn moving_the_reference_point_there_and_back_is_the_identity() {
        let state = State::from_vector(&SVector::from([1.0, -2.0, 0.7, 0.1, 0.2, 0.3, 0.4, 1.5, 6.0, 7.0]));
        let offset = Vector2::new(0.02, -0.07);
        let back = state.moved_by(offset).moved_by(-offset);
        // Two rotations by the same matrix cancel to rounding.
        assert!((back.to_vector() - state.to_vector()).amax() < 1e-15);
    }
}
