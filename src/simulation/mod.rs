//! Moreau time stepping, rollouts and their trajectories.

mod contact_timeline;
mod least_loads;
mod load_sensitivity;
mod moreau_step;
mod rollout;
mod sensitivity;
mod step_derivative;
mod torque_schedule;
mod trajectory;

pub use contact_timeline::{ContactModeSpan, Separation};
pub use least_loads::LeastLoads;
pub use load_sensitivity::LoadDerivative;
pub use rollout::{ContactMethod, Rollout, Simulator};
pub use sensitivity::{EndDerivative, EndSensitivity};
pub use torque_schedule::{TorqueSchedule, control_interval};
pub use trajectory::{ContactSample, Trajectory};
