//! The iteration on problems whose answers are known.
//!
//! Where as many rows and bounds are active as there are variables (a vertex), the iteration is Newton's, and it ends within
//! rounding and what restoration leaves. Elsewhere it ends when the model promises less than 1e-7 within its radius, which is
//! about as large as the error that is left: so the error of a variable is about the root of that, and that of t its square.

mod criticality;
mod functions;

use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;

use functions::*;

use super::*;
use crate::optimizer::small_problem::{PLENTY, SmallProblem, settings};

/// Wide bounds.
const WIDE: (f64, f64) = (-10.0, 10.0);
/// Ten times what a restored point misses by default, and what that changes.
const AT_VERTEX: f64 = 1e-8;
/// Three times the root of the smallest prediction.
const ON_CURVE: f64 = 1e-3;
/// The square of that.
const OBJECTIVE_ON_CURVE: f64 = 1e-6;

fn assert_near(result: &SequentialLinearResult, expected: &[f64], of_variables: f64, of_objective: f64) {
    let t = expected.len() - 1;
    let is_near = (0..t).all(|index| (result.x[index] - expected[index]).abs() <= of_variables);
    assert!(is_near && (result.x[t] - expected[t]).abs() <= of_objective, "{result:?}, not {expected:?}");
    assert!(result.constraints.violation() <= AT_VERTEX, "{result:?}");
}

fn assert_at_vertex(result: &SequentialLinearResult, expected: &[f64]) {
    assert_near(result, expected, AT_VERTEX, AT_VERTEX);
}

fn assert_on_curve(result: &SequentialLinearResult, expected: &[f64]) {
    assert_near(result, expected, ON_CURVE, OBJECTIVE_ON_CURVE);
}

#[test]
fn rosenbrock_outside_the_circle_ends_at_its_vertex() {
    // Problem 20 of Hock & Schittkowski: x = 1/2 is a bound, and y is on the circle.
    let expected = [0.5, 0.75_f64.sqrt(), (81.5 - 25.0 * 3.0_f64.sqrt()) / 100.0];
    for start in [[0.1, 3.0, 0.0], [0.0, 0.0, 0.0]] {
        let mut problem = SmallProblem::new(&[(-10.0, 0.5), WIDE], &[], &[rosenbrock, outside_circle]);
        assert_at_vertex(&problem.solve(&start), &expected);
    }
}

#[test]
fn equations_limits_and_bounds_are_met_together() {
    // Problem 71 of Hock & Schittkowski, whose answer is known to seven digits.
    let mut problem = SmallProblem::new(&[(1.0, 5.0); 4], &[sphere], &[product_objective, product_limit]);
    let expected = [1.0, 4.742_999_4, 3.821_150_3, 1.379_408_2, 1.701_401_73];
    assert_on_curve(&problem.solve(&[1.0, 5.0, 5.0, 1.0, 1.6]), &expected);
}

#[test]
fn the_correction_keeps_steps_along_a_curve_long() {
    // With this penalty parameter a tangent step that gains without a correction is a hundredth of the way that is left.
    let settings = SequentialLinearSettings { penalty_parameter: 100.0, ..settings() };
    for start in 0..32 {
        let (y, x) = ((f64::from(start) + 0.5) / 32.0 * TAU).sin_cos();
        let mut problem = SmallProblem::new(&[WIDE; 2], &[circle], &[maratos]);
        let result = problem.solve_with(&[x, y, -x], &settings, PLENTY);
        assert_on_curve(&result, &[1.0, 0.0, -1.0]);
        assert!(problem.iterations <= 150, "{} iterations from {start}", problem.iterations);
    }
}

#[test]
fn objectives_may_be_equations() {
    let result = SmallProblem::new(&[WIDE; 2], &[circle, maratos], &[]).solve(&[-0.6, 0.8, 0.6]);
    assert_on_curve(&result, &[1.0, 0.0, -1.0]);
}

