//! Moreau time stepping, rollouts and their trajectories.

mod contact_timeline;
mod end_frame;
mod friction_law;
mod moreau_step;
mod motor_load;
mod path_extremes;
mod path_maxima;
mod path_quantity;
mod path_row;
mod path_sensitivity;
mod path_tangents;
mod rollout;
mod sensitivity;
mod step_derivative;
mod tape;
mod torque_schedule;
mod trajectory;
mod turn;

pub use contact_timeline::{ContactModeSpan, NormalLoad, Separation};
pub use end_frame::{EndFrame, EndFrameAt};
pub use friction_law::FrictionLaw;
pub use motor_load::MotorJudged;
pub use path_extremes::{CONTACT_COUNT, PathExtremes};
pub use path_maxima::{PathMaxima, PathMaximum};
pub use path_quantity::PathQuantity;
pub use path_row::PathDerivative;
pub use rollout::{ContactMethod, Rollout, Simulator};
pub use sensitivity::{EndDerivative, EndSensitivity};
pub use torque_schedule::{TorqueSchedule, control_interval};
pub use trajectory::{ContactSample, Trajectory};
