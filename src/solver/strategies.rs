//! Strategies from a start to a local optimum, and from one local optimum to a better one nearby.
//!
//! The latter is monotonic basin hopping (Leary 2000; basin hopping: Wales & Doye 1997): a perturbed copy of the local
//! optimum descends again, and the better of both is kept.

use std::ops::Range;

use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::candidate::{Candidate, Stationarity, keep_better};
use super::local_search::LocalSearch;
use super::run_control::Phase;
use super::search::is_distinct;
use super::settings::Method;
use super::starts::{Start, Strategy};
use crate::optimizer::{
    Ending, Interruption, Problem, Restoration, SequentialLinearSettings, criticality_measure, minimise_sequentially,
};
use crate::shooting::decision_from_schedule;

/// Slip smoothings between a start and the exact law, m/s: they remove the kinks where contacts change their modes. Under
/// the exact law alone the search stops at such kinks, with final times up to 20 % longer.
pub(super) const SMOOTHING: [f64; 3] = [0.1, 0.03, 0.01];
/// Fewer smoothings between a local optimum and the exact law.
const POLISH_SMOOTHING: [f64; 2] = [0.03, 0.01];
/// Most linear programs under one smoothing from a start: the next smoothing moves the optimum anyway, and more starts find
/// more than more iterations.
const SMOOTHED_ITERATION_LIMIT: usize = 15;
/// Most linear programs under one smoothing from a good local optimum.
const POLISH_ITERATION_LIMIT: usize = 40;
/// First trust radii under the exact law: which one leads to the best point depends on the kinks.
const FIRST_RADII: [f64; 2] = [0.5, 0.3];
/// First trust radius from a start, whose torques may be far from the optimum.
const START_RADIUS: f64 = 0.3;
/// First trust radius from the plan of a similar maneuver: small enough to stay near it.
const WARM_RADIUS: f64 = 0.05;
/// A descent that loses more than this share of that plan's final time has left its local optimum.
const WARM_LOSS: f64 = 0.05;
/// First trust radius of all later descents: large enough to leave a kink.
const RADIUS: f64 = 0.1;
/// Least predicted decrease of each step of a rough descent, as a share of the final time: below that the last third of the
/// rollouts would gain little.
const ROUGH_PREDICTION: f64 = 1e-5;
/// The perturbations of local optima, used in turn.
const PERTURBATIONS: [Perturbation; 4] = [
    Perturbation::Shift,
    Perturbation::Noise { share: 0.03, everywhere: true },
    Perturbation::Noise { share: 0.05, everywhere: false },
    Perturbation::Noise { share: 0.2, everywhere: false },
];
/// Factor of a perturbed copy's final time.
const PERTURBED_FINAL_TIME: f64 = 1.003;
const FINISH_LIMIT: usize = 5;
const FINISH_SHRINK_FACTOR: f64 = 0.1;
/// No further hops once so many rollouts were spent on one optimum: long descents, as under lunar gravity, would use up the
/// time limit.
const HOP_ROLLOUTS: u64 = 5000;
/// A hop that gains less than this share of the final time counts as idle.
const HOP_GAIN: f64 = 1e-4;
/// A plan that loses more than this share of its final time on another grid has left its local optimum.
const ADAPTION_LOSS: f64 = 5e-3;

