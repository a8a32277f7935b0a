//! The criticality measure where the distance from a local optimum is known.

use std::sync::atomic::AtomicBool;

use nalgebra::DVector;

use super::functions::*;
use super::{SMALLEST_RADIUS, WIDE};
use crate::optimizer::small_problem::{PLENTY, SmallProblem, settings};
use crate::optimizer::{
    Budget, CriticalityMeasure, ElasticSolver, FIRST_RADIUS, Interruption, SequentialLinearSettings,
    criticality_measure,
};

const PENALTY_PARAMETER: f64 = 5.0;
/// Rounding of a model with coefficients near 1.
const ROUNDING: f64 = 1e-14;
/// A predicted decrease is confirmed by a tenth of it: the measure is at most this many times as large as the decrease.
const LARGEST_EXCESS: f64 = 10.0;

fn measured_within(rollouts: u64, problem: &mut SmallProblem, x: &[f64]) -> Result<CriticalityMeasure, Interruption> {
    let settings = SequentialLinearSettings {
        penalty_parameter: PENALTY_PARAMETER,
        first_radius: FIRST_RADIUS,
        smallest_prediction: 0.0,
        feasibility_tolerance: 0.0,
        ..settings()
    };
    let stop = AtomicBool::new(false);
    let from = (&DVector::from_row_slice(x), &mut ElasticSolver::default());
    criticality_measure(problem, from, &settings, &mut Budget::new(&stop, rollouts))
}

fn measured(problem: &mut SmallProblem, x: &[f64]) -> CriticalityMeasure {
    let measure = measured_within(PLENTY, problem, x).unwrap();
    assert!(measure.better.is_ok());
    measure
}

/// By how much the better point lowers the merit.
fn decrease(measure: &CriticalityMeasure, problem: &mut SmallProblem, x: &[f64]) -> f64 {
    let mut merit = |x: &DVector<f64>| x[x.len() - 1] + PENALTY_PARAMETER * problem.constraints_at(x).violation_sum();
    merit(&DVector::from_row_slice(x)) - merit(measure.better.as_ref().unwrap().as_ref().unwrap())
}

#[test]
fn smooth_stationary_points_have_none() {
    let vertex = [0.5, 0.75_f64.sqrt()];
    let value = rosenbrock(&[vertex[0], vertex[1], 0.0]).0;
    let pieces = &[minimax::<0>, minimax::<1>, minimax::<2>];
    for (mut problem, x) in [
        (SmallProblem::new(&[WIDE; 2], &[circle], &[maratos]), [1.0, 0.0, -1.0]),
        (SmallProblem::new(&[WIDE; 2], &[], &[rosenbrock]), [1.0, 1.0, 0.0]),
        (SmallProblem::new(&[(-10.0, 0.5), WIDE], &[], &[rosenbrock, outside_circle]), [vertex[0], vertex[1], value]),
        (SmallProblem::new(&[WIDE; 2], &[], pieces), [1.0, 1.0, 2.0]),
    ] {
        let measure = measured(&mut problem, &x);
        assert!(measure.prediction.abs() <= ROUNDING && measure.better == Ok(None), "{x:?}: {measure:?}");
        assert!(measure.promise.abs() <= ROUNDING, "{x:?}: {measure:?}");
    }
}

#[test]
fn minimisers_at_a_kink_have_none() {
    // The radius shrinks to its smallest, where slopes of up to 6 promise no more than that.
    let largest = 6.0 * SMALLEST_RADIUS;
    for (mut problem, x) in [
        (SmallProblem::new(&[WIDE], &[], &[magnitude]), &[0.0, 0.0][..]),
        (SmallProblem::new(&[WIDE], &[magnitude], &[]), &[0.0, 0.0]),
        (SmallProblem::new(&[WIDE], &[], &[leaning_magnitude]), &[0.0, 0.0]),
        (SmallProblem::new(&[WIDE; 2], &[], &[largest_minimax_piece]), &[1.0, 1.0, 2.0]),
    ] {
        let measure = measured(&mut problem, x);
        assert!(measure.prediction <= largest && measure.better == Ok(None), "{x:?}: {measure:?}");
        // The one side that the linear model knows has a slope of a half at least.
        let (decrease, way) = (measure.promise, (&measure.promised_point - DVector::from_row_slice(x)).amax());
        assert!(decrease >= 0.5 * FIRST_RADIUS && way >= FIRST_RADIUS, "{x:?}: {decrease} after {way}");
    }
}

