//! The exact contact solver: enumeration of the contact modes. It finds the contact pattern and solves its equations.
//!
//! Patterns with at most one slipping wheel are linear, and their solution maps are constants of the robot. Only
//! spatial slip (both wheels, or the front support) needs a small Newton iteration. A candidate is accepted only if
//! its residual, the [natural map](super::natural_map), vanishes to rounding. The order of the attempts: the pattern of the
//! last step, all other patterns, and then, for the rare steps at the boundary of sticking, fixed-point sweeps,
//! [Newton with sliding multipliers](super::sliding_newton) and a continuation in the smoothing of the
//! [regularised law](super::smoothed).

use nalgebra::SVector;

use super::delassus::DelassusOperator;
use super::fixed_point::{FixedPointSettings, FixedPointSolver};
use super::mode_equations::ModeEquations;
use super::natural_map::{contact_impulses, residual, split};
use super::newton::{NEWTON_LIMIT, Newton};
use super::one_step_problem::OneStepProblem;
use super::pattern::{ContactMode, ContactPattern, WheelPattern};
use super::sliding_newton::SlidingNewton;
use super::smoothed::falling_smoothings;
use super::solution::ContactSolution;
use crate::stop::Stop;

/// Accepted residual relative to m g dt: well above the rounding of a solved pattern (1e-15), and far below what a
/// wrong pattern leaves.
const ACCEPTED_RESIDUAL: f64 = 1e-12;
/// Rounding of the slip itself, in units in the last place of the largest slip.
const SLIP_ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Below this update, relative to m g dt, quadratic convergence has arrived at rounding.
const NEWTON_UPDATE: f64 = 1e-8;
/// Sweeps before the pattern of the fixed point's iterate is tried first; doubled after each try.
const FIRST_SWEEPS: usize = 20;
/// Most sweeps between two tries. Ill-conditioned problems would take millions; a rollout must end in bounded time, and
/// the residual reports the accuracy that was reached.
const MOST_SWEEPS: usize = 640;
/// Last slip smoothing of the continuation, m/s, and the factor from one to the next.
const FINE_SMOOTHING: f64 = 1e-18;
const SMOOTHING_FACTOR: f64 = 0.25;
/// Newton's update, as a share of the smoothing, at which the continuation goes on to the next smoothing.
const SMOOTHED_UPDATE: f64 = 0.01;
/// Newton steps of the check for further solutions, from each of its starts: where a solution exists, 4 are usual.
const CHECK_LIMIT: usize = 8;
/// Solutions that differ by more than this, relative to m g dt, are different motions.
const DISTINCT_IMPULSE: f64 = 1e-6;

/// Where the search for the pattern starts: the last step's solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guess<const N: usize> {
    /// Pattern to try first.
    pub pattern: ContactPattern,
    /// Friction impulse to start Newton from, N s.
    pub impulse: SVector<f64, N>,
}

impl<const N: usize> Default for Guess<N> {
    fn default() -> Self {
        Self { pattern: ContactPattern::default(), impulse: SVector::zeros() }
    }
}

impl<const N: usize> From<&ContactSolution<N>> for Guess<N> {
    #[inline]
    fn from(solution: &ContactSolution<N>) -> Self {
        Self { pattern: solution.pattern, impulse: solution.impulse }
    }
}

/// How a solution was found, cheapest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolvePath {
    /// In the pattern of the guess.
    GuessedPattern,
    /// In another pattern.
    OtherPattern,
    /// With the help of fixed-point sweeps.
    FixedPoint,
}

/// The exact solver; stateless.
#[derive(Debug, Clone, Copy, Default)]
pub struct ExactSolver;

impl ExactSolver {
    /// Solves one step.
    ///
    /// The residual of the answer is the accuracy to which the friction law holds. It is at most 1e-10, except for steps so
    /// short that the rounding of the slip exceeds that. Once stopped, it is what the residual says.
    #[inline]
    pub fn solve<const N: usize>(
        self,
        operator: &DelassusOperator<N>,
        problem: &OneStepProblem<N>,
        guess: &Guess<N>,
        stop: &Stop,
    ) -> (ContactSolution<N>, SolvePath) {
        let search = Search::new(operator, problem);
        if let Some(solution) = search.in_pattern(guess.pattern, &guess.impulse) {
            return (solution, SolvePath::GuessedPattern);
        }
        if let Some(solution) = search.in_other_patterns(guess) {
            return (solution, SolvePath::OtherPattern);
        }
        (search.after_sweeps(stop), SolvePath::FixedPoint)
    }

