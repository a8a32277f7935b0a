use super::*;
use crate::stop::probe;

fn solve(matrix: &DMatrix<f64>, target: &[f64], cost: &[f64], bound: f64, penalty_parameter: f64) -> ElasticSolution {
    let n = cost.len();
    let program = ElasticProgram {
        matrix,
        target: &DVector::from_column_slice(target),
        row_name: &(0..target.len()).collect::<Vec<_>>(),
        equation_count: target.len(),
        cost: &DVector::from_column_slice(cost),
        lower: &DVector::repeat(n, -bound),
        upper: &DVector::repeat(n, bound),
        penalty_parameter,
    };
    ElasticSolver::default().solve(&program, Stop::never()).unwrap()
}

#[test]
fn without_rows_that_bind_the_cheapest_corner_wins() {
    let solution = solve(&DMatrix::zeros(1, 2), &[0.0], &[1.0, -2.0], 3.0, 10.0);
    assert_eq!(solution.x.as_slice(), [-3.0, 3.0]);
    assert_eq!(solution.objective, -9.0);
}

#[test]
fn a_large_penalty_meets_the_row_and_its_multiplier_is_the_marginal_cost() {
    // minimise x0 + 3 x1 with x0 + x1 = 1.5 and |x| <= 1: x0 = 1, x1 = 0.5, a unit of target costs 3.
    let solution = solve(&DMatrix::from_row_slice(1, 2, &[1.0, 1.0]), &[1.5], &[1.0, 3.0], 1.0, 10.0);
    assert!((solution.x[0] - 1.0).abs() < 1e-14 && (solution.x[1] - 0.5).abs() < 1e-14);
    assert!((solution.multiplier[0] - 3.0).abs() < 1e-14);
}

#[test]
fn a_small_penalty_violates_the_row() {
    let solution = solve(&DMatrix::from_row_slice(1, 1, &[1.0]), &[0.5], &[1.0], 1.0, 0.5);
    assert_eq!(solution.x[0], -1.0);
    assert!((solution.objective - (-1.0 + 0.5 * 1.5)).abs() < 1e-15);
}

#[test]
fn unreachable_targets_are_approached() {
    let solution = solve(&DMatrix::from_row_slice(1, 2, &[1.0, 1.0]), &[5.0], &[0.0, 0.0], 1.0, 2.0);
    assert_eq!(solution.x.as_slice(), [1.0, 1.0]);
    assert!((solution.objective - 6.0).abs() < 1e-14);
}

#[test]
fn degenerate_vertices_and_parallel_rows_do_not_cycle() {
    // Only the last variable has a cost, rows come in nearly parallel pairs: nearly every vertex is degenerate.
    let (rows, columns) = (160, 40);
    let coefficient = |row: usize, column: usize| ((7 * (row / 2) + 3 * column) as f64).sin();
    let nearly = |row: usize| 1.0 + 1e-10 * (row % 2) as f64;
    let matrix = DMatrix::from_fn(rows, columns, |row, column| nearly(row) * coefficient(row, column));
    let mut cost = vec![0.0; columns];
    cost[columns - 1] = 1.0;
    for bound in [1e-3, 1.0, 1e3] {
        let solution = solve(&matrix, &vec![0.1; rows], &cost, bound, 30.0);
        assert!(solution.iterations < 10 * (rows + columns), "{} iterations", solution.iterations);
        assert!(solution.objective < 30.0 * 0.1 * rows as f64, "{}", solution.objective);
    }
}

#[test]
fn smaller_trust_regions_have_the_same_solutions() {
    // Speeds under a limit that many of them reach: sums of steps, of which only the last, the final time, costs anything.
    let (rows, columns) = (44, 41);
    for case in 0..50 {
        let wave = |index: usize| ((7 * index + 13 * case) as f64).sin();
        let matrix = DMatrix::from_fn(rows, columns, |row, column| match row {
            0 => wave(column),
            1 => (columns - column) as f64,
            2.. if column + 2 <= row => 1.0,
            _ => 0.0,
        });
        let target = DVector::from_fn(rows, |row, _| if row < 2 { wave(row) } else { wave(row).abs().floor() });
        let cost = DVector::from_fn(columns, |column, _| if column + 1 == columns { 1.0 } else { 0.0 });
        let solved = |radius: f64| {
            let program = ElasticProgram {
                matrix: &(radius * &matrix),
                target: &(radius * &target),
                row_name: &(0..rows).collect::<Vec<_>>(),
                equation_count: 2,
                cost: &(radius * &cost),
                lower: &DVector::repeat(columns, -1.0),
                upper: &DVector::repeat(columns, 1.0),
                penalty_parameter: 30.0,
            };
            ElasticSolver::default().solve(&program, Stop::never()).unwrap()
        };
        let (whole, small) = (solved(1.0), solved(2.0_f64.powi(-20)));
        for solution in [&whole, &small] {
            assert_eq!(solution.gap, 0.0, "{case}");
            assert!(solution.iterations < 5 * (rows + columns), "{} iterations", solution.iterations);
        }
        assert!((&whole.x - &small.x).amax() < 1e-9, "{case}: {}", (&whole.x - &small.x).amax());
    }
}

