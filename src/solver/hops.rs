//! Monotonic basin hopping (Leary 2000; basin hopping: Wales & Doye 1997): a perturbed copy of a local optimum descends again, and
//! the better of both is kept.

use std::ops::Range;

use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::candidate::{CRITICALITY_TOLERANCE, Candidate, keep_better};
use super::local_search::{LocalSearch, SMALLEST_PREDICTION};
use crate::optimizer::{FIRST_RADIUS, Interruption, Problem};

/// A local optimum without rivals is left after so many hops in a row that gain nothing.
pub(super) const PATIENCE: usize = 6;

impl LocalSearch<'_> {
    /// Basin hopping: descends again from perturbed copies of a local optimum, until so many in a row gain nothing. Local optima lie
    /// on kinks, and another one nearby is often better.
    pub(super) fn hop(&mut self, best: &mut Candidate, patience: usize, stream: u64) -> Result<(), Interruption> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.settings.seed.wrapping_add(stream));
        let mut in_vain = 0;
        for perturb in [Self::shifted, Self::with_noise].into_iter().cycle() {
            if in_vain == patience {
                break;
            }
            let perturbed = perturb(self, &best.decision, &mut rng);
            let until = (SMALLEST_PREDICTION, best.time_to_beat());
            let next = self.descend_until(&perturbed, (FIRST_RADIUS, None), until)?;
            // Less than what `converged` allows is no gain.
            in_vain = if next.gains_on(best, CRITICALITY_TOLERANCE) { 0 } else { in_vain + 1 };
            keep_better(best, next);
        }
        Ok(())
    }

    /// The torques of both wheels between two intervals move one interval earlier or later: a descent cannot move a switch
    /// to the next interval where the final time first rises.
    fn shifted(&self, decision: &DVector<f64>, rng: &mut Xoshiro256PlusPlus) -> DVector<f64> {
        let (mut shifted, count) = (decision.clone(), self.problem.control_count());
        let (from, to) = (rng.random_range(0..count), rng.random_range(0..count));
        for torques in shifted.as_mut_slice()[..2 * count].chunks_exact_mut(count) {
            shift(torques, from, to);
        }
        shifted
    }

    /// The torques of one stretch of each wheel change at random.
    fn with_noise(&self, decision: &DVector<f64>, rng: &mut Xoshiro256PlusPlus) -> DVector<f64> {
        let (mut noisy, count) = (decision.clone(), self.problem.control_count());
        let scale = self.problem.variable_scale(decision);
        for first in [0, count] {
            for interval in random_stretch(count, rng) {
                noisy[first + interval] += FIRST_RADIUS * scale[first + interval] * rng.random_range(-1.0..1.0);
            }
        }
        noisy
    }
}

fn random_stretch(count: usize, rng: &mut Xoshiro256PlusPlus) -> Range<usize> {
    let (one, other) = (rng.random_range(0..count), rng.random_range(0..count));
    one.min(other)..one.max(other) + 1
}

/// Drops the torque of one interval and repeats that of another; those in between move by one interval.
fn shift(torques: &mut [f64], from: usize, to: usize) {
    if from < to {
        torques.copy_within(from + 1..=to, from);
    } else {
        torques.copy_within(to..from, to + 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_drops_one_torque_and_repeats_another() {
        let shifted = |from, to| {
            let mut torques = [1.0, 2.0, 3.0, 4.0];
            shift(&mut torques, from, to);
            torques
        };
        assert_eq!(shifted(0, 2), [2.0, 3.0, 3.0, 4.0]);
        assert_eq!(shifted(3, 1), [1.0, 2.0, 2.0, 3.0]);
        assert_eq!(shifted(1, 1), [1.0, 2.0, 3.0, 4.0]);
    }
}