#[test]
fn a_straight_descent_is_measured_exactly() {
    for x in [-3.0, 5.0] {
        let (mut problem, x) = (SmallProblem::new(&[WIDE], &[], &[magnitude]), [x, f64::abs(x)]);
        let measure = measured(&mut problem, &x);
        assert!(measure.prediction > 0.0);
        assert!((decrease(&measure, &mut problem, &x) - measure.prediction).abs() <= ROUNDING, "{measure:?}");
    }
}

#[test]
fn near_an_optimum_the_attainable_decrease_is_measured() {
    for x in [-0.03, 0.01, 2e-3] {
        let smooth = (SmallProblem::new(&[WIDE], &[], &[parabola]), 0.5 * x * x);
        let kinked = (SmallProblem::new(&[WIDE], &[], &[magnitude]), f64::abs(x));
        for (mut problem, attainable) in [smooth, kinked] {
            let x = [x, attainable];
            let measure = measured(&mut problem, &x);
            let decrease = decrease(&measure, &mut problem, &x);
            assert!(
                decrease <= attainable + ROUNDING && measure.prediction <= LARGEST_EXCESS * decrease,
                "{measure:?}"
            );
            // A radius that reaches the optimum is confirmed, so the largest that is reaches most of the way.
            assert!(measure.prediction >= 0.5 * attainable, "{measure:?} at {x:?}");
        }
    }
}

#[test]
fn with_few_rollouts_the_measure_is_a_bound() {
    let mut problem = SmallProblem::new(&[WIDE], &[], &[magnitude]);
    assert_eq!(measured_within(0, &mut problem, &[0.0, 0.0]).err(), Some(Interruption::RolloutLimit));
    let full = measured(&mut problem, &[0.0, 0.0]).prediction;
    for rollouts in 1..5 {
        let measure = measured_within(rollouts, &mut problem, &[0.0, 0.0]).unwrap();
        assert_eq!(measure.better, Err(Interruption::RolloutLimit));
        assert!(measure.prediction > full);
    }
}

/// `1 - t`: t should be 1, or at least 1.
fn short_of_one(x: &[f64]) -> (f64, Vec<f64>) {
    (1.0 - x[0], vec![-1.0])
}

fn decrease_at(mut problem: SmallProblem, x: f64, tolerance: f64) -> f64 {
    let settings = SequentialLinearSettings {
        penalty_parameter: 50.0,
        first_radius: FIRST_RADIUS,
        smallest_prediction: 1e-9,
        feasibility_tolerance: tolerance,
        inequality_tolerance: tolerance,
        ..settings()
    };
    let stop = AtomicBool::new(false);
    let mut budget = Budget::new(&stop, 100);
    criticality_measure(&mut problem, (&DVector::repeat(1, x), &mut ElasticSolver::default()), &settings, &mut budget)
        .unwrap()
        .prediction
}

#[test]
fn accepted_violations_need_not_be_taken_back() {
    let problems =
        || [SmallProblem::new(&[], &[], &[short_of_one]), SmallProblem::new(&[], &[short_of_one], &[])].into_iter();
    assert!(problems().all(|problem| decrease_at(problem, 0.999, 1e-2) < 1e-12));
    assert!(problems().all(|problem| decrease_at(problem, 0.999, 1e-4) > 0.04));
}

#[test]
fn slack_of_an_inequality_still_counts() {
    assert!((decrease_at(SmallProblem::new(&[], &[], &[short_of_one]), 1.001, 1e-2) - 0.001).abs() < 1e-12);
}