#[test]
fn rows_that_are_nearly_dependent_do_not_stall() {
    // As on rolling wheels: velocities follow from the wheel rates, but for a slip that is smaller by orders of magnitude.
    let (free, rows, columns, slip) = (3, 8, 81, 1e-6);
    let mut cost = vec![0.0; columns];
    cost[columns - 1] = 1.0;
    for case in 0..20 {
        let wave = |row: usize, column: usize| {
            ((7 * row + 3 * column + 11 * case) as f64 + 0.37 * (row * column) as f64).sin()
        };
        let rolling = |row: usize, column: usize| wave(row % free, column) + 0.5 * wave((row + 1) % free, column);
        let matrix = DMatrix::from_fn(rows, columns, |row, column| {
            if row < free { wave(row, column) } else { 10.0 * (rolling(row, column) + slip * wave(row, column)) }
        });
        let target: Vec<f64> = (0..rows).map(|row| 1e-6 * wave(row, case)).collect();
        let solution = solve(&matrix, &target, &cost, 1.0, 30.0);
        assert!(solution.iterations < 2 * (rows + columns), "{} iterations", solution.iterations);
    }
}

#[test]
fn each_iteration_asks_whether_it_is_stopped() {
    let (rows, columns) = (6, 60);
    let matrix = DMatrix::from_fn(rows, columns, |row, column| ((7 * row + 3 * column) as f64).sin());
    let (target, cost) = (DVector::repeat(rows, 1.0), DVector::from_fn(columns, |column, _| (column as f64).cos()));
    let bound = DVector::repeat(columns, 1.0);
    let program = ElasticProgram {
        matrix: &matrix,
        target: &target,
        row_name: &(0..rows).collect::<Vec<_>>(),
        equation_count: rows,
        cost: &cost,
        lower: &-&bound,
        upper: &bound,
        penalty_parameter: 10.0,
    };
    let (solution, asked) = probe::unstopped(|stop| ElasticSolver::default().solve(&program, stop));
    let iterations = solution.unwrap().iterations as u64;
    assert!(iterations > 10 && asked >= iterations, "{asked} questions in {iterations} iterations");
    for question in 1..=asked {
        let (solution, asked) = probe::stopped_at(question, |stop| ElasticSolver::default().solve(&program, stop));
        assert_eq!((solution, asked), (Err(Stopped), question));
    }
}

#[test]
fn rows_out_of_reach_change_no_solution() {
    // t >= |x - a| for 40 anchors a, of which a step of 0.1 from (0.8, 2) can violate few.
    let (rows, at) = (80, DVector::from_vec(vec![0.8, 2.0]));
    let sign = |row: usize| if row.is_multiple_of(2) { 1.0 } else { -1.0 };
    let anchor = |row: usize| -1.0 + 0.05 * (row / 2) as f64;
    let matrix = DMatrix::from_fn(rows, 2, |row, column| if column == 0 { sign(row) } else { -1.0 });
    let target = DVector::from_fn(rows, |row, _| sign(row) * anchor(row)) - &matrix * at;
    let program = ElasticProgram {
        matrix: &matrix,
        target: &target,
        row_name: &(0..rows).collect::<Vec<_>>(),
        equation_count: 0,
        cost: &DVector::from_vec(vec![0.0, 1.0]),
        lower: &DVector::repeat(2, -0.1),
        upper: &DVector::repeat(2, 0.1),
        penalty_parameter: 10.0,
    };
    let reached = program.rows_within_reach();
    assert!(reached.len() < rows / 4, "{} rows", reached.len());
    let (solution, of_all) = (
        ElasticSolver::default().solve(&program, Stop::never()).unwrap(),
        ElasticSolver::default().solve_rows(&program, Stop::never()).unwrap(),
    );
    assert!((&solution.x - &of_all.x).amax() < 1e-14);
    assert!((solution.objective - of_all.objective).abs() < 1e-14);
    assert!((&solution.multiplier - &of_all.multiplier).amax() < 1e-14);
    assert!((&matrix * &solution.x - target).max() <= 1e-12);
}
