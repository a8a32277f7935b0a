//! The ways from a start to a local optimum, and from one local optimum to a better one nearby.

use std::ops::Range;

use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::Method;
use super::candidate::{Candidate, Stationarity, keep_better};
use super::local_search::LocalSearch;
use super::run_control::Phase;
use super::starts::{Start, Way};
use crate::optimizer::{
    Ending, Interruption, Problem, Restoration, SequentialLinearSettings, criticality_measure, minimise_sequentially,
};
use crate::shooting::decision_from_schedule;

/// Slip smoothing on the way from a start to the exact law, m/s: it carries the search over the kinks where contacts
/// change their modes, by which the exact law alone would stop it up to 20 % too slow.
const SMOOTHING: [f64; 3] = [0.1, 0.03, 0.01];
/// Shorter ways back to the exact law from a local optimum.
const POLISH_SMOOTHING: [f64; 2] = [0.03, 0.01];
/// Linear programs under one smoothing, on the way from a start: the next smoothing moves the optimum anyway, and more
/// starts find more than more iterations.
const SMOOTHED_ITERATION_LIMIT: usize = 15;
/// And around a good local optimum.
const POLISH_ITERATION_LIMIT: usize = 40;
/// First trust radii under the exact law: kinks decide which one gets furthest.
const FIRST_RADII: [f64; 2] = [0.5, 0.3];
/// Trust radius of a start, of which its torques may be far from the optimum.
const START_RADIUS: f64 = 0.3;
/// Trust radius of a plan of a similar maneuver: small enough to stay near it.
const WARM_RADIUS: f64 = 0.05;
/// A descent that loses more than this share of that plan's final time has left its local optimum.
const WARM_LOSS: f64 = 0.05;
/// Trust radius of all later descents: large enough to jump off a kink.
const RADIUS: f64 = 0.1;
/// Share of the final time that each step of a rough descent must promise: the last third of the rollouts gains less.
const ROUGH_PROMISE: f64 = 1e-5;
/// How local optima are disturbed, in turn.
const SHAKES: [Shake; 6] = [
    Shake::Shift,
    Shake::Noise { share: 0.03, everywhere: true },
    Shake::Noise { share: 0.05, everywhere: false },
    Shake::Noise { share: 0.2, everywhere: false },
    Shake::Noise { share: 0.5, everywhere: false },
    Shake::Noise { share: 1.0, everywhere: false },
];
/// A disturbed copy takes this much longer.
const SHAKEN_FINAL_TIME: f64 = 1.003;
const FINISH_LIMIT: usize = 5;
const FINISH_SHRINK_FACTOR: f64 = 0.1;
/// No more disturbed copies once so many rollouts went into one optimum: long descents, on the moon say, would take the
/// time limit.
const SHAKEN_ROLLOUTS: u64 = 5000;
/// Gains below this share of the final time count as nothing.
const SHAKEN_GAIN: f64 = 1e-4;
const POLISH_LIMIT: usize = 4;
/// A round of polishing that gains less than this share of the final time is the last one.
const POLISH_GAIN: f64 = 3e-6;
/// A plan that loses more than this share of its final time on another grid has left its local optimum.
const ADAPTION_LOSS: f64 = 5e-3;

/// When to stop disturbing a local optimum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patience {
    /// Most disturbed copies.
    copies: usize,
    /// Copies in a row that gain nothing.
    in_vain: usize,
    /// Added to the seed: what was tried in vain before is not tried again.
    stream: u64,
}

impl Patience {
    /// For one of many starts.
    const LEAST: Self = Self { copies: 3, in_vain: 3, stream: 0 };
    /// Each disturbance once or twice.
    pub(super) const SHORT: Self = Self { copies: 12, in_vain: 6, stream: 0 };
    /// As long as it pays.
    pub(super) const LONG: Self = Self { copies: 80, in_vain: 15, stream: 1 };
}