    /// Whether another pattern also solves the step, with a different motion than `solution`.
    ///
    /// Always false where uniqueness is proved ([`DelassusOperator::has_unique_solutions`]), which is cheaper to ask.
    pub fn is_indeterminate<const N: usize>(
        self,
        operator: &DelassusOperator<N>,
        problem: &OneStepProblem<N>,
        solution: &ContactSolution<N>,
    ) -> bool {
        let search = Search { iteration_limit: CHECK_LIMIT, ..Search::new(operator, problem) };
        let differs = |other: &ContactSolution<N>| {
            (other.impulse - solution.impulse).amax() > DISTINCT_IMPULSE * problem.weight_impulse()
        };
        let starts = [solution.impulse, -solution.impulse, search.impulse_against_free_slip()];
        all_patterns::<N>().any(|pattern| {
            // The solution of a linear pattern does not depend on the start.
            let count = if DelassusOperator::<N>::linear_index(pattern).is_some() { 1 } else { starts.len() };
            starts[..count].iter().filter_map(|start| search.in_pattern(pattern, start)).any(|other| differs(&other))
        })
    }
}

struct Search<'a, const N: usize> {
    operator: &'a DelassusOperator<N>,
    problem: &'a OneStepProblem<N>,
    tolerance: f64,
    /// Newton steps per pattern and start.
    iteration_limit: usize,
}

impl<'a, const N: usize> Search<'a, N> {
    #[inline]
    fn new(operator: &'a DelassusOperator<N>, problem: &'a OneStepProblem<N>) -> Self {
        let [left, right, _] = operator.prox_step();
        let rounding = SLIP_ROUNDING * problem.free_slip.amax() * left.max(right);
        let tolerance = ACCEPTED_RESIDUAL + rounding / problem.weight_impulse();
        Self { operator, problem, tolerance, iteration_limit: NEWTON_LIMIT }
    }

    #[inline]
    fn in_pattern(&self, pattern: ContactPattern, start: &SVector<f64, N>) -> Option<ContactSolution<N>> {
        match DelassusOperator::<N>::linear_index(pattern) {
            Some(index) => self.in_linear_pattern(pattern, index),
            None => self.by_newton(pattern, start),
        }
    }

    #[inline]
    fn in_linear_pattern(&self, pattern: ContactPattern, index: usize) -> Option<ContactSolution<N>> {
        let map = self.operator.linear_mode(index)?;
        let impulse = map.by_free_slip * self.problem.free_slip + map.by_free_normal * self.problem.free_normal;
        self.accepted(self.candidate(pattern, impulse))
    }

    fn by_newton(&self, pattern: ContactPattern, start: &SVector<f64, N>) -> Option<ContactSolution<N>> {
        let (operator, problem, iteration_limit) = (self.operator, self.problem, self.iteration_limit);
        let newton = Newton { operator, problem, pattern, slip_smoothing: 0.0, iteration_limit };
        newton.solve(start, self.small_update(), |impulse| self.accepted(self.candidate(pattern, impulse)))
    }

    /// N s.
    #[inline]
    fn small_update(&self) -> f64 {
        NEWTON_UPDATE * self.problem.weight_impulse()
    }

    fn in_other_patterns(&self, guess: &Guess<N>) -> Option<ContactSolution<N>> {
        let start = self.impulse_against_free_slip();
        all_patterns::<N>()
            .filter(|pattern| *pattern != guess.pattern)
            .find_map(|pattern| self.in_pattern(pattern, &start))
    }

    /// Fixed-point sweeps until the pattern of their iterate can be solved; continuation where that fails.
    #[cold]
    fn after_sweeps(&self, stop: &Stop) -> ContactSolution<N> {
        let settings = FixedPointSettings::default();
        let mut fixed_point = FixedPointSolver::new(settings);
        let mut sweeps = FIRST_SWEEPS;
        // Motions that overflowed have no solution: their residual is not finite without any sweep.
        let is_finite = self.problem.free_slip.sum().is_finite() && self.problem.weight_impulse().is_finite();
        while is_finite && sweeps <= MOST_SWEEPS && !stop.is_set() {
            for number in 1..=sweeps {
                fixed_point.sweep(self.operator, self.problem);
                if number % Stop::PERIOD == 0 && stop.is_set() {
                    break;
                }
            }
            let seen = fixed_point.solution(self.operator, self.problem);
            if let Some(solution) = self.in_pattern(seen.pattern, &seen.impulse) {
                return solution;
            }
            if let Some(solution) = self.by_sliding_multipliers(&seen, stop) {
                return solution;
            }
            sweeps *= 2;
        }
        let swept = fixed_point.solution(self.operator, self.problem);
        let followed = if is_finite { self.by_vanishing_smoothing(stop) } else { None };
        followed.filter(|followed| followed.residual < swept.residual).unwrap_or(swept)
    }

