//! Independent parts of a search, run by any number of threads with the result of a single thread.
//!
//! A single thread runs the parts in order, and each part may spend the rollouts that the parts before it have left. With
//! several threads this share is not known in advance, so a part runs under an upper bound of it: the limit less what the
//! parts before it are known to have spent. Afterwards the parts are taken in order. The outcome of a part that ended by
//! itself within its true share is the single thread's; the first other part is run again with exactly its share, and the
//! outcomes of the parts after it are discarded.

use std::iter;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::candidate::{Candidate, keep_best};
use super::helpers::{CancelOnPanic, SharedWork};
use super::progress::BestProgress;
use super::run_control::RunControl;
use super::search::SearchResult;
use super::solution::StopReason;
use crate::optimizer::Interruption;

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

/// The parts of one search.
pub(super) struct Parts<'a> {
    progress: &'a BestProgress<'a>,
    rollout_limit: u64,
    run: &'a RunPart<'a>,
    state: Mutex<State>,
    /// Set when the outcomes of the running parts are no longer needed.
    is_cancelled: AtomicBool,
}

struct State {
    slots: Vec<Slot>,
    /// The best decision of the parts that were given back; used only when the search is stopped.
    given_back: Option<Candidate>,
}

enum Slot {
    Open,
    UnderWay,
    Done { outcome: Box<PartOutcome>, limit: u64 },
}

impl SearchResult {
    /// Adds the outcome of a part; gives its local optimum.
    fn add(&mut self, outcome: PartOutcome, goal_tolerance: f64) -> Option<Candidate> {
        self.iterations += outcome.iterations;
        self.rollouts += outcome.rollouts;
        keep_best(&mut self.best, outcome.best, goal_tolerance);
        outcome.local.map_err(|interruption| self.stop_reason = interruption.into()).ok()
    }
}

impl<'a> Parts<'a> {
    pub(super) fn new(progress: &'a BestProgress<'a>, rollout_limit: u64, count: usize, run: &'a RunPart<'a>) -> Self {
        let state = State { slots: (0..count).map(|_| Slot::Open).collect(), given_back: None };
        Self { progress, rollout_limit, run, state: Mutex::new(state), is_cancelled: AtomicBool::new(false) }
    }

    /// Runs all parts, with the helpers of the control, and adds them to what was found; the local optima with the numbers of their
    /// parts, in order.
    pub(super) fn run_into(self, found: &mut SearchResult) -> Vec<(usize, Candidate)> {
        let Self { progress, rollout_limit, run, .. } = self;
        let BestProgress { control, goal_tolerance, .. } = *progress;
        control.share(&self);
        let State { slots, given_back } = self.state.into_inner().unwrap_or_else(PoisonError::into_inner);
        let (before, mut locals) = (found.rollouts, Vec::new());
        let again = control.of_part(control.stop(), progress);
        let mut slots = slots.into_iter().enumerate();
        while let Some((index, slot)) = slots.next() {
            let share = rollout_limit - (found.rollouts - before);
            let outcome = match slot {
                Slot::Done { outcome, limit } if outcome.holds_under(share, limit) => *outcome,
                slot if control.is_stopped() => {
                    keep_best(&mut found.best, given_back, goal_tolerance);
                    for (index, slot) in iter::once((index, slot)).chain(slots) {
                        if let Slot::Done { outcome, .. } = slot {
                            locals.extend(found.add(*outcome, goal_tolerance).map(|local| (index, local)));
                        }
                    }
                    found.stop_reason = StopReason::Stopped;
                    break;
                }
                Slot::Open | Slot::UnderWay | Slot::Done { .. } => run(index, &again, share),
            };
            let Some(local) = found.add(outcome, goal_tolerance) else { break };
            locals.push((index, local));
        }
        locals
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_over(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed) || self.progress.control.is_stopped()
    }

    /// The first open part, and the most that it may spend.
    fn begin(&self) -> Option<(usize, u64)> {
        let mut state = self.state();
        let index = state.slots.iter().position(|slot| matches!(slot, Slot::Open))?;
        state.slots[index] = Slot::UnderWay;
        let known = state.slots[..index].iter().map(|slot| match slot {
            Slot::Done { outcome, .. } => outcome.rollouts,
            Slot::Open | Slot::UnderWay => 0,
        });
        Some((index, self.rollout_limit.saturating_sub(known.sum())))
    }

    fn end(&self, index: usize, limit: u64, outcome: PartOutcome) {
        let mut state = self.state();
        if matches!(outcome.local, Err(Interruption::Stopped)) && !self.progress.control.is_stopped() {
            state.slots[index] = Slot::Open;
            keep_best(&mut state.given_back, outcome.best, self.progress.goal_tolerance);
            return;
        }
        state.slots[index] = Slot::Done { outcome: Box::new(outcome), limit };
        if state.is_used_up(self.rollout_limit) {
            self.is_cancelled.store(true, Ordering::Relaxed);
        }
    }
}

impl State {
    /// Whether the finished parts before the first unfinished one have used up the rollout limit, so that the rest is not
    /// needed.
    fn is_used_up(&self, rollout_limit: u64) -> bool {
        let mut rollouts = 0;
        for slot in &self.slots {
            let Slot::Done { outcome, .. } = slot else { return false };
            rollouts += outcome.rollouts;
            if rollouts > rollout_limit || matches!(outcome.local, Err(Interruption::RolloutLimit)) {
                return true;
            }
        }
        false
    }
}

impl SharedWork for Parts<'_> {
    fn open_parts(&self) -> usize {
        if self.is_over() {
            return 0;
        }
        self.state().slots.iter().filter(|slot| matches!(slot, Slot::Open)).count()
    }

    fn take_part(&self, recalled: &AtomicBool) -> bool {
        if self.is_over() || recalled.load(Ordering::Relaxed) {
            return false;
        }
        let Some((index, limit)) = self.begin() else { return false };
        let alarm = CancelOnPanic::new(&self.is_cancelled);
        let control = self.progress.control;
        let control = control.of_part(control.stop().interrupted_by([&self.is_cancelled, recalled]), self.progress);
        let outcome = (self.run)(index, &control, limit);
        alarm.disarm();
        self.end(index, limit, outcome);
        true
    }
}