#[test]
fn discs_that_do_not_meet_are_missed_by_least() {
    // In between, each is missed by 3 + x^2 + y^2 -+ 4 x.
    for start in [[1.0, 1.0, 0.0], [5.0, -3.0, 0.0], [0.0, 0.0, 0.0]] {
        let result = SmallProblem::new(&[WIDE; 2], &[], &[disc::<-2>, disc::<2>, nothing_to_gain]).solve(&start);
        let (sum, largest) = (result.constraints.violation_sum(), result.constraints.violation());
        assert!((6.0..6.0 + OBJECTIVE_ON_CURVE).contains(&sum), "{result:?}");
        assert!((3.0..3.0 + 4.0 * ON_CURVE).contains(&largest), "{result:?}");
    }
}

#[test]
fn equations_that_contradict_each_other_are_missed_by_least() {
    let result = SmallProblem::new(&[WIDE], &[exactly::<1>, exactly::<-1>], &[parabola]).solve(&[5.0, 0.0]);
    assert!((result.constraints.violation_sum() - 2.0).abs() <= AT_VERTEX, "{result:?}");
}

#[test]
fn equations_out_of_reach_are_approached_to_the_bound() {
    let result = SmallProblem::new(&[WIDE], &[exactly::<20>], &[nothing_to_gain]).solve(&[5.0, 0.0]);
    assert_eq!(result.x[0], WIDE.1);
    assert_eq!(result.constraints.violation(), 10.0);
}

#[test]
fn dependent_and_empty_rows_do_no_harm() {
    fn empty(x: &[f64]) -> (f64, Vec<f64>) {
        (0.0, vec![0.0; x.len()])
    }
    for start in [[5.0, -3.0, 0.0], [-7.0, 0.1, 0.0]] {
        let equations = &[sum::<1>, sum::<2>, sum::<-1>, empty];
        let result = SmallProblem::new(&[WIDE; 2], equations, &[square, empty]).solve(&start);
        assert_on_curve(&result, &[0.5, 0.5, 0.5]);
    }
}

#[test]
fn more_active_rows_than_variables_do_no_harm() {
    // Any three of them that are not on one side suffice.
    let planes = &[plane::<0>, plane::<1>, plane::<2>, plane::<3>, plane::<4>, plane::<5>, plane::<6>, plane::<3>];
    for start in [[-4.0, 5.0, 1.0], [1.0, 2.0, 3.0], [9.0, 9.0, -3.0]] {
        assert_at_vertex(&SmallProblem::new(&[WIDE; 2], &[], planes).solve(&start), &[1.0, 2.0, 0.0]);
    }
}

#[test]
fn the_largest_of_several_pieces_is_minimised() {
    for (start, margin) in [([2.0, 2.0, 0.0], 0.1), ([-1.0, 3.0, 0.0], f64::INFINITY), ([0.0, 0.0, 0.0], 0.1)] {
        let minimax = SmallProblem::new(&[WIDE; 2], &[], &[minimax::<0>, minimax::<1>, minimax::<2>]);
        assert_at_vertex(&minimax.with_margin(margin).solve(&start), &[1.0, 1.0, 2.0]);
        let quadratic = SmallProblem::new(&[WIDE; 2], &[], &[falling, falling_and_rising]);
        let (half, value) = (0.5_f64.sqrt(), -2.0_f64.sqrt());
        assert_on_curve(&quadratic.with_margin(margin).solve(&start), &[half, half, value]);
    }
}

#[test]
fn kinks_are_found_from_either_side_of_them() {
    for start in [-7.0, -0.3, 0.0, 0.3, 5.0] {
        for mut problem in [
            SmallProblem::new(&[WIDE], &[], &[magnitude]),
            SmallProblem::new(&[WIDE], &[magnitude], &[]),
            SmallProblem::new(&[WIDE], &[], &[leaning_magnitude]),
            SmallProblem::new(&[WIDE], &[leaning_magnitude], &[]),
        ] {
            let result = problem.solve(&[start, 0.0]);
            // The slopes are near 1, so an error of t is no smaller.
            assert_near(&result, &[0.0, 0.0], ON_CURVE, ON_CURVE);
        }
    }
}