    /// Continuation from a nearly linear law, in which all contacts slip, to a law that differs negligibly from Coulomb's.
    ///
    /// At the boundary between sticking and slipping, where optimal plans often lie, the slips of all patterns vanish: the
    /// sweeps would take millions of iterations, and the equations of the patterns become singular.
    #[cold]
    fn by_vanishing_smoothing(&self, stop: &Stop) -> Option<ContactSolution<N>> {
        let (operator, problem, iteration_limit) = (self.operator, self.problem, self.iteration_limit);
        let pattern = ContactPattern::ALL_SLIP;
        let mut best: Option<ContactSolution<N>> = None;
        let mut impulse = self.impulse_against_free_slip();
        for slip_smoothing in falling_smoothings(SMOOTHING_FACTOR, FINE_SMOOTHING) {
            let newton = Newton { operator, problem, pattern, slip_smoothing, iteration_limit };
            let small_update = SMOOTHED_UPDATE * slip_smoothing * operator.prox_step()[0];
            let Some(followed) = newton.solve(&impulse, small_update.min(self.small_update()), Some) else { break };
            impulse = followed;
            let solution = self.with_undetermined_directions(self.candidate(pattern, impulse));
            if best.is_none_or(|best| solution.residual < best.residual) {
                best = Some(solution);
            }
            if solution.residual <= self.tolerance || stop.is_set() {
                break;
            }
        }
        best
    }

    /// Newton with sliding multipliers in every pattern with spatial slip, from the fixed point's iterate: a slip may be so
    /// slow that the iterate's own pattern is sticking.
    #[cold]
    fn by_sliding_multipliers(&self, seen: &ContactSolution<N>, stop: &Stop) -> Option<ContactSolution<N>> {
        let start = contact_impulses(self.operator, seen);
        let small_update = self.small_update();
        all_patterns::<N>()
            .filter(|pattern| DelassusOperator::<N>::linear_index(*pattern).is_none())
            .take_while(|_| !stop.is_set())
            .find_map(|pattern| {
                let newton = SlidingNewton { operator: self.operator, problem: self.problem, pattern };
                newton.solve(&start, small_update, |impulse| self.accepted(self.candidate(pattern, impulse)))
            })
    }

    /// Full friction against the slip that the step would have without friction.
    fn impulse_against_free_slip(&self) -> SVector<f64, N> {
        let zero = SVector::zeros();
        ModeEquations::at(
            self.operator,
            ContactPattern::ALL_SLIP,
            &self.problem.free_slip,
            &self.problem.free_normal,
            0.0,
        )
        .map_or(zero, |equations| -equations.residual(&zero))
    }

    #[inline]
    fn candidate(&self, pattern: ContactPattern, impulse: SVector<f64, N>) -> ContactSolution<N> {
        let impact_slip = self.operator.impact_slip(self.problem, &impulse);
        let normal_impulse = self.operator.normal_impulse(self.problem, &impulse);
        let parts = split(self.operator, pattern, &impulse, &impact_slip, &normal_impulse);
        let residual = residual(self.operator, self.problem, &parts, &impact_slip, &normal_impulse);
        ContactSolution { impulse, impact_slip, normal_impulse, pattern, residual }
    }

    #[inline]
    fn accepted(&self, candidate: ContactSolution<N>) -> Option<ContactSolution<N>> {
        if candidate.residual <= self.tolerance {
            return Some(candidate);
        }
        if candidate.pattern.wheels == WheelPattern::BothSlip {
            self.accepted_with_undetermined_directions(candidate)
        } else {
            None
        }
    }

    #[cold]
    fn accepted_with_undetermined_directions(&self, candidate: ContactSolution<N>) -> Option<ContactSolution<N>> {
        let candidate = self.with_undetermined_directions(candidate);
        (candidate.residual <= self.tolerance).then_some(candidate)
    }

    /// With the residual that allows for undetermined slip directions ([`contact_impulses`]). Computing it for every
    /// candidate would cost 8 % of a drifting rollout.
    fn with_undetermined_directions(&self, candidate: ContactSolution<N>) -> ContactSolution<N> {
        let ContactSolution { impact_slip, normal_impulse, .. } = &candidate;
        let parts = contact_impulses(self.operator, &candidate);
        let residual = residual(self.operator, self.problem, &parts, impact_slip, normal_impulse);
        ContactSolution { residual, ..candidate }
    }
}

/// Every pattern, the linear ones first.
fn all_patterns<const N: usize>() -> impl Iterator<Item = ContactPattern> {
    let fronts: &[ContactMode] = if N == 5 { &[ContactMode::Stick, ContactMode::Slip] } else { &[ContactMode::Slip] };
    fronts.iter().flat_map(|&front| {
        let wheels = WheelPattern::LINEAR.into_iter().chain([WheelPattern::BothSlip]);
        wheels.map(move |wheels| ContactPattern { wheels, front })
    })
}
