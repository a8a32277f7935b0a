//! The elastic simplex against a general LP library, on random programs with dependent rows, limit rows and tight boxes, each
//! begun where the one before ended.

use microlp::{ComparisonOp, OptimizationDirection, Problem, SolveOutcome};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::optimizer::{ElasticProgram, ElasticSolver};
use slipdrive::stop::Stop;

const COLUMNS: usize = 41;
const EQUATIONS: usize = 8;
/// Most limit rows.
const LIMITS: usize = 24;

struct Data {
    row_name: Vec<usize>,
    matrix: DMatrix<f64>,
    target: DVector<f64>,
    cost: DVector<f64>,
    lower: DVector<f64>,
    upper: DVector<f64>,
    penalty_parameter: f64,
}

impl Data {
    fn objective(&self, x: &DVector<f64>) -> f64 {
        let rows = &self.matrix * x - &self.target;
        let limits = rows.iter().skip(EQUATIONS).map(|row| row.max(0.0)).sum::<f64>();
        self.cost.dot(x) + self.penalty_parameter * (rows.rows(0, EQUATIONS).lp_norm(1) + limits)
    }
}

/// A program like those of a maneuver: some variables at a bound, rows that depend on each other where it ends sticking.
fn random_program(seed: u64) -> Data {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    // Limits come and go, as in a working set.
    let share = rng.random_range(0.0..1.0);
    let limits = (EQUATIONS..EQUATIONS + LIMITS).filter(|_| rng.random_bool(share));
    let row_name: Vec<usize> = (0..EQUATIONS).chain(limits.collect::<Vec<_>>()).collect();
    let rows = row_name.len();
    let mut matrix = DMatrix::from_fn(rows, COLUMNS, |_, _| rng.random_range(-1.0..1.0));
    for row in 5..EQUATIONS {
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
    Data {
        row_name,
        matrix,
        target,
        cost,
        lower,
        upper,
        penalty_parameter: if rng.random_bool(0.5) { 5.0 } else { 50.0 },
    }
}

/// The objective at the library's minimiser, back in the box: its own value leaves out what it violates within its tolerance.
fn by_library(data: &Data) -> f64 {
    let mut problem = Problem::new(OptimizationDirection::Minimize);
    let variables: Vec<_> =
        (0..COLUMNS).map(|index| problem.add_var(data.cost[index], (data.lower[index], data.upper[index]))).collect();
    for row in 0..data.target.len() {
        let above = problem.add_var(data.penalty_parameter, (0.0, f64::INFINITY));
        let slack = if row < EQUATIONS { data.penalty_parameter } else { 0.0 };
        let below = problem.add_var(slack, (0.0, f64::INFINITY));
        let terms = variables.iter().enumerate().map(|(index, &variable)| (variable, data.matrix[(row, index)]));
        let terms: Vec<_> = terms.chain([(above, -1.0), (below, 1.0)]).collect();
        problem.add_constraint(terms, ComparisonOp::Eq, data.target[row]);
    }
    match problem.solve() {
        Ok(SolveOutcome::Solution(solution)) => {
            let x = DVector::from_iterator(COLUMNS, variables.iter().map(|variable| solution[*variable]));
            data.objective(&x.zip_zip_map(&data.lower, &data.upper, f64::clamp))
        }
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
            row_name: &data.row_name,
            equation_count: EQUATIONS,
            cost: &data.cost,
            lower: &data.lower,
            upper: &data.upper,
            penalty_parameter: data.penalty_parameter,
        };
        let solution = solver.solve(&program, Stop::never()).unwrap();
        let objective = data.objective(&solution.x);
        let expected = by_library(&data);
        // Weak duality: no point of the box is better than this.
        let gradient = &data.cost - data.matrix.tr_mul(&solution.multiplier);
        let least = |index: usize| (gradient[index] * data.lower[index]).min(gradient[index] * data.upper[index]);
        let dual = data.target.dot(&solution.multiplier) + (0..COLUMNS).map(least).sum::<f64>();
        // Dozens of terms of up to 50 round to some 1e-14 each.
        assert!(objective - dual <= 1e-11, "seed {seed}: {objective} is not shown to be optimal, {dual}");
        assert!(objective <= expected + 1e-11, "seed {seed}: {objective}, library {expected}");
        let box_of = |index: usize| data.lower[index]..=data.upper[index];
        assert!((0..COLUMNS).all(|index| box_of(index).contains(&solution.x[index])), "seed {seed} leaves its box");
    }
}