#[test]
fn a_minimiser_at_a_kink_stays() {
    let expected = [1.0, 1.0, 2.0];
    let result = SmallProblem::new(&[WIDE; 2], &[], &[largest_minimax_piece]).solve(&expected);
    assert_eq!(result.x.as_slice(), expected);
}

#[test]
fn points_without_values_are_stepped_back_from() {
    let expected = [0.1, 0.1 - 0.1 * 0.1_f64.ln()];
    assert_on_curve(&SmallProblem::new(&[WIDE], &[], &[barrier]).solve(&[3.0, 0.0]), &expected);
    assert_on_curve(&SmallProblem::new(&[WIDE], &[barrier], &[]).solve(&[3.0, 0.0]), &expected);
}

#[test]
fn restoration_steps_back_from_points_without_values() {
    // From e^2 a Newton step for ln x = 0 ends at -e^2.
    let settings = SequentialLinearSettings { iteration_limit: 1, ..settings() };
    let mut problem = SmallProblem::new(&[WIDE], &[logarithm], &[nothing_to_gain]);
    let result = problem.solve_with(&[2.0_f64.exp(), 0.0], &settings, PLENTY);
    assert_eq!(result.ending, Ok(()));
    assert!((result.x[0] - 1.0).abs() <= AT_VERTEX, "{result:?}");
}

#[test]
fn restoration_removes_what_a_small_penalty_leaves() {
    // minimise (x + 1)^2 / 2 with 3/8 (x - 1) = 0: the multiplier is 16/3, so a parameter of 5 leads to x = 7/8.
    fn slow(x: &[f64]) -> (f64, Vec<f64>) {
        (0.375 * (x[0] - 1.0), vec![0.375, 0.0])
    }
    fn shifted_parabola(x: &[f64]) -> (f64, Vec<f64>) {
        parabola(&[x[0] + 1.0, x[1]])
    }
    let penalised = |penalty_parameter: f64, restores: bool| {
        let settings = SequentialLinearSettings { penalty_parameter, restores, ..settings() };
        SmallProblem::new(&[WIDE], &[slow, shifted_parabola], &[]).solve_with(&[3.0, 0.0], &settings, PLENTY)
    };
    let skipped = penalised(5.0, false);
    assert!((skipped.x[0] - 0.875).abs() <= ON_CURVE, "{skipped:?}");
    assert_at_vertex(&penalised(5.0, true), &[1.0, 2.0]);
    assert_at_vertex(&penalised(6.0, false), &[1.0, 2.0]);
}

#[test]
fn a_penalty_parameter_that_is_too_small_grows() {
    // minimise (x + 1)^2 / 2 with x = 1: the multiplier is 2.
    fn at_one(x: &[f64]) -> (f64, Vec<f64>) {
        (x[0] - 1.0, vec![1.0, 0.0])
    }
    fn shifted_parabola(x: &[f64]) -> (f64, Vec<f64>) {
        parabola(&[x[0] + 1.0, x[1]])
    }
    let settings = SequentialLinearSettings {
        penalty_parameter: 1.5,
        largest_penalty_parameter: 10.0,
        restores: false,
        ..settings()
    };
    let mut problem = SmallProblem::new(&[WIDE], &[at_one, shifted_parabola], &[]);
    let (stop, start) = (AtomicBool::new(false), DVector::from_row_slice(&[3.0, 0.0]));
    let (from, mut budget) = ((&start, &mut ElasticSolver::default()), Budget::new(&stop, PLENTY));
    let result = minimise_sequentially(&mut problem, from, (&settings, None), &mut budget, &mut |_, _| {});
    assert_at_vertex(&result, &[1.0, 2.0]);
}

