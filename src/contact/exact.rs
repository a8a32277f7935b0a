//! The exact contact solver: enumeration of the contact modes. It finds the contact pattern and solves its equations.
//!
//! Patterns with at most one slipping wheel are linear, and their solution maps are constants of the robot. With a [front support that slips
//! besides](super::slipping_front) they are one equation for its direction. Two slipping wheels need a small Newton iteration. A candidate is
//! accepted only if its residual, the [natural map](super::natural_map), vanishes to rounding. The order of the attempts: the pattern of the
//! last step, in which Newton starts from the last impulse and is given up where it overshoots; the linear patterns; both slipping wheels of
//! the last step from its slip; all directions of a slipping front support; the patterns that an [interior point](super::interior_point)
//! comes to in at most 60 steps of one small linear solve each; and, where its path is lost, the patterns that are left.

use nalgebra::SVector;

use super::delassus::DelassusOperator;
use super::directions::ROWS;
use super::fixed_point::FixedPointSolver;
use super::interior_point::InteriorPoint;
use super::mode_equations::ModeEquations;
use super::natural_map::{contact_impulses, miss_bound, residual, split};
use super::newton::{Newton, impulse_at};
use super::one_step_problem::OneStepProblem;
use super::pattern::{ContactMode, ContactPattern, WheelPattern};
use super::slipping_front::SlippingFront;
use super::solution::ContactSolution;
use crate::stop::Stop;

/// Accepted residual relative to m g dt: well above the rounding of a solved pattern (1e-15), and far below what a
/// wrong pattern leaves.
const ACCEPTED_RESIDUAL: f64 = 1e-12;
/// Rounding of the slip itself, in units in the last place of the largest slip.
const SLIP_ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Below this update, relative to m g dt, quadratic convergence has arrived at rounding.
const NEWTON_UPDATE: f64 = 1e-8;
/// Most steps of the interior point, and after how many of them it is asked for its pattern. Half of the steps that come to it
/// take 6, and 99 of 100 take 27.
const INTERIOR_LIMIT: usize = 60;
const INTERIOR_PERIOD: usize = 3;
/// Residual that answers keep, apart from the exceptions that [`ExactSolver::solve`] names.
pub const PROMISED_RESIDUAL: f64 = 1e-10;
/// Most sweeps of the reference solver behind an answer that does not.
const POLISHING_LIMIT: usize = 1000;
/// Solutions that differ by more than this, relative to m g dt, are different motions.
const DISTINCT_IMPULSE: f64 = 1e-6;

/// How a solution was found, cheapest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolvePath {
    /// In the pattern of the guess.
    GuessedPattern,
    /// In another pattern that is quick to try.
    OtherPattern,
    /// With the help of the interior point, which took some steps of one linear solve each.
    InteriorPoint {
        /// At most 60.
        steps: usize,
    },
}

/// The exact solver; stateless.
#[derive(Debug, Clone, Copy, Default)]
pub struct ExactSolver;

impl ExactSolver {
    /// Solves one step; `solution` is the last step's, in whose pattern the search begins, and then this one's.
    ///
    /// The residual of the answer is the accuracy to which the friction law holds. It is at most 1e-10, except for steps so
    /// short that the rounding of the slip exceeds that, and some in which contacts lift off.
    #[expect(clippy::inline_always, reason = "a call would take the solution through memory")]
    #[inline(always)]
    pub fn solve<const N: usize>(
        self,
        operator: &DelassusOperator<N>,
        problem: &OneStepProblem<N>,
        solution: &mut ContactSolution<N>,
    ) -> SolvePath {
        let search = Search { operator, problem, backtracks: false };
        let (guess, start, slip) = (solution.pattern, solution.impulse, solution.impact_slip);
        if search.in_pattern(guess, &start, solution) {
            return SolvePath::GuessedPattern;
        }
        Search { backtracks: true, ..search }.beyond_guess(guess, &slip, solution)
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
        let search = Search { operator, problem, backtracks: true };
        let mut other = ContactSolution::default();
        let starts = [solution.impulse, -solution.impulse, search.impulse_against_free_slip()];
        let is_another = |other: &ContactSolution<N>| {
            (other.impulse - solution.impulse).amax() > DISTINCT_IMPULSE * problem.weight_impulse()
        };
        all_patterns::<N>().any(|pattern| search.anywhere_in(pattern, &starts, &mut other, is_another))
    }
}