/// A disturbance of the torques.
enum Shake {
    /// What both wheels do between two intervals happens one interval earlier or later: a descent cannot move a switch on to
    /// the next interval where that costs before it pays.
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
            Method::SequentialLinear => match start.way {
                Way::Warm => self.warmly(&guess),
                Way::Direct => self.directly(&guess),
                Way::Smoothed => self.smoothly(&guess),
            },
            Method::NelderMead => self.nelder_mead(&guess),
        }
    }

    /// Moves a local optimum of another grid to this one; by longer ways where the near one loses the goal or much time.
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

    /// Improves a local optimum until a whole round of descents gains nothing more.
    ///
    /// # Errors
    /// When the budget ended the search; the best point so far is kept.
    pub(super) fn polish(&mut self, candidate: Candidate, patience: Patience) -> Result<Candidate, Interruption> {
        if self.settings.method == Method::NelderMead {
            return Ok(candidate);
        }
        let _phase = self.control.enter(Phase::Polish);
        self.aim(candidate.goal_heading, candidate.final_time());
        let tolerance = self.settings.goal_tolerance;
        let mut best = candidate;
        for _ in 0..POLISH_LIMIT {
            let before = best.final_time();
            for (penalty_parameter, radius) in
                [(self.penalty_parameters[0], START_RADIUS), (self.penalty_parameters[1], RADIUS)]
            {
                let next = self.descend(&best.decision, penalty_parameter, radius)?;
                keep_better(&mut best, next, tolerance);
            }
            let smoothed = self.around(&best.decision)?;
            let next = self.descend(&smoothed, self.penalty_parameters[0], RADIUS)?;
            keep_better(&mut best, next, tolerance);
            if before - best.final_time() < POLISH_GAIN * before {
                break;
            }
        }
        self.shake(&mut best, patience)?;
        self.finish(&mut best)?;
        Ok(best)
    }

    /// Under the exact law from several trust radii, then from shaken copies of the best point; through smoothing where
    /// the exact law leads nowhere.
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
        self.shake(&mut best, Patience::LEAST)?;
        self.finish(&mut best)?;
        Ok(best)
    }

    /// From a plan of a similar maneuver: one descent near it, another one with more room where that loses the goal or much
    /// time, and the direct way where neither meets the goal.
    fn warmly(&mut self, guess: &DVector<f64>) -> Result<Candidate, Interruption> {
        let (tolerance, guessed) = (self.settings.goal_tolerance, guess[guess.len() - 1]);
        let smallest_prediction = ROUGH_PROMISE * guessed;
        let mut warm = self.descend_until(guess, (self.penalty_parameters[0], WARM_RADIUS), smallest_prediction)?;
        if !warm.is_feasible(tolerance) || warm.final_time() > (1.0 + WARM_LOSS) * guessed {
            let next = self.descend_until(guess, (self.penalty_parameters[0], START_RADIUS), smallest_prediction)?;
            keep_better(&mut warm, next, tolerance);
        }
        if warm.is_feasible(tolerance) {
            self.finish(&mut warm)?;
            return Ok(warm);
        }
        self.directly(guess)
    }

    /// Descends again from slightly slower, disturbed copies of a local optimum: it sits on a kink, and another one
    /// nearby is often better.
    fn shake(&mut self, best: &mut Candidate, patience: Patience) -> Result<(), Interruption> {
        let tolerance = self.settings.goal_tolerance;
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(self.settings.seed.wrapping_add(patience.stream));
        let mut in_vain = 0;
        for shake in SHAKES.iter().cycle().take(patience.copies) {
            let shaken = self.shaken(&best.decision, shake, &mut rng);
            let (was_feasible, before) = (best.is_feasible(tolerance), best.final_time());
            let penalty_parameter = if was_feasible { self.penalty_parameters[0] } else { self.penalty_parameters[1] };
            let next = self.descend_until(&shaken, (penalty_parameter, RADIUS), ROUGH_PROMISE * before)?;
            keep_better(best, next, tolerance);
            let gained =
                best.is_feasible(tolerance) && !was_feasible || before - best.final_time() > SHAKEN_GAIN * before;
            in_vain = if gained { 0 } else { in_vain + 1 };
            if in_vain == patience.in_vain || self.budget.spent() > SHAKEN_ROLLOUTS {
                break;
            }
        }
        Ok(())
    }

    fn shaken(&self, decision: &DVector<f64>, shake: &Shake, rng: &mut Xoshiro256PlusPlus) -> DVector<f64> {
        let mut shaken = decision.clone();
        let last = decision.len() - 1;
        shaken[last] *= SHAKEN_FINAL_TIME;
        let (left, right) = shaken.as_mut_slice()[..last].split_at_mut(last / 2);
        match *shake {
            Shake::Shift => {
                let (from, to) = (rng.random_range(0..left.len()), rng.random_range(0..left.len()));
                shift(left, from, to);
                shift(right, from, to);
            }
            Shake::Noise { share, everywhere } => {
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
        shaken
    }

    /// Goes on from the very step that would refute the certificate of the plan, while there is one.
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
                // Nearer to the step that has been confirmed.
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
        let smoothed =
            self.through_smoothing(guess, &SMOOTHING, penalty_parameter, (START_RADIUS, SMOOTHED_ITERATION_LIMIT))?;
        let smallest_prediction = ROUGH_PROMISE * smoothed[smoothed.len() - 1];
        self.descend_until(&smoothed, (penalty_parameter, RADIUS), smallest_prediction)
    }

    /// Back into the smoothed laws from a local optimum, to get off the kink on which it sits.
    fn around(&mut self, decision: &DVector<f64>) -> Result<DVector<f64>, Interruption> {
        self.through_smoothing(
            decision,
            &POLISH_SMOOTHING,
            self.penalty_parameters[0],
            (RADIUS, POLISH_ITERATION_LIMIT),
        )
    }

    fn through_smoothing(
        &mut self,
        guess: &DVector<f64>,
        smoothings: &[f64],
        penalty_parameter: f64,
        (first_radius, iteration_limit): (f64, usize),
    ) -> Result<DVector<f64>, Interruption> {
        let mut decision = guess.clone();
        let mut radius = first_radius;
        for &smoothing in smoothings {
            let settings = SequentialLinearSettings {
                penalty_parameter,
                first_radius: radius,
                iteration_limit,
                restoration: Restoration::Skip,
                smallest_prediction: ROUGH_PROMISE * decision[decision.len() - 1],
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
            radius = RADIUS;
        }
        Ok(decision)
    }
}

fn random_stretch(count: usize, rng: &mut Xoshiro256PlusPlus) -> Range<usize> {
    let (one, other) = (rng.random_range(0..count), rng.random_range(0..count));
    one.min(other)..one.max(other) + 1
}

/// Drops the torque of one interval and repeats that of another; those in between move over.
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
