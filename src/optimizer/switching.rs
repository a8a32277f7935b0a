//! Sign check of the switching function (Pontryagin's minimum principle, discretised).
//!
//! The reduced cost of a variable, `cost_j - multiplier' jacobian_j`, is the change of the optimal cost per unit of that
//! variable: for a torque over time it is the switching function. At a first-order optimum it is negative or zero where the
//! variable is at its upper bound, positive or zero at its lower bound, and zero in between.

use nalgebra::DVector;

use super::elastic_program::ElasticProgram;
use super::evaluation::{Linearisation, Problem};
use super::linear_program::{ElasticSolver, TOLERANCE};
use crate::stop::{Stop, Stopped};

/// The multipliers are those of the linear model in a box this small, as a fraction of each variable's scale.
const RADIUS: f64 = 1e-3;
/// Reduced costs below this share of the largest one count as zero.
const ZERO: f64 = 1e-2;

/// How many variables that cost nothing themselves, as torques do, contradict the sign of their reduced cost at `x`, where `model` is the
/// problem's linearisation.
///
/// # Errors
/// When it was stopped.
pub fn sign_violations(
    problem: &dyn Problem,
    x: &DVector<f64>,
    model: &Linearisation,
    penalty_parameter: f64,
    stop: Stop,
) -> Result<usize, Stopped> {
    let scale = problem.variable_scale(x);
    let below = problem.lower() - x;
    let above = problem.upper() - x;
    let program = ElasticProgram {
        matrix: &model.jacobian,
        target: &-model.rows_of(&model.constraints),
        row_name: &model.row_names(),
        equation_count: model.constraints.residual.len(),
        cost: problem.cost(),
        lower: &below.zip_map(&scale, |room, scale| room.max(-RADIUS * scale).min(0.0)),
        upper: &above.zip_map(&scale, |room, scale| room.min(RADIUS * scale).max(0.0)),
        penalty_parameter,
    };
    let multiplier = ElasticSolver::default().solve(&program, stop)?.multiplier;
    let reduced_cost = (problem.cost() - model.jacobian.tr_mul(&multiplier)).component_mul(&scale);

    let zero = ZERO * reduced_cost.amax();
    let contradicts = |&index: &usize| {
        let slack = TOLERANCE * scale[index];
        let can_fall = below[index] < -slack && reduced_cost[index] > zero;
        let can_rise = above[index] > slack && reduced_cost[index] < -zero;
        problem.cost()[index] == 0.0 && (can_fall || can_rise)
    };
    Ok((0..x.len()).filter(contradicts).count())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimizer::small_problem::SmallProblem;

    /// `(x + y) / 10 - t`. In a box of equal widths the tenth makes t basic: with a coefficient of 1 it may as well be x or y.
    fn tenth_of_sum(x: &[f64]) -> (f64, Vec<f64>) {
        (0.1 * (x[0] + x[1]) - x[2], vec![0.1, 0.1, -1.0])
    }

    fn violations(x: [f64; 3], penalty_parameter: f64) -> usize {
        let mut problem = SmallProblem::new(&[(-1.0, 1.0); 2], &[tenth_of_sum], &[]);
        let x = DVector::from_row_slice(&x);
        let mut model = Linearisation::new(problem.constraints(), x.len());
        problem.linearise((&x, 1.0), &mut model, Stop::never()).unwrap();
        sign_violations(&problem, &x, &model, penalty_parameter, Stop::never()).unwrap()
    }

    #[test]
    fn the_optimum_contradicts_no_sign() {
        assert_eq!(violations([-1.0, -1.0, -0.2], 5.0), 0);
    }

    #[test]
    fn variables_that_could_gain_are_counted() {
        assert_eq!(violations([-1.0, 1.0, 0.0], 5.0), 1);
        assert_eq!(violations([0.5, 0.5, 0.1], 5.0), 2);
    }

    #[test]
    fn what_the_cost_counts_is_no_torque() {
        // Below the multiplier of the sum the penalty gives it up for a smaller last variable.
        assert_eq!(violations([-1.0, -1.0, -0.2], 0.5), 0);
    }
}
