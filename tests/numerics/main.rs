//! The numerics: mechanics, contact, derivatives, optimisation and whole solves, without a service around them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod best_known;
mod derivatives;
mod end_frame;
mod extreme_input;
mod forward_drive;
mod helped_search;
mod infeasible;
mod limits;
mod linear_program;
mod lower_bound;
mod one_step_contact;
mod path_derivatives;
mod physics;
mod random;
mod reference_rollouts;
mod shooting_derivatives;
mod value_digests;
mod warm_starts;
