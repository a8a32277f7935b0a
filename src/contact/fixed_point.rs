//! The paper's contact solver: block Gauss-Seidel sweeps of the prox map (27), one contact after the other, with normal
//! impulses by projection.
//!
//! Slow (tens to thousands of sweeps), simple and robust: the reference that the exact solver is checked against.

use nalgebra::{SVector, Vector3};

use super::delassus::DelassusOperator;
use super::directions::{AXLE, ROWS, contact_count};
use super::natural_map::{friction_radius, prox_argument, residual};
use super::one_step_problem::OneStepProblem;
use super::pattern::{ContactMode, ContactPattern, SlipSign, WheelPattern};
use super::prox::project_onto_disc;
use super::solution::{ContactImpulse, ContactSolution};
use crate::stop::Stop;

/// Largest change of any impulse in one sweep, relative to m g dt, at which the sweeps end: rounding.
const TOLERANCE: f64 = 1e-15;
/// A slip that shifts the argument of the prox map by less than this share of the friction radius is none: the sweeps leave sticking wheels
/// on the rim of their discs.
const NO_SLIP: f64 = 1e-12;

/// The prox iteration, warm-started from the last step's impulses.
#[derive(Debug, Clone)]
pub struct FixedPointSolver {
    sweep_limit: usize,
    impulse: [ContactImpulse; 3],
    sweeps: u64,
}

impl FixedPointSolver {
    /// A solver that starts from zero impulses, and takes so many sweeps of one step at most.
    pub fn new(sweep_limit: usize) -> Self {
        Self::starting_at([[0.0; 2]; 3], sweep_limit)
    }

    /// The same from these impulses.
    pub(super) fn starting_at(impulse: [ContactImpulse; 3], sweep_limit: usize) -> Self {
        Self { sweep_limit, impulse, sweeps: 0 }
    }

    /// Sweeps done so far.
    pub fn sweeps(&self) -> u64 {
        self.sweeps
    }

    /// Solves one step; once stopped, the answer is the iterate of the last sweep.
    #[inline]
    pub fn solve<const N: usize>(
        &mut self,
        operator: &DelassusOperator<N>,
        problem: &OneStepProblem<N>,
        stop: &Stop,
    ) -> ContactSolution<N> {
        let smallest_change = TOLERANCE * problem.weight_impulse();
        let mut left = self.sweep_limit;
        while left > 0 {
            let block = left.min(Stop::PERIOD);
            let has_converged = (0..block).any(|_| self.sweep(operator, problem) <= smallest_change);
            if has_converged || stop.is_set() {
                break;
            }
            left -= block;
        }
        self.solution(operator, problem)
    }

    /// Updates each contact once; returns the largest change of an impulse component, N s.
    #[inline]
    fn sweep<const N: usize>(&mut self, operator: &DelassusOperator<N>, problem: &OneStepProblem<N>) -> f64 {
        self.sweeps += 1;
        let mut total = sum_by_direction::<N>(&self.impulse);
        let mut largest_change = 0.0_f64;
        for contact in 0..contact_count::<N>() {
            let normal = operator.normal_impulse(problem, &total);
            let slip = operator.impact_slip(problem, &total);
            let old = self.impulse[contact];
            let point = prox_argument(operator, contact, old, &slip);
            let new = project_onto_disc(point, friction_radius(operator, contact, &normal));
            for axis in 0..2 {
                let change = new[axis] - old[axis];
                total[ROWS[contact][axis]] += change;
                largest_change = largest_change.max(change.abs());
            }
            self.impulse[contact] = new;
        }
        largest_change
    }

    /// The current iterate as a solution; its pattern is the branch of each contact's prox map (inside the disc, or on its rim: stick).
    #[inline]
    fn solution<const N: usize>(
        &self,
        operator: &DelassusOperator<N>,
        problem: &OneStepProblem<N>,
    ) -> ContactSolution<N> {
        let impulse = sum_by_direction::<N>(&self.impulse);
        let impact_slip = operator.impact_slip(problem, &impulse);
        let normal_impulse = operator.normal_impulse(problem, &impulse);
        let pattern = self.pattern(operator, &impact_slip, &normal_impulse);
        let residual = residual(operator, problem, &self.impulse, &impact_slip, &normal_impulse);
        ContactSolution { impulse, impact_slip, normal_impulse, pattern, residual }
    }

    fn pattern<const N: usize>(
        &self,
        operator: &DelassusOperator<N>,
        impact_slip: &SVector<f64, N>,
        normal_impulse: &Vector3<f64>,
    ) -> ContactPattern {
        let sticks = |contact: usize| {
            let [a, b] = prox_argument(operator, contact, self.impulse[contact], impact_slip);
            let radius = friction_radius(operator, contact, normal_impulse);
            radius > 0.0 && a.hypot(b) <= radius * (1.0 + NO_SLIP)
        };
        let sign = |wheel: usize| SlipSign::of(impact_slip[wheel], normal_impulse[wheel]);
        let wheels = WheelPattern::of_sticking([sticks(0), sticks(1)], sign);
        let front_sticks = contact_count::<N>() == 3 && sticks(2);
        ContactPattern { wheels, front: if front_sticks { ContactMode::Stick } else { ContactMode::Slip } }
    }
}

#[inline]
fn sum_by_direction<const N: usize>(impulse: &[ContactImpulse; 3]) -> SVector<f64, N> {
    let mut total = SVector::zeros();
    total[0] = impulse[0][0];
    total[1] = impulse[1][0];
    total[AXLE] = impulse[0][1] + impulse[1][1];
    if N == 5 {
        total[ROWS[2][0]] = impulse[2][0];
        total[ROWS[2][1]] = impulse[2][1];
    }
    total
}
