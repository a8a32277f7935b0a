//! The elastic simplex against a general LP library, on random programs with dependent rows and tight boxes.

use microlp::{ComparisonOp, OptimizationDirection, Problem, SolveOutcome};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::optimizer::{ElasticProgram, ElasticSolver};
use slipdrive::stop::Stop;

const COLUMNS: usize = 41;
const ROWS: usize = 8;

struct Data {
    matrix: DMatrix<f64>,
    target: DVector<f64>,
    cost: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    penalty_parameter: f64,
}

/// A program like those of a maneuver: some variables at a bound, rows that depend on each other where it ends sticking.
fn random_program(seed: u64) -> Data {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut matrix = DMatrix::from_fn(ROWS, COLUMNS, |_, _| rng.random_range(-1.0..1.0));
    for row in 5..ROWS {
        if rng.random_bool(0.5) {
            let dependent = matrix.row(0) * rng.random_range(-1.0..1.0) + matrix.row(1) * rng.random_range(-1.0..1.0);
            matrix.set_row(row, &dependent);
        }
    }
    let radius = 10.0_f64.powf(rng.random_range(-6.0..0.0));
    let mut cost = DVector::zeros(COLUMNS);
    cost[COLUMNS - 1] = 1.0;
    let mut bound = || if rng.random_bool(0.4) { 0.0 } else { radius };
    let (lower, upper) = (DVector::from_fn(COLUMNS, |_, _| -bound()), DVector::from_fn(COLUMNS, |_, _| bound()));
    let size = if rng.random_bool(0.5) { 0.0 } else { radius };
    let inside = DVector::from_fn(COLUMNS, |_, _| rng.random_range(-1.0..1.0) * size);
    let target = &matrix * inside;
    Data { matrix, target, cost, lower, upper, penalty_parameter: if rng.random_bool(0.5) { 5.0 } else { 50.0 } }
}

fn by_library(data: &Data) -> f64 {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let variables: Vec<_> =
        (0..COLUMNS).map(|index| problem.add_var(data.cost[index], (data.lower[index], data.upper[index]))).collect();
    for row in 0..ROWS {
        let above = problem.add_var(data.penalty_parameter, (0.0, f64::INFINITY));
        let below = problem.add_var(data.penalty_parameter, (0.0, f64::INFINITY));
        let terms = variables.iter().enumerate().map(|(index, &variable)| (variable, data.matrix[(row, index)]));
        let terms: Vec<_> = terms.chain([(above, -1.0), (below, 1.0)]).collect();
        problem.add_constraint(terms, ComparisonOp::Eq, data.target[row]);
    }
    match problem.solve() {
        Ok(SolveOutcome::Solution(solution)) => solution.objective(),
        other => panic!("the program is feasible: {other:?}"),
    }
}

#[test]
fn elastic_simplex_is_as_good_as_a_general_solver() {
    let mut solver = ElasticSolver::new();
    for seed in 0..2000 {
        let data = random_program(seed);
        let program = ElasticProgram {
            matrix: &data.matrix,
            target: &data.target,
            equation_count: ROWS,
            cost: &data.cost,
            lower: &data.lower,
            upper: &data.upper,
            penalty_parameter: data.penalty_parameter,
        };
        let solution = solver.solve(&program, Stop::never()).unwrap();
        let violation = (&data.matrix * &solution.x - &data.target).lp_norm(1);
        let objective = data.cost.dot(&solution.x) + data.penalty_parameter * violation;
        let expected = by_library(&data);
        // The library stops at 1e-9 or so; the penalty parameter magnifies that.
        assert!(objective <= expected + 1e-7 * (1.0 + expected.abs()), "seed {seed}: {objective}, library {expected}");
        let box_of = |index: usize| data.lower[index]..=data.upper[index];
        assert!((0..COLUMNS).all(|index| box_of(index).contains(&solution.x[index])), "seed {seed} leaves its box");
    }
}
