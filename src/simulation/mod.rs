//! Moreau time stepping, rollouts and their trajectories.

mod chain;
mod contact_timeline;
mod end_frame;
mod least_normal_forces;
mod moreau_step;
mod normal_force_sensitivity;
mod rollout;
mod sensitivity;
mod step_derivative;
mod tape;
mod torque_schedule;
mod trajectory;

pub use contact_timeline::{ContactModeSpan, NormalLoad, Separation};
pub use end_frame::EndFrame;
pub use least_normal_forces::LeastNormalForces;
pub use normal_force_sensitivity::NormalForceDerivative;
pub use rollout::{ContactMethod, Rollout, Simulator};
pub use sensitivity::{EndDerivative, EndSensitivity};
pub use torque_schedule::{TorqueSchedule, control_interval};
pub use trajectory::{ContactSample, Trajectory};
