//! Wheels held on the floor: they stick, whatever friction that takes; the front support keeps its own law.
//!
//! Where the friction that this takes is within the wheels' grip, it is a solution of the exact law.

use nalgebra::SVector;

use super::delassus::DelassusOperator;
use super::natural_map::friction_radius;
use super::newton::Newton;
use super::one_step_problem::OneStepProblem;
use super::pattern::{ContactMode, ContactPattern, WheelPattern};
use super::solution::ContactSolution;

/// Newton's update relative to m g dt at which it has converged to rounding.
const SMALL_UPDATE: f64 = 1e-9;

/// Solves one step with sticking wheels, and the front support's law with a slip smoothing, m/s, or 0 for the exact one; without wheel
/// friction the wheels are not held. `step` is the last step's solution, from whose impulse Newton starts, and then this one's. Its
/// residual is 0, or NaN where no friction of the front support was found.
#[inline]
pub fn solve_held<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    slip_smoothing: f64,
    step: &mut ContactSolution<N>,
) {
    let [sticking, ..] = DelassusOperator::<N>::linear_patterns();
    let impulse = operator.linear_derivative(sticking).map_or_else(SVector::zeros, |map| map.impulse(problem));
    let sticks = operator.solution_at(problem, (sticking, impulse));
    *step = if N == 3 || slip_smoothing == 0.0 && front_sticks(operator, &sticks) {
        sticks
    } else {
        with_slipping_front(operator, problem, slip_smoothing, [step.impulse, within_grip(operator, &sticks)])
    };
}

/// Newton starts from the last step's impulse, or else from another one.
fn with_slipping_front<const N: usize>(
    operator: &DelassusOperator<N>,
    problem: &OneStepProblem<N>,
    slip_smoothing: f64,
    starts: [SVector<f64, N>; 2],
) -> ContactSolution<N> {
    let pattern = ContactPattern { wheels: WheelPattern::BothStick, front: ContactMode::Slip };
    let newton = Newton { operator, problem, pattern, slip_smoothing, backtracks: true };
    let unit = problem.weight_impulse();
    let mut slipping = ContactSolution::default();
    let accept = |slipping: &mut ContactSolution<N>| {
        *slipping = operator.solution_at(problem, (pattern, slipping.impulse));
        true
    };
    let solves = |start| newton.solve(start, (0.0, SMALL_UPDATE * unit), &mut slipping, accept);
    if starts.iter().any(solves) {
        slipping
    } else {
        ContactSolution { residual: f64::NAN, ..operator.solution_at(problem, (pattern, starts[0])) }
    }
}

/// Whether the friction of a sticking front support is within its grip.
fn front_sticks<const N: usize>(operator: &DelassusOperator<N>, solution: &ContactSolution<N>) -> bool {
    front_friction(solution) <= friction_radius(operator, 2, &solution.normal_impulse)
}

/// The impulse with no more of the front support's friction than its grip: the slip is then against the friction. At rest no torque
/// slips it before the wheels have friction, so that without any impulse the direction of its slip is not defined.
fn within_grip<const N: usize>(operator: &DelassusOperator<N>, solution: &ContactSolution<N>) -> SVector<f64, N> {
    let share = (friction_radius(operator, 2, &solution.normal_impulse) / front_friction(solution)).min(1.0);
    let mut impulse = solution.impulse;
    impulse.fixed_rows_mut::<2>(N - 2).scale_mut(share);
    impulse
}

/// N s.
fn front_friction<const N: usize>(solution: &ContactSolution<N>) -> f64 {
    solution.impulse[N - 2].hypot(solution.impulse[N - 1])
}
