//! The one-step friction problem as plain data (Delassus operator, free slip, free normal impulses), and its solvers.
//!
//! Given the slip and the normal impulses that a step would have without friction, find the friction impulses:
//!
//! ```text
//! xi       = free_slip   + delassus Lambda_T               impact slip, (19): gamma+ + e gamma-
//! Lambda_N = free_normal + normal_response Lambda_T        normal impulses by projection, (22)
//! -xi_i in N_C(Lambda_T,i),  C = disc of radius mu_i max(Lambda_N,i, 0)      spatial Coulomb friction, (23)
//! ```
//!
//! The two wheels share one lateral direction. The problem therefore has N = 3 directions (left longitudinal, right
//! longitudinal, axle lateral), or N = 5 when the front support has friction (front longitudinal, front lateral). In
//! these directions the Delassus matrix is positive definite; only the split of the lateral impulse between two
//! sticking wheels is not determined.
//!
//! All solvers have the same residual, the [natural map](natural_map). Nothing in this module depends on the robot.

mod delassus;
mod directions;
mod exact;
mod fixed_point;
mod held;
mod impulse_derivative;
mod interior_point;
mod mode_equations;
pub mod natural_map;
mod newton;
mod one_step_problem;
mod pattern;
mod prox;
mod slipping_front;
mod small_systems;
mod smoothed;
mod solution;
mod uniqueness;
mod utilization;

pub use delassus::{DelassusOperator, ImpulseDerivative};
pub use exact::{ExactSolver, PROMISED_RESIDUAL, SolvePath};
pub use fixed_point::FixedPointSolver;
pub use held::solve_held;
pub use one_step_problem::OneStepProblem;
pub use pattern::{ContactMode, ContactPattern, SlipSign, WheelPattern};
pub use prox::{project_onto_disc, project_onto_half_line};
pub use smoothed::solve_smoothed;
pub use solution::{ContactImpulse, ContactName, ContactSolution, PerContact};
pub use utilization::{UtilizationGradient, WheelFriction};