#[test]
fn a_penalty_parameter_does_not_grow_where_violations_cost_more_than_can_be_saved() {
    // t may fall from 0 to -1000.
    for (penalty_parameter, residual, grows) in [(5.0, 100.0, true), (5.0, 300.0, false), (50.0, 100.0, false)] {
        let mut problem = SmallProblem::new(&[WIDE; 2], &[circle], &[maratos]);
        let settings = SequentialLinearSettings { penalty_parameter, largest_penalty_parameter: 1e3, ..settings() };
        let (start, mut programs) = (DVector::from_row_slice(&[0.6, 0.8, 0.0]), ElasticSolver::default());
        let mut search = Search::new(&mut problem, (&start, &mut programs), &settings);
        search.model.constraints.residual.fill(residual);
        assert_eq!(search.tightens(), grows);
    }
}

#[test]
fn a_merit_out_of_reach_ends_the_iteration() {
    let settings = SequentialLinearSettings { merit_to_beat: -1e6, ..settings() };
    let mut problem = SmallProblem::new(&[WIDE; 2], &[circle], &[maratos]);
    let result = problem.solve_with(&[-0.6, 0.8, 0.6], &settings, PLENTY);
    assert_eq!((result.ending, problem.iterations), (Ok(()), 1));
}

#[test]
fn the_budget_ends_the_iteration_at_its_best_point() {
    let mut problem = SmallProblem::new(&[WIDE; 2], &[circle], &[maratos]);
    let mut last = f64::INFINITY;
    for rollouts in 1..20 {
        let result = problem.solve_with(&[-0.6, 0.8, 0.6], &settings(), rollouts);
        assert_eq!(result.ending, Err(Interruption::RolloutLimit));
        let merit = result.x[2] + 5.0 * result.constraints.violation_sum();
        assert!(merit <= last);
        last = merit;
    }
}

#[test]
fn the_start_is_passed_on_too() {
    // A caller keeps a start that meets its constraints, wherever the descent leads.
    let mut problem = SmallProblem::new(&[WIDE; 2], &[circle], &[maratos]);
    let start = DVector::from_row_slice(&[0.6, 0.8, -0.6]);
    let (stop, mut passed) = (AtomicBool::new(false), Vec::new());
    let mut budget = Budget::new(&stop, PLENTY);
    let mut programs = ElasticSolver::default();
    minimise_sequentially(&mut problem, (&start, &mut programs), (&settings(), None), &mut budget, &mut |x, _| {
        passed.push(x.clone());
    });
    assert_eq!(passed.first(), Some(&start));
}

#[test]
fn accepted_residuals_count_as_none() {
    // The circle's value on one of radius 1.1.
    let accepted = DVector::repeat(1, 0.21);
    let mut problem = SmallProblem::new(&[WIDE; 2], &[circle], &[maratos]);
    let start = DVector::from_row_slice(&[0.6, 0.8, 1.0]);
    let (stop, mut programs) = (AtomicBool::new(false), ElasticSolver::default());
    let (mut budget, settings) = (Budget::new(&stop, PLENTY), (&settings(), Some(&accepted)));
    let result =
        minimise_sequentially(&mut problem, (&start, &mut programs), settings, &mut budget, &mut |_, constraints| {
            assert!(constraints.residual[0] > -0.1, "as the problem has them");
        });
    assert!((result.x - DVector::from_row_slice(&[1.1, 0.0, 2.0 * 0.21 - 1.1])).amax() <= ON_CURVE);
    assert!((result.constraints.residual[0] - 0.21).abs() <= AT_VERTEX);
}

#[test]
fn what_is_not_a_number_is_not_met() {
    let mut problem = SmallProblem::new(&[WIDE; 2], &[circle], &[]);
    let (start, mut programs, settings) =
        (DVector::from_row_slice(&[0.6, 0.8, 0.0]), ElasticSolver::default(), settings());
    let mut search = Search::new(&mut problem, (&start, &mut programs), &settings);
    for (residual, is_met) in [(f64::NAN, false), (0.0, true)] {
        search.model.constraints.residual.fill(residual);
        assert_eq!(search.is_met(), is_met);
    }
}
