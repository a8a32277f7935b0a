//! The robot as a mechanical system: parameters, state, mass matrix, smooth forces, contact kinematics,
//! normal forces.
//!
//! Source: Yunt & Glocker, "Time-optimal trajectories of a differential drive robot", equations (2) to (22); the
//! matrices that the paper does not print are derived in `docs/model.md`. Nothing here depends on how a friction
//! problem is solved.

mod carried;
mod contact_kinematics;
mod dynamics;
mod normal_force;
mod parameters;
mod payload;
mod state;
#[cfg(test)]
pub(crate) mod unlucky;

pub(crate) use carried::{check_robot, joined};
pub use contact_kinematics::{BodyVector, TangentJacobian};
pub use dynamics::Robot;
pub use normal_force::NormalForceProjection;
pub use parameters::{Motor, RobotParameters};
pub use payload::Payload;
pub use state::{Configuration, PerWheel, State, Velocity};
