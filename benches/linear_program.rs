//! The elastic simplex against a general LP library on programs of a maneuver's shape: 81 variables, 8 rows without limits and 120
//! with limits, begun where the one before ended.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use microlp::{ComparisonOp, OptimizationDirection, Problem, SolveOutcome};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::optimizer::{ElasticProgram, ElasticSolver};
use slipdrive::stop::Stop;

/// One per component of the goal; all others are limits.
const EQUATIONS: usize = 8;
/// Of a plan without limits, and of one with limits.
const ROWS: [usize; 2] = [EQUATIONS, 120];

struct Data {
    matrix: DMatrix<f64>,
    target: DVector<f64>,
    cost: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    penalty_parameter: f64,
}

/// A random program in which final time is cheap and the goal is within reach.
fn random_program(rows: usize, seed: u64) -> Data {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut cost = DVector::zeros(81);
    cost[80] = 1.0;
    Data {
        matrix: DMatrix::from_fn(rows, 81, |_, _| rng.random_range(-0.1..0.1)),
        target: DVector::from_fn(rows, |_, _| rng.random_range(-0.05..0.05)),
        cost,
        lower: DVector::from_fn(81, |_, _| -rng.random_range(0.0..0.3)),
        upper: DVector::from_fn(81, |_, _| rng.random_range(0.0..0.3)),
        penalty_parameter: 5.0,
    }
}

fn by_library(data: &Data) -> f64 {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let variables: Vec<_> =
        (0..81).map(|index| problem.add_var(data.cost[index], (data.lower[index], data.upper[index]))).collect();
    for row in 0..data.target.len() {
        let above = problem.add_var(data.penalty_parameter, (0.0, f64::INFINITY));
        let slack = if row < EQUATIONS { data.penalty_parameter } else { 0.0 };
        let below = problem.add_var(slack, (0.0, f64::INFINITY));
        let terms = variables.iter().enumerate().map(|(index, &variable)| (variable, data.matrix[(row, index)]));
        let terms: Vec<_> = terms.chain([(above, -1.0), (below, 1.0)]).collect();
        problem.add_constraint(terms, ComparisonOp::Eq, data.target[row]);
    }
    match problem.solve() {
        Ok(SolveOutcome::Solution(solution)) => solution.objective(),
        other => panic!("the program is feasible: {other:?}"),
    }
}

fn by_elastic_simplex(solver: &mut ElasticSolver, data: &Data) -> f64 {
    let program = ElasticProgram {
        matrix: &data.matrix,
        target: &data.target,
        row_name: &(0..data.target.len()).collect::<Vec<_>>(),
        equation_count: EQUATIONS,
        cost: &data.cost,
        lower: &data.lower,
        upper: &data.upper,
        penalty_parameter: data.penalty_parameter,
    };
    solver.solve(&program, Stop::never()).expect("nothing stops it").objective
}

fn programs(criterion: &mut Criterion) {
    for rows in ROWS {
        let programs: Vec<Data> = (0..20).map(|seed| random_program(rows, seed)).collect();
        let mut solver = ElasticSolver::default();
        for data in &programs {
            let (own, library) = (by_elastic_simplex(&mut solver, data), by_library(data));
            assert!((own - library).abs() < 1e-9, "{own} against {library}");
        }
        let mut group = criterion.benchmark_group(format!("twenty_linear_programs_of_{rows}_by_81"));
        group.bench_function("elastic_simplex", |bench| {
            bench.iter(|| programs.iter().map(|data| by_elastic_simplex(&mut solver, black_box(data))).sum::<f64>());
        });
        group.bench_function("microlp", |bench| {
            bench.iter(|| programs.iter().map(|data| by_library(black_box(data))).sum::<f64>());
        });
        group.finish();
    }
}

criterion_group!(benches, programs);
criterion_main!(benches);
