//! The elastic simplex against a general LP library, on random programs with dependent rows, limit rows and tight boxes, begun
//! where the one before ended and from nothing.

use microlp::{ComparisonOp, OptimizationDirection, Problem, SolveOutcome};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use slipdrive::optimizer::{ElasticProgram, ElasticSolution, ElasticSolver};
use slipdrive::stop::Stop;

const COLUMNS: usize = 41;
const EQUATIONS: usize = 8;
/// Most limit rows.
const LIMITS: usize = 24;
/// Dozens of terms of up to 50 round to some 1e-14 each.
const ROUNDING: f64 = 1e-11;
/// Of the objective. A row counts as met when it is off by 1e-10 of its range, some 10; hundreds of them cost up to 5 times that.
const AGREEMENT: f64 = 1e-7;

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

    fn program(&self) -> ElasticProgram<'_> {
        ElasticProgram {
            matrix: &self.matrix,
            target: &self.target,
            row_name: &self.row_name,
            equation_count: EQUATIONS,
            cost: &self.cost,
            lower: &self.lower,
            upper: &self.upper,
            penalty_parameter: self.penalty_parameter,
        }
    }

    /// The objective of a solution, which is in its box and which no point of the box betters by more: weak duality.
    fn optimal_objective(&self, solution: &ElasticSolution, tolerance: f64, label: &str) -> f64 {
        let objective = self.objective(&solution.x);
        let gradient = &self.cost - self.matrix.tr_mul(&solution.multiplier);
        let least = |index: usize| (gradient[index] * self.lower[index]).min(gradient[index] * self.upper[index]);
        let dual = self.target.dot(&solution.multiplier) + (0..COLUMNS).map(least).sum::<f64>();
        assert!(objective - dual <= tolerance, "{label}: {objective} is not shown to be optimal, {dual}");
        let box_of = |index: usize| self.lower[index]..=self.upper[index];
        assert!((0..COLUMNS).all(|index| box_of(index).contains(&solution.x[index])), "{label} leaves its box");
        objective
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
    let mut solver = ElasticSolver::default();
    for seed in 0..2000 {
        let data = random_program(seed);
        let solution = solver.solve(&data.program(), Stop::never()).unwrap();
        let objective = data.optimal_objective(&solution, ROUNDING, &format!("seed {seed}"));
        let expected = by_library(&data);
        assert!(objective <= expected + ROUNDING, "seed {seed}: {objective}, library {expected}");
    }
}

/// How the rows of a crowded program lie.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Rows {
    /// Anywhere; so many limits cannot be kept together.
    Scattered,
    /// With coefficients of -1, 0 and 1, half of them there twice, and all of them tight at the optimum.
    InOnePoint,
}

/// A program with as many limits as a plan near its least loads.
fn crowded_program(limits: usize, rows: Rows, rng: &mut Xoshiro256PlusPlus) -> Data {
    let row_count = EQUATIONS + limits;
    let mut number = || match rows {
        Rows::Scattered => rng.random_range(-1.0..1.0),
        Rows::InOnePoint => f64::from(rng.random_range(-1_i8..=1)),
    };
    let mut matrix = DMatrix::from_fn(row_count, COLUMNS, |_, _| number());
    let inside = DVector::from_fn(COLUMNS, |_, _| 0.1 * number());
    if rows == Rows::InOnePoint {
        for row in EQUATIONS + limits / 2..row_count {
            let other = matrix.row(row - limits / 2).into_owned();
            matrix.set_row(row, &other);
        }
    }
    let target = &matrix * inside;
    let cost = match rows {
        Rows::Scattered => DVector::from_fn(COLUMNS, |_, _| rng.random_range(-1.0..1.0)),
        // Multipliers within the penalty parameter make the point optimal.
        Rows::InOnePoint => -matrix.tr_mul(&DVector::from_fn(row_count, |_, _| rng.random_range(0.0..5.0))),
    };
    let (lower, upper) = (DVector::repeat(COLUMNS, -0.3), DVector::repeat(COLUMNS, 0.3));
    Data { row_name: (0..row_count).collect(), matrix, target, cost, lower, upper, penalty_parameter: 5.0 }
}

/// The program a step further: another point is the origin, and some limits are not near it.
fn next_program(data: &Data, rng: &mut Xoshiro256PlusPlus) -> Data {
    let step = DVector::from_fn(COLUMNS, |_, _| rng.random_range(-0.05..0.05));
    let is_kept: Vec<bool> = data.row_name.iter().map(|name| *name < EQUATIONS || rng.random_bool(0.9)).collect();
    let kept: Vec<usize> = (0..is_kept.len()).filter(|row| is_kept[*row]).collect();
    let matrix = data.matrix.select_rows(&kept);
    Data {
        row_name: kept.iter().map(|row| data.row_name[*row]).collect(),
        target: data.target.select_rows(&kept) - &matrix * &step,
        matrix,
        cost: data.cost.clone(),
        lower: &data.lower - &step,
        upper: &data.upper - &step,
        penalty_parameter: data.penalty_parameter,
    }
}

#[test]
fn many_limits_are_met_as_well_as_by_a_general_solver() {
    for (seed, limits) in [1, 3, 24, 80, 200].into_iter().enumerate() {
        for rows in [Rows::Scattered, Rows::InOnePoint] {
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed as u64);
            let mut data = crowded_program(limits, rows, &mut rng);
            let mut warm = ElasticSolver::default();
            for step in 0..3 {
                let expected = by_library(&data);
                let tolerance = AGREEMENT * expected.abs();
                for (start, solver) in [("warm", &mut warm), ("cold", &mut ElasticSolver::default())] {
                    let label = format!("{limits} limits, {rows:?}, step {step}, {start}");
                    let solution = solver.solve(&data.program(), Stop::never()).unwrap();
                    let objective = data.optimal_objective(&solution, tolerance, &label);
                    assert!((objective - expected).abs() <= tolerance, "{label}: {objective}, library {expected}");
                }
                data = next_program(&data, &mut rng);
            }
        }
    }
}