/// What a round of the race does for one start.
#[derive(Debug, Clone, Copy)]
pub(super) enum Heat {
    /// Descends under these smoothed laws, m/s.
    Smooth(&'static [f64]),
    /// Descends under the exact law.
    Descend,
}

/// Idle hops in a row that end the hops of a round.
const IDLE_HOPS: usize = 12;
/// Hops of a direct start.
const FIRST_HOPS: usize = 3;

/// A perturbation of the torques.
enum Perturbation {
    /// The torques of both wheels between two intervals move one interval earlier or later: a descent cannot move a switch
    /// to the next interval where the final time first rises.
    Shift,
    /// All torques change, each by up to this share of its limit, or those of one stretch of each wheel do.
    Noise { share: f64, everywhere: bool },
}

impl LocalSearch<'_, '_, '_> {
    /// Searches from one start of several; the local optimum is also kept when it is the best so far.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn run_from(&mut self, start: &Start, number: (usize, usize)) -> Result<Candidate, Interruption> {
        let _phase = self.control.enter(Phase::Start { number: number.0 });
        self.start = number;
        self.aim(start.goal_heading, start.schedule.final_time);
        let guess = decision_from_schedule(&start.schedule);
        match self.settings.method {
            Method::SequentialLinear => match start.strategy {
                Strategy::Warm => self.warmly(&guess),
                Strategy::Direct => self.directly(&guess),
                Strategy::Smoothed => self.smoothly(&guess),
            },
            Method::NelderMead => self.nelder_mead(&guess),
        }
    }

    /// Moves a local optimum of another grid to this one; by longer strategies where the short one loses the goal or much
    /// time.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn adapt(&mut self, candidate: &Candidate) -> Result<Candidate, Interruption> {
        let _phase = self.control.enter(Phase::Refinement);
        self.aim(candidate.goal_heading, candidate.final_time());
        let tolerance = self.settings.goal_tolerance;
        let slowest = (1.0 + ADAPTION_LOSS) * candidate.final_time();
        let arrived = |best: &Candidate| best.is_feasible(tolerance) && best.final_time() <= slowest;
        let mut best = self.descend(&candidate.decision, self.penalty_parameters[0], RADIUS)?;
        if !arrived(&best) {
            let next = self.descend(&candidate.decision, self.penalty_parameters[1], START_RADIUS)?;
            keep_better(&mut best, next, tolerance);
        }
        if !arrived(&best) {
            let smoothed = self.around(&candidate.decision)?;
            let next = self.descend(&smoothed, self.penalty_parameters[0], RADIUS)?;
            keep_better(&mut best, next, tolerance);
        }
        if best.is_feasible(tolerance) {
            self.finish(&mut best)?;
        }
        Ok(best)
    }

    /// The first heat of a start: under smoothed laws, to a merit by which starts are compared.
    ///
    /// # Errors
    /// When the budget ended the search.
    pub(super) fn begin(
        &mut self,
        start: &Start,
        heat: Heat,
        number: (usize, usize),
    ) -> Result<Candidate, Interruption> {
        let guess = Candidate::new(decision_from_schedule(&start.schedule), f64::INFINITY, true, start.goal_heading);
        self.go_on(start, &guess, heat, number)
    }

    /// A further heat of a start, from where the last one ended.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn go_on(
        &mut self,
        start: &Start,
        from: &Candidate,
        heat: Heat,
        number: (usize, usize),
    ) -> Result<Candidate, Interruption> {
        let _phase = self.control.enter(Phase::Start { number: number.0 });
        self.start = number;
        self.aim(start.goal_heading, start.schedule.final_time);
        let (penalty_parameter, tolerance) = (self.penalty_parameters[0], self.settings.goal_tolerance);
        if let Heat::Smooth(smoothings) = heat {
            let radius = if from.smoothed_merit.is_none() { START_RADIUS } else { RADIUS };
            let limits = (radius, SMOOTHED_ITERATION_LIMIT);
            let (decision, merit) = self.through_smoothing(&from.decision, smoothings, penalty_parameter, limits)?;
            let candidate = Candidate::new(decision, f64::INFINITY, true, start.goal_heading);
            return Ok(Candidate { smoothed_merit: Some(merit), ..candidate });
        }
        let until = (ROUGH_PREDICTION * from.final_time(), f64::INFINITY);
        let mut best = self.descend_until(&from.decision, (penalty_parameter, RADIUS), until)?;
        if !best.is_feasible(tolerance) {
            let guess = decision_from_schedule(&start.schedule);
            keep_better(&mut best, self.smoothly_with_penalty(&guess, self.penalty_parameters[1])?, tolerance);
        }
        Ok(best)
    }

    /// Improves a local optimum: directly and through smoothing as long as that leads to another optimum, then by at most so
    /// many hops.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn polish(&mut self, candidate: Candidate, hops: usize, stream: u64) -> Result<Candidate, Interruption> {
        if self.settings.method == Method::NelderMead {
            return Ok(candidate);
        }
        let _phase = self.control.enter(Phase::Polish);
        self.aim(candidate.goal_heading, candidate.final_time());
        let tolerance = self.settings.goal_tolerance;
        let mut best = candidate;
        loop {
            let before = best.final_time();
            let [usual, large] = self.penalty_parameters;
            for (penalty_parameter, radius) in [(usual, START_RADIUS), (large, RADIUS)] {
                let next = self.descend(&best.decision, penalty_parameter, radius)?;
                keep_better(&mut best, next, tolerance);
            }
            let smoothed = self.around(&best.decision)?;
            let until = (SequentialLinearSettings::default().smallest_prediction, before);
            let next = self.descend_until(&smoothed, (usual, RADIUS), until)?;
            keep_better(&mut best, next, tolerance);
            if !is_distinct(best.final_time(), before) {
                break;
            }
        }
        self.hop(&mut best, hops, stream)?;
        self.finish(&mut best)?;
        Ok(best)
    }

    /// Under the exact law from several trust radii, then from perturbed copies of the best point; through smoothing where
    /// the exact law does not lead to the goal.
    fn directly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let tolerance = self.settings.goal_tolerance;
        let mut best = self.descend(guess, self.penalty_parameters[0], FIRST_RADII[0])?;
        for radius in &FIRST_RADII[1..] {
            let next = self.descend(guess, self.penalty_parameters[0], *radius)?;
            keep_better(&mut best, next, tolerance);
        }
        if !best.is_feasible(tolerance) {
            keep_better(&mut best, self.smoothly(guess)?, tolerance);
        }
        self.hop(&mut best, FIRST_HOPS, 0)?;
        self.finish(&mut best)?;
        Ok(best)
    }

    /// From a plan of a similar maneuver: one descent near it, another one with a larger trust region where that loses the
    /// goal or much time, and the direct strategy where neither meets the goal.
    fn warmly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let (tolerance, guessed) = (self.settings.goal_tolerance, guess[guess.len() - 1]);
        let until = (ROUGH_PREDICTION * guessed, f64::INFINITY);
        let mut warm = self.descend_until(guess, (self.penalty_parameters[0], WARM_RADIUS), until)?;
        if !warm.is_feasible(tolerance) || warm.final_time() > (1.0 + WARM_LOSS) * guessed {
            let next = self.descend_until(guess, (self.penalty_parameters[0], START_RADIUS), until)?;
            keep_better(&mut warm, next, tolerance);
        }
        if warm.is_feasible(tolerance) {
            self.finish(&mut warm)?;
            return Ok(warm);
        }
        self.directly(guess)
    }

    /// Basin hopping: descends again from slightly slower, perturbed copies of a local optimum. Local optima lie on kinks,
    /// and another one nearby is often better.
    fn hop(&mut self, best: &mut Candidate, hops: usize, stream: u64) -> Result<(), Interruption> {
        let tolerance = self.settings.goal_tolerance;
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.settings.seed.wrapping_add(stream));
        let mut idle_hops = 0;
        for perturbation in PERTURBATIONS.iter().cycle().take(hops) {
            let perturbed = self.perturbed(&best.decision, perturbation, &mut rng);
            let (was_feasible, before) = (best.is_feasible(tolerance), best.final_time());
            let penalty_parameter = if was_feasible { self.penalty_parameters[0] } else { self.penalty_parameters[1] };
            let time_to_beat = if was_feasible { before } else { f64::INFINITY };
            let until = (ROUGH_PREDICTION * before, time_to_beat);
            let next = self.descend_until(&perturbed, (penalty_parameter, RADIUS), until)?;
            keep_better(best, next, tolerance);
            let gained = best.is_feasible(tolerance) && !was_feasible || before - best.final_time() > HOP_GAIN * before;
            idle_hops = if gained { 0 } else { idle_hops + 1 };
            if idle_hops == IDLE_HOPS || self.budget.spent() > HOP_ROLLOUTS {
                break;
            }
        }
        Ok(())
    }

    fn perturbed(
        &self,
        decision: &DVector<f64>,
        perturbation: &Perturbation,
        rng: &mut Xoshiro256PlusPlus,
    ) -> DVector<f64> {
        let mut perturbed = decision.clone();
        let last = decision.len() - 1;
        perturbed[last] *= PERTURBED_FINAL_TIME;
        let (left, right) = perturbed.as_mut_slice()[..last].split_at_mut(last / 2);
        match *perturbation {
            Perturbation::Shift => {
                let (from, to) = (rng.random_range(0..left.len()), rng.random_range(0..left.len()));
                shift(left, from, to);
                shift(right, from, to);
            }
            Perturbation::Noise { share, everywhere } => {
                let scale = self.problem.variable_scale(decision) * share;
                let (left_scale, right_scale) = scale.as_slice()[..last].split_at(last / 2);
                for (torques, scale) in [(left, left_scale), (right, right_scale)] {
                    let count = torques.len();
                    let stretch = if everywhere { 0..count } else { random_stretch(count, rng) };
                    for index in stretch {
                        torques[index] += scale[index] * rng.random_range(-1.0..1.0);
                    }
                }
            }
        }
        perturbed
    }

    /// Continues from the point that the criticality measure found, while it finds a better one: the certificate would find
    /// it too.
    fn finish(&mut self, best: &mut Candidate) -> Result<(), Interruption> {
        let (penalty_parameter, tolerance) = (self.penalty_parameters[1], self.settings.goal_tolerance);
        let mut radius = RADIUS;
        for _ in 0..FINISH_LIMIT {
            let settings = Stationarity::settings(self.problem, (penalty_parameter, best.final_time()), tolerance);
            let mut measure = criticality_measure(self.problem, &best.decision, &settings, &mut self.budget)?;
            if let Some(interruption) = measure.interruption {
                return Err(interruption);
            }
            let Some(better) = measure.better.take() else {
                self.note_stationarity(best, Stationarity { penalty_parameter, measure });
                return Ok(());
            };
            let next = self.descend(&better, penalty_parameter, radius)?;
            if next.is_better_than(best, tolerance) {
                *best = next;
            } else {
                // Stay nearer to the confirmed point.
                radius *= FINISH_SHRINK_FACTOR;
            }
        }
        Ok(())
    }

    /// Through decreasing smoothing to the exact law; with the larger penalty parameter where that misses the goal.
    fn smoothly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let mut best = self.smoothly_with_penalty(guess, self.penalty_parameters[0])?;
        if !best.is_feasible(self.settings.goal_tolerance) {
            let next = self.smoothly_with_penalty(guess, self.penalty_parameters[1])?;
            keep_better(&mut best, next, self.settings.goal_tolerance);
        }
        Ok(best)
    }

    fn smoothly_with_penalty(
        &mut self,
        guess: &DVector<f64>,
        penalty_parameter: f64,
    ) -> Result<Candidate, Interruption> {
        let limits = (START_RADIUS, SMOOTHED_ITERATION_LIMIT);
        let (smoothed, _) = self.through_smoothing(guess, &SMOOTHING, penalty_parameter, limits)?;
        let smallest_prediction = ROUGH_PREDICTION * smoothed[smoothed.len() - 1];
        self.descend_until(&smoothed, (penalty_parameter, RADIUS), (smallest_prediction, f64::INFINITY))
    }

    /// From a local optimum back through the smoothed laws, to leave the kink on which it lies.
    fn around(&mut self, decision: &DVector<f64>) -> Result<DVector<f64>, Interruption> {
        let limits = (RADIUS, POLISH_ITERATION_LIMIT);
        let (smoothed, _) = self.through_smoothing(decision, &POLISH_SMOOTHING, self.penalty_parameters[0], limits)?;
        Ok(smoothed)
    }

    /// The decision and its merit under the last smoothed law.
    fn through_smoothing(
        &mut self,
        guess: &DVector<f64>,
        smoothings: &[f64],
        penalty_parameter: f64,
        (first_radius, iteration_limit): (f64, usize),
    ) -> Result<(DVector<f64>, f64), Interruption> {
        let mut decision = guess.clone();
        let mut merit = f64::INFINITY;
        let mut radius = first_radius;
        for &smoothing in smoothings {
            let settings = SequentialLinearSettings {
                penalty_parameter,
                first_radius: radius,
                iteration_limit,
                restoration: Restoration::Skip,
                smallest_prediction: ROUGH_PREDICTION * decision[decision.len() - 1],
                ..SequentialLinearSettings::default()
            };
            self.problem.set_slip_smoothing(smoothing);
            let result = minimise_sequentially(self.problem, &decision, &settings, &mut self.budget, &mut |_, _| {});
            self.problem.set_slip_smoothing(0.0);
            self.iterations += result.iterations;
            if let Ending::Interrupted(interruption) = result.ending {
                return Err(interruption);
            }
            decision = result.x;
            merit = decision[decision.len() - 1] + penalty_parameter * result.constraints.violation_sum();
            radius = RADIUS;
        }
        Ok((decision, merit))
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