/// Methods that try to solve the step write what they come to into a solution, from where a time step reads it without copies, and say
/// whether it solves the step.
struct Search<'a, const N: usize> {
    operator: &'a DelassusOperator<N>,
    problem: &'a OneStepProblem<N>,
    /// Whether Newton goes on where it overshoots.
    backtracks: bool,
}

impl<const N: usize> Search<'_, N> {
    /// Whether a residual is the rounding of a solved pattern.
    #[inline]
    fn accepts(&self, residual: f64) -> bool {
        residual <= ACCEPTED_RESIDUAL || residual <= self.tolerance()
    }

    /// The accepted residual with the rounding of the slip, which matters in very short steps alone.
    #[cold]
    fn tolerance(&self) -> f64 {
        let [left, right, _] = self.operator.prox_step();
        let rounding = SLIP_ROUNDING * self.problem.free_slip.amax() * left.max(right);
        ACCEPTED_RESIDUAL + rounding / self.problem.weight_impulse()
    }

    /// The first pattern that solves the step, or else the closest answer, after the guessed one did not at once.
    #[cold]
    fn beyond_guess(
        &self,
        guess: ContactPattern,
        last_slip: &SVector<f64, N>,
        solution: &mut ContactSolution<N>,
    ) -> SolvePath {
        let start = [self.impulse_against_free_slip()];
        let in_others = |equations: Equations, solution: &mut ContactSolution<N>| {
            // Of the directions of a slipping front support only one was tried.
            let with_guess = equations == Equations::FrontDirection;
            all_patterns::<N>()
                .filter(|pattern| equations_of::<N>(*pattern) == equations && (with_guess || *pattern != guess))
                .any(|pattern| self.anywhere_in(pattern, &start, solution, |_| true))
        };
        if in_others(Equations::Linear, solution) {
            return SolvePath::OtherPattern;
        }
        if equations_of::<N>(guess) == Equations::Spatial
            && impulse_at(self.operator, self.problem, last_slip)
                .is_some_and(|start| self.in_pattern(guess, &start, solution))
        {
            return SolvePath::GuessedPattern;
        }
        // Two slipping wheels are one Newton iteration; with a front support they are two, and the interior point finds the right one sooner.
        if in_others(if N == 5 { Equations::FrontDirection } else { Equations::Spatial }, solution) {
            return SolvePath::OtherPattern;
        }
        let steps = self.by_interior_point(solution);
        if !self.accepts(solution.residual) {
            let closest = *solution;
            if N == 3 || !in_others(Equations::Spatial, solution) {
                *solution = self.polished(closest);
            }
        }
        SolvePath::InteriorPoint { steps }
    }

    /// Whether a pattern has a solution that is wanted, with spatial slip from one of these starts.
    fn anywhere_in(
        &self,
        pattern: ContactPattern,
        starts: &[SVector<f64, N>],
        solution: &mut ContactSolution<N>,
        is_wanted: impl Fn(&ContactSolution<N>) -> bool,
    ) -> bool {
        match equations_of::<N>(pattern) {
            Equations::Linear => self.in_linear_pattern(pattern, solution) && is_wanted(solution),
            Equations::FrontDirection => self.slipping_front(pattern).is_some_and(|front| {
                front.all().any(|impulse| self.with_impulse(pattern, impulse, solution) && is_wanted(solution))
            }),
            Equations::Spatial => {
                starts.iter().any(|start| self.by_newton(pattern, start, solution) && is_wanted(solution))
            }
        }
    }

    #[expect(clippy::inline_always, reason = "a call would hide a pattern that is known")]
    #[inline(always)]
    fn in_pattern(&self, pattern: ContactPattern, start: &SVector<f64, N>, solution: &mut ContactSolution<N>) -> bool {
        match equations_of::<N>(pattern) {
            Equations::Linear => self.in_linear_pattern(pattern, solution),
            Equations::FrontDirection => self.near_slipping_front(pattern, start, solution),
            Equations::Spatial => self.by_newton(pattern, start, solution),
        }
    }

    /// With a slip of the front support against its friction at the start, or near that.
    fn near_slipping_front(
        &self,
        pattern: ContactPattern,
        start: &SVector<f64, N>,
        solution: &mut ContactSolution<N>,
    ) -> bool {
        let front = self.slipping_front(pattern);
        let impulse = front.and_then(|front| front.nearest(ROWS[2].map(|row| -start[row])));
        impulse.is_some_and(|impulse| self.with_impulse(pattern, impulse, solution))
    }

    #[inline]
    fn slipping_front(&self, pattern: ContactPattern) -> Option<SlippingFront<'_, N>> {
        let wheels = &self.operator.wheel_responses.as_ref()?[pattern.wheels.linear_index()?];
        Some(SlippingFront::new(self.operator, self.problem, wheels))
    }

    #[expect(clippy::inline_always, reason = "a call would take the solution through memory")]
    #[inline(always)]
    fn in_linear_pattern(&self, pattern: ContactPattern, solution: &mut ContactSolution<N>) -> bool {
        let Some(map) = self.operator.linear_derivative(pattern) else { return false };
        self.with_impulse(pattern, map.impulse(self.problem), solution)
    }

    /// Whether an impulse solves the step while the wheels' pattern is linear.
    #[expect(clippy::inline_always, reason = "a call would take the solution through memory")]
    #[inline(always)]
    fn with_impulse(
        &self,
        pattern: ContactPattern,
        impulse: SVector<f64, N>,
        solution: &mut ContactSolution<N>,
    ) -> bool {
        let impact_slip = self.operator.impact_slip(self.problem, &impulse);
        let normal_impulse = self.operator.normal_impulse(self.problem, &impulse);
        let bound = miss_bound(self.operator, pattern, &impulse, &impact_slip, &normal_impulse);
        let unit = self.problem.weight_impulse();
        *solution = ContactSolution { impulse, impact_slip, normal_impulse, pattern, residual: bound / unit };
        bound <= ACCEPTED_RESIDUAL * unit || self.accepted_at_its_edge(solution)
    }

    /// Where the inequalities of the pattern do not tell.
    #[cold]
    fn accepted_at_its_edge(&self, solution: &mut ContactSolution<N>) -> bool {
        *solution = self.candidate(solution.pattern, solution.impulse);
        self.accepts(solution.residual)
    }

    fn by_newton(&self, pattern: ContactPattern, start: &SVector<f64, N>, solution: &mut ContactSolution<N>) -> bool {
        let Self { operator, problem, backtracks } = *self;
        // Without front friction no other pattern needs Newton: the compiler leaves out what the others would.
        let pattern = if N == 3 { ContactPattern::ALL_SLIP } else { pattern };
        let newton = Newton { operator, problem, pattern, slip_smoothing: 0.0, backtracks };
        let unit = problem.weight_impulse();
        newton.solve(start, (ACCEPTED_RESIDUAL * unit, NEWTON_UPDATE * unit), solution, |solution| {
            self.accepted(pattern, solution.impulse, solution)
        })
    }

    /// Follows the [interior point](InteriorPoint), and tries the patterns that it comes to; gives its steps.
    fn by_interior_point(&self, solution: &mut ContactSolution<N>) -> usize {
        let mut point = InteriorPoint::new(self.operator, self.problem);
        let mut steps = 0;
        while steps < INTERIOR_LIMIT && point.advance().is_some() {
            steps += 1;
            if steps % INTERIOR_PERIOD == 0 && self.near(point.pattern(), &point.impulse(), solution) {
                return steps;
            }
        }
        *solution = self.closest(point.pattern(), point.impulse());
        steps
    }

    /// The answer where the interior point ends without a pattern: what is left are mostly slips that are too slow to tell from
    /// sticking.
    fn closest(&self, pattern: ContactPattern, impulse: SVector<f64, N>) -> ContactSolution<N> {
        let mut solution = ContactSolution::default();
        if self.in_pattern(ContactPattern::ALL_SLIP, &impulse, &mut solution) {
            return solution;
        }
        let [found, slipping] = [pattern, ContactPattern::ALL_SLIP]
            .map(|pattern| self.with_undetermined_directions(self.candidate(pattern, impulse)));
        if found.residual <= slipping.residual { found } else { slipping }
    }

    /// An answer of no pattern, with the reference solver's sweeps behind it where its residual is more than promised.
    fn polished(&self, closest: ContactSolution<N>) -> ContactSolution<N> {
        if closest.residual <= PROMISED_RESIDUAL {
            return closest;
        }
        let start = if closest.residual.is_nan() { [[0.0; 2]; 3] } else { contact_impulses(self.operator, &closest) };
        let mut reference = FixedPointSolver::starting_at(start, POLISHING_LIMIT);
        let swept = reference.solve(self.operator, self.problem, &Stop::never());
        if swept.residual < closest.residual || closest.residual.is_nan() { swept } else { closest }
    }

    /// In a pattern that the interior point comes to, from its impulse, or the impulse itself.
    fn near(&self, pattern: ContactPattern, impulse: &SVector<f64, N>, solution: &mut ContactSolution<N>) -> bool {
        // From close to a solution no step overshoots.
        Self { backtracks: false, ..*self }.in_pattern(pattern, impulse, solution)
            || self.accepted(pattern, *impulse, solution)
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

    #[expect(clippy::inline_always, reason = "a call would take the solution through memory")]
    #[inline(always)]
    fn candidate(&self, pattern: ContactPattern, impulse: SVector<f64, N>) -> ContactSolution<N> {
        let impact_slip = self.operator.impact_slip(self.problem, &impulse);
        let normal_impulse = self.operator.normal_impulse(self.problem, &impulse);
        let parts = split(self.operator, pattern, &impulse, &impact_slip, &normal_impulse);
        let residual = residual(self.operator, self.problem, &parts, &impact_slip, &normal_impulse);
        ContactSolution { impulse, impact_slip, normal_impulse, pattern, residual }
    }

    /// Whether an impulse of a pattern solves the step.
    #[inline]
    fn accepted(&self, pattern: ContactPattern, impulse: SVector<f64, N>, solution: &mut ContactSolution<N>) -> bool {
        *solution = self.candidate(pattern, impulse);
        self.accepts(solution.residual)
            || pattern.wheels == WheelPattern::BothSlip && self.accepted_with_undetermined_directions(solution)
    }

    #[cold]
    fn accepted_with_undetermined_directions(&self, solution: &mut ContactSolution<N>) -> bool {
        *solution = self.with_undetermined_directions(*solution);
        self.accepts(solution.residual)
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

/// What a pattern asks of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Equations {
    /// Linear ones.
    Linear,
    /// One for the direction in which the front support slips.
    FrontDirection,
    /// Those of two wheels that slip.
    Spatial,
}

#[inline]
fn equations_of<const N: usize>(pattern: ContactPattern) -> Equations {
    match pattern {
        ContactPattern { wheels: WheelPattern::BothSlip, .. } => Equations::Spatial,
        ContactPattern { front: ContactMode::Slip, .. } if N == 5 => Equations::FrontDirection,
        ContactPattern { .. } => Equations::Linear,
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

#[cfg(test)]
mod tests {
    use nalgebra::SMatrix;

    use super::*;

    #[test]
    fn answer_off_the_law_is_polished_and_one_within_the_promise_stays() {
        let operator = DelassusOperator::<3>::new(SMatrix::identity(), SMatrix::zeros(), [0.5, 0.5, 0.0]);
        let free_slip = SVector::from([0.9, -0.2, 0.3]);
        let problem = OneStepProblem { free_slip, free_normal: [1.0, 1.0, 1.0].into() };
        let search = Search { operator: &operator, problem: &problem, backtracks: true };
        let mut solution = ContactSolution::default();
        ExactSolver.solve(&operator, &problem, &mut solution);
        assert_eq!(search.polished(solution), solution);
        for off in [1e-6, 1.0, f64::NAN] {
            let closest = search.candidate(solution.pattern, solution.impulse.add_scalar(off));
            let polished = search.polished(closest);
            assert!(polished.residual <= PROMISED_RESIDUAL, "{off}: {polished:?}");
            assert!((polished.impulse - solution.impulse).amax() <= 1e-9, "{off}: {polished:?}");
        }
    }
}
