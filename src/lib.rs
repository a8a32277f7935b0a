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
//! # An example
//! The paper's forward drive of 5 m, from the straight start alone:
//!
//! ```
//! use slipdrive::prelude::*;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let input = SolveInput::new(SolveParameters {
//!     robot: RobotParameters { wheel_friction_coefficient: 0.45, ..RobotParameters::default() },
//!     maneuver: Maneuver { goal: Goal::at_rest(0.0, 5.0, 0.0), ..Maneuver::forward_drive() },
//!     settings: SolverSettings { start_count: 1, refinement: Refinement::Fixed, ..SolverSettings::default() },
//!     ..SolveParameters::default()
//! })?;
//! let solution = solve(&input, &RunControl::unattended())?;
//! assert_eq!(solution.status, Status::Converged);
//! assert!((solution.schedule.final_time - 2.930).abs() < 1e-3);
//! # Ok(())
//! # }
//! ```
//!
//! # The modules
//! - [`robot`]: parameters, mass matrix, smooth forces, contact kinematics, normal forces.
//! - [`contact`]: the one-step friction problem as plain data, its exact and its fixed-point solver, smoothed friction and held wheels.
//! - [`simulation`]: Moreau time stepping, rollouts, trajectories, derivatives.
//! - [`optimizer`]: sequential linear programming and Nelder-Mead; they know no mechanics.
//! - [`shooting`]: from a maneuver to a decision vector, goal errors and their Jacobian.
//! - [`motion`]: what given torques do, as asked and under changes, and what is used of the limits.
//! - [`solver`]: the search, and what its answer states about itself.
//! - [`assessment`]: how often a plan succeeds on a robot that is known up to a distribution only.
//! - [`rules`]: what parameters must be, and all violations at once.
//! - [`stop`]: how running work is asked to end early.
//! - [`plot`]: figures of plans as SVG.
//!
//! With the feature `server`, beside them:
//! - `contract`: messages, as protobuf and as JSON, problems and error codes.
//! - `jobs`: the kinds of jobs, and how each is accepted, run and answered.
//! - `service`: jobs behind a bounded queue (`queue`), counted (`metrics`).
//! - `api`: the jobs over REST and gRPC.
//! - `sweep`: files that describe many jobs of one kind, run on one machine or on many, with results that outlast them.
//!
//! # Features
//! `server` is on by default. Without it, numerics and figures alone are built: no runtime, no generated code, no
//! build script to speak of. `otel` exports spans, `tls` encrypts both ports, `nats` runs sweeps on many machines.
//!
//! # Stability
//! Until 1.0, what [`prelude`] holds changes only with a new minor version and a line in the changelog; everything else may
//! change with any version. The contract with callers over REST and gRPC is kept more strictly: once released, fields,
//! values and codes are added, never changed. The same input gives the same answer, to the bit, in the same version on the
//! same platform, whatever the number of threads.

#[cfg(feature = "server")]
pub mod api;
pub mod assessment;
pub mod contact;
#[cfg(feature = "server")]
pub mod contract;
#[cfg(feature = "server")]
pub mod jobs;
#[cfg(feature = "server")]
pub mod metrics;
pub mod motion;
pub mod optimizer;
pub mod plot;
pub mod prelude;
#[cfg(feature = "server")]
pub mod queue;
pub mod robot;
pub mod rules;
#[cfg(feature = "server")]
pub mod service;
pub mod shooting;
pub mod simulation;
pub mod solver;
pub mod stop;
#[cfg(feature = "server")]
pub mod sweep;
