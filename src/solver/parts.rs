//! Independent parts of a search, run by any number of threads with the result of a single thread.
//!
//! A single thread runs the parts in order, and each part may spend the rollouts that the parts before it have left. With
//! several threads this share is not known in advance, so a part runs under an upper bound of it: the limit less what the
//! parts before it are known to have spent. Afterwards the parts are taken in order. The outcome of a part that ended by
//! itself within its true share is the single thread's; the first other part is run again with exactly its share, and the
//! outcomes of the parts after it are discarded.

use std::iter;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use super::candidate::{Candidate, keep_best};
use super::helpers::in_parts;
use super::progress::BestProgress;
use super::run_control::RunControl;
use super::search::SearchResult;
use super::solution::StopReason;
use crate::optimizer::Interruption;
use crate::stop::Stop;

/// The outcome of one part.
#[derive(Debug)]
pub(super) struct PartOutcome {
    /// Its local optimum, or why there is none.
    pub(super) local: Result<Candidate, Interruption>,
    /// The best decision that it met.
    pub(super) best: Option<Candidate>,
    pub(super) iterations: u64,
    pub(super) rollouts: u64,
}

impl PartOutcome {
    /// Whether a part with this outcome under `limit` has the same one under `share`, which is at most as large.
    fn holds_under(&self, share: u64, limit: u64) -> bool {
        match self.local {
            Ok(_) => self.rollouts <= share,
            Err(Interruption::RolloutLimit) => limit == share,
            Err(Interruption::Stopped) => false,
        }
    }
}

/// Runs the part with this number under a control and a rollout limit.
pub(super) type RunPart<'a> = dyn Fn(usize, &RunControl, u64) -> PartOutcome + Sync + 'a;

impl SearchResult {
    /// Runs so many parts within so many rollouts, with the helpers of the control, and adds what they found; their local optima with their
    /// numbers, in order.
    pub(super) fn add_parts(
        &mut self,
        (count, rollout_limit): (usize, u64),
        progress: &BestProgress,
        run: &RunPart,
    ) -> Vec<(usize, Candidate)> {
        let control = progress.control;
        let given_back = Mutex::new(None);
        let tried = tried_parts((count, rollout_limit), progress, &given_back, run);
        let (again, mut locals, mut share) = (control.of_part(control.stop(), progress), Vec::new(), rollout_limit);
        let mut tried = (0..).zip(tried);
        while let Some((index, part)) = tried.next() {
            let outcome = match part {
                Some((outcome, limit)) if outcome.holds_under(share, limit) => outcome,
                part if control.is_stopped() => {
                    // All that there is counts, whatever the shares.
                    let given_back = given_back.into_inner().unwrap_or_else(PoisonError::into_inner);
                    keep_best(&mut self.best, given_back);
                    for (index, part) in iter::once((index, part)).chain(tried) {
                        let local = part.and_then(|(outcome, _)| self.add(outcome));
                        locals.extend(local.map(|local| (index, local)));
                    }
                    self.stop_reason = StopReason::Stopped;
                    break;
                }
                Some(_) | None => run(index, &again, share),
            };
            share -= outcome.rollouts;
            let Some(local) = self.add(outcome) else { break };
            locals.push((index, local));
        }
        locals
    }

    /// Adds the outcome of a part; gives its local optimum.
    fn add(&mut self, outcome: PartOutcome) -> Option<Candidate> {
        self.iterations += outcome.iterations;
        self.rollouts += outcome.rollouts;
        keep_best(&mut self.best, outcome.best);
        outcome.local.map_err(|interruption| self.stop_reason = interruption.into()).ok()
    }
}

/// Runs the parts in any order, each within what is known then to be left of the rollouts, which comes with its outcome; `given_back` has
/// the best decision of those that ended since their helper was recalled.
fn tried_parts(
    (count, rollout_limit): (usize, u64),
    progress: &BestProgress,
    given_back: &Mutex<Option<Candidate>>,
    run: &RunPart,
) -> Vec<Option<(PartOutcome, u64)>> {
    let control = progress.control;
    // Of the parts that have ended.
    let spent: Vec<_> = (0..count).map(|_| AtomicU64::new(0)).collect();
    in_parts(control, count, &|index: usize, stop: Stop| {
        let known: u64 = spent[..index].iter().map(|spent| spent.load(Ordering::Relaxed)).sum();
        let limit = rollout_limit.saturating_sub(known);
        let outcome = run(index, &control.of_part(stop, progress), limit);
        if matches!(outcome.local, Err(Interruption::Stopped)) && !control.is_stopped() {
            let mut given_back = given_back.lock().unwrap_or_else(PoisonError::into_inner);
            keep_best(&mut given_back, outcome.best);
            return None;
        }
        spent[index].store(outcome.rollouts, Ordering::Relaxed);
        Some((outcome, limit))
    })
}
