//! Time-optimal maneuvers of a differential-drive robot whose wheels may stick or slip.
//!
//! # The problem
//! Find wheel torques and a final time that bring the robot from a start to a goal as fast as possible:
//!
//! ```text
//! minimise    t_f
//! over        torque_left(t), torque_right(t), t_f
//! subject to  M(q) du - h(q, u, torque) dt - W_T(q) dLambda_T = 0        motion, (25)
//!             dLambda_N = P(q, u, du)                                    normal loads by projection, (26)
//!             -(gamma+ + e gamma-) in N_C(dLambda_T)                     spatial Coulomb friction, (23)
//!             |torque_left| <= limit_left, |torque_right| <= limit_right
//!             start state given, goal state given in some or all components
//! ```
//!
//! q = (x, y, heading, left wheel angle, right wheel angle), SI units, heading 0 faces world +y. Equation numbers are
//! those of Yunt & Glocker, "Time-optimal trajectories of a differential drive robot"; `docs/model.md` derives what
//! the paper leaves out. A maneuver of N steps (200 in the paper) and n torques per wheel (40) has 2 n + 1 unknowns.
//!
//! # The modules
//! - [`robot`]: parameters, mass matrix, smooth forces, contact kinematics, normal loads.
//! - [`contact`]: the one-step friction problem as plain data, its exact and its fixed-point solver.
//! - [`simulation`]: Moreau time stepping, rollouts, trajectories, derivatives.
//! - [`optimizer`]: sequential linear programming and Nelder-Mead; they know no mechanics.
//! - [`shooting`]: from a maneuver to a decision vector, goal errors and their Jacobian.
//! - [`solver`]: the search, and what its answer states about itself.
//! - [`plot`]: the paper's figures from a solution, as a page.
//! - [`queue`]: a bounded queue that feeds blocking worker threads.
//! - [`service`]: solve, simulate and validate behind the queue.
//! - [`metrics`]: what a server counts about itself.
//! - [`api`] offers the service over REST and gRPC.

pub mod api;
pub mod contact;
pub mod metrics;
pub mod optimizer;
pub mod plot;
pub mod queue;
pub mod robot;
pub mod service;
pub mod shooting;
pub mod simulation;
pub mod solver;
pub mod violation;
