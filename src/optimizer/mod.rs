//! Optimisers, independent of any mechanics: sequential linear programming and Nelder-Mead.

mod elastic_program;
mod evaluation;
mod independent_rows;
mod linear_program;
mod nelder_mead;
mod sequential_linear;
#[cfg(test)]
mod small_problem;
mod switching;

pub use elastic_program::{ElasticProgram, ElasticSolution};
pub use evaluation::{Budget, Constraints, Interruption, Linearisation, Problem, larger, largest_magnitude};
pub use linear_program::ElasticSolver;
pub use nelder_mead::{NelderMeadResult, minimise_by_nelder_mead};
pub use sequential_linear::{
    CriticalityMeasure, FIRST_RADIUS, PENALTY_GROWTH, SequentialLinearResult, SequentialLinearSettings,
    criticality_measure, minimise_sequentially,
};
pub use switching::sign_violations;
