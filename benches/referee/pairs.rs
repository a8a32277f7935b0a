//! Both programs on one maneuver, seed by seed, in turn.

use anyhow::{Context as _, Result};
use serde::Serialize;

use crate::maneuvers::Maneuver;
use crate::program::{Program, Run};
use crate::statistics::mean;

/// Both answers to one maneuver with one seed.
#[derive(Debug, Serialize)]
pub(crate) struct Pair {
    pub(crate) seed: u64,
    pub(crate) candidate: Run,
    pub(crate) opponent: Run,
}

/// All answers to one maneuver.
#[derive(Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) maneuver: String,
    pub(crate) pairs: Vec<Pair>,
}

impl Pair {
    /// Whether both programs found a plan: only then do final times and effort compare.
    pub(crate) fn is_converged(&self) -> bool {
        self.candidate.is_converged() && self.opponent.is_converged()
    }
}

impl Row {
    /// Solves a maneuver with seeds from zero on. Which program comes first alternates, from maneuver to maneuver too: warmth and
    /// neighbours on the machine favour neither.
    ///
    /// # Errors
    /// A program that gives no answer.
    pub(crate) fn measured(maneuver: &Maneuver, place: usize, seeds: u64, programs: &[Program; 2]) -> Result<Self> {
        let [candidate, opponent] = programs;
        let run = |program: &Program, seed| {
            program.run(&maneuver.request, seed).with_context(|| format!("{} with seed {seed}", maneuver.name))
        };
        let mut pairs = Vec::new();
        for seed in 0..seeds {
            let is_candidate_first = (place as u64 + seed).is_multiple_of(2);
            let (candidate, opponent) = if is_candidate_first {
                let candidate = run(candidate, seed)?;
                (candidate, run(opponent, seed)?)
            } else {
                let opponent = run(opponent, seed)?;
                (run(candidate, seed)?, opponent)
            };
            pairs.push(Pair { seed, candidate, opponent });
        }
        Ok(Self { maneuver: maneuver.name.clone(), pairs })
    }

    /// Mean over the seeds of the logarithm of a figure's ratio, candidate over opponent; none without a pair of plans.
    pub(crate) fn log_ratio(&self, figure: impl Fn(&Run) -> f64) -> Option<f64> {
        let converged = self.pairs.iter().filter(|pair| pair.is_converged());
        let ratios: Vec<f64> = converged.map(|pair| (figure(&pair.candidate) / figure(&pair.opponent)).ln()).collect();
        (!ratios.is_empty()).then(|| mean(&ratios))
    }
}
